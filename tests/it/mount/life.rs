//! A simulator's life: where it mounts and where not, how it ends, and what is left when it is
//! killed.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read};
use std::net::TcpListener;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;

use nix::errno::Errno;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use onbrick::clock::VirtualClock;
use onbrick::recording::Run;
use onbrick::sim::{EventLayout, Mount, MountError, Simulation, Unfit};

use super::bench::{Mounted, await_or_fail, errno, names, no_fuse, real_time};
use crate::drivers_bench::Bench;
use crate::support::real_time::in_real_time;
use crate::support::{OTHER_USER, copy_of_program, pass_over, tested_program};

/// A simulator in a process of its own, that says that it has mounted.
struct Simulator {
    process: Child,
    said: BufReader<std::process::ChildStdout>,
    /// What it said until then.
    greeting: String,
}

impl Simulator {
    fn start(point: &Path) -> Self {
        let mut process = Command::new(tested_program())
            .arg("sim")
            .arg(point)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(process.stdout.take().unwrap());
        let mut greeting = String::new();
        while !greeting.contains("mounted a simulated brick") {
            assert_ne!(
                said.read_line(&mut greeting).unwrap(),
                0,
                "it ended and had said: {greeting}"
            );
        }
        Self { process, said, greeting }
    }

    fn signal(&self, signal: Signal) {
        kill(Pid::from_raw(i32::try_from(self.process.id()).unwrap()), signal).unwrap();
    }

    /// Waits for the end; exit code, and what it said last.
    fn end(mut self) -> (Option<i32>, String) {
        let mut rest = String::new();
        self.said.read_to_string(&mut rest).unwrap();
        (self.process.wait().unwrap().code(), rest)
    }
}

fn is_mounted(point: &Path) -> bool {
    let table = fs::read_to_string("/proc/self/mountinfo").unwrap();
    table.lines().any(|line| line.split(' ').nth(4) == point.to_str())
}

fn refused(arguments: &[&str]) -> (Option<i32>, String) {
    let Output { status, stderr, .. } =
        Command::new(tested_program()).arg("sim").args(arguments).output().unwrap();
    (status.code(), String::from_utf8_lossy(&stderr).into_owned())
}

/// The first time makes the folder `arena`, which is the name of the world that is taken by
/// default.
#[test]
fn a_folder_of_a_worlds_name_is_not_taken_for_the_world() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for time in 1..=2 {
        let mut command = Command::new(tested_program());
        let mut process = command
            .args(["sim", "arena"])
            .current_dir(folder.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(process.stdout.take().unwrap());
        let mut greeting = String::new();
        while !greeting.contains("mounted a simulated brick") {
            assert_ne!(said.read_line(&mut greeting).unwrap(), 0, "time {time}: {greeting}");
        }
        let simulator = Simulator { process, said, greeting };
        simulator.signal(Signal::SIGTERM);
        assert_eq!(simulator.end().0, Some(0), "time {time}");
    }
}

#[test]
fn every_signal_that_asks_to_end_unmounts_also_with_files_open() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let point = folder.path().join("brick");
    for signal in [Signal::SIGINT, Signal::SIGTERM, Signal::SIGHUP] {
        let simulator = Simulator::start(&point);
        assert_eq!(
            simulator.greeting.contains("made the folder"),
            signal == Signal::SIGINT,
            "{}",
            simulator.greeting
        );
        let kept = File::open(point.join("sys/class/tacho-motor/motor0/position")).unwrap();
        let mut text = [0; 8];
        assert_eq!(kept.read_at(&mut text, 0).unwrap(), 2);
        simulator.signal(signal);
        let (code, last) = simulator.end();
        assert_eq!(code, Some(0), "{signal}: {last}");
        assert!(last.contains("unmounted after"), "{last}");
        assert!(!is_mounted(&point), "{signal}");
        assert_eq!(names(&point), [""; 0]);
        assert_eq!(
            kept.read_at(&mut text, 0).map_err(errno),
            Err(Errno::ENOTCONN),
            "answered, not kept waiting"
        );
    }
}

fn umount(point: &Path) {
    if nix::mount::umount(point).is_err() {
        let _ = Command::new("fusermount3").arg("-u").arg(point).status();
    }
}

#[test]
fn a_simulator_that_somebody_else_unmounts_ends_and_says_so() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let simulator = Simulator::start(folder.path());
    umount(folder.path());
    let (code, last) = simulator.end();
    assert_eq!(code, Some(0));
    assert!(last.contains("unmounted by another program"), "{last}");
}

