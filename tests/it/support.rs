//! What several test modules need.

use std::path::PathBuf;

/// The folder with recordings and references; `None` where this machine has none.
pub(crate) fn shared() -> Option<PathBuf> {
    let beside = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared"));
    let named = std::env::var_os("ONBRICK_SHARED").map(PathBuf::from);
    [Some(beside), named].into_iter().flatten().find(|folder| folder.join("data").is_dir())
}

/// Says that a test could not run here; fails it where `ONBRICK_REQUIRE=1` asks for all of them.
pub(crate) fn pass_over(what: &str) {
    assert!(std::env::var("ONBRICK_REQUIRE").as_deref() != Ok("1"), "this machine lacks {what}");
    println!("passed over: {what}");
}
