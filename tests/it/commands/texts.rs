//! Texts of files and recordings that would act on a terminal or a page: each is shown, and does
//! nothing else.

use std::path::Path;

use onbrick::link::{KeyPair, KnownBrick, KnownBricks};
use onbrick::recording::{End, Info, Options, Pace, Recorder, create};
use onbrick::runtime::StopReason;
use onbrick::senses::Channel;

use super::{Done, run};
use crate::recording::sample;

/// Clears the screen, sets the title, turns the order round, and begins a line of its own.
const LOUD: &str = "a\u{1b}[2J\u{1b}]0;x\u{7}\u{9b}31m\u{202e}b\u{200b}\u{2028}c\nerror: forged";

#[track_caller]
fn is_harmless(what: &str, text: &str) {
    let acts = |letter: char| {
        letter != '\n' && letter.is_control() || "\u{202e}\u{200b}\u{2028}".contains(letter)
    };
    assert!(!text.contains(acts), "{what}: {text:?}");
    assert!(!text.lines().any(|line| line.starts_with("error: forged")), "{what}: {text:?}");
}

#[track_caller]
fn only_shows(folder: &Path, arguments: &[&str]) -> Done {
    let done = run(folder, arguments);
    is_harmless(&format!("{arguments:?}"), &done.out);
    is_harmless(&format!("{arguments:?}"), &done.err);
    done
}

#[test]
fn a_files_names_are_shown_and_do_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    // As TOML writes it.
    let loud: String = LOUD.chars().map(|letter| format!("\\U{:08X}", u32::from(letter))).collect();
    write("loud.toml", format!("name = \"x\"\n\"{loud}\" = 3\n"));
    write("named.toml", format!("name = \"{loud}\"\n"));
    for file in ["loud.toml", "named.toml"] {
        for arguments in [
            &["check", file][..],
            &["--json", "check", file],
            &["run", file, "--sim", "arena"],
            &["run", "map", "--robot", file, "--sim", "arena"],
        ] {
            let done = only_shows(folder.path(), arguments);
            assert_eq!(done.code, Some(3), "{arguments:?}: {}", done.err);
        }
        // A world may be called anything.
        only_shows(folder.path(), &["run", "map", "--sim", file]);
    }
    // A file that is called so, and one that the shell found for a command that takes none.
    let name = LOUD.replace('\n', " ");
    write(&name, "= 3".to_owned());
    for arguments in
        [&["check", &name][..], &["graph", &name], &["devices", &name], &["replay", &name]]
    {
        only_shows(folder.path(), arguments);
    }
}

#[test]
fn a_recordings_texts_are_shown_and_do_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let loud = || LOUD.to_owned();
    let mut start = sample::start(Pace::Virtual);
    let settings = vec![(loud(), 1.0)];
    start.info = Info { brick: loud(), mission: loud(), run: Some(loud()), settings, ..start.info };
    start.machines[0].name = loud();
    start.machines[0].states[0].name = loud();
    let sink = create(&file).unwrap();
    let (recorder, mut side) =
        Recorder::start(Box::new(sink), start, Options::default(), Box::new(|_| {})).unwrap();
    (0..100).for_each(|number| sample::put(&mut side, number));
    recorder
        .finish(
            side,
            End { stop: StopReason::Lost(Channel::Gyro).with(loud()), ..sample::end(100) },
        )
        .unwrap();
    for out in ["map.svg", "map.html"] {
        let done = only_shows(folder.path(), &["plot", "run.mcap", "-o", out]);
        assert_eq!(done.code, Some(0), "{}", done.err);
        is_harmless(out, &std::fs::read_to_string(folder.path().join(out)).unwrap());
    }
    only_shows(folder.path(), &["plot", "run.mcap", "-o", "s.html", "--signals", "x"]);
    for arguments in [&["replay", "run.mcap"][..], &["--json", "replay", "run.mcap"]] {
        only_shows(folder.path(), arguments);
    }
}

#[test]
fn the_names_of_known_bricks_are_shown_and_do_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let key = KeyPair::load_or_make(folder.path()).unwrap().public();
    let brick = KnownBrick { name: "blue".to_owned(), address: "127.0.0.1:1".to_owned(), key };
    let mut known = KnownBricks::load(folder.path()).unwrap();
    known.put(&brick, None).unwrap();
    let text = std::fs::read_to_string(known.path()).unwrap();
    let loud: String = LOUD.chars().map(|letter| format!("\\U{:08X}", u32::from(letter))).collect();
    std::fs::write(known.path(), text.replace("blue", &loud)).unwrap();
    let keys = folder.path().to_str().unwrap();
    for command in ["bricks", "missions", "status", "stop"] {
        only_shows(folder.path(), &[command, "--keys", keys, "--timeout", "0.2"]);
        only_shows(folder.path(), &["--json", command, "--keys", keys, "--timeout", "0.2"]);
    }
}
