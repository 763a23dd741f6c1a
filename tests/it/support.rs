//! What tests share: where recordings of others lie, and how to pass over what a machine lacks.

use std::path::PathBuf;

/// The folder of shared recordings, if this machine has it.
#[allow(dead_code, reason = "for tests that use recordings of others")]
pub(crate) fn shared() -> Option<PathBuf> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared"));
    std::env::var_os("ONBRICK_SHARED")
        .map(PathBuf::from)
        .into_iter()
        .chain([beside])
        .find(|folder| folder.join("data").is_dir())
}

/// Says what is not tested here; under `ONBRICK_REQUIRE=1` that is failing.
pub(crate) fn pass_over(what: &str) {
    assert!(
        std::env::var_os("ONBRICK_REQUIRE").is_none_or(|value| value != "1"),
        "required, not there: {what}"
    );
    println!("passed over: {what}");
}