#[test]
fn what_a_killed_simulator_leaves_is_cleaned_up_by_the_next_one() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let point = folder.path().canonicalize().unwrap();
    let mut first = Simulator::start(&point);
    let kept = File::open(point.join("sys/class/tacho-motor/motor0/position")).unwrap();
    let mut cat = Command::new("cat")
        .arg(point.join("dev/input/by-path/platform-gpio_keys-event"))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    first.signal(Signal::SIGKILL);
    first.process.wait().unwrap();
    let mut text = [0; 8];
    assert_eq!(
        kept.read_at(&mut text, 0).map_err(errno),
        Err(Errno::ENOTCONN),
        "no reader is taken down with it"
    );
    await_or_fail("the waiting reader's end", || cat.try_wait().unwrap().is_some());
    assert_eq!(fs::metadata(&point).map(drop).map_err(errno), Err(Errno::ENOTCONN));
    assert!(is_mounted(&point), "a mount without a program behind it");

    let second = Simulator::start(&point);
    assert!(second.greeting.contains("took away what a simulator had left"), "{}", second.greeting);
    assert_eq!(
        fs::read_to_string(point.join("sys/class/tacho-motor/motor0/position")).unwrap(),
        "0\n"
    );
    second.signal(Signal::SIGTERM);
    assert_eq!(second.end().0, Some(0));
    assert!(!is_mounted(&point), "nothing is left of either");
}

#[test]
fn a_run_whose_simulator_is_killed_says_so_and_blames_no_plug() {
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    in_real_time("a run whose simulator is killed", |pace| {
        let folder = tempfile::tempdir().unwrap();
        let point = folder.path().join("brick");
        let mut simulator = Simulator::start(&point);
        let mut run = Command::new(tested_program())
            .args(["--json", "run", "square", "--out", "out", "--brick"])
            .arg(&point)
            .current_dir(folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        pace.watch(&simulator.process);
        pace.watch(&run);
        let mut events = BufReader::new(run.stdout.take().unwrap()).lines();
        let drives = events.any(|event| event.unwrap().contains("\"driving\""));
        simulator.signal(Signal::SIGKILL);
        simulator.process.wait().unwrap();
        events.for_each(drop);
        let said = run.wait_with_output().unwrap();
        let told = String::from_utf8_lossy(&said.stderr).into_owned();
        pace.ensure(drives && told.contains("the brick's files are gone"), || told.clone());
        let run = Run::open(&folder.path().join("out/run.mcap")).unwrap();
        let kept: Vec<&str> = run.logs.iter().map(|log| log.text.as_str()).collect();
        pace.ensure(![&told[..], &kept.concat()].concat().contains("plug"), || kept.join("; "));
        pace.same("exit code", &said.status.code(), &Some(1));
        umount(&point);
    });
}

#[test]
fn a_place_that_is_no_mount_point_is_refused_before_anything_happens() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::create_dir(path("full")).unwrap();
    fs::write(path("full/file"), "mine").unwrap();
    for (point, why) in [
        (path("full"), "it is not empty"),
        (path("full/file"), "it is not a folder"),
        (path("no/such/folder"), "it cannot be made: entity not found"),
        ("/proc".to_owned(), "`proc` is mounted there already"),
    ] {
        let (code, said) = refused(&[&point]);
        assert_eq!(code, Some(3), "{said}");
        assert!(
            said.contains(why) && said.contains(&point) && said.contains("try:"),
            "{point}: {said}"
        );
    }
    assert_eq!(fs::read_to_string(path("full/file")).unwrap(), "mine");
    let (code, said) = refused(&[&path("new"), "--robots", "9"]);
    assert!(code == Some(3) && said.contains("start poses"), "{said}");
    let (code, said) = refused(&[&path("new"), "--world", "nowhere"]);
    assert!(code == Some(3) && said.contains("arena"), "{said}");
    for wrong in [["--robots", "0"], ["--lcd", "178x128"], ["--event-bits", "16"]] {
        assert_eq!(refused(&[&path("new"), wrong[0], wrong[1]]).0, Some(2), "{wrong:?}");
    }
    assert_eq!(names(folder.path()), ["full"], "nothing was made");
}

#[test]
fn a_second_simulator_at_the_same_place_is_refused_and_the_first_goes_on() {
    let Some(mounted) = Mounted::recorded() else { return };
    let point = mounted.mount().point();
    let simulation =
        Simulation::new(Arc::new(VirtualClock::default()), Box::new(Bench::as_recorded()), 1);
    match Mount::new(&simulation, point, EventLayout::NATIVE) {
        Err(MountError::Unfit { why: Unfit::Busy(source), .. }) => {
            assert_eq!(source, "onbrick-sim")
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(
        fs::read_to_string(point.join("sys/class/tacho-motor/motor0/position")).unwrap(),
        "0\n"
    );
}

/// A folder open to all users, with a copy of the program.
fn open_house() -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o777)).unwrap();
    let program = copy_of_program(folder.path());
    (folder, program)
}

