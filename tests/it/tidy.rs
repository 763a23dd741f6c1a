//! What the design says about the source as a whole, held against its text: layers, absences, and
//! the house's order.

use std::path::{Path, PathBuf};

/// The layers from top to bottom; `use` points downwards only. Modules at the crate's root that are
/// in none of them are a finding.
const LAYERS: [&str; 23] = [
    "cli",
    "menu",
    "report",
    "link",
    "service",
    "protocol",
    "commissioning",
    "simulated",
    "runtime",
    "recording",
    "robot",
    "behavior",
    "planning",
    "mapping",
    "sim",
    "page",
    "senses",
    "ev3dev",
    "clock",
    "units",
    "document",
    "printable",
    "threads",
];

/// One file of the source.
struct Source {
    /// Relative to `src`, such as `robot/lease.rs`.
    path: String,
    text: String,
}

impl Source {
    /// The layer that the file belongs to: its first folder, or its own name.
    fn layer(&self) -> &str {
        self.path.split(['/', '.']).next().unwrap()
    }

    /// The lines that the program is made of, with their numbers: no comments, no tests.
    fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let numbered = self.text.lines().enumerate().map(|(at, line)| (at + 1, line));
        let without_tests = numbered.take_while(|(_, line)| !begins_tests(line));
        without_tests.filter(|(_, line)| !line.trim_start().starts_with("//"))
    }

    /// Lines with one of these in them, as `path:line: text`.
    fn with(&self, words: &[&str]) -> Vec<String> {
        let found = self.code().filter(|(_, line)| words.iter().any(|word| line.contains(word)));
        found.map(|(at, line)| format!("src/{}:{at}: {}", self.path, line.trim())).collect()
    }
}

fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let path = entry.path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}

fn sources_below(folder: &str) -> Vec<Source> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let source = |path: PathBuf| Source {
        path: path.strip_prefix(&folder).unwrap().to_str().unwrap().to_owned(),
        text: std::fs::read_to_string(&path).unwrap(),
    };
    rust_files(&folder).into_iter().map(source).collect()
}

/// The program's own; the build script, which talks to Cargo by printing, is none of it.
fn sources() -> Vec<Source> {
    sources_below("src").into_iter().filter(|source| source.path != "build.rs").collect()
}

/// From here on a file has only its tests: `#[cfg(test)]`, or with a feature beside it.
fn begins_tests(line: &str) -> bool {
    line.starts_with("#[cfg(test") || line.starts_with("#[cfg(all(test")
}

/// A file that only holds the tests of the one beside it.
fn is_tests(source: &Source) -> bool {
    source.path.ends_with("/tests.rs")
}

#[track_caller]
fn none(what: &str, found: &[String]) {
    assert!(found.is_empty(), "{what}:\n{}", found.join("\n"));
}

#[test]
fn use_points_downwards_only() {
    let place = |layer: &str| LAYERS.iter().position(|known| *known == layer);
    let mut found = Vec::new();
    for source in
        sources().iter().filter(|source| !["lib.rs", "main.rs"].contains(&source.path.as_str()))
    {
        let Some(own) = place(source.layer()) else {
            found.push(format!("src/{} is in no layer", source.path));
            continue;
        };
        for (at, line) in source.code() {
            for used in line.split("crate::").skip(1) {
                let used: String = used
                    .chars()
                    .take_while(|letter| letter.is_alphanumeric() || *letter == '_')
                    .collect();
                // `$crate::` of a macro and a path without a layer (`crate::{…}`) are looked at in
                // the next lines' names.
                if place(&used).is_some_and(|used| used < own) {
                    found.push(format!("src/{}:{at}: {} uses {used}", source.path, source.layer()));
                }
            }
        }
    }
    none("upward uses", &found);
}

#[test]
fn modules_are_used_by_name_so_that_layers_can_be_seen() {
    let found: Vec<String> = sources()
        .iter()
        .filter(|source| !is_tests(source))
        .flat_map(|source| source.with(&["use crate::{", "use crate::*", "use super::*"]))
        .collect();
    none("uses that hide which layer they are of", &found);
}

