//! Buttons pressed, what the screen says and what the service was asked to do, as a transcript:
//! `tests/data/menu-transcripts.txt`. `ONBRICK_BLESS=1` rewrites it; read what changed.

use std::fmt::Write as _;

use onbrick::ev3dev::Button;
use onbrick::menu::StartedBy;
use onbrick::protocol::{Kind, Pairing, Refusal, State};
use onbrick::runtime::StopReason;
use onbrick::senses::Channel;

use super::scripted::last;
use super::{Bench, TURN_NS};

/// A bench whose keys are written down.
struct Session {
    bench: Bench,
    text: String,
}

impl Session {
    fn begin(text: &mut String, title: &str, started_by: StartedBy) -> Self {
        let mut bench = Bench::started_by(started_by);
        bench.pass(2000);
        let mut session = Self { bench, text: std::mem::take(text) };
        let _ = writeln!(session.text, "== {title}\n");
        session.note("two seconds after the start");
        session
    }

    fn note(&mut self, what: &str) {
        let _ = writeln!(self.text, "-- {what}\n{}", self.bench.menu.text());
        for done in self.bench.service.done() {
            let _ = writeln!(self.text, "=> {done}");
        }
        self.text.push('\n');
    }

    fn keys(mut self, keys: &str) -> Self {
        for key in keys.chars() {
            self.bench.press(super::button_of(key));
            self.note(&format!("{:?}", super::button_of(key)));
        }
        self
    }

    fn pass(mut self, milliseconds: i64) -> Self {
        self.bench.pass(milliseconds);
        self.note(&format!("{milliseconds} ms later"));
        self
    }

    fn happens(mut self, what: &str, happen: impl FnOnce(&Bench)) -> Self {
        happen(&self.bench);
        self.bench.pass(1000);
        self.note(what);
        self
    }

    fn end(self, text: &mut String) {
        *text = self.text;
    }
}

