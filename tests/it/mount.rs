//! The mounted simulation: the same drivers through the kernel's files, against the kernel's
//! transcript, against the door of this process, and against people who pull plugs, kill readers
//! and mount where they should not.

pub(crate) mod bench;
mod faults;
mod figures;
mod life;
mod missions;
mod streams;

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{Access, LocalTree, Tree};
use onbrick::sim::{EventLayout, MotorKind, Options, Plugged, Port, Simulation};

use self::bench::{Mounted, errno, no_fuse};
use crate::drivers_bench::{Bench, InProcess};
use crate::sim_drivers::{HandClock, check_error_matrix};
use crate::support::real_time::{Pace, in_real_time};
use crate::transcript::{self, Control as _, Tolerances};

#[test]
fn every_operation_of_the_kernel_transcript_gets_the_kernels_answer_through_the_mount() {
    let Some(mounted) = Mounted::recorded() else { return };
    let rig = mounted.rig();
    let tolerances = Tolerances { speed: 8, position: 10, duty: 8, moment_ms: 100 };
    let outcome =
        transcript::play(rig.tree.as_ref(), rig.bench.clock.as_ref(), &mounted, tolerances);
    println!(
        "kernel transcript through the mount: {} operations with the same bytes, {} within \
         {tolerances:?}, {} excepted, {} actions, \
         {} entries of folders; largest differences {:?}",
        outcome.exact,
        outcome.near,
        outcome.excepted,
        outcome.actions,
        outcome.entries,
        outcome.largest
    );
    assert!(outcome.differences.is_empty(), "{}", outcome.differences.join("\n"));
    let (operations, entries) = transcript::size();
    assert_eq!((outcome.exact, outcome.near, outcome.excepted, outcome.actions), (550, 231, 8, 12));
    assert_eq!(550 + 231 + 8 + 12, operations, "nothing in the transcript was skipped");
    assert_eq!((outcome.entries, entries), (126, 126));
}

#[test]
fn the_error_matrix_is_the_same_through_the_mount() {
    let Some(mounted) = Mounted::recorded() else { return };
    check_error_matrix(mounted.rig());
    let direct = mounted.open("sys/class/lego-sensor/sensor0/direct", Access::ReadWrite).unwrap();
    assert_eq!(
        direct.write_at(b"x", 1).map_err(errno),
        Err(Errno::EINVAL),
        "raw bytes at an offset"
    );
    assert_eq!(direct.write_at(b"x", 0).map_err(errno), Ok(1));
}

#[test]
fn the_mount_lists_what_the_door_of_this_process_lists_and_every_link_leads_somewhere() {
    let Some(mounted) = Mounted::recorded() else { return };
    let mut folders = vec![String::new()];
    let mut kinds = BTreeMap::<u32, usize>::new();
    while let Some(folder) = folders.pop() {
        let found = mounted.entries(&folder);
        assert_eq!(found, mounted.rig().bench.brick.entries(&folder).unwrap(), "{folder}");
        for entry in found {
            *kinds.entry(entry.mode() & 0o170_000).or_default() += 1;
            let path =
                if folder.is_empty() { entry.name } else { format!("{folder}/{}", entry.name) };
            let local = mounted.path(&path);
            let metadata = local.symlink_metadata().unwrap();
            assert_eq!(
                (metadata.uid(), metadata.gid()),
                (nix::unistd::getuid().as_raw(), nix::unistd::getgid().as_raw())
            );
            if metadata.is_dir() {
                folders.push(path);
            } else if metadata.is_symlink() {
                let target = local.canonicalize().unwrap_or_else(|error| panic!("{path}: {error}"));
                assert!(
                    target.starts_with(mounted.mount().point()),
                    "{path} leads to {}",
                    target.display()
                );
            }
        }
    }
    println!("entries by the kind in their mode: {kinds:?}");
    assert!(
        kinds[&0o100_000] > 250 && kinds[&0o040_000] > 50 && kinds[&0o120_000] > 50,
        "{kinds:?}"
    );
    let motor = mounted.path("sys/class/tacho-motor/motor1");
    let target = fs::read_link(&motor).unwrap();
    let expected = "../../devices/platform/ev3-ports/ev3-ports:outB/lego-port/port5/ev3-ports:outB:lego-ev3-l-motor/tacho-motor/motor1";
    assert_eq!(target, Path::new(expected));
    let through_port =
        mounted.path("sys/class/lego-port/port5/ev3-ports:outB:lego-ev3-l-motor/tacho-motor");
    assert_eq!(bench::names(&through_port), ["motor1"]);
    assert_eq!(
        motor.join("device/../..").canonicalize().unwrap().file_name().unwrap(),
        "lego-port"
    );
    assert_eq!(
        motor.join("subsystem").canonicalize().unwrap(),
        mounted.path("sys/class/tacho-motor")
    );
}

