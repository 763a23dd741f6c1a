//! A class: several real services with simulated bricks, and `onbrick class` in a real browser, as
//! a teacher uses it.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use onbrick::link::{KeyPair, KnownBrick, KnownBricks};
use onbrick::protocol::LiveDevice;
use serde_json::{Value, json};

use super::bench::{Bench, Service, onbrick, until};
use crate::support::devtools::Tab;
use crate::support::real_time::{beside_others, patiently};

mod figures;

/// Sizes of what the page is looked at on.
const PROJECTOR: (u32, u32) = (1280, 720);
pub const PHONE: (u32, u32) = (390, 844);

/// `onbrick class`, and its page's address.
pub struct Class {
    folder: tempfile::TempDir,
    child: Child,
    pub url: String,
}

impl Class {
    /// A PC's folder of keys, before the page is there.
    fn keys(folder: &Path) -> PathBuf {
        folder.join("keys")
    }

    fn new(folder: tempfile::TempDir) -> Self {
        Self::started(folder, onbrick())
    }

    /// By this program, be it in a network of its own.
    pub fn started(folder: tempfile::TempDir, program: Command) -> Self {
        let (child, url) = Self::spawned(folder.path(), program);
        Self { folder, child, url }
    }

    /// The program is gone.
    fn end(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// The program is there again.
    fn start_again(&mut self) {
        (self.child, self.url) = Self::spawned(self.folder.path(), onbrick());
    }

    fn spawned(folder: &Path, mut program: Command) -> (Child, String) {
        let log = std::fs::File::create(folder.join("log")).unwrap();
        let mut child = program
            .env("ONBRICK_KEYS", Self::keys(folder))
            .current_dir(folder)
            .args(["--json", "class", "--folder", "monday"])
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said: Value = serde_json::from_str(&line).unwrap();
        (child, said["page"].as_str().unwrap().to_owned())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("monday").join(name)
    }

    /// The process's number.
    pub fn process(&self) -> u32 {
        self.child.id()
    }

    /// What it has said on its terminal.
    fn log(&self) -> String {
        std::fs::read_to_string(self.folder.path().join("log")).unwrap()
    }

    /// The answer to a request as it comes over the wire; the path is below the token.
    fn ask(&self, method: &str, path: &str, headers: &str, body: &str) -> String {
        let (host, token) = self.url.trim_start_matches("http://").split_once('/').unwrap();
        let path = path.replace("TOKEN/", token);
        let length = body.len();
        let request = format!(
            "{method} {path} HTTP/1.1\r\n{headers}Content-Length: {length}\r\nConnection: close\
             \r\n\r\n{body}"
        );
        let mut stream = TcpStream::connect(host).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    /// What the page is sent.
    fn state(&self) -> Value {
        let answer = self.ask("GET", "/TOKEN/state", "Host: localhost\r\n", "");
        serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap()
    }
}

impl Drop for Class {
    fn drop(&mut self) {
        self.end();
    }
}

/// Real services in this world that the PC with these keys knows.
fn services(names: &[&str], keys: &Path) -> Vec<Service> {
    let made = names.iter().map(|name| Service::of(name, &["--sim", "arena"]));
    made.inspect(|service| service.introduce_to(keys)).collect()
}

/// A card by the brick's name.
fn card(name: &str) -> String {
    format!(
        "[...document.querySelectorAll('.card')]\
         .find((one) => one.querySelector('h2').textContent === '{name}')"
    )
}

fn says(name: &str, words: &str) -> String {
    format!("{}.innerText.includes('{words}')", card(name))
}

#[test]
fn without_the_token_and_its_own_page_nothing_is_shown_and_nothing_done() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new();
    let keys = Class::keys(folder.path());
    bench.pc.save(&keys).unwrap();
    let brick =
        KnownBrick { name: "fake".to_owned(), address: bench.address(), key: bench.brick_key() };
    KnownBricks::load(&keys).unwrap().put(&brick, None).unwrap();
    let class = Class::new(folder);
    assert!(class.url.starts_with("http://127.0.0.1:"), "{}", class.url);
    let second = onbrick()
        .args(["class", "--folder", "monday", "--keys"])
        .arg(Class::keys(class.folder.path()))
        .current_dir(class.folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&second.stderr);
    assert_eq!(second.status.code(), Some(3), "{said}");
    assert!(said.contains("another onbrick class uses the folder monday"), "{said}");
    assert!(said.contains("--folder with another folder"), "{said}");
    until("the brick is heard", || (class.state()["bricks"][0]["state"] == "ready").then_some(()));
    const HOST: &str = "Host: localhost\r\n";
    const OWN: &str = "Host: localhost\r\nX-Onbrick: 1\r\n";
    for (method, path, headers, status) in [
        ("GET", "/", HOST, 404),
        ("GET", "/state", HOST, 404),
        ("GET", "/TOKEN/x/../state", HOST, 404),
        ("POST", "/stop", OWN, 404),
        ("POST", "/0123456789abcdef0123456789abcdef/stop", OWN, 404),
        ("POST", "/TOKEN/stop", HOST, 405),
        ("PUT", "/TOKEN/stop", OWN, 405),
        ("POST", "/TOKEN/stop", "Host: evil.example\r\nX-Onbrick: 1\r\n", 403),
        ("POST", "/TOKEN/stop", "X-Onbrick: 1\r\n", 403),
        (
            "POST",
            "/TOKEN/stop",
            "Host: localhost\r\nX-Onbrick: 1\r\nOrigin: http://evil.example\r\n",
            403,
        ),
        ("POST", "/TOKEN/stop", "Host: localhost\r\nX-Onbrick: 1\r\nOrigin: null\r\n", 403),
        ("GET", "/TOKEN/map/0/..%2F..", HOST, 400),
        ("GET", "/TOKEN/missions/text?name=../../keys/key", HOST, 400),
        ("GET", "/TOKEN/", HOST, 200),
    ] {
        let answer = class.ask(method, path, headers, "");
        let found: u16 = answer.split(' ').nth(1).unwrap().parse().unwrap();
        assert_eq!(found, status, "{method} {path} {headers}: {answer}");
    }
    let asked: Vec<String> =
        bench.fake.asked.lock().unwrap().iter().map(|(op, _)| op.clone()).collect();
    assert!(asked.iter().all(|op| op == "status"), "{asked:?}");
    let page = class.ask("GET", "/TOKEN/", HOST, "");
    let policy = page.lines().find(|line| line.starts_with("Content-Security-Policy:")).unwrap();
    assert!(policy.contains("default-src 'none'") && !policy.contains("unsafe"), "{policy}");
    assert_eq!(page.matches("<script").count(), page.matches("<script src=").count());
    assert!(!page.contains("<style") && !page.contains(" style=") && !page.contains(" onclick"));
    let big = "x".repeat(300_000);
    assert!(class.ask("POST", "/TOKEN/save", OWN, &big).starts_with("HTTP/1.1 500"));
    assert!(class.ask("POST", "/TOKEN/stop", OWN, "").starts_with("HTTP/1.1 200"));
    until("the stop has come", || {
        let asked = bench.fake.asked.lock().unwrap();
        asked.iter().any(|(op, _)| op == "stop").then_some(())
    });
}

#[test]
fn a_stop_is_told_at_once_while_another_order_to_the_same_brick_hangs() {
    let _machine = beside_others();
    patiently("a stop overtakes", || {
        let folder = tempfile::tempdir().unwrap();
        let bench = Bench::new();
        let keys = Class::keys(folder.path());
        bench.pc.save(&keys).unwrap();
        let (name, address) = ("fake".to_owned(), bench.address());
        let brick = KnownBrick { name, address, key: bench.brick_key() };
        KnownBricks::load(&keys).unwrap().put(&brick, None).unwrap();
        bench.fake.record("long", vec![7; 1 << 20], false);
        let class = Class::new(folder);
        let post = |path: &str, body: &Value| {
            let own = "Host: localhost\r\nX-Onbrick: 1\r\n";
            let answer = class.ask("POST", &format!("/TOKEN/{path}"), own, &body.to_string());
            assert!(answer.starts_with("HTTP/1.1 200"), "{path}: {answer}");
        };
        let brick = || class.state()["bricks"][0].clone();
        let count = |op: &str| {
            let asked = bench.fake.asked.lock().unwrap();
            asked.iter().filter(|(asked, _)| asked == op).count()
        };
        let one = json!({ "brick": 0 });
        let start = json!({ "bricks": [0], "name": "mine", "text": "name = 1" });
        for (op, path, order) in [
            ("status", "", &Value::Null),
            ("live", "", &Value::Null),
            ("identify", "identify", &one),
            // That has a connection of its own; the next question how the brick is hangs behind it.
            ("fetch", "fetch", &json!({ "brick": 0, "run": "long" })),
            ("start", "start", &start),
        ] {
            until("the brick is heard", || (brick()["silent_s"].is_null()).then_some(()));
            let before = count(op);
            *bench.fake.hangs.lock().unwrap() = Some(op);
            match path {
                "" => drop(class.ask("GET", "/TOKEN/ports/0", "Host: localhost\r\n", "")),
                path => post(path, order),
            }
            until("it hangs", || (count(op) > before).then_some(()));
            // By now it is asked again how it is.
            std::thread::sleep(Duration::from_millis(700));
            let stops = count("stop");
            if op == "start" {
                // A second one waits behind it.
                post("start", &start);
            }
            post("stop", &one);
            let told_s = until("the stop is told", || {
                let stop = &brick()["stop"];
                stop["told_after_s"].as_f64().filter(|_| count("stop") > stops)
            });
            println!("told after {told_s:.3} s while `{op}` hangs");
            assert!(told_s < 1.5, "{op}: {told_s} s");
            *bench.fake.hangs.lock().unwrap() = None;
        }
        until("it is said of the second", || {
            (brick()["said"][0] == "not done: a stop came first").then_some(())
        });
        let heard = count("status");
        until("it is heard again", || (count("status") > heard + 1).then_some(()));
        assert_eq!(count("start"), 1, "the second is never sent");
    });
}

#[test]
fn a_class_is_written_a_mission_tried_started_and_stopped() {
    let _machine = beside_others();
    patiently("a class", a_class);
}

fn a_class() {
    let folder = tempfile::tempdir().unwrap();
    let keys = Class::keys(folder.path());
    let mut bricks = services(&["ada", "bob"], &keys);
    let mut class = Class::new(folder);
    let Some(mut tab) = Tab::open(&class.url, PROJECTOR) else { return };
    for name in ["ada", "bob"] {
        tab.until(&says(name, "○ ready"));
    }
    tab.until("document.querySelector('#summary').textContent === '2 bricks: 0 driving, 0 wrong'");
    tab.picture("1-cards");

    // A mission, with the keyboard alone.
    tab.tab_to("Missions");
    tab.key("Enter");
    tab.until("document.querySelector('#work select').options.length > 3");
    tab.eval("document.querySelector('#work form input').focus()");
    tab.text("round");
    tab.key("Enter");
    tab.until("document.querySelector('#verdict').dataset.good === 'true'");
    let read = || std::fs::read_to_string(class.path("missions/round.toml")).unwrap();
    let whole = read();
    assert!(whole.contains("\nname = \"round\""), "its runs are called by its name: {whole}");
    tab.eval("document.querySelector('textarea').select()");
    tab.text("name = \"round\"\nrate = 3\n");
    tab.until("document.querySelector('.findings').innerText.includes('rate')");
    tab.until("document.querySelector('#verdict').textContent === 'not in order yet'");
    assert_eq!(
        tab.eval("document.querySelector('.findings').innerText.split(' ')[0]"),
        json!("1:1"),
        "the same place as `check` has, for what is missing: the file's beginning"
    );
    tab.picture("2-findings");
    until("the edit is kept", || (read() == "name = \"round\"\nrate = 3\n").then_some(()));
    tab.until("document.querySelector('#work p select').options.length === 2");
    tab.click("#work", "Start on all");
    tab.until("document.querySelector('#told').textContent.includes('not in order yet')");
    let map = std::fs::read_to_string(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/brick-image/missions/map.toml"
    ))
    .unwrap();
    std::fs::write(class.path("missions/round.toml"), "name = \"elsewhere\"\n").unwrap();
    tab.eval("document.querySelector('textarea').select()");
    tab.text(&map);
    tab.until("document.querySelector('#told').textContent.includes('changed elsewhere')");
    tab.until("document.querySelector('#verdict').dataset.good === 'true'");
    let kept = std::fs::read_dir(class.path("kept/round")).unwrap().count();
    assert!(kept >= 3, "each edit is kept: {kept}; the first: {whole}");

