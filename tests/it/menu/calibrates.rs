//! Calibrating on the brick's screen, from the first page to the new numbers: the real menu, the
//! real questions, a simulated robot that drives, and a person who knows nothing but the screen and
//! the robot before it.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};

use onbrick::commissioning::{CalibrateOptions, Dialogue, NoAnswer, Straight, calibrate};
use onbrick::ev3dev::Button;
use onbrick::menu::{Effect, Replies, ScreenDialogue, TalkKind, Told};
use onbrick::runtime::StopFlags;

use super::Bench;
use crate::setup::calibrate::{Measurer, assert_near, make_room, wrong};
use crate::setup::{self, load};

/// More presses than any answer takes.
const PRESSES: usize = 200;

/// The questions on their way to the screen, and the answers back from a person at the buttons.
struct AtTheScreen {
    menu: Bench,
    person: Measurer,
    /// What asks.
    dialogue: ScreenDialogue,
    /// What the screen gets of it, and where its answers go.
    told: Receiver<Told>,
    replies: Replies,
    /// The pages that were shown, to explain a failure.
    pages: Vec<String>,
}

impl AtTheScreen {
    fn new(person: Measurer, keys: &str, kind: TalkKind) -> Self {
        let mut menu = Bench::ready();
        menu.keys(keys);
        assert_eq!(menu.effects, [Effect::Talk(kind)]);
        let (sender, told) = channel();
        let (answers, replies) = channel();
        let (pressed, flags) = (Arc::default(), StopFlags::default());
        let dialogue = ScreenDialogue {
            told: sender,
            replies,
            pressed: Arc::clone(&pressed),
            flags: flags.clone(),
        };
        let replies = Replies { sender: answers, pressed, flags };
        Self { menu, person, dialogue, told, replies, pages: Vec::new() }
    }

    /// What was said by now is on the screen.
    fn read(&mut self) -> String {
        self.told.try_iter().for_each(|told| self.menu.menu.told(told));
        self.menu.turn();
        let page = self.menu.menu.text();
        self.pages.push(page.clone());
        page
    }

    fn press(&mut self, button: Button) -> String {
        self.menu.press(button);
        self.menu.menu.text()
    }

    /// Presses a button until the page shows this line.
    fn until(&mut self, button: Button, line: &str) {
        let mut page = self.menu.menu.text();
        for _ in 0..PRESSES {
            if page.lines().any(|shown| shown == line) {
                return;
            }
            page = self.press(button);
        }
        panic!("`{line}` is not reached with {button:?}:\n{page}");
    }

    /// Enter until the answer is on its way: the first presses may scroll.
    fn enter(&mut self) {
        self.menu.effects.clear();
        for _ in 0..PRESSES {
            self.press(Button::Enter);
            if let Some(Effect::Reply(reply)) = self.menu.effects.pop() {
                self.replies.sender.send(reply).unwrap();
                return;
            }
        }
        panic!("Enter does not answer:\n{}", self.menu.menu.text());
    }

    /// Asks over the dialogue while a person answers at the screen.
    fn ask<T: Send>(
        &mut self,
        ask: impl FnOnce(&mut ScreenDialogue) -> T + Send,
        answer: impl FnOnce(&mut Self),
    ) -> T {
        let unused = channel().1;
        let idle = ScreenDialogue {
            told: channel().0,
            replies: unused,
            pressed: Arc::default(),
            flags: StopFlags::default(),
        };
        let mut dialogue = std::mem::replace(&mut self.dialogue, idle);
        let (answered, dialogue) = std::thread::scope(|scope| {
            let asking = scope.spawn(move || (ask(&mut dialogue), dialogue));
            let question = self.told.recv().unwrap();
            self.menu.menu.told(question);
            answer(self);
            asking.join().unwrap()
        });
        self.dialogue = dialogue;
        answered
    }

    /// Writes a text over the one that stands there, letter by letter.
    fn write(&mut self, text: &str) {
        let written = |page: &str| {
            page.lines().last().unwrap_or_default().trim_start_matches("> ").to_owned()
        };
        let before = written(&self.menu.menu.text()).replace(['[', ']'], "");
        let length = before.chars().count().max(text.chars().count());
        let wanted: Vec<char> = format!("{text:length$}").chars().collect();
        for (place, letter) in wanted.iter().enumerate() {
            let mut presses = 0;
            while !written(&self.menu.menu.text()).contains(&format!("[{letter}]")) {
                self.press(if presses < 40 { Button::Down } else { Button::Up });
                presses += 1;
                assert!(presses < PRESSES, "no `{letter}`: {}", self.menu.menu.text());
            }
            if place + 1 < wanted.len() {
                self.press(Button::Right);
            }
        }
    }
}