/// What udev and scripts look at beside the attributes: the device on the bus, its driver, power
/// management.
#[test]
fn a_plugged_device_is_on_the_bus_and_bound_to_a_driver() {
    let Some(mounted) = Mounted::recorded() else { return };
    let read = |path: &str| fs::read_to_string(mounted.path(path)).map_err(errno);
    for (device, driver, name, address) in [
        ("tacho-motor/motor1", "legoev3-motor", "lego-ev3-l-motor", "ev3-ports:outB"),
        ("lego-sensor/sensor1", "ev3-analog-sensor", "lego-ev3-touch", "ev3-ports:in2"),
        ("lego-sensor/sensor0", "ev3-uart-host", "lego-ev3-us", "ev3-ports:in1"),
    ] {
        let folder = format!("sys/class/{device}/device");
        assert_eq!(read(&format!("{folder}/modalias")), Ok(format!("lego:{driver}\n")));
        let uevent = format!(
            "DEVTYPE={driver}\nDRIVER={driver}\nLEGO_DRIVER_NAME={name}\nLEGO_ADDRESS={address}\n\
             MODALIAS=lego:{driver}\n"
        );
        assert_eq!(read(&format!("{folder}/uevent")), Ok(uevent));
        let real = |path: &str| mounted.path(path).canonicalize().unwrap();
        let of_driver = format!("sys/bus/lego/drivers/{driver}");
        assert_eq!(real(&format!("{folder}/driver")), real(&of_driver));
        assert_eq!(real(&format!("{folder}/subsystem")), real("sys/bus/lego"));
        for link in [
            format!("sys/bus/lego/devices/{address}:{name}"),
            format!("{of_driver}/{address}:{name}"),
        ] {
            assert_eq!(real(&link), real(&folder), "{link}");
        }
        for power in [format!("sys/class/{device}/power"), format!("{folder}/power")] {
            let names = bench::names(&mounted.path(&power));
            let expected = [
                "autosuspend_delay_ms",
                "control",
                "runtime_active_time",
                "runtime_status",
                "runtime_suspended_time",
            ];
            assert_eq!(names, expected, "{power}");
            assert_eq!(read(&format!("{power}/control")), Ok("auto\n".to_owned()));
            assert_eq!(read(&format!("{power}/runtime_status")), Ok("unsupported\n".to_owned()));
            assert_eq!(read(&format!("{power}/autosuspend_delay_ms")), Err(Errno::EIO));
            let write = |word: &str| {
                fs::write(mounted.path(&format!("{power}/control")), word).map_err(errno)
            };
            assert_eq!((write("on\n"), write("off")), (Ok(()), Err(Errno::EINVAL)));
        }
    }
    mounted.unplug(Port::OutB);
    assert_eq!(
        fs::read_dir(mounted.path("sys/bus/lego/drivers/legoev3-motor")).unwrap().count(),
        2
    );
    assert_eq!(
        read("sys/bus/lego/devices/ev3-ports:outB:lego-ev3-l-motor/modalias"),
        Err(Errno::ENOENT)
    );
}

