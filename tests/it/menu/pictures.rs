//! Every page in every state as a picture that a person has looked at: `tests/data/menu/*.png`,
//! compared pixel by pixel. `ONBRICK_BLESS=1 cargo test --test it menu::` rewrites them; look at
//! what changed.

use std::path::PathBuf;

use nix::time::{ClockId, clock_gettime};
use onbrick::ev3dev::Button;
use onbrick::menu::{Canvas, HEIGHT, Menu, MenuOptions, StartedBy, TalkKind, Told, WIDTH};
use onbrick::protocol::{Kind, Missions, Pairing, Refusal, Runs, State};
use onbrick::recording;
use onbrick::runtime::StopReason;
use onbrick::senses::Channel;

use super::scripted::{last, mission, recorded, run_info};
use super::{Bench, TURN_NS};

fn path_of(name: &str) -> PathBuf {
    PathBuf::from(format!("{}/tests/data/menu/{name}.png", env!("CARGO_MANIFEST_DIR")))
}

fn read(name: &str) -> Option<Vec<u8>> {
    let mut reader =
        png::Decoder::new(std::fs::File::open(path_of(name)).ok()?).read_info().ok()?;
    let mut pixels = vec![0; reader.output_buffer_size()];
    reader.next_frame(&mut pixels).ok()?;
    Some(pixels)
}

fn write(name: &str, canvas: &Canvas) {
    std::fs::create_dir_all(path_of(name).parent().unwrap()).unwrap();
    let mut encoder =
        png::Encoder::new(std::fs::File::create(path_of(name)).unwrap(), WIDTH, HEIGHT);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(canvas.pixels()).unwrap();
}

/// Holds what is on the screen against the picture of this name.
fn holds(name: &str, bench: &mut Bench) {
    let canvas = bench.screen();
    if std::env::var_os("ONBRICK_BLESS").is_some() {
        write(name, &canvas);
    }
    let kept = read(name).unwrap_or_default();
    let differ = kept.iter().zip(canvas.pixels()).filter(|(kept, now)| kept != now).count();
    let text = bench.menu.text();
    assert!(
        kept.len() == canvas.pixels().len() && differ == 0,
        "{differ} pixels of {name}.png have changed; ONBRICK_BLESS=1 rewrites it. The page:\n{text}"
    );
}

#[test]
fn level_one_has_five_pages_that_left_and_right_turn() {
    let mut bench = Bench::ready();
    for name in ["missions", "runs", "ports", "set-up", "settings"] {
        holds(name, &mut bench);
        bench.keys("r");
    }
    holds("missions", &mut bench);
    bench.keys("ld dd");
    holds("settings-scrolled", &mut bench);
}

#[test]
fn lists_may_be_empty_long_or_not_there_yet() {
    let mut bench = Bench::started_by(StartedBy::Boot);
    bench.service.world().gone = true;
    holds("waiting", &mut bench);
    bench.pass(200);
    holds("no-service", &mut bench);
    bench.service.world().gone = false;
    bench.service.world().missions = Missions { missions: Vec::new() };
    bench.service.world().runs = Runs { runs: Vec::new() };
    bench.service.world().live.devices.clear();
    bench.pass(4000);
    holds("missions-none", &mut bench);
    bench.keys("r");
    holds("runs-none", &mut bench);
    bench.keys("r");
    holds("ports-none", &mut bench);
    let long =
        "Erkundungsfahrt durch das große Klassenzimmer der Ölmühle (Straßenseite) – äöü ñ é €";
    bench.service.world().missions.missions =
        vec![mission(long, None), mission("мир", None), mission("map", None)];
    bench.keys("ll");
    bench.pass(4000);
    bench.keys("d");
    holds("missions-long-names", &mut bench);
    bench.service.world().runs.runs =
        (0..60).map(|number| run_info(100 - number, "map", None)).collect();
    bench.keys("r ddddddddd");
    holds("runs-many", &mut bench);
}

#[test]
fn a_mission_says_what_it_is_or_what_is_wrong_with_it() {
    let mut bench = Bench::ready();
    bench.keys("de");
    holds("mission", &mut bench);
    bench.keys("l dde");
    bench.keys("e");
    holds("mission-broken", &mut bench);
    bench.keys("d");
    holds("mission-broken-scrolled", &mut bench);
    let mut brickman = Bench::started_by(StartedBy::Brickman);
    brickman.pass(2000);
    brickman.keys("e");
    holds("mission-under-brickman", &mut brickman);
    brickman.service.world().refuses = Some(
        Refusal::new(Kind::NotReady, "the gyro on in4 is not plugged in")
            .hint("onbrick doctor says what else is amiss"),
    );
    brickman.keys("e");
    holds("refused", &mut brickman);
}