impl Dialogue for AtTheScreen {
    fn say(&mut self, text: &str) {
        self.dialogue.say(text);
        let page = self.read();
        assert!(
            text.lines().all(|line| page.contains(line.trim())),
            "`{text}` is not on the screen:\n{page}"
        );
        self.person.say(text);
    }

    fn choose(
        &mut self,
        question: &str,
        choices: &[&str],
        default: usize,
    ) -> Result<usize, NoAnswer> {
        self.ask(
            |dialogue| dialogue.choose(question, choices, default),
            |here| {
                let page = here.read();
                assert!(page.contains(question), "`{question}` is not on the screen:\n{page}");
                let choice = here.person.choose(question, choices, default).unwrap();
                let way = if choice < default { Button::Up } else { Button::Down };
                here.until(way, &format!("> {}", choices[choice]));
                here.enter();
            },
        )
    }

    fn text(&mut self, question: &str, default: &str) -> Result<String, NoAnswer> {
        self.ask(
            |dialogue| dialogue.text(question, default),
            |here| {
                let page = here.read();
                assert!(page.contains(question), "`{question}` is not on the screen:\n{page}");
                let text = here.person.text(question, default).unwrap();
                here.write(&text);
                here.enter();
            },
        )
    }

    fn is_pressed(&mut self) -> bool {
        if self.person.is_pressed() {
            self.menu.effects.clear();
            self.press(Button::Enter);
            if self.menu.effects.contains(&Effect::Pressed) {
                self.replies.pressed.store(true, Ordering::Relaxed);
            }
        }
        self.dialogue.is_pressed()
    }
}

/// Calibrates a robot with wrong numbers at the screen; the questions and what was said, page by
/// page.
fn calibrated(what: &str, straight: Straight) -> Vec<String> {
    let bench = setup::Bench::new("", 1);
    if straight == Straight::Metre {
        make_room(&bench);
    }
    let robot = wrong(0.9, 1.1, straight != Straight::Metre);
    let mut screen = AtTheScreen::new(Measurer::new(&bench), "rrr d e", TalkKind::Calibrate);
    let flags = screen.replies.flags.clone();
    let options = CalibrateOptions { straight: Some(straight), ..CalibrateOptions::default() };
    let outcome =
        calibrate(&bench.tree, &*bench.clock, &flags, &mut screen, &load(&robot), &options);
    let calibration =
        outcome.unwrap_or_else(|error| panic!("{error}\n{}", screen.pages.join("\n")));
    bench.assert_still();
    assert_near(what, &bench, &robot, &calibration);
    let done = "robot.toml is written.".to_owned();
    screen.menu.menu.told(Told::Over(Ok(done.clone())));
    assert!(screen.read().contains(&done));
    // What is longer than the screen is read to its end first.
    for _ in 0..PRESSES {
        if screen.read().starts_with("[Set up]") {
            return screen.pages;
        }
        screen.press(Button::Enter);
    }
    panic!("the talk is not over:\n{}", screen.menu.menu.text());
}

#[test]
fn a_robot_is_calibrated_at_the_screen_with_five_buttons() {
    let pages = calibrated("at the screen, wall, gyro", Straight::Ask);
    let is_there = |words: &str| pages.iter().any(|page| page.contains(words));
    assert!(is_there("by what the range sensor hears again"), "{}", pages.join("\n"));
    assert!(!is_there("along a line"), "{}", pages.join("\n"));
}

#[test]
fn numbers_read_from_a_tape_are_written_letter_by_letter_at_the_screen() {
    let pages = calibrated("at the screen, tape, marks", Straight::Metre);
    assert!(pages.iter().any(|page| page.contains("stand along the line")), "{}", pages.join("\n"));
}

#[test]
fn the_range_sensor_is_measured_at_the_screen() {
    let bench = setup::Bench::new("[robot.errors]\nrange_walls_sd_db = 0.0\n", 1);
    let robot = wrong(1.0, 1.0, true);
    let mut screen = AtTheScreen::new(Measurer::new(&bench), "rrr dd e", TalkKind::Range);
    let flags = screen.replies.flags.clone();
    let options = TalkKind::Range.measures().unwrap();
    let outcome =
        calibrate(&bench.tree, &*bench.clock, &flags, &mut screen, &load(&robot), &options);
    let calibration =
        outcome.unwrap_or_else(|error| panic!("{error}\n{}", screen.pages.join("\n")));
    let bias = calibration.range_bias_m.unwrap();
    assert!((bias.after + 0.014).abs() < 0.006 && bias.doubt.is_none(), "{bias}");
}