    // What cannot be saved stays until it can be.
    std::fs::write(class.path("missions/other.toml"), "name = \"other\"\n").unwrap();
    tab.eval("location.hash = '#/'");
    tab.until("document.querySelector('.card')");
    tab.eval("location.hash = '#/missions'");
    tab.until("document.querySelectorAll('#work .list button').length === 2");
    let grown = "document.querySelector('textarea').value.length > 70000";
    tab.eval(
        "(() => { const area = document.querySelector('textarea'); \
         area.value += '#'.repeat(70000); area.dispatchEvent(new Event('input')); })()",
    );
    let refused = "document.querySelector('#told').textContent.includes('at most 65536 bytes')";
    tab.until(refused);
    tab.eval("document.querySelector('#told').textContent = ''");
    tab.click("#work .list", "other");
    tab.until(refused);
    assert_eq!(tab.eval(grown), json!(true));
    tab.eval("document.querySelector('textarea').select()");
    tab.text(&map);
    tab.until("document.querySelector('#verdict').dataset.good === 'true'");

    // It is tried at once.
    tab.click("#work", "Try it here");
    tab.until(
        "document.querySelector('iframe').contentDocument\
         .querySelector('#phase').textContent === 'running'",
    );
    tab.until(
        "Number(document.querySelector('iframe').contentDocument\
         .querySelector('canvas').dataset.moved) > 0.02",
    );
    tab.picture("3-trial");
    // The key stops all in there, too.
    tab.eval("document.querySelector('iframe').contentDocument.querySelector('button').focus()");
    tab.key("Escape");
    tab.until("document.querySelector('#stopped').textContent.includes('2 still')");

