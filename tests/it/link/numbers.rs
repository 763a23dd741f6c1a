//! What stands in for the C library's look-up of names in a static file (`src/link/libzmq/netdb.h`).

use std::path::Path;
use std::process::Command;

#[test]
fn a_static_file_takes_every_number_that_the_c_library_takes_and_gives_it_back_alike() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("numbers");
    // The feature `link` wants this compiler anyway.
    let compiler = std::env::var_os("CXX").unwrap_or_else(|| "c++".into());
    let mut compile = Command::new(compiler);
    compile.args(["-Wall", "-Wextra", "-Werror", "-I"]).arg(here.join("src/link/libzmq"));
    compile.arg(here.join("tests/it/link/numbers.cpp")).arg("-o").arg(&program);
    assert!(compile.status().unwrap().success());
    let ran = Command::new(program).output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stdout));
}
