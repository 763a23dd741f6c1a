//! Where a service may be begun: on a brick, or for a simulated one; and in which folder.

use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use onbrick::protocol::{Request, Status};
use onbrick::service::client::Client;

use crate::support::pass_over;
use crate::support::tested_program;
use crate::support::turning_brick::await_that;

/// `onbrick serve` that is expected to end at once.
fn refused(folder: &Path, arguments: &[&str]) -> Output {
    Command::new("timeout")
        .args(["10", tested_program(), "serve"])
        .args(arguments)
        .env("HOME", folder)
        .env_remove("XDG_CONFIG_HOME")
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[test]
fn a_machine_without_a_brick_is_not_served_and_gets_no_keys() {
    if Path::new("/sys/class/tacho-motor").exists() {
        return pass_over("a machine that is no brick");
    }
    let folder = tempfile::tempdir().unwrap();
    let before = Path::new("/etc/onbrick").exists();
    for arguments in [&[][..], &["--config", "own"], &["--brick", ".", "--config", "own"]] {
        let output = refused(folder.path(), arguments);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {said}");
        assert!(said.contains("there is no brick below") && said.contains("--sim arena"), "{said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing was made");
    assert_eq!(Path::new("/etc/onbrick").exists(), before);
}

#[test]
fn a_folder_that_is_named_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let own = folder.path().join("one/of/my/own");
    let mut service = Command::new(tested_program())
        .args(["serve", "--sim", "arena", "--config"])
        .arg(&own)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut client = Client::at(own.join("socket"));
    await_that("it answers", || {
        client.ask::<Status>(&Request::Status, Duration::from_secs(1)).is_ok()
    });
    service.kill().unwrap();
    service.wait().unwrap();
    // One that cannot be made says so.
    let output = refused(folder.path(), &["--sim", "arena", "--config", "/proc/none"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(3) && said.contains("cannot make /proc/none"), "{said}");
}