    // On all.
    tab.click("#work", "Start on all");
    for name in ["ada", "bob"] {
        tab.until(&says(name, "▶ driving"));
        tab.until(&format!("Number({}.querySelector('canvas').dataset.path) > 3", card(name)));
    }
    let named = |end: &str| {
        let kept = std::fs::read_dir(class.path("kept/round")).unwrap();
        kept.filter(|file| file.as_ref().unwrap().file_name().to_str().unwrap().ends_with(end))
            .count()
    };
    assert_eq!((named("-ada.toml"), named("-bob.toml")), (1, 1), "kept by brick and time");
    tab.picture("4-driving");

    // One by its card's button, all by the keyboard.
    tab.tab_to("Stop ada");
    tab.key("Enter");
    tab.until(&says("ada", "still after"));
    assert_eq!(tab.eval(&says("bob", "▶ driving")), json!(true));
    tab.key("Escape");
    tab.until(&says("bob", "still after"));
    tab.until("document.querySelector('#stopped').textContent.includes('2 still')");
    tab.picture("5-stopped");
    let state = class.state();
    for brick in state["bricks"].as_array().unwrap() {
        let told_s = brick["stop"]["told_after_s"].as_f64().unwrap();
        println!("{}: told after {told_s:.3} s: {}", brick["name"], brick["stop"]);
    }

