//! Bricks that make themselves known: avahi with the package's own file, in a network of the test's
//! own.

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

use super::bench::text;
use super::class::{Class, PHONE};
use crate::foreign::bench::unshare;
use crate::support::devtools::Tab;
use crate::support::pass_over;
use crate::support::real_time::beside_others;
use crate::support::tested_program;

/// As on ev3dev, without the system's bus, which is not there.
const AVAHI: &str = "[server]\nhost-name=ev3-blue\nuse-ipv4=yes\nuse-ipv6=no\n\
                     allow-interfaces=brick\nenable-dbus=no\n";

/// A network with one cable, a brick's avahi at it, and a PC that listens.
const SCRIPT: &str = r#"
set -e
ip link set lo up
ip link add brick type veth peer name cable
ip address add 10.5.0.1/24 dev brick
ip link set brick up
ip link set cable up
mount --bind "$1/services" /etc/avahi/services
mount -t tmpfs tmpfs /run
mkdir -p /run/avahi-daemon
avahi-daemon --file "$1/conf" --no-drop-root --no-chroot --no-rlimits >"$1/avahi.log" 2>&1 &
avahi=$!
said=0
shift
"$@" || said=$?
kill $avahi
exit $said
"#;

/// True, and said, where this machine has no avahi, or makes no networks.
fn no_avahi() -> bool {
    if Command::new("avahi-daemon").arg("--version").output().is_err()
        || !Path::new("/etc/avahi/services").is_dir()
    {
        pass_over("avahi-daemon");
        return true;
    }
    let cable = ["--net", "ip", "link", "add", "one", "type", "veth", "peer", "name", "other"];
    let can = unshare().args(cable).output();
    let can = can.is_ok_and(|output| output.status.success());
    if !can {
        pass_over("network namespaces: unshare --net, ip, and veth");
    }
    !can
}

/// What avahi needs.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("brick-image/package/onbrick.avahi");
    std::fs::create_dir(folder.path().join("services")).unwrap();
    std::fs::copy(file, folder.path().join("services/onbrick.service")).unwrap();
    std::fs::write(folder.path().join("conf"), AVAHI).unwrap();
    folder
}

/// A program on the PC, as its arguments name it. All of it ends when this process is killed.
fn beside_a_brick(folder: &TempDir) -> Command {
    let mut command = unshare();
    command.args(["--net", "--pid", "--mount-proc", "--fork", "--kill-child"]);
    command.args(["sh", "-c", SCRIPT, "sh"]).arg(folder.path());
    command
}

#[test]
fn a_brick_whose_avahi_has_the_packages_file_is_found() {
    if no_avahi() {
        return;
    }
    let folder = folder();
    let discover = |listen: &str| {
        let output = beside_a_brick(&folder)
            .args([tested_program(), "bricks", "--discover", "--json", "--listen", listen])
            .env("ONBRICK_KEYS", folder.path().join("keys"))
            .output()
            .unwrap();
        let log = std::fs::read_to_string(folder.path().join("avahi.log")).unwrap_or_default();
        assert!(output.status.success(), "{}{}{log}", text(&output.stdout), text(&output.stderr));
        println!("{log}");
        text(&output.stdout)
    };
    // Avahi looks for a second whether its name is free; a machine that has no time for it is given
    // more.
    let said = ["6", "20", "60"]
        .into_iter()
        .map(discover)
        .find(|said| !said.is_empty())
        .unwrap_or_default();
    let brick: Value =
        serde_json::from_str(said.lines().next().expect("no brick was heard")).unwrap();
    assert_eq!(brick["brick"], "ev3-blue", "{brick}");
    assert_eq!(brick["address"], "ev3-blue.local", "{brick}");
    assert_eq!(brick["numbers"][0], "10.5.0.1", "{brick}");
    assert_eq!(brick["known"], false, "{brick}");
}

#[test]
fn a_brick_that_makes_itself_known_stands_on_the_page_of_a_class_and_can_be_paired() {
    if no_avahi() {
        return;
    }
    let _machine = beside_others();
    let avahi = folder();
    let mut program = beside_a_brick(&avahi);
    program.arg(tested_program());
    let class = Class::started(tempfile::tempdir().unwrap(), program);
    let mut browser = Command::new("nsenter");
    browser.args(["--target", &class.process().to_string(), "--net"]);
    if !nix::unistd::geteuid().is_root() {
        browser.args(["--user", "--preserve-credentials"]);
    }
    browser.args(["--", "sh"]);
    let Some(mut tab) = Tab::open_by(&mut browser, &class.url, PHONE) else { return };
    tab.until("document.querySelector('#pairing').innerText.includes('New: ev3-blue at 10.5.0.1')");
    tab.picture("12-stranger");
    tab.click("#pairing", "Pair");
    // Its window is closed.
    tab.until("document.querySelector('#pairing').innerText.includes('Not paired: ')");
    tab.picture("13-not-paired");
    tab.click("#pairing", "Close");
    tab.until("!document.querySelector('#pairing').innerText.includes('Not paired')");
}