/// As udev's rules do; the rights of a device that went are not those of the next one.
#[test]
fn root_may_change_rights_and_no_user_the_owner() {
    let Some(mounted) = Mounted::recorded() else { return };
    let path = mounted.path("sys/class/tacho-motor/motor1/command");
    let rights = || fs::metadata(&path).unwrap().permissions().mode() & 0o7777;
    let set =
        |mode: u32| fs::set_permissions(&path, fs::Permissions::from_mode(mode)).map_err(errno);
    if !nix::unistd::geteuid().is_root() {
        assert_eq!((set(0o666), rights()), (Err(Errno::EPERM), 0o200));
        return;
    }
    assert_eq!((set(0o666), rights()), (Ok(()), 0o666));
    assert_eq!(std::os::unix::fs::chown(&path, Some(1), None).map_err(errno), Err(Errno::EPERM));
    mounted.unplug(Port::OutB);
    mounted.plug(Port::OutB);
    let again = mounted.path("sys/class/tacho-motor/motor3/command");
    assert_eq!(fs::metadata(again).unwrap().permissions().mode() & 0o7777, 0o200);
}

/// Two simulations alike, one mounted, one not: whatever is written, both answer the same.
#[test]
fn writes_of_every_length_and_every_byte_are_answered_as_in_process() {
    let Some(mounted) = Mounted::recorded() else { return };
    let twin = InProcess::new(Bench::as_recorded(), Options::default());
    let mut lengths: Vec<usize> = (0..=40).collect();
    lengths.extend([255, 256, 257, 4095, 4096, 4097, 5000, 65_535, 65_536]);
    let targets = [
        "tacho-motor/motor1/position_sp",
        "tacho-motor/motor1/command",
        "tacho-motor/motor1/hold_pid/Kp",
        "lego-sensor/sensor0/mode",
        "lego-sensor/sensor0/direct",
        "lego-port/port0/set_device",
        "leds/led0:red:brick-status/brightness",
        "board-info/board0/uevent",
        "graphics/fb0/bits_per_pixel",
    ];
    let mut writes = 0;
    for target in targets {
        let path = format!("sys/class/{target}");
        let through_mount = OpenOptions::new().write(true).open(mounted.path(&path)).unwrap();
        let in_process = twin.brick.open(&path, Access::Write).unwrap();
        let both = |bytes: &[u8]| {
            // Each write is one system call, and so one store.
            let found = through_mount.write_at(bytes, 0).map_err(errno);
            let shown = String::from_utf8_lossy(bytes.get(..40).unwrap_or(bytes)).into_owned();
            // No byte, no store: the kernel does not ask the file system at all.
            let expected = if bytes.is_empty() { Ok(0) } else { in_process.write(bytes) };
            assert_eq!(found, expected, "{target}: {} bytes, {shown:?}", bytes.len());
        };
        for length in &lengths {
            for byte in [b'7', b'\n', 0, 0xff] {
                both(&vec![byte; *length]);
                writes += 1;
            }
        }
        for byte in 0..=u8::MAX {
            both(&[byte]);
            both(&[b'1', byte, b'2']);
            writes += 2;
        }
    }
    println!("{writes} writes answered alike");
    for path in [
        "sys/class/tacho-motor/motor1/position_sp",
        "sys/class/leds/led0:red:brick-status/brightness",
    ] {
        let mut text = [0; 64];
        let length = twin.brick.open(path, Access::Read).unwrap().read(&mut text).unwrap();
        assert_eq!(fs::read(mounted.path(path)).unwrap(), &text[..length], "{path}");
    }
}

