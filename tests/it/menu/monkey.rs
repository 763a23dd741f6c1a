//! A monkey on the buttons: whatever is pressed, however late the answers are, nothing panics,
//! nothing hangs, no motor is left on.
//!
//! The short form runs with the others; `ONBRICK_MONKEY=1000000 cargo test --test it menu::monkey
//! -- --nocapture` is the long one, and prints its figures.

use onbrick::clock::MILLISECOND_NS;
use onbrick::ev3dev::Button;
use onbrick::menu::{StartedBy, Told};
use onbrick::protocol::{Kind, Pairing, Refusal, State};
use onbrick::runtime::StopReason;
use onbrick::senses::Channel;

use super::Bench;
use super::scripted::{last, mission};

/// Chance that repeats: xorshift64 (Marsaglia, 2003).
struct Chance(u64);

impl Chance {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 16) % limit
    }
}

/// What happens beside the buttons.
fn happens(bench: &mut Bench, chance: &mut Chance) {
    let service = bench.service.clone();
    let mut world = service.world();
    match chance.below(24) {
        0 => world.gone = true,
        1..=3 => world.gone = false,
        4 => world.refuses = Some(Refusal::new(Kind::Failed, "it went wrong on the brick")),
        5 => world.begin("map", "laptop"),
        6 if world.status.run.is_some() => {
            world.status.run = None;
            world.status.last = Some(last(StopReason::Lost(Channel::Gyro)));
            world.enter(State::Fault);
        }
        7 => {
            world.pairing =
                Pairing::Compare { code: "482 915".to_owned(), name: "ÄÖÜ".to_owned() }
        }
        8 => world.missions.missions.clear(),
        9 => world.missions.missions = vec![mission("map", None), mission("bump", Some("broken"))],
        10 => world.live.devices.truncate(2),
        11 => {
            drop(world);
            let told = match chance.below(4) {
                0 => Told::Said("The motor on outB turns now.".to_owned()),
                1 => Told::Choose {
                    question: "Which?".to_owned(),
                    choices: vec!["a".to_owned(), "b".to_owned()],
                    default: 1,
                },
                2 => Told::Write { question: "How far?".to_owned(), default: "0.19".to_owned() },
                _ => Told::Over(Ok("robot.toml is written.".to_owned())),
            };
            bench.menu.told(told);
        }
        12 => bench.late_ns = i64::try_from(chance.below(40)).unwrap() * 100 * MILLISECOND_NS,
        13..=15 => bench.late_ns = 0,
        _ => {}
    }
}

fn play(presses: u32, seed: u64, started_by: StartedBy) -> u64 {
    let mut chance = Chance(seed);
    let mut bench = Bench::started_by(started_by);
    let mut held: Option<Button> = None;
    for _ in 0..presses {
        if let Some(button) = held.take() {
            bench.menu.release(button);
        }
        let button = Button::ALL[usize::try_from(chance.below(6)).unwrap()];
        bench.menu.press(button);
        held = Some(button);
        if chance.below(16) == 0 {
            happens(&mut bench, &mut chance);
        }
        for _ in 0..chance.below(3) {
            bench.turn();
        }
        if chance.below(8) == 0 {
            bench.menu.release(button);
            held = None;
            // Longer than a lease.
            bench.pass(400);
            let turning = bench.service.world().turning.clone();
            assert!(
                turning.is_empty(),
                "no button is held, and these turn: {turning:?} (seed {seed})"
            );
        }
    }
    if let Some(button) = held {
        bench.menu.release(button);
    }
    // The last orders may still be on their way, each as late as they get.
    bench.late_ns = 0;
    bench.service.world().gone = false;
    bench.pass(30_000);
    assert!(bench.service.world().turning.is_empty(), "a motor was left on (seed {seed})");
    assert!(!bench.menu.text().contains("No service"), "{}", bench.menu.text());
    // It still answers: the same presses lead from anywhere to the list of missions.
    bench.service.world().status.run = None;
    bench.service.world().status.last = None;
    bench.service.world().enter(State::Ready);
    bench.menu.told(Told::Over(Ok("robot.toml is written.".to_owned())));
    bench.pass(1000);
    for _ in 0..6 {
        let is_fault = bench.menu.text().starts_with("[Fault]");
        bench.keys(if is_fault { "e" } else { "b" });
    }
    bench.pass(1000);
    assert!(bench.menu.text().starts_with("[Missions]"), "{}", bench.menu.text());
    bench.frames
}

#[test]
fn whatever_is_pressed_the_menu_goes_on_and_no_motor_is_left_on() {
    let presses =
        std::env::var("ONBRICK_MONKEY").ok().and_then(|count| count.parse().ok()).unwrap_or(20_000);
    let games = [StartedBy::Boot, StartedBy::Brickman, StartedBy::Terminal];
    for (seed, started_by) in (1..).zip(games) {
        let frames = play(presses / 3 + 1, seed, started_by);
        println!("{started_by:?}: {} presses, {frames} frames", presses / 3 + 1);
    }
}