#[test]
fn a_mission_speaks_in_the_letters_of_western_europe_and_others_leave_the_page_whole() {
    let mut bench = Bench::ready();
    bench.service.world().runs_by_itself = false;
    bench.keys("dee");
    bench.service.world().enter(State::Running);
    let mut progress = super::scripted::progress(37.0);
    progress.said =
        ["Größe: 3 Äpfel, à 20°", "¿Qué? Œuf, 5 €", "мир 雪 ☃", "a\u{308} e\u{301}\u{7}\u{1b}[2J"]
            .map(str::to_owned)
            .to_vec();
    progress.states[0].1 = "rückwärts".to_owned();
    {
        let mut world = bench.service.world();
        let run = world.status.run.as_mut().unwrap();
        run.mission = "grüße-zählen".to_owned();
        run.progress = Some(progress);
    }
    bench.pass(1000);
    holds("running-letters", &mut bench);
}

#[test]
fn a_run_shows_how_it_goes_and_its_map_grows() {
    let mut bench = Bench::ready();
    bench.service.world().runs_by_itself = false;
    bench.keys("dee");
    holds("preparing", &mut bench);
    bench.service.world().enter(State::Running);
    bench.service.world().status.run.as_mut().unwrap().progress =
        Some(super::scripted::progress(37.0));
    bench.pass(1000);
    holds("running", &mut bench);
    // The map from nothing to half of it, the robot where the recording says that it was.
    bench.service.world().recorded = 0;
    bench.keys("r");
    holds("map-none", &mut bench);
    for (name, share) in [("map-quarter", 4), ("map-half", 2)] {
        let bytes = recorded().len() / share;
        let run = recording::Run::read(&recorded()[..bytes]).unwrap();
        {
            let mut world = bench.service.world();
            world.recorded = bytes;
            let progress = world.status.run.as_mut().unwrap().progress.as_mut().unwrap();
            progress.pose = run.poses.last().unwrap().pose;
        }
        bench.pass(10_000);
        holds(name, &mut bench);
    }
    bench.keys("l");
    bench.service.world().status.battery_v = Some(6.4);
    bench.service.world().status.run.as_mut().unwrap().progress.as_mut().unwrap().battery_v =
        Some(6.4);
    bench.pass(1000);
    holds("running-flat-battery", &mut bench);
    bench.late_ns = 60 * 1_000_000_000;
    bench.pass(9000);
    holds("running-late", &mut bench);
    bench.late_ns = 0;
    bench.pass(60_000);
    bench.service.hand_stop();
    bench.pass(500);
    holds("stopping", &mut bench);
    {
        let mut world = bench.service.world();
        world.status.run = None;
        world.enter(State::Stopped);
    }
    bench.pass(500);
    holds("done", &mut bench);
}

#[test]
fn a_finished_run_has_a_still_map_and_can_be_deleted() {
    let mut bench = Bench::ready();
    bench.keys("r e");
    bench.pass(30_000);
    holds("run-map", &mut bench);
    bench.keys("e");
    holds("run-delete", &mut bench);
}

#[test]
fn a_fault_stays_until_somebody_has_seen_it() {
    let mut bench = Bench::ready();
    {
        let mut world = bench.service.world();
        world.status.last = Some(last(StopReason::Lost(Channel::Range)));
        world.enter(State::Fault);
    }
    bench.pass(1000);
    holds("fault", &mut bench);
    let mut bench = Bench::started_by(StartedBy::Boot);
    {
        let mut world = bench.service.world();
        let finding = "robot.toml:12:8: a port is outA, outB, outC or outD, not `outX`";
        world.status.robot = Some(finding.to_owned());
        world.enter(State::Fault);
    }
    bench.pass(1000);
    holds("fault-robot", &mut bench);
    bench.keys("e rrr");
    bench.pass(1000);
    holds("set-up-with-finding", &mut bench);
}

#[test]
fn a_port_shows_what_it_reads_and_turns_while_a_button_is_held() {
    let mut bench = Bench::ready();
    bench.keys("rr e");
    holds("port-sensor", &mut bench);
    bench.keys("l ddde");
    holds("port-motor", &mut bench);
    bench.service.world().live.devices.clear();
    bench.pass(500);
    holds("port-gone", &mut bench);
}

#[test]
fn settings_are_changed_and_a_pc_is_paired() {
    let mut bench = Bench::ready();
    bench.keys("l dde uuu");
    holds("time-limit", &mut bench);
    bench.keys("e");
    holds("settings-with-limit", &mut bench);
    bench.keys("d e");
    holds("pairing-closed", &mut bench);
    for (name, pairing) in [
        ("pairing-open", Pairing::Open { seconds: 96 }),
        (
            "pairing-compare",
            Pairing::Compare { code: "482 915".to_owned(), name: "Anna's laptop".to_owned() },
        ),
        ("pairing-paired", Pairing::Paired { name: "Anna's laptop".to_owned() }),
        ("pairing-failed", Pairing::Failed { why: "the codes are not the same".to_owned() }),
        (
            "pairing-no-link",
            Pairing::NoLink { why: "waits for entropy, which comes with use".to_owned() },
        ),
    ] {
        bench.service.world().pairing = pairing;
        bench.pass(1000);
        holds(name, &mut bench);
    }
    bench.service.world().status.link = "waits for entropy".to_owned();
    bench.keys("b ddd");
    bench.pass(1000);
    holds("settings-first-boot", &mut bench);
}

