//! Buttons, speaker and screen through the mount.

use std::fs::{self, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Stdio};
use std::sync::Arc;

use nix::errno::Errno;
use onbrick::clock::{Clock, MILLISECOND_NS, MonotonicClock, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{Button, Buttons, EV3, LocalTree, Sound, Tree};
use onbrick::sim::{EventLayout, LcdGeometry, Mount, Options, Simulation};

use super::bench::{Mounted, await_or_fail, errno, no_fuse};
use crate::drivers_bench::Bench;

#[test]
#[cfg_attr(
    target_arch = "arm",
    ignore = "QEMU's user mode knows no EVIOCGKEY, which tells what is held at the start"
)]
fn our_own_buttons_and_sound_work_on_the_mount() {
    let Some(mounted) = Mounted::recorded() else { return };
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(mounted.root()));
    let simulation = &mounted.simulation;
    simulation.press(0, Button::Left).unwrap();
    let mut buttons = Buttons::open(&tree, &EV3).unwrap();
    assert!(
        buttons.held().contains(Button::Left),
        "held at the start, which only an ioctl can tell"
    );
    assert!(buttons.changes().unwrap().pressed.is_empty());
    simulation.press(0, Button::Enter).unwrap();
    simulation.release(0, Button::Left).unwrap();
    let changes = buttons.changes().unwrap();
    assert_eq!(changes.pressed.iter().collect::<Vec<_>>(), [Button::Enter]);
    assert_eq!(changes.released.iter().collect::<Vec<_>>(), [Button::Left]);
    for _ in 0..100 {
        simulation.press(0, Button::Up).unwrap();
        simulation.release(0, Button::Up).unwrap();
    }
    simulation.press(0, Button::Down).unwrap();
    while !buttons.held().contains(Button::Down) {
        buttons.changes().unwrap();
    }
    assert_eq!(
        buttons.held().iter().collect::<Vec<_>>(),
        [Button::Enter, Button::Down],
        "after a lost event"
    );

    let mut heard = OpenOptions::new().read(true).open(mounted.path(EV3.speaker.unwrap())).unwrap();
    let mut sound = Sound::open(&tree, &EV3).unwrap();
    sound.tone(440).unwrap();
    assert_eq!(simulation.tone_hz(0), Some(440));
    drop(sound);
    assert_eq!((simulation.tone_hz(0), simulation.last_tone_hz(0)), (None, Some(440)));
    let length = EventLayout::NATIVE.length();
    let mut events = vec![0; 4 * length];
    heard.read_exact(&mut events).unwrap();
    assert_eq!(
        events[length - 8..length],
        [0x12, 0, 2, 0, 0xb8, 1, 0, 0],
        "what was played can be read"
    );
}

#[test]
fn a_reader_waits_for_a_button_and_one_that_may_not_wait_is_told_so() {
    let Some(mounted) = Mounted::over(Bench::as_recorded(), Arc::new(MonotonicClock)) else {
        return;
    };
    let path = mounted.path(EV3.buttons.unwrap());
    let mut hasty =
        OpenOptions::new().read(true).custom_flags(nix::libc::O_NONBLOCK).open(&path).unwrap();
    let mut buffer = [0; 96];
    assert_eq!(hasty.read(&mut buffer).map_err(errno), Err(Errno::EAGAIN));
    std::thread::scope(|scope| {
        let patient = scope.spawn(|| {
            let mut file = OpenOptions::new().read(true).open(&path).unwrap();
            let mut buffer = [0; 96];
            file.read(&mut buffer).map(|length| buffer[..length].to_vec())
        });
        MonotonicClock.sleep_ns(100 * MILLISECOND_NS);
        assert!(!patient.is_finished(), "it waits");
        assert!(
            fs::read_to_string(mounted.path("sys/class/tacho-motor/motor0/position")).is_ok(),
            "others do not"
        );
        mounted.simulation.press(0, Button::Back).unwrap();
        let length = EventLayout::NATIVE.length();
        let events = patient.join().unwrap().unwrap();
        assert_eq!(
            (events.len(), &events[length - 8..length]),
            (2 * length, [1, 0, 14, 0, 1, 0, 0, 0].as_slice())
        );
    });
    assert_eq!(hasty.read(&mut buffer).unwrap(), 2 * EventLayout::NATIVE.length());
    let file = std::os::fd::AsFd::as_fd(&hasty);
    let mut watched = [nix::poll::PollFd::new(file, nix::poll::PollFlags::POLLIN)];
    assert_eq!(nix::poll::poll(&mut watched, 20_u16), Ok(0), "nothing to read");
    std::thread::scope(|scope| {
        scope.spawn(|| {
            MonotonicClock.sleep_ns(50 * MILLISECOND_NS);
            mounted.simulation.release(0, Button::Back).unwrap();
        });
        assert_eq!(nix::poll::poll(&mut watched, 5000_u16), Ok(1), "a poll is woken");
    });
}

