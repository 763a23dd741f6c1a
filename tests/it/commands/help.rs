//! Help, usage and what every command has in common.

use std::os::unix::ffi::OsStrExt as _;
use std::process::Stdio;

use super::{onbrick, run};

const COMMANDS: [&str; 13] = [
    "demo", "sim", "run", "check", "graph", "new", "devices", "halt", "plot", "export", "repair",
    "replay", "explain",
];

#[test]
fn every_command_has_help_with_an_example() {
    let folder = tempfile::tempdir().unwrap();
    let overview = run(folder.path(), &["--help"]).expect(0).out;
    let listed = overview.lines().skip_while(|line| *line != "Commands:").skip(1);
    let listed: Vec<&str> = listed
        .take_while(|line| !line.is_empty())
        .filter_map(|line| {
            line.strip_prefix("  ")?.split(' ').next().filter(|name| !name.is_empty())
        })
        .collect();
    assert!(!listed.contains(&"control"), "control is not started by hand: {overview}");
    for command in COMMANDS {
        assert!(listed.contains(&command), "`{command}` is not in\n{overview}");
    }
    let bricks = "those that announce\n\x20            themselves in this network.";
    assert!(overview.contains(bricks), "lines break where the terminal has them: {overview}");
    for command in listed.into_iter().filter(|command| *command != "help") {
        let help = run(folder.path(), &[command, "--help"]).expect(0);
        assert!(
            help.out.contains(&format!("onbrick {command} ")) && help.out.contains("Example"),
            "{}",
            help.out
        );
        assert!(help.out.contains("--json"), "{}", help.out);
        assert_eq!(help.err, "");
    }
}

#[test]
fn the_help_of_sim_fault_lists_the_faults() {
    let folder = tempfile::tempdir().unwrap();
    let help = run(folder.path(), &["sim", "fault", "--help"]).expect(0).out;
    for word in onbrick::sim::DeviceFault::words() {
        assert!(help.contains(word), "`{word}` is not in\n{help}");
    }
}

#[test]
fn the_pages_for_users_are_shown_whole() {
    let folder = tempfile::tempdir().unwrap();
    for (page, whole) in [
        ("missions", include_str!("../../../src/behavior/missions.md")),
        ("using", include_str!("../../../src/USING.md")),
    ] {
        // But for the addresses of links into the crate documentation, at its end.
        let shown = whole.split("\n\n[`behavior::mission`]: crate::").next().unwrap().trim_end();
        let said = run(folder.path(), &["explain", page]).expect(0).out;
        assert_eq!(said, format!("{shown}\n"), "{page}");
    }
    let pages = run(folder.path(), &["explain"]).expect(0).out;
    assert!(pages.contains("onbrick explain missions  ") && pages.contains("explain using"));
}

#[test]
fn wrong_usage_ends_with_2_and_says_what_is_right() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, expected) in [
        (&[][..], "Usage: onbrick"),
        (&["dmeo"], "'demo'"),
        (&["run"], "<MISSION>"),
        (&["run", "map", "--brcik", "/"], "'--brick'"),
        (&["run", "map", "--sim", "arena", "--brick", "/tmp"], "cannot be used with"),
        (&["run", "map", "--seed", "5"], "--sim"),
        (&["run", "map", "--sim", "arena", "--set", "near_m"], "name=value"),
        (&["run", "map", "--sim", "arena", "--set", "near_m=close"], "`close` is not a number"),
        (&["run", "map", "--sim", "arena", "--set", "near_m=nan"], "finite"),
        (&["run", "map", "--sim", "arena", "--set", "naer_m=1"], "did you mean `near_m`?"),
        (&["run", "map", "--sim", "arena", "--set", "time_limit_s=1e9"], "it can be 1 to 36000"),
        (&["run", "explore", "--sim", "arena", "--set", "within_m=6"], "6; it can be 0.1 to 5"),
        (&["run", "map", "--sim", "arena", "--pose", "1,2"], "x,y,deg"),
        (&["run", "map", "--sim", "arena", "--pose", "1,2,nan"], "finite"),
        (&["run", "map", "--sim", "arena", "--sync-s", "0"], "0.1 to 60"),
        (&["demo", "--seconds", "0"], "1 to 36000"),
        (&["demo", "--seconds", "inf"], "1 to 36000"),
        (&["demo", "--seconds", "-5"], "1 to 36000"),
        (&["run", "map", "--sim", "arena", "--sync-s", "-1"], "0.1 to 60"),
        (&["bricks", "--timeout", "-1"], "0.1 to 86400"),
        (&["bricks", "--discover", "--listen", "-0.5"], "0.1 to 86400"),
        (&["team", "team.toml", "--lost", "-1e3"], "0.1 to 86400"),
        (&["demo", "--seconds", "-.5"], "invalid value '-0.5'"),
        (&["run", "map", "--seconds", "5"], "unexpected argument '--seconds'"),
        (&["demo", "--seed", "-1"], "invalid value '-1'"),
        (&["plot", "a.mcap"], "--output"),
        (&["plot", "a.mcap", "-o", "a.bmp"], ".svg, .png, .pdf or .html"),
        (&["export", "a.mcap", "--format", "dxf"], "csv, ply, pgm"),
        (&["replay", "a.mcap", "--robot", "b.toml"], "--out"),
        (&["new", "rover"], "mission, submachine, robot, world, service"),
        (&["new", "mission", "--from", "mapp"], "did you mean `map`?"),
        (&["new", "team", "--from", "map"], "for a mission, a sub-machine, a robot or a world"),
        (&["new", "world", "--from", "arean"], "did you mean `arena`"),
        (&["check"], "<MISSIONS>"),
    ] {
        let said = run(folder.path(), arguments).expect(2);
        assert!(
            said.err.contains(expected),
            "{arguments:?} should say `{expected}`:\n{}",
            said.err
        );
        assert_eq!(said.out, "", "{arguments:?}");
    }
    assert_eq!(super::names(folder.path()), [""; 0], "wrong usage leaves nothing behind");
    let said = run(folder.path(), &["run", "map", "--seconds", "5"]).expect(2);
    assert!(!said.err.contains("--json"), "it has nothing to do with it: {}", said.err);
}

