//! What the menu's pictures cost, by the thread's own processor clock: `menu RUN FRAMEBUFFER`.
//!
//! The menu is the real one, and so is the screen; the service is played, so that only the menu's
//! part is counted. `RUN` is a recording whose map is drawn.

use std::error::Error;
use std::path::Path;
use std::time::Duration;

use nix::time::{ClockId, clock_gettime};
use onbrick::clock::MILLISECOND_NS;
use onbrick::ev3dev::{Button, Screen};
use onbrick::menu::{Lane, Menu, MenuOptions, StartedBy, WIDTH};
use onbrick::protocol::{Answer, LocalOnly, LocalRequest, Request};
use serde_json::{Value, json};

const TURN_NS: i64 = 50 * MILLISECOND_NS;

pub(crate) fn menu(run: &str, framebuffer: &str) -> Result<(), Box<dyn Error>> {
    let recording = std::fs::read(run)?;
    let screen = Screen::open(Path::new(framebuffer), Path::new("/"))?;
    let options = MenuOptions { started_by: StartedBy::Boot, no_talks: None, seed: 1 };
    let mut bench = Bench { menu: Menu::new(options), screen, recording, now_ns: 0, frames: 0 };
    bench.pass(100)?;
    bench.print("a turn, nothing new from the service", 2000, |bench| bench.turn())?;
    bench.print("a page of text, drawn and shown", 200, |bench| bench.key(Button::Right))?;
    // Twice five pages on it is the first again; the second has the runs.
    bench.key(Button::Right)?;
    bench.key(Button::Enter)?;
    bench.pass(2000)?;
    let before = bench.frames;
    // A question comes before the map, and goes: two pictures, of which one is the map.
    bench.print("a map and a page of text, drawn and shown", 100, |bench| {
        bench.key(Button::Enter)?;
        bench.key(Button::Back)
    })?;
    if bench.frames != before + 200 {
        return Err(
            format!("{} pictures in 100 turns to the map and back", bench.frames - before).into()
        );
    }
    let picture = onbrick::menu::Canvas::default();
    bench.print("of it, putting a picture on the screen", 200, |bench| {
        Ok(bench.screen.show(picture.pixels(), WIDTH as usize)?)
    })
}

struct Bench {
    menu: Menu,
    screen: Screen,
    recording: Vec<u8>,
    now_ns: i64,
    frames: u64,
}

impl Bench {
    /// Nanoseconds of processor time that one of this many of these takes.
    fn print(
        &mut self,
        what: &str,
        count: u32,
        mut one: impl FnMut(&mut Self) -> Result<(), Box<dyn Error>>,
    ) -> Result<(), Box<dyn Error>> {
        let spent = || clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map(Duration::from);
        let before = spent()?;
        for _ in 0..count {
            one(self)?;
        }
        println!("{}: {what}", (spent()?.saturating_sub(before) / count).as_nanos());
        Ok(())
    }

    fn turn(&mut self) -> Result<(), Box<dyn Error>> {
        self.now_ns += TURN_NS;
        self.menu.tick(self.now_ns);
        for lane in Lane::ALL {
            if let Some(request) = self.menu.next_request(lane) {
                let answer = self.answer(&request);
                self.menu.learn(lane, Ok(answer));
            }
        }
        if let Some(picture) = self.menu.picture() {
            self.screen.show(picture.pixels(), WIDTH as usize)?;
            self.frames += 1;
        }
        Ok(())
    }

    fn pass(&mut self, turns: u32) -> Result<(), Box<dyn Error>> {
        (0..turns).try_for_each(|_| self.turn())
    }

    fn key(&mut self, button: Button) -> Result<(), Box<dyn Error>> {
        self.menu.press(button);
        self.menu.release(button);
        self.turn()
    }

    fn answer(&self, request: &LocalRequest) -> Answer {
        let value = match request {
            LocalRequest::Shared(Request::Status) => status(),
            LocalRequest::Shared(Request::Missions) => {
                json!({ "missions": [mission("bump"), mission("map"), mission("wall")] })
            }
            LocalRequest::Shared(Request::Runs) => json!({ "runs": [run(&self.recording)] }),
            LocalRequest::Shared(Request::Fetch(fetch)) => {
                let offset =
                    usize::try_from(fetch.offset).unwrap_or(usize::MAX).min(self.recording.len());
                let end = (offset + fetch.length as usize).min(self.recording.len());
                let bytes = self.recording[offset..end].to_vec();
                let value = json!({
                    "run": fetch.run, "offset": offset, "length": bytes.len(),
                    "total": self.recording.len(),
                    "complete": end == self.recording.len(), "sha256": null,
                });
                return Answer { value, bytes: Some(bytes) };
            }
            LocalRequest::Shared(Request::Live) => json!({ "devices": [
                { "port": "in1", "driver": "lego-ev3-us", "role": "range", "reading": "82.4 cm",
                  "motor": false },
                { "port": "outB", "driver": "lego-ev3-l-motor", "role": "left wheel",
                  "reading": "120", "motor": true },
            ]}),
            LocalRequest::Own(LocalOnly::Settings) => json!({
                "brick": "ev3dev", "version": "0.1.0", "addresses": ["192.168.1.17"],
                "fingerprint": null,
                "lights": true, "sounds": true, "time_limit_s": null,
            }),
            _ => json!({}),
        };
        Answer { value, bytes: None }
    }
}

fn status() -> Value {
    json!({
        "brick": "ev3dev", "version": "0.1.0", "protocol": 1, "state": "ready", "state_s": 0.0,
        "run": null, "last": null,
        "battery_v": 7.9, "token": "", "link": "ready",
        "disk": { "used": 0, "quota": 1, "free": 1 }, "robot": null,
    })
}

fn mission(name: &str) -> Value {
    json!({ "name": name, "sha256": "", "time_limit_s": 120.0, "findings": null })
}

fn run(recording: &[u8]) -> Value {
    json!({
        "run": "r-1", "mission": "map", "number": 1, "bytes": recording.len(), "going_on": false,
        "fetched": false,
        "end": null, "travelled_m": null, "points": null,
    })
}
