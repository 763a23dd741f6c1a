//! Other languages are clients too: the Python example of the protocol's page, against the real
//! service.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use onbrick::link::KeyPair;
use onbrick::link::keys::Authorised;

use super::bench::{Service, onbrick, text, until};
use super::commands::{SHORT, newest};
use crate::support::pass_over;
use crate::support::real_time::{beside_others, patiently};

/// True, and said, where Python or the library is missing.
fn no_pyzmq() -> bool {
    let has_zmq =
        Command::new("python3").args(["-c", "import zmq; assert zmq.has('curve')"]).output();
    let has_zmq = has_zmq.is_ok_and(|output| output.status.success());
    if !has_zmq {
        pass_over("python3 with pyzmq");
    }
    !has_zmq
}

/// A script of the repository's with these arguments, and behind them the keys of a folder.
fn python(script: &str, arguments: &[&str], keys: &Path) -> Command {
    let mut command = Command::new("python3");
    command
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python").join(script))
        .args(arguments);
    let own = std::fs::read_to_string(keys.join("own.key")).unwrap();
    for half in ["public", "secret"] {
        let line = own.lines().find(|line| line.starts_with(half)).unwrap();
        command.arg(line.split('"').nth(1).unwrap());
    }
    command
}

#[test]
fn the_python_example_asks_a_brick_and_brings_a_run_home() {
    if no_pyzmq() {
        return;
    }
    patiently("the_python_example_asks_a_brick_and_brings_a_run_home", || {
        let service = Service::new();
        service.mission("short", SHORT);
        service.introduce();
        service.done(&["start", "short", "sim"]);
        let run = newest(&service);
        until("the run is over", || {
            (!service.done(&["runs", "sim"]).contains("going on")).then_some(())
        });

        let key = |folder: &str| KeyPair::load(&service.path(folder)).unwrap();
        let home = service.path("python.mcap");
        let key = key("keys").public().to_string();
        let mut script = python("link_client.py", &[&service.address, &key], &service.path("pc"));
        let output = script.arg(&run).arg(&home).output().unwrap();
        let (said, error) = (text(&output.stdout), text(&output.stderr));
        assert!(output.status.success(), "{said}{error}");
        assert!(said.starts_with("sim stopped") && said.contains("'short'"), "{said}");
        service.says(&["runs", "sim"], "fetched");
        service.done(&["fetch", "sim", "--run", &run]);
        let ours = std::fs::read(service.path("out").join(format!("{run}.mcap"))).unwrap();
        assert!(std::fs::read(home).unwrap() == ours, "not the same bytes");
    });
}

#[test]
fn a_pc_pairs_by_what_the_protocols_page_says_and_nothing_else() {
    if no_pyzmq() {
        return;
    }
    let _machine = beside_others();
    patiently("a PC in Python pairs", || {
        let service = Service::new();
        let pc = KeyPair::generate().unwrap();
        let folder = service.path("python");
        pc.save(&folder).unwrap();
        for (answer, is_let_in) in [("no\n", false), ("yes\n", true)] {
            std::fs::write(service.path("answer"), "yes\n").unwrap();
            let person = onbrick()
                .args(["pair", "--config"])
                .arg(service.folder.path())
                .arg("--answers")
                .arg(service.path("answer"))
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            // The window's socket is there a moment after the person has opened it.
            let mut script = until("the window is open", || {
                let connected =
                    std::net::TcpStream::connect((service.address.as_str(), 5671)).is_ok();
                connected
                    .then(|| python("link_pair.py", &[&service.address, "annas-laptop"], &folder))
            });
            let mut script = script.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
            script.stdin.take().unwrap().write_all(answer.as_bytes()).unwrap();
            let output = script.wait_with_output().unwrap();
            let there = text(&person.wait_with_output().unwrap().stderr);
            let said = text(&output.stdout);
            assert_eq!(output.status.success(), is_let_in, "{said}{there}");
            let code = said.lines().next().unwrap();
            // A person at the PC who says no is quicker than the one at the brick.
            assert!(
                !is_let_in || there.lines().any(|line| line.trim() == code),
                "`{code}` is not on the brick: {there}"
            );
            let found = Authorised::below(&service.path("keys")).find(&pc.public()).unwrap();
            assert_eq!(found.as_deref(), is_let_in.then_some("annas-laptop"), "{there}");
            if is_let_in {
                let key = KeyPair::load(&service.path("keys")).unwrap().public();
                assert_eq!(said.lines().nth(1), Some(format!("sim {key}").as_str()));
                let mut asks =
                    python("link_client.py", &[&service.address, &key.to_string()], &folder);
                let output = asks.output().unwrap();
                assert!(text(&output.stdout).starts_with("sim ready"), "{}", text(&output.stderr));
            }
        }
    });
}