#[test]
fn a_path_of_the_brick_that_is_not_utf_8_is_wrong_usage() {
    let folder = tempfile::tempdir().unwrap();
    let path = std::ffi::OsStr::from_bytes(b"\xff");
    for option in ["--brick", "--buttons", "--speaker"] {
        let output = onbrick(folder.path(), &["run", "map", option]).arg(path).output().unwrap();
        let said = super::done(&output).expect(2);
        let place = said.err.contains(&format!("for '{option} <"));
        assert!(place && said.err.contains("the path is not UTF-8"), "{}", said.err);
    }
}

#[test]
fn a_failure_is_json_for_a_program_and_text_for_a_person() {
    let folder = tempfile::tempdir().unwrap();
    let said = run(folder.path(), &["--json", "plot", "none.mcap", "-o", "map.svg"]).expect(3);
    let [failure] = said.json().try_into().unwrap();
    assert_eq!(super::keys(&failure), ["error", "exit", "hint"]);
    assert_eq!(failure["exit"], 3);
    assert!(failure["error"].as_str().unwrap().contains("none.mcap"), "{failure}");
    assert!(said.err.starts_with("error: "), "{}", said.err);
    for arguments in [&["--json", "plot"][..], &["plot", "--json"], &["--json", "plto"]] {
        let usage = run(folder.path(), arguments).expect(2);
        let [failure] = usage.json().try_into().unwrap();
        assert_eq!(super::keys(&failure), ["error", "exit", "hint"]);
        assert!(failure["exit"] == 2 && usage.err.contains("Usage"), "{failure} {}", usage.err);
    }
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["new", "mission"][..],
        &["graph", "map"],
        &["run", "map", "--sim", "arena", "--set", "time_limit_s=2", "--json"],
    ] {
        let mut child = onbrick(folder.path(), arguments)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let said = super::done(&child.wait_with_output().unwrap()).expect(0);
        assert_eq!(said.err, "", "{arguments:?}");
    }
}

#[test]
fn output_that_a_full_disk_does_not_take_is_a_failure() {
    let folder = tempfile::tempdir().unwrap();
    for arguments in [
        &["--help"][..],
        &["new", "mission"],
        &["graph", "map", "--json"],
        &["explain", "missions"],
    ] {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let output = onbrick(folder.path(), arguments).stdout(full).output().unwrap();
        let said = super::done(&output).expect(1).err;
        assert!(said.starts_with("error: cannot write the output: No space"), "{said}");
    }
}

#[test]
fn control_without_a_job_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let said = run(folder.path(), &["control"]).expect(2);
    assert!(said.err.contains("onbrick run"), "{}", said.err);
}

#[test]
fn the_manual_has_a_page_for_each_command_that_is_shown_and_bash_completes_just_those() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &["manual", "."]).expect(0);
    let share = folder.path().join("share");
    let page = |name: &str| std::fs::read_to_string(share.join("man/man1").join(name)).ok();
    for command in COMMANDS {
        assert!(page(&format!("onbrick-{command}.1")).is_some_and(|page| page.contains("Example")));
    }
    assert!(page("onbrick-sim-exec.1").is_some(), "of the commands of a command, too");
    for (name, usage) in [("plot", " <RUNS>..."), ("sim-press", " <BRICK> <BUTTON>...")] {
        let page = page(&format!("onbrick-{name}.1")).unwrap();
        let synopsis = page.split(".SH SYNOPSIS").nth(1).unwrap().lines().nth(1).unwrap();
        assert!(synopsis.ends_with(usage), "{synopsis}");
    }
    assert_eq!(page("onbrick-control.1"), None, "control is not started by hand");
    let fish = share.join("fish/vendor_completions.d/onbrick.fish");
    let fish = std::fs::read_to_string(fish).unwrap();
    assert!(fish.contains("-a \"replay\""));
    let methods: Vec<&str> =
        fish.split("complete -c ").filter(|c| c.contains("-l method")).collect();
    assert!(
        methods.len() == 3 && methods.iter().all(|one| one.contains("odometry")),
        "{methods:?}"
    );
    let zsh = std::fs::read_to_string(share.join("zsh/site-functions/_onbrick")).unwrap();
    assert!(zsh.starts_with("#compdef onbrick") && !zsh.contains("guard"), "{zsh}");
    let (_, sim) = zsh.split_once("\n            (sim)\n").unwrap();
    let (options, _) = sim.split_once("_sim_commands").expect("commands of sim");
    assert!(!options.contains("\n':"), "a word before the commands of sim: {options}");
    let script = share.join("bash-completion/completions/onbrick");
    let completed = |word: &str| {
        let ask = ". \"$1\"; COMP_WORDS=(onbrick \"$2\"); COMP_CWORD=1; \
            _onbrick onbrick \"$2\" onbrick; echo \"${COMPREPLY[@]}\"";
        let mut bash = std::process::Command::new("bash");
        let said = bash.args(["-c", ask, "bash"]).arg(&script).arg(word).output().unwrap();
        String::from_utf8(said.stdout).unwrap()
    };
    assert_eq!(completed("rep"), "repair replay\n");
    assert_eq!(completed("con"), "\n", "hidden");
}
