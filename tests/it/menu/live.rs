//! The real menu against a real service: `onbrick menu` and `onbrick serve --sim`, as processes.
//!
//! `ONBRICK_MENU_KILLS=1000 cargo test --test it menu::live -- --nocapture` kills the menu that
//! many times; it prints how the runs ended.

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::sys::stat::Mode;
use nix::unistd::{Pid, mkfifo};
use onbrick::clock::MonotonicClock;
use onbrick::ev3dev::Button;
use onbrick::protocol::{
    Chosen, LocalOnly, Request, RunId, Start, Started, State, Status, Stopped,
};
use onbrick::service::client::Client;

use crate::mount::bench::{Mounted, real_time};
use crate::support::own_address;
use crate::support::real_time::in_real_time;
use crate::support::tested_program;

/// Far more than anything here takes on a machine that does other things as well.
const DEADLINE: Duration = Duration::from_secs(120);

/// A process that does not outlive its test.
pub(super) struct Running(pub(super) Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    /// SIGTERM, and how it ends then.
    pub(super) fn end(mut self) -> std::process::ExitStatus {
        kill(Pid::from_raw(i32::try_from(self.0.id()).unwrap()), Signal::SIGTERM).unwrap();
        self.0.wait().unwrap()
    }
}

pub(super) fn onbrick(arguments: &[&str]) -> Command {
    let mut command = Command::new(tested_program());
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

#[track_caller]
pub(super) fn eventually<T>(what: &str, mut look: impl FnMut() -> Result<T, String>) -> T {
    let began = Instant::now();
    loop {
        match look() {
            Ok(found) => return found,
            Err(last) => {
                assert!(began.elapsed() < DEADLINE, "{what}: not in {DEADLINE:?}; last:\n{last}")
            }
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A service with a folder of its own.
pub(super) struct Served {
    folder: tempfile::TempDir,
    /// `--sim` and a world, or `--brick` and a root.
    place: [String; 2],
    serve: Option<Running>,
}

impl Served {
    pub(super) fn new() -> Self {
        Self::at(["--sim", "arena"])
    }

    fn at(place: [&str; 2]) -> Self {
        let place = place.map(str::to_owned);
        let folder = tempfile::tempdir().unwrap();
        let config = format!("[link]\naddress = \"{}\"\n", own_address());
        fs::write(folder.path().join("onbrick.toml"), config).unwrap();
        let mut served = Self { folder, place, serve: None };
        served.begin();
        served
    }

    pub(super) fn config(&self) -> &str {
        self.folder.path().to_str().unwrap()
    }

    fn begin(&mut self) {
        let serve = onbrick(&["serve", &self.place[0], &self.place[1], "--config", self.config()])
            .spawn()
            .unwrap();
        self.serve = Some(Running(serve));
        self.until("the service answers", |_| true);
    }

    fn client(&self) -> Client {
        Client::at(self.folder.path().join("socket"))
    }

    fn status(&self) -> Result<Status, String> {
        self.client()
            .ask(&Request::Status, Duration::from_secs(5))
            .map_err(|error| error.to_string())
    }

    #[track_caller]
    fn until(&self, what: &str, so: impl Fn(&Status) -> bool) -> Status {
        eventually(what, || {
            let status = self.status()?;
            if so(&status) { Ok(status) } else { Err(format!("{status:?}")) }
        })
    }

    /// The machine had no time for the control loop, which ends the run as it should; nothing of
    /// the menu's can be seen then.
    fn is_too_slow(&self) -> bool {
        let last = self.status().ok().and_then(|status| status.last);
        last.is_some_and(|last| ["late", "guard"].contains(&last.stop.reason.word().as_str()))
    }

    fn stop(&self) {
        let stop = Request::Stop { run: None };
        let _: Stopped = self.client().ask(&stop, DEADLINE).unwrap();
        self.until("the run is over", |status| status.run.is_none());
    }

    fn start(&self, name: &str) {
        let run = RunId::new(name).unwrap();
        let start = Start {
            run,
            mission: Chosen::Name("map".to_owned()),
            token: None,
            pose: None,
            set: Vec::new(),
            no_button: false,
        };
        let asked = LocalOnly::StartHere(start);
        // The run before may just be letting go of the hardware.
        eventually("a run that is started", || {
            let started: Result<Started, _> = self.client().ask(&asked, DEADLINE);
            started.map_err(|error| error.to_string())
        });
    }
}

/// A menu whose keys come through a pipe, and whose pictures are files.
struct Piped {
    _menu: Running,
    keys: ChildStdin,
    frames: PathBuf,
}

impl Piped {
    fn at(served: &Served) -> Self {
        Self::with(served, &[])
    }

    fn with(served: &Served, more: &[&str]) -> Self {
        let frames = served.folder.path().join("frames");
        let mut command =
            onbrick(&["menu", "--config", served.config(), "--frames", frames.to_str().unwrap()]);
        let mut menu = command.args(more).stdin(Stdio::piped()).spawn().unwrap();
        let keys = menu.stdin.take().unwrap();
        Self { _menu: Running(menu), keys, frames }
    }

    fn keys(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    /// The page once it says this; `None` where the machine was too slow for the run.
    #[track_caller]
    fn shows(&self, served: &Served, what: &str) -> Option<String> {
        eventually(what, || {
            let page = self.page();
            match page.contains(what) {
                true => Ok(Some(page)),
                false if page.starts_with("[Fault]") && served.is_too_slow() => Ok(None),
                false => Err(page),
            }
        })
    }

    fn page(&self) -> String {
        fs::read_to_string(self.frames.join("page.txt")).unwrap_or_default()
    }

    fn pictures(&self) -> usize {
        let files = fs::read_dir(&self.frames).unwrap().map(|entry| entry.unwrap().path());
        files.filter(|path| path.extension().is_some_and(|ending| ending == "png")).count()
    }
}

/// Plays a scenario, and again where the machine was too slow for the run in it: what the scenario
/// says by `None`.
fn played(name: &str, scenario: impl Fn() -> Option<()>) {
    in_real_time(name, |pace| {
        pace.ensure(scenario().is_some(), || "the control loop was late".to_owned());
    });
}

#[test]
fn a_mission_is_chosen_started_watched_and_stopped_from_the_menu() {
    let _alone = real_time();
    played("a mission from the menu", || {
        let served = Served::new();
        let mut menu = Piped::at(&served);
        let missions = menu.shows(&served, "  map")?;
        let name = |line: &str| line.trim_start_matches("> ").trim().to_owned();
        let place = missions.lines().skip(1).position(|line| name(line) == "map").unwrap();
        menu.keys(&"d".repeat(place));
        menu.shows(&served, "> map")?;
        menu.keys("e");
        menu.shows(&served, "> Start")?;
        menu.keys("e");
        menu.shows(&served, "points")?;
        menu.keys("r");
        menu.shows(&served, "[Map]")?;
        // The map grows without a key.
        let before = menu.pictures();
        let grown = eventually("a map that grows", || match menu.pictures() {
            count if count > before + 2 => Ok(Some(())),
            _ if served.is_too_slow() => Ok(None),
            count => Err(format!("{count} pictures, {before} before")),
        });
        grown?;
        menu.keys("e");
        menu.shows(&served, "> Show the map")?;
        let last =
            served.until("the run is over", |status| status.state == State::Stopped).last.unwrap();
        assert_eq!((last.mission.as_str(), last.is_wanted()), ("map", true), "{last:?}");
        menu.keys("e");
        menu.shows(&served, "[Run 1]")?;
        menu.keys("ede");
        menu.shows(&served, "There are no runs yet.")?;
        Some(())
    });
}

#[test]
fn the_menu_says_when_the_service_is_gone_and_finds_it_again() {
    let mut served = Served::new();
    let menu = Piped::at(&served);
    menu.shows(&served, "[Missions]");
    served.serve = None;
    menu.shows(&served, "No service");
    served.begin();
    menu.shows(&served, "[Missions]");
}

#[test]
fn setting_up_on_the_screen_writes_the_robots_file_by_the_commands_own_code() {
    let Some(brick) = Mounted::in_world("arena", 1, Arc::new(MonotonicClock)) else { return };
    let _alone = real_time();
    let root = brick.root();
    let root = root.to_str().unwrap();
    let served = Served::at(["--brick", root]);
    let mut menu = Piped::with(&served, &["--brick", root]);
    menu.shows(&served, "[Missions]");
    menu.keys("rrr");
    menu.shows(&served, "> Set up the robot");
    menu.keys("e");
    // Every question is answered by what stands there at first; Enter scrolls where it is not in
    // view yet.
    let over = eventually("the end of the questions", || {
        let page = menu.page();
        if page.contains("robot.toml is written.") || page.contains("Nothing was written.") {
            return Ok(page);
        }
        if page.contains("\n> ") {
            // The next press only when this one has shown, if only by scrolling.
            let before = menu.pictures();
            menu.keys("e");
            eventually("another picture", || {
                if menu.pictures() > before { Ok(()) } else { Err(menu.page()) }
            });
        }
        Err(page)
    });
    assert!(over.contains("robot.toml is written."), "{over}");
    let written = fs::read(served.folder.path().join("robot.toml")).unwrap();
    let (robot, _) = onbrick::robot::RobotConfig::load("robot.toml", &written).unwrap();
    assert_eq!(robot.name, "mapper");
}

/// A brick's root with a screen and buttons, as plain files: enough for a menu.
struct Root {
    folder: tempfile::TempDir,
    buttons: File,
}

impl Root {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let class = folder.path().join("sys/class/graphics/fb0");
        fs::create_dir_all(&class).unwrap();
        for (name, text) in
            [("bits_per_pixel", "32\n"), ("virtual_size", "178,128\n"), ("stride", "712\n")]
        {
            fs::write(class.join(name), text).unwrap();
        }
        let buttons = folder.path().join(onbrick::ev3dev::EV3.buttons.unwrap());
        fs::create_dir_all(buttons.parent().unwrap()).unwrap();
        mkfifo(&buttons, Mode::S_IRWXU).unwrap();
        fs::write(folder.path().join("dev/fb0"), []).unwrap();
        // Open for both, so that neither side waits for the other.
        let buttons = OpenOptions::new().read(true).write(true).open(buttons).unwrap();
        Self { folder, buttons }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Writes an event as the kernel does.
    fn event(&mut self, button: Button, value: i32) {
        let mut event = vec![0; 2 * size_of::<std::ffi::c_long>()];
        event.extend(1_u16.to_ne_bytes());
        event.extend(button.code().to_ne_bytes());
        event.extend(value.to_ne_bytes());
        self.buttons.write_all(&event).unwrap();
    }

    fn screen(&self) -> Vec<u8> {
        fs::read(self.path().join("dev/fb0")).unwrap()
    }

    /// The screen once the list of missions is on it: the one that is chosen is a black bar, as the
    /// head is.
    #[track_caller]
    fn list(&self) -> Vec<u8> {
        eventually("a list of missions", || {
            let screen = self.screen();
            let black = screen.chunks_exact(4).filter(|pixel| pixel[..3] == [0; 3]).count();
            let is_there = screen.len() == 178 * 128 * 4 && black > 178 * 22;
            if is_there {
                Ok(screen)
            } else {
                Err(format!("{} bytes, {black} black pixels", screen.len()))
            }
        })
    }

    fn menu(&self, served: &Served, more: &[&str]) -> Running {
        let mut arguments =
            vec!["menu", "--config", served.config(), "--brick", self.path().to_str().unwrap()];
        arguments.extend(more);
        Running(onbrick(&arguments).spawn().unwrap())
    }
}

#[test]
fn the_bricks_buttons_turn_the_pages_on_its_screen() {
    let served = Served::new();
    let mut root = Root::new();
    let menu = root.menu(&served, &["--at-boot"]);
    let first = root.list();
    root.event(Button::Right, 1);
    root.event(Button::Right, 0);
    eventually("another page", || {
        if root.screen() == first { Err("the same".to_owned()) } else { Ok(()) }
    });
    let proc = fs::read_to_string(format!("/proc/{}/status", menu.0.id())).unwrap();
    let resident = proc.lines().find(|line| line.starts_with("VmRSS")).unwrap_or_default();
    println!("the menu's memory on this machine: {resident}");
    assert_eq!(menu.end().code(), Some(0), "SIGTERM is a way out like any other");
}

#[test]
fn a_menu_of_brickmans_that_is_killed_takes_its_run_with_it_and_one_of_ours_does_not() {
    let _alone = real_time();
    let kills: u64 =
        std::env::var("ONBRICK_MENU_KILLS").ok().and_then(|count| count.parse().ok()).unwrap_or(2);
    let served = Served::new();
    let root = Root::new();
    let mut ends = std::collections::BTreeMap::<String, u64>::new();
    // As many again and some more, where the machine was too slow for a run.
    for kill in 0..2 * kills + 20 {
        if ends.get("menu closed") >= Some(&kills) {
            break;
        }
        fs::write(root.path().join("dev/fb0"), []).unwrap();
        let mut menu = root.menu(&served, &[]);
        root.list();
        served.start(&format!("kill-{kill}"));
        // Anywhere between the start and some way into the drive.
        std::thread::sleep(Duration::from_millis(kill * 7919 % 6000));
        menu.0.kill().unwrap();
        menu.0.wait().unwrap();
        let status = served.until("the run is over", |status| status.run.is_none());
        *ends.entry(status.last.unwrap().stop.reason.word()).or_default() += 1;
    }
    println!("{kills} menus killed; the runs ended by {ends:?}");
    assert_eq!(ends.get("menu closed"), Some(&kills), "{ends:?}");
    assert!(
        ends.keys().all(|word| ["menu closed", "late", "guard"].contains(&word.as_str())),
        "{ends:?}"
    );

    played("a run that survives the menu", || {
        let menu = root.menu(&served, &["--at-boot"]);
        served.start(&format!("survives-{}", served.status().unwrap().state_s.to_bits()));
        let drives = |status: &Status| status.state == State::Running || status.run.is_none();
        served.until("it drives", drives);
        drop(menu);
        std::thread::sleep(Duration::from_secs(1));
        let status = served.status().unwrap();
        if status.run.is_none() && served.is_too_slow() {
            return None;
        }
        assert_eq!(status.state, State::Running, "{status:?}");
        served.stop();
        Some(())
    });
}
