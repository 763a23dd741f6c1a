//! The tasks of a usual course, here and as programs for Pybricks 2.0, which runs under ev3dev: how
//! many lines each takes.
//!
//! A Pybricks program does what the mission does: it looks at its time, and does not push on where
//! its wheels are blocked. What is used of a library counts on neither side: not `DriveBase`, not
//! the sub-machines that come with the program.

use onbrick::behavior::shipped::find;

/// Each task, its mission, and its program.
const TASKS: [(&str, &str, &str); 4] = [
    ("follow a line", "line", include_str!("../../data/pybricks/line.py")),
    ("to a place", "visit", include_str!("../../data/pybricks/visit.py")),
    ("count colours", "count-colours", include_str!("../../data/pybricks/count_colours.py")),
    ("there and back", "there-and-back", include_str!("../../data/pybricks/there_and_back.py")),
];

const PAGE: &str = include_str!("../../../src/behavior/missions.md");

/// The lines that are neither empty nor a comment.
fn lines(text: &str) -> usize {
    let lines = text.lines().map(str::trim);
    lines.filter(|line| !line.is_empty() && !line.starts_with('#')).count()
}

/// A mission of the reference page.
fn example(name: &str) -> Option<String> {
    let begins = format!("name = \"{name}\"\n");
    let mut examples = PAGE.split("```toml\n").filter(|example| example.starts_with(&begins));
    examples.next()?.split("```").next().map(str::to_owned)
}

#[test]
fn course_tasks_take_at_most_half_the_lines_of_pybricks() {
    for (task, mission, program) in TASKS {
        let text = example(mission).or_else(|| Some(find(mission)?.text.to_owned()));
        let text = text.unwrap_or_else(|| panic!("no mission `{mission}`"));
        for line in text.lines().chain(program.lines()) {
            assert!(line.chars().count() <= 100, "{mission}: {line}");
        }
        let (ours, theirs) = (lines(&text), lines(program));
        println!("{task}: {ours} lines, {theirs} for Pybricks");
        assert!(2 * ours <= theirs, "{task}: {ours} lines, {theirs} for Pybricks");
        let row = format!("| {task} | {ours} | {theirs} |\n");
        assert!(PAGE.contains(&row), "the page's table should have {row}");
    }
}
