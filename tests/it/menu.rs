//! The menu: its pages as pictures, its buttons as transcripts, a monkey on the buttons, and the
//! real one against a real service.
#![cfg(feature = "host")]

mod calibrates;
mod live;
mod monkey;
mod pictures;
mod scripted;
mod transcripts;
mod window;

use std::collections::VecDeque;
use std::sync::Arc;

use onbrick::clock::MILLISECOND_NS;
use onbrick::ev3dev::Button;
use onbrick::menu::{Canvas, Effect, Lane, Menu, MenuOptions, StartedBy, Trouble};
use onbrick::protocol::{Answer, Caller, LocalRequest, Operations};

use scripted::Scripted;

/// One turn of the menu's loop.
const TURN_NS: i64 = 50 * MILLISECOND_NS;

/// An answer on its way.
type Flight = (i64, Result<Answer, Trouble>);

/// A menu and a scripted service, over a clock that the test moves.
struct Bench {
    menu: Menu,
    service: Arc<Scripted>,
    now_ns: i64,
    /// How long an answer takes.
    late_ns: i64,
    flights: [VecDeque<Flight>; 2],
    effects: Vec<Effect>,
    /// How many pictures there were, and the last.
    frames: u64,
    shown: Canvas,
}

impl Bench {
    fn started_by(started_by: StartedBy) -> Self {
        Self {
            menu: Menu::new(MenuOptions { started_by, no_talks: None, seed: 7 }),
            service: Arc::new(Scripted::default()),
            now_ns: 0,
            late_ns: 0,
            flights: Default::default(),
            effects: Vec::new(),
            frames: 0,
            shown: Canvas::default(),
        }
    }

    /// At boot, and two seconds later.
    fn ready() -> Self {
        let mut bench = Self::started_by(StartedBy::Boot);
        bench.pass(2000);
        bench
    }

    fn turn(&mut self) {
        self.now_ns += TURN_NS;
        self.service.at(self.now_ns);
        self.menu.tick(self.now_ns);
        for lane in Lane::ALL {
            let flights = &mut self.flights[lane as usize];
            while flights.front().is_some_and(|(due_ns, _)| *due_ns <= self.now_ns) {
                let (_, outcome) = flights.pop_front().unwrap();
                self.menu.learn(lane, outcome);
            }
            if let Some(request) = self.menu.next_request(lane) {
                let outcome = ask(&self.service, &request);
                self.flights[lane as usize].push_back((self.now_ns + self.late_ns, outcome));
            }
        }
        while let Some(effect) = self.menu.next_effect() {
            self.effects.push(effect);
        }
        self.look();
    }

    fn look(&mut self) {
        if let Some(picture) = self.menu.picture() {
            self.shown = picture.clone();
            self.frames += 1;
        }
    }

    /// What the screen shows now.
    fn screen(&mut self) -> Canvas {
        self.look();
        self.shown.clone()
    }

    fn pass(&mut self, milliseconds: i64) {
        for _ in 0..milliseconds * MILLISECOND_NS / TURN_NS {
            self.turn();
        }
    }

    /// Presses a button for a moment and lets the answer come.
    fn press(&mut self, button: Button) {
        self.menu.press(button);
        self.turn();
        self.menu.release(button);
        self.pass(200);
    }

    /// `u d l r e b`: up, down, left, right, Enter, Back.
    fn keys(&mut self, keys: &str) {
        for key in keys.chars().filter(|key| !key.is_whitespace()) {
            self.press(button_of(key));
        }
    }
}

fn button_of(key: char) -> Button {
    match key {
        'u' => Button::Up,
        'd' => Button::Down,
        'l' => Button::Left,
        'r' => Button::Right,
        'e' => Button::Enter,
        'b' => Button::Back,
        other => panic!("`{other}` is no key"),
    }
}

fn ask(service: &Scripted, request: &LocalRequest) -> Result<Answer, Trouble> {
    if service.is_gone() {
        return Err(Trouble::Gone("no service answers at /run/onbrick/socket".to_owned()));
    }
    let caller = Caller::Here;
    match request {
        LocalRequest::Shared(request) => service.shared(request, &caller),
        LocalRequest::Own(request) => service.own(request, &caller),
    }
    .map_err(Trouble::Refused)
}