    // What ada did is here.
    tab.eval("location.hash = '#/brick/0'");
    tab.until("document.querySelector('#one').innerText.includes('round-')");
    tab.until("document.querySelector('#runs').innerText.includes('Map')");
    tab.click("#one", "Map");
    tab.until("document.querySelector('.map').naturalWidth > 100");
    tab.until(
        "document.querySelector('iframe').contentDocument\
         .querySelector('#phase').textContent === 'ended'",
    );
    // Its ports, while it stands.
    let ports = "document.querySelector('#ports').innerText";
    for told in ["outB", "left wheel", "lego-ev3-l-motor", "°"] {
        tab.until(&format!("{ports}.includes('{told}')"));
    }
    tab.picture("6-brick");
    tab.size(PHONE);
    for (place, name) in [("iframe", "6-brick-phone"), ("#ports", "6-ports-phone")] {
        tab.eval(&format!("document.querySelector('{place}').scrollIntoView()"));
        tab.picture(name);
    }
    tab.size(PROJECTOR);

    // One vanishes: its card says since when, comes first, and the other is as quick as before.
    tab.eval("location.hash = '#/'");
    bricks[1].kill();
    tab.key("Escape");
    tab.until(&says("bob", "no answer for"));
    assert_eq!(tab.eval(&says("bob", "not told yet")), json!(true));
    tab.until("document.querySelector('.card h2').textContent === 'bob'");
    tab.until("document.querySelector('#summary').textContent.endsWith('1 wrong')");
    tab.picture("7-vanished");
    tab.click("#cards", "Identify");
    assert_eq!(tab.eval(&says("ada", "stopped")), json!(true));
    bricks[1].start();
    tab.until(&says("bob", "ready"));
    tab.until(&says("bob", "still after"));
    tab.until("document.querySelector('#summary').textContent.endsWith('0 wrong')");

