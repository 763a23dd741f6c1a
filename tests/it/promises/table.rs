//! The table of promises: which tests each has, whether they hold, and what they counted.

use std::collections::BTreeMap;
use std::process::Command;

use crate::support::promised::MARK;

const PROMISES: [&str; 11] = [
    "a dead or hung runtime stops the motors",
    "a stalled loop stops",
    "plugs come loose",
    "blocked wheels are noticed",
    "commands out of range cannot be given",
    "battery: warn, slow down, stop in time",
    "records survive",
    "the wall clock does not matter",
    "a foreign hand is noticed",
    "two owners are one too many",
    "soak",
];

/// A test of a promise, and how it went.
#[derive(Debug)]
struct Told {
    test: String,
    result: String,
    figures: Vec<String>,
}

/// The promise that a test is of, by its name.
fn number(test: &str) -> Option<usize> {
    let (_, name) = test.rsplit_once("promise_")?;
    name.split('_').next()?.parse().ok()
}

/// What the harness printed, test by test.
fn read(output: &str) -> BTreeMap<usize, Vec<Told>> {
    let mut told: BTreeMap<usize, Vec<Told>> = BTreeMap::new();
    for line in output.lines() {
        let Some((test, result)) = line.strip_prefix("test ").and_then(|line| line.split_once(" ... "))
        else {
            continue;
        };
        if let Some(number) = number(test) {
            let (test, result) = (test.to_owned(), result.to_owned());
            told.entry(number).or_default().push(Told { test, result, figures: Vec::new() });
        }
    }
    let mut of = None;
    for line in output.lines() {
        if let Some(heading) = line.strip_prefix("---- ") {
            of = heading.strip_suffix(" stdout ----");
        }
        let (Some(test), Some(figures)) = (of, line.strip_prefix(MARK)) else { continue };
        let all = told.values_mut().flatten();
        if let Some(told) = all.into_iter().find(|told| told.test == test) {
            told.figures.push(figures.to_owned());
        }
    }
    told
}

#[test]
#[ignore = "runs every test of a promise again and prints the table; see the module's parent"]
fn table_of_promises() {
    let program = std::env::current_exe().unwrap();
    let output = Command::new(program).args(["promise_", "--show-output"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let told = read(&said);
    for (promise, number) in PROMISES.iter().zip(1..) {
        let tests = told.get(&number).map_or(&[][..], Vec::as_slice);
        let held = tests.iter().filter(|told| told.result == "ok").count();
        println!("{number:>2}. {promise}: {held} of {} tests hold", tests.len());
        for test in tests {
            let name = test.test.rsplit("::").next().unwrap_or(&test.test);
            println!("      {:<6} {}", test.result, name.replace('_', " "));
            test.figures.iter().for_each(|figures| println!("             {figures}"));
        }
    }
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn the_table_is_made_of_names_results_and_figures() {
    let output = "running 2 tests\ntest a::promise_5_x ... ok\ntest b::promise_11_y ... FAILED\ntest other ... ok\n\nsuccesses:\n\n\
                  ---- a::promise_5_x stdout ----\nchatter\npromised: 7 of 7\n\n\nfailures:\n---- b::promise_11_y stdout ----\npromised: seed 3\n";
    let told = read(output);
    assert_eq!(told.keys().copied().collect::<Vec<_>>(), [5, 11]);
    assert_eq!(
        (told[&5][0].result.as_str(), told[&5][0].figures.as_slice()),
        ("ok", &["7 of 7".to_owned()][..])
    );
    assert_eq!(
        (told[&11][0].result.as_str(), told[&11][0].figures.as_slice()),
        ("FAILED", &["seed 3".to_owned()][..])
    );
}
