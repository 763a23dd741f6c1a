//! Disks that are full, small or read-only, and configurations that are wrong.

use std::path::Path;
use std::process::Command;

use onbrick::protocol::{Kind, LocalOnly, State};
use onbrick::runtime::StopReason;

use super::{Served, folder, id, refused_as, start};
use crate::commands::run;
use crate::foreign::bench::unshare;
use crate::support::turning_brick::await_that;
use crate::support::{pass_over, real_time::beside_others};

/// A program behind a line of shell.
fn behind(script: &str, command: &Command) -> Command {
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(format!("{script}; exec \"$@\"")).arg("sh").arg(command.get_program());
    shell.args(command.get_args());
    shell
}

#[test]
fn a_disk_that_fills_up_ends_the_run_as_a_fault_that_says_so() {
    let _machine = beside_others();
    // No file may have more than 100 kB, some seconds of a recording; the signal for it is ignored,
    // so that writing fails.
    let mut served = Served::started(folder(""), &["--sim", "arena"], |command| {
        behind("trap '' XFSZ; ulimit -f 200", &command)
    });
    served.own::<serde_json::Value>(&LocalOnly::StartHere(start("r", "straight")));
    await_that("the fault is seen", || served.status().state == State::Fault);
    let last = served.status().last.unwrap();
    assert_eq!(
        (last.stop.reason.word().as_str(), last.is_wanted()),
        ("recording", false),
        "{last:?}"
    );
    assert!(last.to_string().contains("File too large"), "{}", last.to_string());
    assert!(served.runs()[0].bytes > 10_000, "what was written before is kept");
}

/// The service with its runs on a file system of its own, in a namespace of its own.
fn on_a_file_system(options: &str) -> Option<Served> {
    let can = unshare().args(["mount", "-t", "tmpfs", "tmpfs", "/mnt"]).output();
    if !can.is_ok_and(|output| output.status.success()) {
        pass_over("mount namespaces: unshare, with root's rights or user namespaces");
        return None;
    }
    let folder = folder("");
    let runs = folder.path().join("runs");
    std::fs::create_dir(&runs).unwrap();
    let mount = format!("mount -t tmpfs -o {options} tmpfs {}", runs.display());
    Some(Served::started(folder, &["--sim", "arena"], |command| {
        let inside = behind(&mount, &command);
        let mut apart = unshare();
        apart.arg(inside.get_program()).args(inside.get_args());
        apart
    }))
}

#[test]
fn a_disk_that_is_too_small_or_read_only_is_a_fault_and_every_start_says_why() {
    for (options, kind, part) in [
        ("size=4m", Kind::NoRoom, "no room for a run"),
        ("size=64m,ro", Kind::Failed, "Read-only file system"),
    ] {
        let Some(mut served) = on_a_file_system(options) else { return };
        let status = served.status();
        assert_eq!(status.state, State::Fault, "{options}: {status:?}");
        let last = status.last.unwrap();
        assert!(
            last.stop.reason == StopReason::Disk && last.to_string().contains(part),
            "{options}: {last:?}"
        );
        let refusal = served.own_refused(&LocalOnly::StartHere(start("r", "short")));
        refused_as(&refusal, kind, part);
        assert_eq!((served.runs().len(), served.status().run), (0, None), "{options}");
        assert_eq!(served.end(), Some(0));
    }
}

#[test]
fn on_a_full_disk_a_run_can_be_deleted() {
    let Some(mut served) = on_a_file_system("size=64m") else { return };
    served.own::<serde_json::Value>(&LocalOnly::StartHere(start("r", "short")));
    served.await_state(State::Stopped);
    let runs = served.path("runs");
    // As the service sees it, in its namespace.
    let seen = Path::new("/proc").join(served.pid().to_string()).join("root");
    let seen = seen.join(runs.strip_prefix("/").unwrap());
    std::fs::write(seen.join("deleted"), vec![b'\n'; 4096]).unwrap();
    let full = std::fs::write(seen.join("filler"), vec![0; 64 << 20]).unwrap_err();
    assert_eq!(full.kind(), std::io::ErrorKind::StorageFull);
    served.own::<serde_json::Value>(&LocalOnly::Delete { run: id("r") });
    assert!(served.runs().is_empty() && !seen.join("r").exists());
    assert!(served.start("r", "short").repeated, "it is remembered");
}

#[test]
fn a_configuration_that_is_wrong_is_refused_with_its_place() {
    let refused = |config: &str, code: i32, part: &str| {
        let folder = folder(config);
        let said = run(folder.path(), &["serve", "--sim", "arena", "--config", "."]).expect(code);
        assert!(said.err.contains(part), "{part}: {}", said.err);
    };
    refused("quota_mb = \"much\"", 3, "onbrick.toml:1:12");
    refused("runs = [", 3, "onbrick.toml:");
    refused("when_menu_closes = \"stopp\"", 3, "\"stop\"");
    refused("[socket]\ngroup = \"nobody-has-this-group\"", 1, "nobody-has-this-group");
    refused("runs = \"onbrick.toml\"\n[socket]\npath = \"missions\"", 1, "missions");
    let folder = folder("");
    run(folder.path(), &["serve", "--sim", "arena", "--config", "onbrick.toml/nowhere"]).expect(3);
    run(folder.path(), &["serve", "--sim", "arnea", "--config", "."]).expect(3);
}

#[test]
fn a_second_service_in_the_same_place_is_refused_and_the_first_is_not_disturbed() {
    let mut served = Served::simulated("");
    let said = run(served.folder.path(), &["serve", "--sim", "arena", "--config", "."]).expect(1);
    assert!(said.err.contains("another service keeps the runs"), "{}", said.err);
    let other = folder(&format!("[socket]\npath = \"{}\"", served.path("socket").display()));
    let said = run(other.path(), &["serve", "--sim", "arena", "--config", "."]).expect(1);
    assert!(said.err.contains("a service is at"), "{}", said.err);
    assert_eq!(served.status().state, State::Ready);
}