#[test]
fn a_text_is_made_when_its_beginning_is_read_and_shells_and_libraries_get_on_with_it() {
    let Some(mounted) = Mounted::recorded() else { return };
    let path = mounted.path("sys/class/tacho-motor/motor1/position");
    let mut file = OpenOptions::new().read(true).write(true).open(&path).unwrap();
    let mut text = String::new();
    file.read_to_string(&mut text).unwrap();
    assert_eq!(text, "0\n");
    assert_eq!(file.read(&mut [0; 8]).unwrap(), 0, "no seek, no more");
    fs::write(&path, "-1234\n").unwrap();
    file.seek(SeekFrom::Start(0)).unwrap();
    let mut bytes = Vec::new();
    let mut byte = [0];
    while file.read(&mut byte).unwrap() == 1 {
        bytes.push(byte[0]);
    }
    assert_eq!(bytes, b"-1234\n", "byte for byte, as a shell reads");
    assert_eq!(fs::metadata(&path).unwrap().len(), 4096, "the size says nothing of the text");
    let mut half = [0; 2];
    assert_eq!(
        (file.read_at(&mut half, 3).unwrap(), &half),
        (2, b"34"),
        "a part of it, without its beginning"
    );

    OpenOptions::new().append(true).open(&path).unwrap().write_all(b"77").unwrap();
    assert_eq!(fs::read_to_string(&path).unwrap(), "77\n", "appending is writing");
    let shell =
        |script: &str| Command::new("sh").args(["-c", script]).env("F", &path).output().unwrap();
    assert!(shell("echo 42 > $F").status.success());
    assert_eq!(shell("cat $F; read x < $F; echo $x").stdout, b"42\n42\n");
    assert!(!shell("echo 42 > $F.new").status.success(), "nothing can be made there");
    assert!(
        !shell("rm -f $F || rmdir $(dirname $F) || mkdir $F.d || mv $F $F.x || ln -s a $F.l")
            .status
            .success()
    );
    assert_eq!(fs::read_to_string(&path).unwrap(), "42\n");
    let error = OpenOptions::new().write(true).truncate(true).open(path.with_file_name("state"));
    assert_eq!(error.map(drop).map_err(errno), Err(Errno::EACCES), "also for root");
}

#[test]
fn a_pulled_motor_is_gone_for_paths_and_for_descriptors_and_comes_back_under_another_name() {
    let Some(mounted) = Mounted::recorded() else { return };
    let rig = mounted.rig();
    let old = mounted.path("sys/class/tacho-motor/motor1/position");
    let kept = OpenOptions::new().read(true).write(true).open(&old).unwrap();
    let mut buffer = [0; 16];
    kept.read_at(&mut buffer, 0).unwrap();
    rig.bench.simulation.unplug(0, Port::OutB).unwrap();
    rig.pass_ms(110);
    assert_eq!(kept.read_at(&mut buffer, 0).map_err(errno), Err(Errno::ENODEV));
    assert_eq!(kept.read_at(&mut buffer, 1).map_err(errno), Err(Errno::ENODEV));
    assert_eq!(kept.write_at(b"0", 0).map_err(errno), Err(Errno::ENODEV));
    assert_eq!(File::open(&old).map(drop).map_err(errno), Err(Errno::ENOENT));
    assert_eq!(
        old.parent().unwrap().symlink_metadata().map(drop).map_err(errno),
        Err(Errno::ENOENT)
    );
    assert_eq!(bench::names(&mounted.path("sys/class/tacho-motor")), ["motor0", "motor2"]);
    rig.bench.simulation.plug(0, Port::OutB, Plugged::Motor(MotorKind::Medium)).unwrap();
    rig.pass_ms(400);
    assert_eq!(
        bench::names(&mounted.path("sys/class/tacho-motor")),
        ["motor0", "motor2", "motor3"]
    );
    assert_eq!(rig.read("outB", "driver_name"), "lego-ev3-m-motor");
    assert_eq!(
        kept.read_at(&mut buffer, 0).map_err(errno),
        Err(Errno::ENODEV),
        "the old file stays dead"
    );
}

#[test]
fn a_poll_sleeps_until_the_state_changes_and_the_removal_of_its_device_does_not_wake_it() {
    if no_fuse() {
        return;
    }
    let _alone = bench::real_time();
    in_real_time("poll", poll_states_and_touches);
}

