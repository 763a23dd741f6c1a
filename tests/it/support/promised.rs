//! Figures for the table of promises (`promises::table`).

/// What stands before a test's figures in its output.
pub const MARK: &str = "promised: ";

/// Prints what a test of a promise counted or measured. The test's own name says which promise:
/// `promise_7_…`.
pub fn promised(figures: &str) {
    println!("{MARK}{figures}");
}
