//! What the tests share.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;
use std::sync::atomic::{AtomicU32, Ordering};

pub mod allocations;
pub mod brick;
pub mod browser;
pub mod chance;
pub mod devtools;
pub mod exported;
pub mod faulty;
pub mod memory;
pub mod memory_group;
pub mod network;
pub mod passed_over;
pub mod promised;
pub mod real_time;
pub mod stage;
pub mod turning_brick;
pub mod turns;
pub mod wall_clock;

pub use passed_over::{not_asked_for, pass_over};

/// The folder of recordings beside the repository, or where `ONBRICK_SHARED` says; `None` where
/// there is neither.
pub fn shared() -> Option<PathBuf> {
    let beside = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared")).to_owned();
    let named = std::env::var_os("ONBRICK_SHARED").map(PathBuf::from);
    [Some(beside), named].into_iter().flatten().find(|folder| folder.join("data").is_dir())
}

/// The program under test: this build's, or the one that `ONBRICK_PROGRAM` names, such as what was
/// installed from the packaged crate.
pub fn tested_program() -> &'static str {
    static PROGRAM: LazyLock<String> = LazyLock::new(|| {
        std::env::var("ONBRICK_PROGRAM")
            .unwrap_or_else(|_| env!("CARGO_BIN_EXE_onbrick").to_owned())
    });
    &PROGRAM
}

/// A user without rights, and its group: the kernel's overflow number.
pub const OTHER_USER: u32 = 65_534;

/// A copy of the program under test in a folder, for a user who has no access to where it was
/// built. `cp` makes it: a program that this process has open for writing can't be started as long
/// as another test's child, forked meanwhile, has inherited it ("Text file busy").
pub fn copy_of_program(folder: &Path) -> PathBuf {
    let program = folder.join("onbrick");
    let copied = Command::new("cp").arg(tested_program()).arg(&program).status().unwrap();
    assert!(copied.success(), "cp: {copied}");
    program
}

/// A loopback address that no other service of these tests listens at; one at `*` would have the
/// port of all of them.
pub fn own_address() -> String {
    static NUMBER: AtomicU32 = AtomicU32::new(1);
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let process = std::process::id();
    format!("127.{}.{}.{}", 100 + number % 100, process >> 8 & 255, process & 255)
}

/// Whether the long forms of tests are asked for: more of the same.
pub fn is_long() -> bool {
    std::env::var_os("ONBRICK_LONG").is_some_and(|long| long == "1")
}

/// The seeds of a simulated world: `1..=count` in the long form, else a third of them; the first
/// alone where this is not a PC's processor but the brick's, which QEMU emulates: it has no floats
/// but in software, and each seed takes a hundred times as long.
pub fn seeds(count: u64) -> RangeInclusive<u64> {
    1..=if cfg!(target_arch = "arm") {
        1
    } else if is_long() {
        count
    } else {
        count.div_ceil(3)
    }
}
