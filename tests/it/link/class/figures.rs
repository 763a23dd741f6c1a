//! A dozen bricks in one simulated world and a network of their own, and what befalls a class: a
//! cable pulled, a brick switched off, one that is not known yet; and forty stubs of an older
//! version.
//!
//! `ONBRICK_CLASS=1 cargo test --test it link::class::figures -- --nocapture` prints the figures;
//! `ONBRICK_PICTURES=FOLDER` keeps a picture of each step.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use onbrick::link::keys::Authorised;
use onbrick::link::{KeyPair, KnownBrick, KnownBricks};
use serde_json::{Value, json};

use super::super::bench::{Fake, serve, text, until};
use super::{Class, PROJECTOR, card, says};
use crate::foreign::bench::Simulator;
use crate::support::devtools::Tab;
use crate::support::network::Network;
use crate::support::not_asked_for;
use crate::support::real_time::{alone, in_real_time};

const ASKED_FOR: &str = "ONBRICK_CLASS";

/// How long is measured, seconds.
const MEASURED_S: u64 = 40;

/// The bounds that the page is to keep: percent of one processor, and megabytes.
const MOST_PERCENT: f64 = 5.0;
const MOST_MB: f64 = 60.0;

const NAMES: [&str; 12] =
    ["ada", "bob", "cleo", "dan", "eve", "finn", "gus", "hal", "ida", "jo", "kim", "lou"];

/// A hall with a place for each robot, and blocks between them.
fn world() -> String {
    let mut toml = String::from(
        "name = \"hall\"\n[[wall]]\npoints = [[-1.5, -1.5], [7.5, -1.5], [7.5, 5.5], [-1.5, 5.5]]\n\
         closed = true\n",
    );
    for at in 0..NAMES.len() {
        let [x, y] = [at % 4, at / 4].map(|place| 2.0 * f64::from(u8::try_from(place).unwrap()));
        writeln!(
            toml,
            "[[start]]\nat = [{x:?}, {y:?}]\n[[block]]\nat = [{:?}, {:?}]\nsize_m = [0.39, 0.19]",
            x + 1.0,
            y + 1.0
        )
        .unwrap();
    }
    toml
}

/// Processor time of a process in hundredths of a second, and its resident memory, megabytes.
fn cost(process: &Child) -> (u64, f64) {
    let read = |file: &str| {
        std::fs::read_to_string(format!("/proc/{}/{file}", process.id())).unwrap_or_default()
    };
    let stat = read("stat");
    let fields: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    let ticks = fields[11..13].iter().map(|field| field.parse::<u64>().unwrap()).sum();
    let status = read("status");
    let line = status.lines().find(|line| line.starts_with("VmRSS:")).unwrap();
    let kb: f64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
    (ticks, kb / 1e3)
}

/// What the page's server costs, and how often the page is filled meanwhile.
fn measured(what: &str, process: &Child, tab: &mut Tab) -> (f64, f64) {
    let turns = |tab: &mut Tab| tab.eval("Number(document.body.dataset.turns)").as_f64().unwrap();
    let (before, _) = cost(process);
    let (begun, first) = (Instant::now(), turns(tab));
    std::thread::sleep(Duration::from_secs(MEASURED_S));
    let ((after, mb), last) = (cost(process), turns(tab));
    let passed_s = begun.elapsed().as_secs_f64();
    let percent = (after - before) as f64 / passed_s;
    let rate = (last - first) / passed_s;
    println!(
        "{what}: {percent:.1} % of one processor, {mb:.0} MB, filled {rate:.2} times a second"
    );
    (percent, mb)
}

/// A service at an address of the bricks' machine.
struct Served {
    name: &'static str,
    folder: tempfile::TempDir,
    address: String,
    child: Child,
}

impl Served {
    fn start(
        network: &Network,
        program: &Path,
        name: &'static str,
        at: usize,
        brick: &Path,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let address = format!("10.77.0.{}", 10 + at);
        network.add_address(&address);
        let config = format!("name = \"{name}\"\n[link]\naddress = \"{address}\"\n");
        std::fs::write(folder.path().join("onbrick.toml"), config).unwrap();
        let log = std::fs::File::create(folder.path().join("log")).unwrap();
        let child = network
            .brick(program.to_str().unwrap())
            .args(["-v", "serve", "--config"])
            .arg(folder.path())
            .arg("--brick")
            .arg(brick)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .spawn()
            .unwrap();
        let served = Self { name, folder, address, child };
        until("the link listens", || served.log().contains("the link listens").then_some(()));
        served
    }

    fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("log")).unwrap_or_default()
    }

    fn introduce_to(&self, keys: &Path) {
        let pc = KeyPair::load_or_make(keys).unwrap();
        let own = self.folder.path().join("keys");
        Authorised::below(&own).add(&pc.public(), "teacher").unwrap();
        let key = KeyPair::load(&own).unwrap().public();
        let (name, address) = (self.name.to_owned(), self.address.clone());
        KnownBricks::load(keys).unwrap().put(&KnownBrick { name, address, key }, None).unwrap();
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn address(network: &Network, what: &str, bricks: &[Served]) {
    for brick in bricks {
        let ip = ["address", what, &format!("{}/24", brick.address), "dev", "cable"];
        assert!(network.brick("ip").args(ip).status().unwrap().success());
    }
}

#[test]
fn a_dozen_in_one_world_and_what_befalls_them() {
    if not_asked_for(ASKED_FOR) {
        return;
    }
    let _alone = alone();
    let Some(network) = Network::new() else { return };
    in_real_time("a dozen", |pace| {
        let folder = tempfile::tempdir().unwrap();
        let keys = Class::keys(folder.path());
        let world = folder.path().join("hall.toml");
        std::fs::write(&world, self::world()).unwrap();
        let simulator = Simulator::start_with(pace, world.to_str().unwrap(), &["--robots", "12"]);
        let own = PathBuf::from(env!("CARGO_BIN_EXE_onbrick"));
        let mut bricks: Vec<Served> = NAMES
            .iter()
            .enumerate()
            .map(|(at, name)| {
                let brick = simulator.root().join((at + 1).to_string());
                Served::start(&network, &own, name, at, &brick)
            })
            .collect();
        bricks.iter().filter(|brick| brick.name != "lou").for_each(|one| one.introduce_to(&keys));
        let class = Class::started(folder, network.pc(own.to_str().unwrap()));
        let mut browser = network.pc("sh");
        let Some(mut tab) = Tab::open_by(&mut browser, &class.url, PROJECTOR) else { return };
        let known = &NAMES[..11];
        for name in known {
            tab.until(&says(name, "ready"));
        }
        tab.picture("dozen-1-ready");
        measured("11 that wait", &class.child, &mut tab);
        // Its ports are asked once a second.
        tab.eval("location.hash = '#/brick/0'");
        tab.until("document.querySelector('#ports').innerText.includes('left wheel')");
        let one_waits = measured("the same, one of them opened", &class.child, &mut tab);
        tab.eval("location.hash = '#/'");
        tab.until(&says("ada", "ready"));

        // One mission on all.
        let explore = onbrick::behavior::shipped::find("explore").unwrap().text;
        let numbers: Vec<usize> = (0..known.len()).collect();
        let body = json!({ "bricks": numbers, "name": "explore", "text": explore }).to_string();
        tab.eval(&posted("start", &body));
        for name in known {
            tab.until(&says(name, "driving"));
        }
        tab.until("document.querySelector('#summary').textContent.includes('11 driving')");
        std::thread::sleep(Duration::from_secs(10));
        tab.picture("dozen-2-driving");
        let all_drive = measured("11 that drive", &class.child, &mut tab);
        tab.picture("dozen-3-mapped");
        tab.eval("location.hash = '#/brick/0'");
        tab.until(
            "document.querySelector('iframe').contentDocument\
             .querySelector('#phase').textContent === 'running'",
        );
        let one_drives = measured("the same, one of them opened", &class.child, &mut tab);
        tab.picture("dozen-3-opened");
        tab.eval("location.hash = '#/'");
        tab.until(&says("ada", "driving"));

        // A cable pulled from three, two switched off.
        address(&network, "del", &bricks[0..3]);
        for brick in &mut bricks[3..5] {
            brick.child.kill().unwrap();
        }
        for name in &NAMES[0..5] {
            tab.until(&says(name, "no answer for"));
        }
        let begun = Instant::now();
        let first = tab.eval(
            "[...document.querySelectorAll('.card h2')].slice(0, 5).map((one) => \
                              one.textContent).sort().join()",
        );
        println!("first on the page: {first}");
        tab.picture("dozen-4-five-vanished");
        tab.key("Escape");
        for name in &NAMES[5..11] {
            tab.until(&says(name, "still after"));
        }
        println!(
            "six are still {:.2} s after the key, as the page says",
            begun.elapsed().as_secs_f64()
        );
        tab.picture("dozen-5-stopped");
        let state: Value = tab.eval("fetch('state').then((answer) => answer.json())");
        for brick in state["bricks"].as_array().unwrap() {
            println!("{}: {} {}", brick["name"], brick["words"], brick["stop"]);
        }

        // They come back, and are told then.
        address(&network, "add", &bricks[0..3]);
        for name in &NAMES[0..3] {
            tab.until(&says(name, "still after"));
        }
        tab.picture("dozen-6-back");

        // The twelfth is introduced.
        let yes = class.folder.path().join("yes");
        std::fs::write(&yes, "yes\n").unwrap();
        let lou = &bricks[11];
        let there = network
            .brick(own.to_str().unwrap())
            .args(["pair", "--config"])
            .arg(lou.folder.path())
            .arg("--answers")
            .arg(&yes)
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        tab.eval("document.querySelector('#pairing input').focus()");
        tab.text(&lou.address);
        tab.key("Enter");
        tab.until("document.querySelector('.code').textContent");
        tab.picture("dozen-7-code");
        tab.click("#pairing", "Yes");
        tab.until(&says("lou", "ready"));
        tab.picture("dozen-8-paired");
        println!("{}", text(&there.wait_with_output().unwrap().stdout));
        for (percent, mb) in [one_waits, all_drive, one_drives] {
            assert!(percent <= MOST_PERCENT, "{percent} %");
            assert!(mb <= MOST_MB, "{mb} MB");
        }
    });
}

/// A post as the page makes it.
fn posted(path: &str, body: &str) -> String {
    format!(
        "fetch('{path}', {{ method: 'POST', headers: {{ 'X-Onbrick': '1' }}, body: {} }})\
         .then((answer) => answer.status)",
        json!(body)
    )
}

#[test]
fn forty_are_still_usable() {
    if not_asked_for(ASKED_FOR) {
        return;
    }
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let keys = Class::keys(folder.path());
    let pc = KeyPair::load_or_make(&keys).unwrap();
    let stubs: Vec<_> = (0..40)
        .map(|number| {
            let own = tempfile::tempdir().unwrap();
            Authorised::below(own.path()).add(&pc.public(), "teacher").unwrap();
            let server = serve(own.path(), &Arc::new(Fake::default()));
            let brick = KnownBrick {
                name: format!("brick-{number}"),
                address: format!("127.0.0.1:{}", server.port()),
                key: KeyPair::load(own.path()).unwrap().public(),
            };
            KnownBricks::load(&keys).unwrap().put(&brick, None).unwrap();
            (own, server)
        })
        .collect();
    let class = Class::started(folder, Command::new(env!("CARGO_BIN_EXE_onbrick")));
    let Some(mut tab) = Tab::open(&class.url, PROJECTOR) else { return };
    tab.until("document.querySelectorAll('.card .state').length === 40");
    for number in 0..40 {
        tab.until(&says(&format!("brick-{number}"), "ready"));
    }
    tab.until(&says("brick-0", "it has onbrick 0, and this PC"));
    tab.picture("forty");
    measured("40 stubs", &class.child, &mut tab);
    let begun = Instant::now();
    tab.key("Escape");
    tab.until("document.querySelector('#stopped').textContent.includes('40 still')");
    println!("40 are told and still {:.2} s after the key", begun.elapsed().as_secs_f64());
    let begun = Instant::now();
    tab.click("#cards", "Identify");
    tab.until(&format!("{}.innerText.includes('beeps')", card("brick-0")));
    println!("one identified after {:.2} s", begun.elapsed().as_secs_f64());
    drop(stubs);
}