#[test]
fn who_is_not_root_and_has_no_helper_is_told_what_to_install() {
    if no_fuse() {
        return;
    }
    let (folder, program) = open_house();
    let point = folder.path().join("brick");
    // In a namespace of its own, where the helpers are no programs.
    let script = r#"
for name in fusermount3 fusermount; do
  if helper=$(command -v $name); then mount --bind /dev/null "$helper"; fi
done
exec setpriv --reuid 65534 --regid 65534 --clear-groups "$@"
"#;
    let output = Command::new("unshare")
        .args(["--mount", "--propagation", "private", "sh", "-c", script, "sh"])
        .args([program.as_os_str(), "sim".as_ref(), point.as_os_str()])
        .output();
    let Some(output) = output.ok().filter(|_| nix::unistd::geteuid().is_root()) else {
        return pass_over("root with unshare, to become a user who cannot mount");
    };
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(
        said.contains("fusermount3 is missing") && said.contains("apt install fuse3"),
        "{said}"
    );
    assert!(!point.exists(), "nothing was made");
}

#[test]
fn an_ordinary_user_mounts_with_the_helper_and_nobody_else_gets_in() {
    if no_fuse() {
        return;
    }
    let helper =
        ["/usr/bin/fusermount3", "/bin/fusermount3"].iter().any(|path| Path::new(path).exists());
    if !nix::unistd::geteuid().is_root() || !helper {
        return pass_over("root, to become an ordinary user, and fusermount3 of the package fuse3");
    }
    let (folder, program) = open_house();
    let point = folder.path().canonicalize().unwrap().join("brick");
    let somebody = |program: &Path| {
        let mut command = Command::new(program);
        command.uid(OTHER_USER).gid(OTHER_USER);
        command
    };
    let mut process =
        somebody(&program).arg("sim").arg(&point).stdout(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(process.stdout.take().unwrap());
    let mut greeting = String::new();
    while !greeting.contains("mounted a simulated brick") {
        assert_ne!(said.read_line(&mut greeting).unwrap(), 0, "it ended and had said: {greeting}");
    }
    let simulator = Simulator { process, said, greeting };
    let position = point.join("sys/class/tacho-motor/motor0/position");
    let read = somebody(Path::new("cat")).arg(&position).output().unwrap();
    assert_eq!(read.stdout, b"0\n", "{}", String::from_utf8_lossy(&read.stderr));
    assert_eq!(fs::read(&position).map_err(errno), Err(Errno::EACCES), "not even root");
    simulator.signal(Signal::SIGTERM);
    let (code, last) = simulator.end();
    assert_eq!(code, Some(0), "{last}");
    assert!(last.contains("unmounted after") && !is_mounted(&point), "{last}");
}

#[test]
fn what_root_has_mounted_is_everybodys() {
    if no_fuse() {
        return;
    }
    if !nix::unistd::geteuid().is_root() {
        return pass_over("root, whose mounts others may use");
    }
    let (folder, _) = open_house();
    let point = folder.path().canonicalize().unwrap().join("brick");
    let simulator = Simulator::start(&point);
    let position = point.join("sys/class/tacho-motor/motor0/position");
    let somebody = |words: &str| {
        let mut command = Command::new("sh");
        command
            .uid(OTHER_USER)
            .gid(OTHER_USER)
            .args(["-c", words, "sh"])
            .arg(&position)
            .output()
            .unwrap()
    };
    let written = somebody(r#"echo 7 >"$1""#);
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    let read = somebody(r#"cat "$1""#);
    assert_eq!(read.stdout, b"7\n", "{}", String::from_utf8_lossy(&read.stderr));
    simulator.signal(Signal::SIGTERM);
    assert_eq!(simulator.end().0, Some(0));
}

/// A simulator with more to do than to mount, until a line that it says.
fn simulate(point: &Path, arguments: &[&str], until: &str) -> Simulator {
    let mut process = Command::new(tested_program())
        .arg("sim")
        .arg(point)
        .args(arguments)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(process.stdout.take().unwrap());
    let mut greeting = String::new();
    while !greeting.contains(until) {
        assert_ne!(said.read_line(&mut greeting).unwrap(), 0, "it ended and had said: {greeting}");
    }
    Simulator { process, said, greeting }
}

#[test]
fn a_simulator_follows_a_scenario_shows_a_page_and_leaves_a_still() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("loose.toml");
    fs::write(&scenario, "[[fault]]\nat_s = 0.2\nport = \"outB\"\nkind = \"write speed_sp 77\"\n")
        .unwrap();
    let still = folder.path().join("end.svg");
    let arguments =
        ["--page", "--scenario", scenario.to_str().unwrap(), "--show", still.to_str().unwrap()];
    let point = folder.path().join("brick");
    let simulator = simulate(&point, &arguments, "the room is at http://127.0.0.1:");
    await_or_fail("the other program's write", || {
        let set = |name: &str| {
            fs::read_to_string(point.join("sys/class/tacho-motor").join(name).join("speed_sp"))
                .unwrap()
        };
        names(&point.join("sys/class/tacho-motor")).iter().any(|name| set(name) == "77\n")
    });
    simulator.signal(Signal::SIGINT);
    let (code, last) = simulator.end();
    assert_eq!(code, Some(0), "{last}");
    assert!(last.contains("0.200 s, robot 1: outB write speed_sp 77"), "{last}");
    let picture = fs::read_to_string(still).unwrap();
    assert!(
        picture.contains("class=\"robot\"")
            && picture.contains("done at 0.2 s: outB write speed_sp 77")
    );
}

#[test]
fn a_page_whose_port_is_taken_is_refused_and_nothing_stays_mounted() {
    if no_fuse() {
        return;
    }
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let folder = tempfile::tempdir().unwrap();
    let point = folder.path().join("brick");
    let (code, said) = refused(&[point.to_str().unwrap(), &format!("--page={port}")]);
    assert_eq!(code, Some(3), "{said}");
    assert!(said.contains(&port) && said.contains("try: another port for --page"), "{said}");
    assert!(!is_mounted(&point));
}

#[test]
fn a_still_that_cannot_be_written_is_refused_before_anything_is_mounted() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("notes.svg"), "kept").unwrap();
    for (still, code) in [("notes.svg", 3), ("none/end.svg", 1), ("end.png", 2)] {
        let output = Command::new(tested_program())
            .args(["sim", "brick", "--show", still])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(still) && said.contains("\n  try: "), "{said}");
    }
    assert_eq!(names(folder.path()), ["notes.svg"]);
    assert_eq!(fs::read_to_string(folder.path().join("notes.svg")).unwrap(), "kept");
}

