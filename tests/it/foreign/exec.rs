//! `onbrick sim exec` itself: what a program sees, what becomes of its exit code, and what is said
//! where it is forbidden.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Output, Stdio};

use super::bench::{Simulator, no_namespaces};
use crate::support::pass_over;
use crate::support::real_time::Pace;
use crate::support::{copy_of_program, tested_program};

fn exec(brick: &std::path::Path, program: &[&str]) -> Output {
    let mut command = Command::new(tested_program());
    command.args(["sim", "exec"]).arg(brick).arg("--").args(program).stdin(Stdio::null());
    command.output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[test]
fn a_program_sees_the_brick_in_place_of_the_machine_and_its_exit_code_is_kept() {
    if no_namespaces() {
        return;
    }
    let simulator = Simulator::start(&Pace::default(), "arena");
    let root = simulator.root();
    let shell = |script: &str| exec(&root, &["sh", "-c", script]);
    for (script, code, out) in [
        ("cat /sys/class/tacho-motor/motor0/address", 0, "ev3-ports:outA\n"),
        ("ls /dev/input", 0, "by-path\nevent0\nevent1\n"),
        ("wc -c < /dev/fb0", 0, "91136\n"),
        (
            "echo > /dev/console; echo > /dev/tty1; echo x > /dev/null; head -c 1 \
             /dev/zero | wc -c",
            0,
            "1\n",
        ),
        ("command -v beep", 0, "/dev/onbrick/bin/beep\n"),
        (
            "/usr/bin/beep -f 660 -l 30 && amixer -q set Playback 30% && amixer get Playback | \
             tail -n1",
            0,
            "  Mono: Playback [30%] [on]\n",
        ),
        ("exit 7", 7, ""),
        ("kill -9 $$", 137, ""),
    ] {
        let ended = shell(script);
        assert_eq!(ended.status.code(), Some(code), "{script}: {}", said(&ended));
        assert_eq!(String::from_utf8_lossy(&ended.stdout), out, "{script}: {}", said(&ended));
    }
    assert_eq!(simulator.truth().last_tone_hz, Some(660));
    // Nothing of it is left outside.
    assert!(
        !std::path::Path::new("/dev/onbrick").exists()
            && !std::path::Path::new("/sys/class/tacho-motor").exists()
    );
    let wrong = shell("beep --what");
    assert!(
        wrong.status.code() == Some(1) && said(&wrong).contains("knows no `--`"),
        "{}",
        said(&wrong)
    );
    let absent = exec(&root, &["no-such-program"]);
    assert!(
        absent.status.code() == Some(1)
            && said(&absent).contains("cannot start no-such-program")
            && said(&absent).contains("try: a program of this machine"),
        "{}",
        said(&absent)
    );
}

/// An ordinary user has a user namespace under the same name, and what root mounted.
#[test]
fn an_ordinary_user_has_a_view_of_their_own() {
    if no_namespaces() || !nix::unistd::geteuid().is_root() {
        // Who is not root has run all the others as an ordinary user.
        return;
    }
    let simulator = Simulator::start(&Pace::default(), "arena");
    // Where everybody may come, and not below this repository.
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o755)).unwrap();
    fs::set_permissions(simulator.root().parent().unwrap(), fs::Permissions::from_mode(0o755))
        .unwrap();
    let program = copy_of_program(folder.path());
    let script = "id -u; cat /sys/class/tacho-motor/motor0/address; /usr/bin/beep -f 770 -l 20; \
                  aplay -q /dev/null";
    let mut command = Command::new("setpriv");
    command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]).arg(&program);
    command
        .args(["sim", "exec"])
        .arg(simulator.root())
        .args(["--", "sh", "-c", script])
        .stdin(Stdio::null());
    let Ok(ended) = command.output() else { return pass_over("setpriv") };
    if ended.status.code() == Some(3)
        && said(&ended).contains("lets an ordinary user have no private mounts")
    {
        return pass_over("user namespaces for an ordinary user");
    }
    assert_eq!(
        String::from_utf8_lossy(&ended.stdout),
        "65534\nev3-ports:outA\n",
        "{}",
        said(&ended)
    );
    assert!(said(&ended).contains("aplay: /dev/null is not a WAV recording"), "{}", said(&ended));
    assert_eq!(simulator.truth().last_tone_hz, Some(770));
}

#[test]
fn where_no_brick_is_mounted_nothing_is_started() {
    let folder = tempfile::tempdir().unwrap();
    for place in [folder.path().to_owned(), folder.path().join("nowhere")] {
        let refused = exec(&place, &["true"]);
        let said = said(&refused);
        assert!(
            refused.status.code() == Some(3)
                && said.contains("there is no simulated brick mounted")
                && said.contains("try: onbrick sim FOLDER"),
            "{said}"
        );
    }
}

/// In a user namespace that may have none below it, as an ordinary user: the kernel's own setting
/// says so.
#[test]
fn where_namespaces_are_forbidden_the_setting_is_named() {
    if no_namespaces() {
        return;
    }
    let simulator = Simulator::start(&Pace::default(), "arena");
    let script = "echo 0 > /proc/sys/user/max_user_namespaces && \
                  exec setpriv --bounding-set=-all --inh-caps=-all \"$0\" sim exec \"$1\" -- true";
    let mut command = Command::new("unshare");
    let refused = command
        .args(["--user", "--map-root-user", "sh", "-c", script, tested_program()])
        .arg(simulator.root())
        .output()
        .unwrap();
    let said = said(&refused);
    if refused.status.code() == Some(127)
        || said.contains("setpriv")
        || said.contains("max_user_namespaces: ")
    {
        return pass_over(&format!("unshare and setpriv, with user namespaces ({said})"));
    }
    assert_eq!(refused.status.code(), Some(3), "{said}");
    assert!(
        said.contains("user.max_user_namespaces is 0") && said.contains("sudo sysctl -w"),
        "{said}"
    );
}