    // The page is closed while a person still types.
    tab.eval("location.hash = '#/missions'");
    tab.until("document.querySelector('textarea').value.length > 100");
    tab.eval("document.querySelector('textarea').select()");
    tab.text("name = \"last\"\n");
    tab.eval("location.href = 'about:blank'");
    until("the last edit is kept", || (read() == "name = \"last\"\n").then_some(()));

    // The program ends while a person still types: the page says so, and keeps the text.
    tab.eval(&format!("location.href = '{}#/missions'", class.url));
    tab.until("document.querySelector('#work .list button')");
    tab.click("#work", "round");
    tab.until("document.querySelector('textarea').value === 'name = \"last\"\\n'");
    class.end();
    tab.eval("document.querySelector('textarea').select()");
    tab.text("name = \"in no file\"\n");
    tab.until("document.querySelector('#summary').textContent.startsWith('no answer')");
    assert_eq!(
        tab.eval("document.querySelector('textarea').value"),
        json!("name = \"in no file\"\n")
    );
    tab.until("document.querySelector('#told').textContent.endsWith('does not answer')");
    tab.picture("8-ended");

    // It is started again, at the same address: what is open works, and is saved.
    class.start_again();
    tab.until("!document.querySelector('#view').classList.contains('lost')");
    let saved = || std::fs::read_to_string(class.path("missions/round.toml")).unwrap();
    until("the edit is kept", || (saved() == "name = \"in no file\"\n").then_some(()));
}

#[test]
fn a_brick_is_paired_with_its_code_compared_on_the_page() {
    let _machine = beside_others();
    patiently("pairing on the page", || {
        let folder = tempfile::tempdir().unwrap();
        let service = Service::of("cleo", &["--sim", "arena"]);
        let class = Class::new(folder);
        let Some(mut tab) = Tab::open(&class.url, PHONE) else { return };
        std::fs::write(service.path("yes"), "yes\n").unwrap();
        let mut there = onbrick()
            .args(["pair", "--config"])
            .arg(service.folder.path())
            .arg("--answers")
            .arg(service.path("yes"))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        tab.until("document.querySelector('#pairing input')");
        tab.eval("document.querySelector('#pairing input').focus()");
        tab.text(&service.address);
        tab.key("Enter");
        let code = tab.until("document.querySelector('.code').textContent");
        tab.picture("8-code");
        assert!(
            KnownBricks::load(&Class::keys(class.folder.path())).unwrap().iter().next().is_none()
        );
        tab.click("#pairing", "Yes");
        tab.until("document.querySelector('#pairing').innerText.includes('is known from now on')");
        tab.until(&says("cleo", "ready"));
        tab.picture("9-paired");
        let mut said = String::new();
        there.stderr.take().unwrap().read_to_string(&mut said).unwrap();
        assert!(there.wait().unwrap().success());
        assert!(said.contains(code.as_str().unwrap()), "the same code on both sides: {said}");
    });
}

#[test]
fn a_team_starts_from_its_poses_and_its_map_grows_in_one_picture() {
    let _machine = beside_others();
    patiently("a team on the page", a_team);
}