#[test]
fn only_clock_reads_a_clock_or_sleeps() {
    let words = [
        "Instant::",
        "SystemTime",
        "thread::sleep",
        "clock_gettime",
        "ClockId",
        "nanosleep",
        "UNIX_EPOCH",
    ];
    let found: Vec<String> = sources()
        .iter()
        .filter(|source| source.layer() != "clock")
        .flat_map(|source| source.with(&words))
        .collect();
    none("clocks and sleeps outside src/clock.rs", &found);
}

const FILES: [&str; 3] = ["std::fs", "std::net", "read_to_string("];

#[test]
fn behavior_and_mapping_do_no_io_and_know_no_clock() {
    let words = [
        &FILES[..],
        &[
            "std::io",
            "std::env",
            "std::process",
            "MonotonicClock",
            "Clock;",
            "now_ns()",
            "std::thread",
        ],
    ]
    .concat();
    let found: Vec<String> = sources()
        .iter()
        .filter(|source| ["behavior", "planning", "mapping"].contains(&source.layer()))
        .flat_map(|source| source.with(&words))
        .collect();
    none("I/O in what should be pure", &found);
}

#[test]
fn only_ev3dev_touches_device_files() {
    // Who else opens files, and why.
    let others = [
        ("cli/", "files that people name on the command line"),
        ("runtime/lock.rs", "the lock that names the hardware's owner"),
        ("runtime/stop_request.rs", "the lock by which a stop is asked for"),
        ("runtime/open_files.rs", "which process has a file open, in /proc"),
        ("runtime/groups.rs", "/etc/group, which a static file reads itself"),
        ("commissioning/doctor/machine.rs", "whether a recording could be written; missions"),
        ("recording/", "run.mcap"),
        ("document/", "files that people write, and robot.toml as setup and calibrate write it"),
        ("service/", "runs, missions, the configuration, the local socket"),
        ("page.rs", "live pages, on this machine's own address"),
        ("link/", "the network, its keys, and the recordings that come home over it"),
        ("sim/mount/", "the mount point, the machine's table of mounts, the signals of who waits"),
    ];
    let may = |source: &Source| {
        source.layer() == "ev3dev" || others.iter().any(|(path, _)| source.path.starts_with(path))
    };
    let files: Vec<String> = sources()
        .iter()
        .filter(|source| !may(source))
        .flat_map(|source| source.with(&FILES))
        .collect();
    none("files opened where none should be", &files);
    // The simulated brick says the same names from the driver's side; the command looks whether
    // there is a brick at all.
    let names: Vec<String> = sources()
        .iter()
        .filter(|source| !["ev3dev", "sim", "cli"].contains(&source.layer()))
        .flat_map(|source| source.with(&["sys/class", "/dev/"]))
        .collect();
    none("device files named outside ev3dev", &names);
    for (path, why) in others {
        assert!(
            sources().iter().any(|source| source.path.starts_with(path)),
            "nothing is at {path} any more ({why})"
        );
    }
}

#[test]
fn only_cli_prints_and_only_it_and_the_processes_of_a_run_know_the_streams() {
    let prints = ["println!", "eprintln!", "print!(", "dbg!"];
    let streams = ["io::stdout", "io::stderr", "stdout()", "stderr()"];
    let mut found = Vec::new();
    for source in sources() {
        found.extend(source.with(&prints));
        // Guard and control talk to their starters over them.
        if source.layer() != "cli" && !source.path.starts_with("runtime/process/") {
            found.extend(source.with(&streams));
        }
    }
    none("prints", &found);
}

#[test]
fn what_is_on_the_ticks_path_knows_neither_report_nor_link_nor_cli() {
    let found: Vec<String> = sources()
        .iter()
        .filter(|source| LAYERS.iter().position(|layer| *layer == source.layer()) >= Some(5))
        .flat_map(|source| {
            source.with(&[
                "crate::report",
                "crate::link",
                "crate::cli",
                "zmq",
                "plotters",
                "indicatif",
                "clap::",
            ])
        })
        .collect();
    none("upper layers on the tick's path", &found);
}

#[test]
fn every_file_opens_with_what_it_is() {
    let mut found = Vec::new();
    for folder in ["src", "tests"] {
        for source in sources_below(folder) {
            let first = source.text.lines().next().unwrap_or_default();
            if !first.starts_with("//! ") || first.len() < 12 {
                found.push(format!("{folder}/{}: {first}", source.path));
            }
        }
    }
    none("files that do not say what they are", &found);
}

