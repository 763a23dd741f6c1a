//! Figures for the table of promises (`promises::table`).

/// What stands before a test's figures in its output.
pub const MARK: &str = "promised: ";

/// Prints what a test of a promise counted or measured. The test's own name says which promise:
/// `promise_7_…`.
pub fn promised(figures: &str) {
    println!("{MARK}{figures}");
}

/// True where the long forms of tests are asked for: `ONBRICK_LONG=1`.
pub fn long() -> bool {
    std::env::var_os("ONBRICK_LONG").is_some_and(|value| value == "1")
}