fn a_team() {
    let folder = tempfile::tempdir().unwrap();
    let keys = Class::keys(folder.path());
    let names = ["ada", "bob"];
    let made = names.iter().map(|name| Service::of(name, &["--sim", "two-arenas"]));
    let mut bricks: Vec<Service> = made.inspect(|one| one.introduce_to(&keys)).collect();
    let class = Class::new(folder);
    let text = onbrick::behavior::shipped::find("map").unwrap().text;
    let body = json!({ "name": "mine", "text": text }).to_string();
    let own = "Host: localhost\r\nX-Onbrick: 1\r\n";
    assert!(class.ask("POST", "/TOKEN/save", own, &body).starts_with("HTTP/1.1 200"));
    let Some(mut tab) = Tab::open(&class.url, PROJECTOR) else { return };
    for name in names {
        tab.until(&says(name, "ready"));
    }
    tab.eval("location.hash = '#/together'");
    for (row, pose) in [["0", "0", "0"], ["3", "0", "90"]].iter().enumerate() {
        tab.until(&format!("document.querySelectorAll('#team tbody tr').length > {row}"));
        tab.eval(&format!(
            "document.querySelectorAll('#team tbody tr')[{row}].querySelector('input').click()"
        ));
        for (column, value) in pose.iter().enumerate() {
            tab.eval(&format!(
                "(() => {{ const field = document.querySelectorAll('#team tbody tr')[{row}]\
                 .querySelectorAll('input[type=number]')[{column}]; field.value = '{value}'; \
                 field.dispatchEvent(new Event('input')); }})()"
            ));
        }
    }
    tab.until("document.querySelector('#field').getAttribute('aria-label').startsWith('2 robots')");
    // One that is away keeps all from starting.
    bricks[1].kill();
    tab.until(
        "fetch('state').then((answer) => answer.json())\
               .then(({ bricks }) => bricks[1].words === 'no answer')",
    );
    tab.click("#team", "Start together");
    tab.until("document.querySelector('#told').textContent.includes('bob does not answer')");
    assert_eq!(class.state()["bricks"][0]["mission"], Value::Null);
    bricks[1].start();
    tab.until(
        "fetch('state').then((answer) => answer.json())\
               .then(({ bricks }) => bricks[1].words === 'ready')",
    );
    tab.click("#team", "Start together");
    // What is said at once, and then of each, before any of them drives.
    tab.until("document.querySelector('#told').textContent === '2 bricks are asked to start mine'");
    for row in 0..2 {
        let row = format!("document.querySelectorAll('#team tbody tr')[{row}].textContent");
        tab.until(&format!("/(preparing|driving); .*mine/.test({row})"));
    }
    tab.until("Number(document.querySelector('#field').dataset.points) > 20");
    let state = class.state();
    assert_eq!(
        state["together"],
        json!({ "mission": "mine", "members": [[0, [0.0, 0.0, 0.0]], [1, [3.0, 0.0, 90.0]]] })
    );
    let x_m = |brick: usize| state["bricks"][brick]["pose"][0].as_f64().unwrap();
    assert!(x_m(0) < 1.5 && x_m(1) > 1.5, "each in its own place of one frame: {state}");
    // The recordings still grow, which is no fault of theirs.
    tab.until("fetch('map/team').then((answer) => answer.ok)");
    tab.picture("10-together");
    tab.key("Escape");
    tab.until("document.querySelector('#stopped').textContent.includes('2 still')");
    tab.click("#team", "Picture of the recordings");
    tab.until("document.querySelector('.map').naturalWidth > 100");
    tab.picture("11-merged");
    assert_eq!(class.log(), "");

    // A recording that is here gets another name, and is deleted.
    tab.eval("location.hash = '#/brick/1'");
    tab.until("document.querySelector('#one td input')");
    let name = tab.eval("document.querySelector('#one td input').value");
    let file = |name: &str| class.path("runs/bob").join(format!("{name}.mcap"));
    assert!(file(name.as_str().unwrap()).exists());
    tab.eval("document.querySelector('#one td input').value = 'best'");
    tab.click("#one td.row", "Rename");
    let label = "document.querySelector('#one td input').getAttribute('aria-label')";
    tab.until(&format!("{label} === 'Another name for best'"));
    assert!(file("best").exists() && !file(name.as_str().unwrap()).exists());
    tab.click("#one td.row", "Delete");
    tab.click("#one td.row", "Delete: sure?");
    until("it is deleted", || (!file("best").exists()).then_some(()));
    // The brick has it still.
    tab.click("#runs", "Fetch");
    until("it is fetched", || file(name.as_str().unwrap()).exists().then_some(()));
}