#[test]
fn files_are_short_enough_to_be_read() {
    /// Lines without tests; the house's measure.
    const LONGEST: usize = 500;
    let length =
        |source: &Source| source.text.lines().take_while(|line| !begins_tests(line)).count();
    let sources = sources();
    let found: Vec<String> = sources
        .iter()
        .filter(|source| !is_tests(source) && length(source) > LONGEST)
        .map(|source| format!("src/{}: {} lines", source.path, length(source)))
        .collect();
    none("long files", &found);
}

/// What people write here by hand: sources, scripts, configuration, README; not test data.
fn written() -> Vec<(String, String)> {
    const ENDINGS: [&str; 13] =
        ["rs", "sh", "toml", "md", "py", "js", "css", "c", "config", "service", "run", "avahi", ""];
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths: Vec<PathBuf> =
        ["README.md", "Cargo.toml", "cross.toml"].iter().map(|name| root.join(name)).collect();
    let mut folders: Vec<PathBuf> =
        ["src", "tests", "brick-image", ".ci"].iter().map(|name| root.join(name)).collect();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap().map(Result::unwrap) {
            let (path, name) = (entry.path(), entry.file_name());
            if !path.is_dir() {
                let ending = path.extension().unwrap_or_default();
                paths.extend(ENDINGS.iter().any(|known| *known == ending).then_some(path));
            } else if !["data", "seeds", "corpus", "target"].iter().any(|no| *no == name) {
                folders.push(path);
            }
        }
    }
    paths.sort();
    let relative = |path: &PathBuf| path.strip_prefix(root).unwrap().display().to_string();
    paths.iter().map(|path| (relative(path), std::fs::read_to_string(path).unwrap())).collect()
}

/// A line's text behind its indentation and the sign of a comment.
fn behind_comment(line: &str) -> &str {
    line.trim_start().trim_start_matches(['/', '!', '#', '*']).trim_start()
}

/// The longest part of a line that cannot go onto two: a word, such as a URL, a path or a name, or
/// a string, except in Rust, where `\` at a line's end breaks one.
fn longest_part(path: &str, line: &str) -> usize {
    let length = |part: &str| part.chars().count();
    let word = line.split_whitespace().map(length).max().unwrap_or_default();
    if path.ends_with(".rs") {
        return word;
    }
    word.max(line.split('"').skip(1).step_by(2).map(length).max().unwrap_or_default())
}

#[test]
fn lines_have_100_columns() {
    /// A part of more characters than this excuses its line.
    const UNBREAKABLE: usize = 60;
    let mut found = Vec::new();
    for (path, text) in written() {
        for (at, line) in text.lines().enumerate() {
            let is_table = behind_comment(line).starts_with('|');
            let is_long = line.chars().count() > 100;
            if is_long && !is_table && longest_part(&path, line) <= UNBREAKABLE {
                found.push(format!("{path}:{}: {line}", at + 1));
            }
        }
    }
    none("lines of more than 100 columns", &found);
}

/// Whether a word stands in a line of Rust as a name of the program and not as English.
fn is_a_name(line: &str, word: &str) -> bool {
    let parts = [
        format!("::{word}"),
        format!(".{word}("),
        format!("fn {word}("),
        format!("let {word} "),
        format!("const {word}:"),
        format!("{word}("),
        format!("({word})"),
        format!("&{word})"),
        format!("\"{word}\""),
    ];
    parts.iter().any(|part| line.contains(part)) || line.trim() == format!("{word},")
}

#[test]
fn words_to_do_without() {
    // Written apart, so that this file does not find itself.
    let words = [
        ["no", "body"],
        ["some", "body"],
        ["who", "ever"],
        ["an", "ew"],
        ["so m", "any"],
        ["goes", " on"],
        ["that is not", " there"],
        ["by and", " by"],
    ]
    .map(|parts| parts.concat());
    let is_of_a_word = |letter: char| letter.is_alphanumeric() || "-_".contains(letter);
    let mut found = Vec::new();
    for (path, text) in written() {
        for (at, line) in text.lines().enumerate() {
            let line = line.to_lowercase();
            let plain: String = format!(" {line} ")
                .chars()
                .map(|letter| if is_of_a_word(letter) { letter } else { ' ' })
                .collect();
            let is_found = |word: &&String| {
                plain.contains(&format!(" {word} "))
                    && !(path.ends_with(".rs") && is_a_name(&line, word))
            };
            if let Some(word) = words.iter().find(is_found) {
                found.push(format!("{path}:{}: `{word}` in: {}", at + 1, line.trim()));
            }
        }
    }
    none("words to do without", &found);
}