fn poll_states_and_touches(pace: &Pace) {
    let mounted = Mounted::over(Bench::as_recorded(), Arc::new(MonotonicClock)).unwrap();
    let tree = LocalTree::new(mounted.root());
    let motor = "sys/class/tacho-motor/motor1";
    let state = tree.open(&format!("{motor}/state"), Access::Read).unwrap();
    let mut buffer = [0; 64];
    assert_eq!(state.wait_changed(Duration::ZERO), Ok(true), "never read");
    state.read(&mut buffer).unwrap();
    assert_eq!(state.wait_changed(Duration::from_millis(30)), Ok(false));
    let write = |attribute: &str, value: &str| {
        fs::write(mounted.path(&format!("{motor}/{attribute}")), value).unwrap();
    };
    write("time_sp", "150");
    write("speed_sp", "300");
    write("command", "run-timed");
    let started_ns = MonotonicClock.now_ns();
    assert_eq!(state.wait_changed(Duration::from_secs(2)), Ok(true));
    state.read(&mut buffer).unwrap();
    pace.ensure(buffer.starts_with(b"running"), || String::from_utf8_lossy(&buffer).into_owned());
    while buffer.starts_with(b"running") {
        assert_eq!(state.wait_changed(Duration::from_secs(20)), Ok(true));
        buffer = [0; 64];
        state.read(&mut buffer).unwrap();
    }
    let took_ms = (MonotonicClock.now_ns() - started_ns) / MILLISECOND_NS;
    println!("two changes of state in {took_ms} ms");
    pace.ensure((100..1500).contains(&took_ms), || format!("{took_ms} ms for a motion of 150 ms"));

    let touch = tree.open("sys/class/lego-sensor/sensor1/value0", Access::Read).unwrap();
    touch.read(&mut buffer).unwrap();
    std::thread::scope(|scope| {
        let waiting = scope.spawn(move || touch.wait_changed(Duration::from_secs(20)));
        MonotonicClock.sleep_ns(50 * MILLISECOND_NS);
        mounted.simulation.inspect(|bench: &mut Bench| bench.readings[1][0] = 1).unwrap();
        assert_eq!(waiting.join().unwrap(), Ok(true), "a press wakes");
    });

    state.read(&mut buffer).unwrap();
    mounted.simulation.unplug(0, Port::OutB).unwrap();
    let before_ns = MonotonicClock.now_ns();
    assert_eq!(state.wait_changed(Duration::from_millis(300)), Ok(true), "the last look finds it");
    let slept_ms = (MonotonicClock.now_ns() - before_ns) / MILLISECOND_NS;
    assert!(slept_ms >= 299, "woken after {slept_ms} ms, though its device went after 100 ms");
    assert_eq!(
        state.wait_changed(Duration::from_secs(20)),
        Ok(true),
        "one that begins is told at once"
    );
    assert_eq!(state.read(&mut buffer), Err(Errno::ENODEV));
}

#[test]
fn a_writer_who_waits_for_a_sensor_holds_up_nobody_else() {
    let clock = Arc::new(HandClock::default());
    let Some(mounted) = Mounted::over(Bench::as_recorded(), clock.clone()) else { return };
    mounted.simulation.record_writes(true);
    let path = mounted.path("sys/class/lego-sensor/sensor2/mode");
    std::thread::scope(|scope| {
        let writer = scope.spawn(|| OpenOptions::new().write(true).open(&path)?.write(b"RGB-RAW"));
        bench::await_or_fail("the first write", || !mounted.simulation.take_writes().is_empty());
        let second = OpenOptions::new().write(true).open(&path).unwrap();
        assert_eq!(second.write_at(b"COL-COLOR", 0).map_err(errno), Err(Errno::EBUSY));
        assert_eq!(fs::read_to_string(&path).unwrap(), "COL-REFLECT\n");
        assert!(!writer.is_finished(), "the first one waits");
        clock.move_to_ns(60 * MILLISECOND_NS);
        assert_eq!(writer.join().unwrap().map_err(errno), Ok(7));
        assert_eq!(fs::read_to_string(&path).unwrap(), "RGB-RAW\n");
    });
}

