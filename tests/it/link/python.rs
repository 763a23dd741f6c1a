//! Other languages are clients too: the Python example of the protocol's page, against the real service.

use std::path::Path;
use std::process::Command;

use onbrick::link::KeyPair;

use super::bench::{Service, text, until};
use super::commands::{SHORT, newest};
use crate::support::pass_over;
use crate::support::real_time::patiently;

#[test]
fn the_python_example_asks_a_brick_and_brings_a_run_home() {
    let has_zmq = Command::new("python3").args(["-c", "import zmq; assert zmq.has('curve')"]).output();
    if !has_zmq.is_ok_and(|output| output.status.success()) {
        return pass_over("python3 with pyzmq");
    }
    patiently("the_python_example_asks_a_brick_and_brings_a_run_home", || {
        let service = Service::new();
        service.mission("short", SHORT);
        service.introduce();
        service.done(&["start", "short", "sim"]);
        let run = newest(&service);
        until("the run is over", || (!service.done(&["runs", "sim"]).contains("going on")).then_some(()));

        let key = |folder: &str| KeyPair::load(&service.path(folder)).unwrap();
        let own = std::fs::read_to_string(service.path("pc").join("own.key")).unwrap();
        let secret = own.lines().find(|line| line.starts_with("secret")).unwrap().split('"').nth(1).unwrap();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/python/link_client.py");
        let home = service.path("python.mcap");
        let output = Command::new("python3")
            .arg(script)
            .args([
                &service.address,
                &key("keys").public().to_string(),
                &key("pc").public().to_string(),
                secret,
            ])
            .arg(&run)
            .arg(&home)
            .output()
            .unwrap();
        let (said, error) = (text(&output.stdout), text(&output.stderr));
        assert!(output.status.success(), "{said}{error}");
        assert!(said.starts_with("sim stopped") && said.contains("'short'"), "{said}");
        service.done(&["fetch", "sim", "--run", &run]);
        let ours = std::fs::read(service.path("out").join(format!("{run}.mcap"))).unwrap();
        assert!(std::fs::read(home).unwrap() == ours, "not the same bytes");
    });
}