#[test]
fn nothing_is_left_undone() {
    // Written apart, so that this file does not find itself.
    let words =
        [["todo", "!"], ["unimplemented", "!"], ["TO", "DO"], ["FIX", "ME"], ["#[ig", "nore"]]
            .map(|parts| parts.concat());
    let mut found = Vec::new();
    for folder in ["src", "tests"] {
        for source in sources_below(folder) {
            for (at, line) in source
                .text
                .lines()
                .enumerate()
                .filter(|(_, line)| words.iter().any(|word| line.contains(word)))
            {
                found.push(format!("{folder}/{}:{}: {}", source.path, at + 1, line.trim()));
            }
        }
    }
    none("left undone", &found);
}

#[test]
fn warnings_are_silenced_with_a_reason_and_for_no_longer_than_needed() {
    let mut found = Vec::new();
    for source in sources() {
        for (at, line) in source
            .code()
            .filter(|(_, line)| line.contains("#[allow(") || line.contains("#![allow("))
        {
            // `expect` says when it is no longer needed; `allow` is for macros and features, with a
            // reason.
            let rest: String = source.text.lines().skip(at - 1).take(6).collect();
            if !rest.split(")]").next().unwrap().contains("reason = ") {
                found.push(format!("src/{}:{at}: {}", source.path, line.trim()));
            }
        }
    }
    none("allow without a reason", &found);
}

#[test]
fn tests_are_named_by_sentences() {
    let mut found = Vec::new();
    for folder in ["src", "tests"] {
        for source in sources_below(folder) {
            let lines: Vec<&str> = source.text.lines().map(str::trim).collect();
            for (at, _) in lines.iter().enumerate().filter(|(_, line)| **line == "#[test]") {
                // Other attributes may stand between.
                let name = lines[at..]
                    .iter()
                    .find_map(|line| line.strip_prefix("fn "))
                    .unwrap_or_default();
                let name = name.split('(').next().unwrap_or_default();
                if name.split('_').count() < 3 || name.starts_with("test_") {
                    found.push(format!("{folder}/{}: {name}", source.path));
                }
            }
        }
    }
    none("tests whose names are no sentences", &found);
}

#[test]
fn no_path_of_one_machine_is_in_the_repository() {
    let home = [["/wo", "rk/"], ["/ho", "me/"], ["/ro", "ot/"]].map(|parts| parts.concat());
    let mut found = Vec::new();
    for folder in ["src", "tests"] {
        for source in sources_below(folder) {
            for (at, line) in source
                .text
                .lines()
                .enumerate()
                .filter(|(_, line)| home.iter().any(|path| line.contains(path)))
            {
                found.push(format!("{folder}/{}:{}: {}", source.path, at + 1, line.trim()));
            }
        }
    }
    none("paths of one machine", &found);
}

#[test]
fn floats_go_through_libm_by_a_list_that_is_complete() {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(".clippy.toml"))
        .unwrap();
    // Every method of std's floats whose result is the platform's own (std's documentation:
    // "unspecified precision").
    let methods = [
        "powi", "powf", "exp", "exp2", "ln", "log", "log2", "log10", "cbrt", "hypot", "sin", "cos",
        "tan", "asin", "acos", "atan", "atan2", "sin_cos", "exp_m1", "ln_1p", "sinh", "cosh",
        "tanh", "asinh", "acosh", "atanh", "mul_add",
    ];
    for float in ["f32", "f64"] {
        for method in methods {
            let path = format!("\"{float}::{method}\"");
            assert!(text.contains(&path), "{path} is not disallowed");
        }
    }
    let matrices: Vec<String> = sources()
        .iter()
        .flat_map(|source| source.with(&["DMatrix", "DVector", "MatrixXx"]))
        .collect();
    none("matrices of run-time size, whose products use FMA where there is any", &matrices);
    let hashes: Vec<String> =
        sources().iter().flat_map(|source| source.with(&["HashMap", "HashSet"])).collect();
    none("orders that change from run to run", &hashes);
}