#[test]
fn setting_up_asks_on_the_screen() {
    let mut bench = Bench::ready();
    bench.keys("rrr e");
    holds("talk-begins", &mut bench);
    for line in [
        "Plugged in:",
        "  outA   lego-ev3-m-motor",
        "  outB   lego-ev3-l-motor",
        "  outD   lego-ev3-l-motor",
    ] {
        bench.menu.told(Told::Said(line.to_owned()));
    }
    bench.menu.told(Told::Write {
        question: "What is the robot called?".to_owned(),
        default: "mapper".to_owned(),
    });
    bench.turn();
    holds("talk-text", &mut bench);
    bench.keys("dd");
    holds("talk-text-scrolled", &mut bench);
    bench.keys("ruu");
    holds("talk-text-changed", &mut bench);
    bench.keys("e");
    bench.menu.told(Told::Said("The motor on outB turns now.".to_owned()));
    bench.turn();
    holds("talk-said", &mut bench);
    let choices = [
        "the left wheel",
        "the right wheel",
        "the head that carries the range sensor",
        "something else",
    ];
    bench.menu.told(Told::Choose {
        question: "What did the motor on outB move?".to_owned(),
        choices: choices.map(str::to_owned).to_vec(),
        default: 0,
    });
    bench.turn();
    holds("talk-choice", &mut bench);
    bench.keys("dd");
    holds("talk-choice-moved", &mut bench);
    bench.keys("e");
    bench.menu.told(Told::Over(Err("stopped; nothing was written".to_owned())));
    bench.turn();
    holds("talk-over", &mut bench);
    bench.keys("e");
    holds("set-up", &mut bench);
    let no_talks = Some("The service's simulated brick is not in this machine's files.".to_owned());
    bench.menu = Menu::new(MenuOptions { started_by: StartedBy::Terminal, no_talks, seed: 7 });
    bench.pass(2000);
    bench.keys("rrr");
    holds("set-up-elsewhere", &mut bench);
    assert_eq!(bench.effects.first(), Some(&onbrick::menu::Effect::Talk(TalkKind::SetUp)));
}

#[test]
fn nothing_is_drawn_while_nothing_changes_and_never_more_than_twenty_frames_a_second() {
    let mut bench = Bench::ready();
    let before = bench.frames;
    bench.pass(60_000);
    assert_eq!(bench.frames, before, "a minute in which nothing changed");
    bench.menu.press(Button::Down);
    bench.pass(10_000);
    let moved = bench.frames - before;
    assert!(
        (2..=3).contains(&moved),
        "a list of three, gone through while Down was held: {moved} frames"
    );
    bench.menu.release(Button::Down);
    bench.keys("uue e");
    bench.pass(2000);
    let before = bench.frames;
    bench.pass(10_000);
    let turns = u64::try_from(10_000_000_000 / TURN_NS).unwrap();
    let running = bench.frames - before;
    assert!((9..=turns / 4).contains(&running), "{running} frames in ten seconds of a run");
}

#[test]
fn a_turn_without_a_change_costs_far_less_than_a_picture() {
    let mut bench = Bench::ready();
    // By the thread's own clock: the machine may be busy.
    let spent =
        || std::time::Duration::from(clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).unwrap());
    let cost_us = |turns: u32, bench: &mut Bench, turn: &mut dyn FnMut(&mut Bench)| {
        let before = spent();
        (0..turns).for_each(|_| turn(bench));
        (spent() - before).as_secs_f64() * 1e6 / f64::from(turns)
    };
    let unchanged_us = cost_us(10_000, &mut bench, &mut |bench| bench.turn());
    let list_us = cost_us(1000, &mut bench, &mut |bench| {
        bench.menu.press(Button::Down);
        bench.menu.release(Button::Down);
        bench.menu.press(Button::Up);
        bench.menu.release(Button::Up);
        bench.menu.press(Button::Right);
        bench.turn();
    });
    bench.keys("b r e");
    bench.pass(30_000);
    let map_us = cost_us(1000, &mut bench, &mut |bench| {
        bench.menu.press(Button::Enter);
        bench.turn();
        bench.menu.press(Button::Back);
        bench.turn();
    });
    println!(
        "a turn: {unchanged_us:.1} us unchanged, {list_us:.0} us a page, {map_us:.0} us a map"
    );
    assert!(10.0 * unchanged_us < list_us && list_us < map_us);
}