#[test]
fn several_robots_have_a_brick_each_and_one_clock() {
    let Some(mounted) = Mounted::in_world("two-arenas", 2, Arc::new(VirtualClock::default()))
    else {
        return;
    };
    assert_eq!(bench::names(mounted.mount().point()), ["1", "2"]);
    let motor = |robot: usize, attribute: &str| {
        mounted.mount().root(robot).join("sys/class/tacho-motor/motor1").join(attribute)
    };
    let position = |robot: usize| -> i64 {
        fs::read_to_string(motor(robot, "position")).unwrap().trim().parse().unwrap()
    };
    fs::write(motor(1, "speed_sp"), "300").unwrap();
    fs::write(motor(1, "command"), "run-forever").unwrap();
    mounted.clock.sleep_until_ns(SECOND_NS);
    assert_eq!(position(0), 0, "the other robot's");
    assert!(position(1) > 150, "{}", position(1));
    assert_eq!(
        fs::metadata(mounted.mount().point().join("3")).map(drop).map_err(errno),
        Err(Errno::ENOENT)
    );
}

#[test]
fn a_thousand_descriptors_and_readers_that_never_read_disturb_nobody() {
    let Some(mounted) = Mounted::recorded() else { return };
    let state = mounted.path("sys/class/tacho-motor/motor1/state");
    let buttons = mounted.path("dev/input/by-path/platform-gpio_keys-event");
    let kept: Vec<File> = (0..1000)
        .map(|index| {
            let path = if index % 10 == 0 { &buttons } else { &state };
            OpenOptions::new().read(true).custom_flags(nix::libc::O_NONBLOCK).open(path).unwrap()
        })
        .collect();
    for _ in 0..100 {
        mounted.simulation.press(0, onbrick::sim::Button::Up).unwrap();
        mounted.simulation.release(0, onbrick::sim::Button::Up).unwrap();
    }
    let started_ns = MonotonicClock.now_ns();
    let mut buffer = [0; 64];
    for (index, file) in kept.iter().enumerate().filter(|(index, _)| index % 10 != 0) {
        assert_eq!(file.read_at(&mut buffer, 0).map_err(errno), Ok(1), "descriptor {index}");
    }
    println!(
        "900 reads with 1000 descriptors open: {} us",
        (MonotonicClock.now_ns() - started_ns) / 1000
    );
    drop(kept);
    assert_eq!(fs::read_to_string(&state).unwrap(), "\n");
}

#[test]
fn shared_maps_are_refused_for_attributes_and_draw_on_the_screen() {
    let Some(mounted) = Mounted::recorded() else { return };
    let script = r#"
import mmap, os, sys
root = sys.argv[1]
fd = os.open(root + "/sys/class/tacho-motor/motor1/position", os.O_RDWR)
try:
    mmap.mmap(fd, 4096, mmap.MAP_SHARED)
    sys.exit("an attribute was mapped")
except OSError as error:
    assert error.errno == 19, error
fd = os.open(root + "/dev/fb0", os.O_RDWR)
picture = mmap.mmap(fd, os.fstat(fd).st_size, mmap.MAP_SHARED)
picture[712:716] = b"\x01\x02\x03\x04"
picture.flush()
"#;
    let python = Command::new("python3").args(["-c", script]).arg(mounted.mount().point()).output();
    let Ok(output) = python else {
        return crate::support::pass_over("python3, for maps of memory");
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let picture = mounted.simulation.lcd(0);
    assert_eq!((picture.len(), &picture[712..716]), (91_136, [1, 2, 3, 4].as_slice()));
}

#[test]
fn a_machine_without_fuse_is_told_of() {
    // The other tests pass over then; this one says so in the list of tests.
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let simulation =
        Simulation::new(Arc::new(VirtualClock::default()), Box::new(Bench::as_recorded()), 1);
    let (mount, found) =
        onbrick::sim::Mount::new(&simulation, folder.path(), EventLayout::NATIVE).unwrap();
    assert_eq!(found, onbrick::sim::Found::default());
    assert!(!mount.is_over());
    mount.unmount().unwrap();
    assert_eq!(bench::names(folder.path()), [""; 0], "the folder is as it was");
}