/// The contrast of every text against what it stands on, as WCAG 2 defines it: below 4.5, or 3
/// where it is large, it is listed.
const CONTRAST: &str = "(() => {
    const light = ([r, g, b]) => [r, g, b].map((c) => (c /= 255) <= 0.04045 ? c / 12.92
        : ((c + 0.055) / 1.055) ** 2.4)
        .reduce((sum, c, at) => sum + c * [0.2126, 0.7152, 0.0722][at], 0);
    const parts = (colour) => colour.match(/[\\d.]+/g).map(Number);
    const ground = (one) => { for (; one; one = one.parentElement) {
        const found = parts(getComputedStyle(one).backgroundColor);
        if (found.length < 4 || found[3] === 1) return found; } return [255, 255, 255]; };
    const poor = []; let looked = 0;
    for (const one of document.body.querySelectorAll('*')) {
        const shows = [...one.childNodes].some((node) => node.nodeType === 3 && node.data.trim())
            || ['INPUT', 'SELECT', 'TEXTAREA'].includes(one.tagName);
        if (!shows || !one.getClientRects().length || one.tagName === 'OPTION') continue;
        const style = getComputedStyle(one);
        const [a, b] = [light(parts(style.color)), light(ground(one))].sort((x, y) => y - x);
        const ratio = (a + 0.05) / (b + 0.05), size = parseFloat(style.fontSize);
        const large = size >= 24 || size >= 18.66 && style.fontWeight >= 700;
        looked++;
        if (ratio < (large ? 3 : 4.5)) poor.push(`${one.tagName} ${one.className} \
${one.textContent.slice(0, 30)} ${ratio.toFixed(2)}`);
    }
    return { looked, poor };
})()";

#[test]
fn every_text_has_the_contrast_of_wcag_aa_in_light_and_dark_and_fits_a_phone() {
    let _machine = beside_others();
    let folder = tempfile::tempdir().unwrap();
    let keys = Class::keys(folder.path());
    let bench = Bench::new();
    bench.pc.save(&keys).unwrap();
    // One of another version, one that is silent, and one that says something hostile.
    let put = |name: &str, address: &str| {
        let key = KeyPair::generate().unwrap().public();
        let key = if name == "older" { bench.brick_key() } else { key };
        let brick = KnownBrick { name: name.to_owned(), address: address.to_owned(), key };
        KnownBricks::load(&keys).unwrap().put(&brick, None).unwrap();
    };
    put("older", &bench.address());
    put("silent", "127.0.0.1:1");
    const HOSTILE: &str = "<i id=evil>the clock</i>";
    *bench.fake.clock.lock().unwrap() = Some(HOSTILE.to_owned());
    *bench.fake.devices.lock().unwrap() = vec![LiveDevice {
        port: "in1".to_owned(),
        driver: HOSTILE.to_owned(),
        role: Some("range".to_owned()),
        reading: "255 cm".to_owned(),
        motor: false,
    }];
    let class = Class::new(folder);
    let Some(mut tab) = Tab::open(&class.url, PROJECTOR) else { return };
    tab.until(&says("older", "it has onbrick 0, and this PC"));
    tab.until(&says("silent", "no answer for"));
    class.ask(
        "POST",
        "/TOKEN/save",
        "Host: localhost\r\nX-Onbrick: 1\r\n",
        &json!({ "name": "mine", "text": "name = \"mine\"\nrate = 3\n" }).to_string(),
    );
    for (size, device) in [(PROJECTOR, "projector"), (PHONE, "phone")] {
        tab.size(size);
        for scheme in ["light", "dark"] {
            tab.scheme(scheme);
            for view in ["", "missions", "together", "brick/0"] {
                tab.eval(&format!("location.hash = '#/{view}'"));
                match view {
                    "" => drop(tab.until(&says("silent", "no answer for"))),
                    "missions" => {
                        tab.click(".list", "mine");
                        tab.until("document.querySelector('.findings li')");
                    }
                    "together" => drop(tab.until("document.querySelector('#team tbody tr')")),
                    _ => drop(tab.until("document.querySelector('#ports td')")),
                }
                if view != "missions" && view != "together" {
                    tab.until(&format!("document.body.innerText.includes('{HOSTILE}')"));
                    assert_eq!(tab.eval("document.querySelector('#evil')"), Value::Null);
                }
                let found = tab.eval(CONTRAST);
                let what = format!("{view} {device} {scheme}");
                assert!(found["looked"].as_u64().unwrap() > 8, "{what}: {found}");
                assert_eq!(found["poor"], json!([]), "{what}");
                let [wide, room] = ["document.documentElement.scrollWidth", "innerWidth"];
                assert_eq!(tab.eval(wide), tab.eval(room), "{what} is scrolled sideways");
                tab.picture(&format!("look-{}-{device}-{scheme}", view.replace('/', "-")));
            }
        }
    }
}
