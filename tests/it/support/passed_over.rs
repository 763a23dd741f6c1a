//! What tests pass over, said where it is seen: on the real standard error, and counted in one line
//! at the end.
//!
//! The harness captures what a test prints and shows it only when the test fails, so a test that
//! was passed over looks like one that held.

#![allow(
    unsafe_code,
    reason = "only the C library runs something at this program's end, whatever ends it"
)]

use std::collections::BTreeSet;
use std::io::{Write as _, stderr};
use std::sync::{Mutex, Once, PoisonError};

use nix::libc;

static TESTS: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// Says what the running test passes over because this machine lacks it; under `ONBRICK_REQUIRE=1`
/// that is a failure.
pub fn pass_over(what: &str) {
    assert!(
        std::env::var_os("ONBRICK_REQUIRE").is_none_or(|value| value != "1"),
        "required, and lacking: {what}"
    );
    say(&format!("lacking: {what}"));
}

/// True, and said, unless this environment variable asks for the running test, or part of it, with
/// `1`.
pub fn not_asked_for(variable: &str) -> bool {
    let asked = std::env::var_os(variable).is_some_and(|value| value == "1");
    if !asked {
        say(&format!("not asked for: {variable}=1"));
    }
    !asked
}

fn say(why: &str) {
    static AT_THE_END: Once = Once::new();
    // SAFETY: `count` is a function of the whole program, and takes and returns nothing.
    AT_THE_END.call_once(|| _ = unsafe { libc::atexit(count) });
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a thread of a test");
    // `eprintln!` would be captured.
    let _ = writeln!(stderr(), "passed over: {test}: {why}");
    TESTS.lock().unwrap_or_else(PoisonError::into_inner).insert(test.to_owned());
}

extern "C" fn count() {
    let tests = TESTS.lock().unwrap_or_else(PoisonError::into_inner).len();
    let _ = writeln!(stderr(), "passed over, whole or in part: {tests} of the tests above");
}

/// The tests of this program itself, in a program of its own that has no FUSE.
#[test]
fn what_is_passed_over_is_said_beside_the_harness_and_counted_at_the_end() {
    let output = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "support::passed_over::passes_itself_over"])
        .env_remove("ONBRICK_REQUIRE")
        .env("ONBRICK_PASSES_ITSELF_OVER", "1")
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(
        lines,
        [
            "passed over: support::passed_over::passes_itself_over: lacking: a moon",
            "passed over: support::passed_over::passes_itself_over: not asked for: ONBRICK_MOON=1",
            "passed over, whole or in part: 1 of the tests above",
        ]
    );
}

#[test]
fn passes_itself_over() {
    if std::env::var_os("ONBRICK_PASSES_ITSELF_OVER").is_some() {
        pass_over("a moon");
        assert!(not_asked_for("ONBRICK_MOON"));
    }
}
