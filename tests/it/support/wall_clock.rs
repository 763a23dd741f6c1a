//! Another wall clock for one program, that jumps when the test says so.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::pass_over;

/// What lets a program see another wall clock: `@12` stands at 12 s after 1970, `+5` and `-5` are
/// seconds away from the true one. Monotonic time stays.
const SHIM: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = dlsym(RTLD_NEXT, "clock_gettime");
    int answer = real(clock, now);
    char text[32] = {0};
    int file = clock == CLOCK_REALTIME ? open(getenv("WALL_CLOCK"), O_RDONLY | O_CLOEXEC) : -1;
    if (file >= 0 && read(file, text, 31) > 1)
        now->tv_sec = text[0] == '@' ? atoll(text + 1) : now->tv_sec + atoll(text);
    if (file >= 0) close(file);
    return answer;
}
"#;

/// The shim, built; `None` where there is no C compiler.
pub fn shim(folder: &Path) -> Option<PathBuf> {
    let (source, library) = (folder.join("shim.c"), folder.join("shim.so"));
    std::fs::write(&source, SHIM).unwrap();
    let built = Command::new("cc")
        .args(["-shared", "-fPIC", "-O1", "-o"])
        .arg(&library)
        .arg(&source)
        .arg("-ldl")
        .status();
    if !built.is_ok_and(|status| status.success()) {
        pass_over("a C compiler");
        return None;
    }
    Some(library)
}

/// Writes what the clock shows from now on, in one step, so that no reader sees half of it.
pub fn replace(path: &Path, text: &str) {
    let fresh = path.with_extension("new");
    std::fs::write(&fresh, text).unwrap();
    std::fs::rename(&fresh, path).unwrap();
}