#[test]
fn another_board_is_mounted_and_its_files_are_served_to_a_program_of_the_seeds() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("secret"), "of the machine").unwrap();
    let point = folder.path().join("brick");
    let arguments = ["--board", "brickpi3", "--node=0"];
    let simulator = simulate(&point, &arguments, "the files of robot 1 are at tcp://");
    let (_, address) = simulator.greeting.trim_end().rsplit_once(' ').unwrap();
    assert!(address.starts_with("tcp://127.0.0.1:"), "{address}");
    let socket = zmq::Context::new().socket(zmq::REQ).unwrap();
    socket.set_rcvtimeo(30_000).unwrap();
    socket.connect(address).unwrap();
    let ask = |request: &str| {
        socket.send(request, 0).unwrap();
        socket.recv_string(0).unwrap().unwrap()
    };
    let ports = ask("l:sys/class/lego-port");
    let is_first =
        |port: &&str| ask(&format!("r:sys/class/lego-port/{port}/address")) == "spi0.1:S1";
    let port = ports.split(' ').find(is_first).unwrap();
    // A program for the seed names files as a brick has them.
    assert_eq!(ask(&format!("w:ev3-uart:/sys/class/lego-port/{port}/mode")), "ok");
    assert_eq!(ask(&format!("w:lego-ev3-us:/sys/class/lego-port/{port}/set_device")), "ok");
    let sensor = ask("l:sys/class/lego-sensor");
    let seen = || ask(&format!("r:sys/class/lego-sensor/{sensor}/value0")).parse::<i32>().unwrap();
    await_or_fail("a range", || seen() > 0);
    assert_eq!(ask("w:moonwalk:sys/class/tacho-motor/motor0/command"), "error");
    for outside in ["../secret", "/etc/passwd", "sys/../../../etc/passwd", "proc/self/mem"] {
        assert_eq!(ask(&format!("r:{outside}")), "error", "{outside}");
    }
    assert_eq!(ask("l:.."), ask("l:"));
    let doctor = Command::new(tested_program())
        .args(["doctor", "--brick"])
        .arg(&point)
        .current_dir(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&doctor.stdout);
    assert!(said.contains("BrickPi3") && said.contains("--no-button"), "{said}");
    simulator.signal(Signal::SIGTERM);
    let (code, last) = simulator.end();
    assert_eq!(code, Some(0), "{last}");
    assert!(names(&point).is_empty());
}

#[test]
fn a_scenario_with_a_mistake_is_refused_before_anything_is_mounted() {
    let folder = tempfile::tempdir().unwrap();
    let (scenario, point) = (folder.path().join("loose.toml"), folder.path().join("brick"));
    fs::write(&scenario, "[[fault]]\nat_s = 1\nport = \"outB\"\nkind = \"blok\"\n").unwrap();
    let (code, said) =
        refused(&[point.to_str().unwrap(), "--scenario", scenario.to_str().unwrap()]);
    assert_eq!(code, Some(3), "{said}");
    assert!(
        said.contains("there is no fault `blok`") && said.contains("did you mean `block`?"),
        "{said}"
    );
    assert!(!point.exists());
}