#[test]
fn a_reader_that_is_killed_while_it_waits_dies_and_leaves_the_mount_alive() {
    let Some(mounted) = Mounted::over(Bench::as_recorded(), Arc::new(MonotonicClock)) else {
        return;
    };
    let mut cat = Command::new("cat")
        .arg(mounted.path(EV3.buttons.unwrap()))
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/wchan", cat.id());
    await_or_fail("a reader that waits", || {
        fs::read_to_string(&status)
            .is_ok_and(|place| place.contains("fuse") || place.contains("request_wait"))
    });
    cat.kill().unwrap();
    let started_ns = MonotonicClock.now_ns();
    let mut ended = None;
    await_or_fail("the reader's end", || {
        ended = cat.try_wait().unwrap();
        ended.is_some()
    });
    println!(
        "a killed reader was gone after {} ms",
        (MonotonicClock.now_ns() - started_ns) / MILLISECOND_NS
    );
    assert_eq!(ended.unwrap().signal(), Some(9));
    assert!(MonotonicClock.now_ns() - started_ns < SECOND_NS, "it hung");
    assert_eq!(
        fs::read_to_string(mounted.path("sys/class/tacho-motor/motor0/position")).unwrap(),
        "0\n"
    );
}

#[test]
fn a_program_of_the_brick_reads_its_own_layout_of_events() {
    if no_fuse() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let lcd: LcdGeometry = "178x128x1".parse().unwrap();
    let clock = Arc::new(VirtualClock::default());
    let options = Options { lcd, ..Options::default() };
    let simulation = Simulation::with_options(clock, Box::new(Bench::as_recorded()), 1, options);
    let options = EventLayout::Bits32;
    let (mount, _) = Mount::new(&simulation, folder.path(), options).unwrap();
    let mut buttons =
        OpenOptions::new().read(true).open(folder.path().join(EV3.buttons.unwrap())).unwrap();
    simulation.press(0, Button::Right).unwrap();
    let mut event = [0; 32];
    buttons.read_exact(&mut event).unwrap();
    assert_eq!(event[8..16], [1, 0, 106, 0, 1, 0, 0, 0]);
    let mut speaker =
        OpenOptions::new().write(true).open(folder.path().join(EV3.speaker.unwrap())).unwrap();
    speaker.write_all(&[0, 0, 0, 0, 0, 0, 0, 0, 0x12, 0, 2, 0, 0xe8, 3, 0, 0]).unwrap();
    assert_eq!(simulation.tone_hz(0), Some(1000));

    let screen =
        OpenOptions::new().read(true).write(true).open(folder.path().join("dev/fb0")).unwrap();
    assert_eq!(screen.metadata().unwrap().len(), 3072);
    screen.write_all_at(&[0xaa; 24], 24).unwrap();
    assert_eq!(simulation.lcd(0)[23..49], [&[0], [0xaa; 24].as_slice(), &[0]].concat());
    let mut row = [0; 24];
    screen.read_exact_at(&mut row, 24).unwrap();
    assert_eq!(row, [0xaa; 24]);
    assert_eq!(screen.write_at(&[1], 3072).map_err(errno), Err(Errno::ENOSPC));
    drop((buttons, speaker, screen));
    mount.unmount().unwrap();
}
