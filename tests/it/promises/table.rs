//! The table of promises: which tests each has, whether they hold, and what they counted.

use std::collections::BTreeMap;
use std::process::{Command, Output};

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
    let (_, name) = test.rsplit_once("::promise_")?;
    name.split('_').next()?.parse().ok()
}

/// What the harness printed, test by test.
fn read(output: &str) -> BTreeMap<usize, Vec<Told>> {
    let mut told: BTreeMap<usize, Vec<Told>> = BTreeMap::new();
    for line in output.lines() {
        let result = line.strip_prefix("test ").and_then(|line| line.split_once(" ... "));
        let Some((test, result)) =
            result.or_else(|| line.rsplit_once(": test").map(|(test, _)| (test, "")))
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
        if let Some(told) = told.values_mut().flatten().find(|told| told.test == test) {
            told.figures.push(figures.to_owned());
        }
    }
    told
}

/// This very program, with the tests of promises only.
fn promises(arguments: &[&str]) -> Output {
    let program = std::env::current_exe().unwrap();
    Command::new(program).arg("::promise_").args(arguments).output().unwrap()
}

fn print(told: &BTreeMap<usize, Vec<Told>>) {
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
}

/// Each promise has tests, and no test is of another one; with `ONBRICK_PROMISES=1` they are all
/// run, and the table is printed.
#[test]
fn table_of_promises() {
    let listed = read(&String::from_utf8_lossy(&promises(&["--list"]).stdout));
    let promises_with_tests: Vec<usize> = listed.keys().copied().collect();
    assert_eq!(promises_with_tests, (1..=PROMISES.len()).collect::<Vec<_>>());
    if std::env::var_os("ONBRICK_PROMISES").is_some_and(|value| value == "1") {
        let output = promises(&["--show-output"]);
        let said = String::from_utf8_lossy(&output.stdout);
        print(&read(&said));
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn the_table_is_made_of_names_results_and_figures() {
    let output = "running 2 tests\ntest a::promise_5_x ... ok\ntest b::promise_11_y ... FAILED\n\
                  test other ... ok\n\nsuccesses:\n\n\
                  ---- a::promise_5_x stdout ----\nchatter\npromised: 7 of 7\n\n\nfailures:\n\
                  ---- b::promise_11_y stdout ----\npromised: seed 3\n";
    let told = read(output);
    assert_eq!(told.keys().copied().collect::<Vec<_>>(), [5, 11]);
    let one =
        |number: usize| (told[&number][0].result.as_str(), told[&number][0].figures.join(";"));
    assert_eq!(one(5), ("ok", "7 of 7".to_owned()));
    assert_eq!(one(11), ("FAILED", "seed 3".to_owned()));
    assert!(
        read("a::promise_3_x: test\nb::c: test\n").contains_key(&3),
        "and a listing is read as well"
    );
}