fn compare(now: &str) {
    let path = format!("{}/tests/data/menu-transcripts.txt", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("ONBRICK_BLESS").is_some() {
        std::fs::write(&path, now).unwrap();
    }
    let read = std::fs::read_to_string(&path).unwrap_or_default();
    for (at, (now, read)) in now.lines().zip(read.lines()).enumerate() {
        assert_eq!(now, read, "line {} of {path}; ONBRICK_BLESS=1 rewrites it", at + 1);
    }
    assert_eq!(now.lines().count(), read.lines().count(), "{path}; ONBRICK_BLESS=1 rewrites it");
}

#[test]
fn sessions_at_the_brick_go_as_they_were_written_down() {
    let mut text = String::new();
    Session::begin(
        &mut text,
        "A mission is started, watched, stopped by hand, and its map looked at",
        StartedBy::Boot,
    )
    .keys("dee")
    .pass(3000)
    .keys("r")
    .happens("Enter, which the run's own process hears", |bench| bench.service.hand_stop())
    .keys("e")
    .pass(3000)
    .keys("lb")
    .end(&mut text);
    Session::begin(
        &mut text,
        "In a terminal the menu asks for the stop itself",
        StartedBy::Terminal,
    )
    .keys("ee")
    .pass(2000)
    .keys("b")
    .pass(1000)
    .keys("de")
    .end(&mut text);
    Session::begin(
        &mut text,
        "A run that was stopped before it drove has no map",
        StartedBy::Terminal,
    )
    .keys("ee")
    .happens("a stop while it still prepares", |bench| {
        let mut world = bench.service.world();
        world.status.last = Some(last(StopReason::Here));
        world.status.run = None;
        world.enter(State::Stopped);
    })
    .keys("e")
    .end(&mut text);
    Session::begin(
        &mut text,
        "A mission that is refused, and one that is broken",
        StartedBy::Brickman,
    )
    .happens("the gyro is unplugged", |bench| {
        bench.service.world().refuses = Some(
            Refusal::new(Kind::NotReady, "the gyro on in4 is not plugged in")
                .hint("onbrick doctor"),
        );
    })
    .keys("eeelddee")
    .end(&mut text);
    Session::begin(&mut text, "A run is deleted, after another was kept", StartedBy::Boot)
        .keys("reeeede")
        .end(&mut text);
    Session::begin(&mut text, "Settings and pairing", StartedBy::Boot)
        .keys("ledeedde")
        .end(&mut text);
    Session::begin(&mut text, "A PC is paired", StartedBy::Boot)
        .keys("lddde")
        .keys("e")
        .happens("a PC asks", |bench| {
            bench.service.world().pairing =
                Pairing::Compare { code: "482 915".to_owned(), name: "annas-laptop".to_owned() };
        })
        .keys("dee")
        .end(&mut text);
    Session::begin(
        &mut text,
        "The page of pairing is left while its window is open",
        StartedBy::Boot,
    )
    .keys("ldddeeb")
    .end(&mut text);
    Session::begin(&mut text, "A fault is acknowledged", StartedBy::Boot)
        .happens("a plug is loose", |bench| {
            let mut world = bench.service.world();
            world.status.last = Some(last(StopReason::Lost(Channel::Range)));
            world.enter(State::Fault);
        })
        .keys("r")
        .keys("e")
        .end(&mut text);
    Session::begin(&mut text, "The service dies under a run and comes back", StartedBy::Boot)
        .keys("ee")
        .pass(1000)
        .happens("it dies", |bench| bench.service.world().gone = true)
        .keys("e")
        .happens("it is back", |bench| bench.service.world().gone = false)
        .end(&mut text);
    compare(&text);
}

#[test]
fn a_motor_turns_as_long_as_a_button_is_held_and_no_longer() {
    let mut bench = Bench::ready();
    bench.keys("rr ddde");
    bench.service.done();
    bench.menu.press(Button::Up);
    bench.pass(1000);
    let jogs = bench.service.done();
    assert!(
        (9..=11).contains(&jogs.len()) && jogs.iter().all(|jog| jog == "jog outB 30"),
        "{jogs:?}"
    );
    assert!(bench.service.world().turning.contains_key("outB"));
    bench.menu.release(Button::Up);
    bench.pass(100);
    assert_eq!(bench.service.done(), ["jog outB 0"]);
    assert!(bench.service.world().turning.is_empty());
    // Another client starts a run while it is held.
    bench.menu.press(Button::Down);
    bench.pass(200);
    bench.service.world().begin("map", "laptop");
    bench.pass(1000);
    assert_eq!(bench.service.done().last().map(String::as_str), Some("jog outB 0"));
    assert!(bench.service.world().turning.is_empty(), "a run began");
    assert!(bench.menu.text().starts_with("[Running]"), "{}", bench.menu.text());
}

#[test]
fn a_refused_jog_says_so_once_and_is_not_repeated() {
    let mut bench = Bench::ready();
    bench.keys("rr ddde");
    bench.service.world().refuses =
        Some(Refusal::new(Kind::Busy, "setting up at the menu has the motors"));
    bench.menu.press(Button::Up);
    bench.pass(2000);
    assert!(
        bench.menu.text().contains("setting up at the menu has the motors"),
        "{}",
        bench.menu.text()
    );
    assert!(bench.service.world().turning.is_empty(), "{:?}", bench.service.done());
}

#[test]
fn a_stop_on_the_brick_is_asked_for_only_if_the_run_goes_on_a_second_later() {
    let mut bench = Bench::ready();
    bench.keys("ee");
    bench.pass(2000);
    bench.service.done();
    bench.menu.press(Button::Enter);
    bench.pass(950);
    assert_eq!(bench.service.done(), [""; 0]);
    bench.pass(200);
    assert_eq!(bench.service.done(), ["stop (remote)"]);
}

#[test]
fn a_stop_does_not_wait_behind_a_list_that_comes_late() {
    let mut bench = Bench::started_by(StartedBy::Terminal);
    bench.pass(2000);
    bench.keys("ee");
    bench.pass(2000);
    bench.late_ns = 30 * 1_000_000_000;
    bench.pass(1000);
    bench.service.done();
    bench.menu.press(Button::Enter);
    bench.turn();
    assert_eq!(bench.service.done(), ["stop (remote)"]);
}

#[test]
fn two_presses_start_one_run_and_every_run_has_its_own_name() {
    let mut bench = Bench::ready();
    bench.late_ns = 20 * TURN_NS;
    bench.keys("e");
    bench.menu.press(Button::Enter);
    bench.menu.press(Button::Enter);
    bench.pass(5000);
    let started = bench.service.done();
    assert_eq!(started, ["start bump"]);
}
