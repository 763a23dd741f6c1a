//! Pairing between real processes and peers that do not keep to the rules: a hostile brick, a
//! hostile PC, and a brick that takes another one's name.

use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Child, Output, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use onbrick::link::keys::Authorised;
use onbrick::link::pairing::{CODE, COMMIT, well_known_key};
use onbrick::link::{KeyPair, KnownBrick, KnownBricks, PublicKey};
use serde_json::{Value, json};
use sha2::{Digest as _, Sha256};

use super::bench::{Service, halves, onbrick, text, until};
use crate::support::real_time::{beside_others, patiently};

/// The protocol's page, written down once more.
fn hash(parts: &[&[u8]]) -> [u8; 32] {
    parts.iter().fold(Sha256::new(), |hash, part| hash.chain_update(part)).finalize().into()
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn commitment(side: &[u8], key: &PublicKey, number: &[u8]) -> String {
    hexadecimal(&hash(&[COMMIT, side, key.as_bytes(), number]))
}

fn code(pc: (&PublicKey, &[u8]), brick: (&PublicKey, &[u8])) -> String {
    let hash = hash(&[CODE, pc.0.as_bytes(), brick.0.as_bytes(), pc.1, brick.1]);
    let number = u64::from_be_bytes(hash[..8].try_into().unwrap()) % 1_000_000;
    format!("{:03} {:03}", number / 1000, number % 1000)
}

/// Whatever was said, a terminal shows it and does nothing else.
#[track_caller]
fn is_harmless(said: &str) {
    let acts = |letter: char| {
        letter != '\n' && letter.is_control()
            || "\u{202e}\u{2066}\u{200b}\u{2028}\u{2029}".contains(letter)
    };
    assert!(!said.contains(acts), "{said:?}");
}

/// The code stands alone in a line, and what the other side calls itself nowhere before it.
#[track_caller]
fn code_before(said: &str, name: &str) -> String {
    let is_code = |line: &&str| {
        let signs: Vec<char> = line.trim().chars().collect();
        signs.len() == 7
            && (0..7).all(|at| if at == 3 { signs[at] == ' ' } else { signs[at].is_ascii_digit() })
    };
    let line = said
        .lines()
        .find(is_code)
        .unwrap_or_else(|| panic!("no code in a line of its own: {said:?}"));
    let before = said.split(line).next().unwrap();
    assert!(!before.contains(name) && said.contains(name), "{name} before the code: {said:?}");
    line.trim().to_owned()
}

/// A brick that answers at the pairing window what it likes.
struct Impostor {
    address: String,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Impostor {
    fn new(mut answer: impl FnMut(&Value) -> Value + Send + 'static) -> Self {
        let context = zmq::Context::new();
        let socket = context.socket(zmq::ROUTER).unwrap();
        socket.set_curve_server(true).unwrap();
        socket.set_curve_publickey(well_known_key().as_bytes()).unwrap();
        socket.set_curve_secretkey(&Sha256::digest(b"onbrick pairing, version 1")).unwrap();
        socket.set_rcvtimeo(50).unwrap();
        socket.set_linger(0).unwrap();
        socket.bind("tcp://127.0.0.1:*").unwrap();
        let endpoint = socket.get_last_endpoint().unwrap().unwrap();
        let over = Arc::new(AtomicBool::new(false));
        let is_over = Arc::clone(&over);
        let thread = std::thread::spawn(move || {
            while !is_over.load(Ordering::Relaxed) {
                let Ok(mut frames) = socket.recv_multipart(0) else { continue };
                let asked: Value = serde_json::from_slice(&frames.pop().unwrap()).unwrap();
                let mut reply = answer(&asked);
                reply["id"] = asked["id"].clone();
                frames.push(reply.to_string().into_bytes());
                socket.send_multipart(frames, 0).unwrap();
            }
        });
        Self {
            address: endpoint.trim_start_matches("tcp://").to_owned(),
            over,
            thread: Some(thread),
        }
    }

    /// One that keeps to the exchange, with a name and a last word of its own.
    fn exchanging(name: &str, last: Value) -> (Self, PublicKey) {
        let key = KeyPair::generate().unwrap().public();
        let number = [7_u8; 32];
        let name = name.to_owned();
        let impostor = Self::new(move |asked| match asked["step"].as_str().unwrap() {
            "commit" => {
                json!({"ok": {"step": "commit", "commit": commitment(b"B", &key, &number)}})
            }
            "reveal" => json!({"ok": {
                "step": "reveal", "key": key.to_string(), "number": hexadecimal(&number),
                "name": name
            }}),
            _ => last.clone(),
        });
        (impostor, key)
    }
}

impl Drop for Impostor {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(ended.is_ok() || std::thread::panicking(), "the impostor has died");
        }
    }
}

/// A brick whose answer is one message of 125 MB, in frames none of which is too long.
fn flood() -> (String, JoinHandle<zmq::Socket>) {
    let context = zmq::Context::new();
    let socket = context.socket(zmq::ROUTER).unwrap();
    socket.set_curve_server(true).unwrap();
    socket.set_curve_secretkey(&Sha256::digest(b"onbrick pairing, version 1")).unwrap();
    socket.set_linger(0).unwrap();
    socket.bind("tcp://127.0.0.1:*").unwrap();
    let endpoint = socket.get_last_endpoint().unwrap().unwrap();
    let thread = std::thread::spawn(move || {
        let mut frames = socket.recv_multipart(0).unwrap();
        frames.pop();
        frames.extend(std::iter::repeat_n(vec![b'x'; 64 << 10], 2000));
        socket.send_multipart(frames, 0).unwrap();
        socket
    });
    (endpoint.trim_start_matches("tcp://").to_owned(), thread)
}

#[test]
#[cfg_attr(
    target_arch = "arm",
    ignore = "QEMU's user mode knows no TCP_INFO, by which the PC sees it"
)]
fn an_answer_without_end_does_not_come_into_the_pcs_memory() {
    let (address, flood) = flood();
    let way = super::hostile::slow_way(address).to_string();
    let pc = Pc::new();
    let mut child = onbrick()
        .env("ONBRICK_KEYS", pc.keys())
        .args(["pair", &way, "--timeout", "60"])
        .stdin(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut peak_kb = 0;
    until("it gives up", || {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find(|line| line.starts_with("VmHWM:"));
        let now_kb =
            line.and_then(|line| line.split_whitespace().nth(1)).and_then(|kb| kb.parse().ok());
        peak_kb = peak_kb.max(now_kb.unwrap_or(0));
        child.try_wait().unwrap()
    });
    drop(flood.join().unwrap());
    let output = child.wait_with_output().unwrap();
    let said = text(&output.stderr);
    println!("the PC's peak is {peak_kb} kB");
    assert!(said.contains("much more than was asked for"), "{said}");
    assert!((1..80 << 10).contains(&peak_kb), "{peak_kb} kB");
}

/// A PC with a folder of keys.
struct Pc {
    folder: tempfile::TempDir,
}

impl Pc {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// `onbrick pair` at an address, with these answers.
    fn pair(&self, address: &str, answers: &str) -> Output {
        let path = self.folder.path().join("answers");
        std::fs::write(&path, answers).unwrap();
        onbrick()
            .env("ONBRICK_KEYS", self.keys())
            .args(["pair", address, "--name", "anna", "--timeout", "20", "--answers"])
            .arg(path)
            .output()
            .unwrap()
    }

    fn keys(&self) -> PathBuf {
        self.folder.path().join("keys")
    }

    fn known(&self) -> Vec<KnownBrick> {
        KnownBricks::load(&self.keys()).unwrap().iter().cloned().collect()
    }
}

#[test]
fn a_brick_whose_name_is_a_trick_of_the_terminal_is_refused_before_any_code_is_shown() {
    let tricks = [
        "ev3\u{1b}]0;",
        "ev3 should show this code:  111 111\u{1b}[8m",
        "ev3\r\u{1b}[2K",
        "a\nb",
        "\u{202e}3ve",
        "\u{9b}2J",
        "",
        "-ev3",
        "a b",
        &"x".repeat(500),
    ];
    for name in tricks {
        let (brick, _) = Impostor::exchanging(name, json!({"ok": {"step": "paired"}}));
        let pc = Pc::new();
        let output = pc.pair(&brick.address, "yes\nyes\n");
        let said = text(&output.stderr) + &text(&output.stdout);
        assert!(!output.status.success(), "{name:?}: {said:?}");
        assert!(said.contains("a name has 1 to 64 letters"), "{name:?}: {said:?}");
        is_harmless(&said);
        assert_eq!(pc.known(), [], "{name:?}");
    }
}

/// What a port that is forwarded to a brick does, an emulated one's for example, while the window
/// is not open there: it takes the connection, and closes it.
#[test]
fn a_pc_that_comes_before_the_window_is_open_waits_for_it_though_its_connections_are_closed() {
    let (brick, key) = Impostor::exchanging("ev3", json!({"ok": {"step": "paired"}}));
    let forward = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = forward.local_addr().unwrap().to_string();
    let window = brick.address.clone();
    std::thread::spawn(move || {
        for (number, pc) in forward.incoming().flatten().enumerate() {
            if number < 6 {
                continue;
            }
            let brick = TcpStream::connect(&window).unwrap();
            for (mut from, mut to) in [
                (pc.try_clone().unwrap(), brick.try_clone().unwrap()),
                (brick.try_clone().unwrap(), pc.try_clone().unwrap()),
            ] {
                std::thread::spawn(move || std::io::copy(&mut from, &mut to));
            }
        }
    });
    let pc = Pc::new();
    let output = pc.pair(&address, "yes\n");
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(pc.known()[0].key, key);
    let said = text(&output.stderr);
    assert!(said.contains(&format!("the port in {address} was for pairing only")), "{said}");
    assert!(said.contains("with --port"), "{said}");
    assert_eq!(pc.known()[0].address, "127.0.0.1");
}

#[test]
fn a_person_who_says_no_or_only_presses_enter_knows_nothing_new_whatever_the_brick_makes_of_it() {
    let (brick, _) = Impostor::exchanging("ev3", json!({"ok": {"step": "paired"}}));
    for answers in ["no\n", "\n", ""] {
        let pc = Pc::new();
        let output = pc.pair(&brick.address, answers);
        let said = text(&output.stderr);
        assert!(
            output.status.code() == Some(3) && said.contains("nothing was kept"),
            "{answers:?}: {said}"
        );
        assert_eq!(pc.known(), [], "{answers:?}");
    }
}

#[test]
fn whatever_a_brick_says_instead_of_an_answer_the_terminal_only_shows_it() {
    let loud = "\u{1b}]0;x\u{7}\u{1b}[2J\u{9b}31m\u{202e}abc\u{200b}\r";
    let cases = [
        json!({"ok": {"step": "failed", "why": loud}}),
        json!({"error": {"kind": "busy", "message": loud, "hint": loud}}),
        json!({"error": {"kind": "failed", "message": loud.repeat(10_000), "hint": null}}),
        json!({"ok": {"step": loud}}),
        json!({"ok": {loud: loud}}),
        json!({"ok": loud}),
        json!({"ok": {"step": "reveal", "key": loud, "number": loud, "name": loud}}),
        json!({}),
    ];
    for last in cases {
        // At the end of an exchange, and at its beginning.
        let beginning = last.clone();
        let (at_the_end, _) = Impostor::exchanging("ev3", last.clone());
        let at_once = Impostor::new(move |_| beginning.clone());
        for brick in [at_the_end, at_once] {
            let pc = Pc::new();
            let output = pc.pair(&brick.address, "yes\n");
            let said = text(&output.stderr) + &text(&output.stdout);
            assert!(!output.status.success(), "{said:?}");
            is_harmless(&said);
            assert!(said.chars().count() < 50_000, "{} characters", said.chars().count());
            assert_eq!(pc.known(), []);
        }
    }
}

#[test]
fn a_brick_that_shows_another_number_or_key_than_it_committed_to_is_refused() {
    let key = KeyPair::generate().unwrap().public();
    let other = KeyPair::generate().unwrap().public();
    for (key, number) in [(key, [8_u8; 32]), (other, [7; 32])] {
        let committed = commitment(b"B", &KeyPair::generate().unwrap().public(), &[7; 32]);
        let brick = Impostor::new(move |asked| match asked["step"].as_str().unwrap() {
            "commit" => json!({"ok": {"step": "commit", "commit": committed}}),
            _ => json!({"ok": {
                "step": "reveal", "key": key.to_string(), "number": hexadecimal(&number),
                "name": "ev3"
            }}),
        });
        let pc = Pc::new();
        let output = pc.pair(&brick.address, "yes\n");
        let said = text(&output.stderr);
        assert!(said.contains("another number than it had committed to"), "{said}");
        assert_eq!((output.status.code(), pc.known()), (Some(3), Vec::new()));
    }
}

#[test]
fn a_brick_of_a_known_name_with_another_key_is_asked_about_and_stays_out_unless_a_person_says_yes()
{
    let (brick, key) = Impostor::exchanging("ev3-blue", json!({"ok": {"step": "paired"}}));
    let pc = Pc::new();
    let old = KnownBrick {
        name: "ev3-blue".to_owned(),
        address: "ev3-blue.local".to_owned(),
        key: KeyPair::generate().unwrap().public(),
    };
    KnownBricks::load(&pc.keys()).unwrap().put(&old, None).unwrap();
    for answers in ["yes\nno\n", "yes\n\n", "yes\n"] {
        let output = pc.pair(&brick.address, answers);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{answers:?}: {said}");
        let fingerprints = [old.key.fingerprint(), key.fingerprint()];
        assert!(fingerprints.iter().all(|one| said.contains(one)), "{answers:?}: {said}");
        assert!(
            said.contains("ev3-blue stays as it was known") && said.contains("try: "),
            "{said}"
        );
        assert_eq!(pc.known(), std::slice::from_ref(&old), "{answers:?}");
    }
    let output = pc.pair(&brick.address, "yes\nyes\n");
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(pc.known().iter().map(|known| known.key).collect::<Vec<_>>(), [key]);

    // By hand the same holds.
    let key = old.key.to_string();
    let know = |more: &[&str]| {
        let mut command = onbrick();
        command.env("ONBRICK_KEYS", pc.keys()).args([
            "key",
            "know",
            "ev3-blue",
            "ev3-blue.local",
            &key,
        ]);
        let output = command.args(more).output().unwrap();
        (output.status.code(), text(&output.stderr))
    };
    let (exit, said) = know(&[]);
    assert!(
        exit == Some(3) && said.contains("with another key") && said.contains("--replace"),
        "{said}"
    );
    assert_eq!(know(&["--replace"]).0, Some(0));
    assert_eq!(pc.known(), [old]);
}

/// A person at the brick who opens the window and answers.
fn at_the_brick(service: &Service, answers: &str) -> Child {
    let path = service.path("answers");
    std::fs::write(&path, answers).unwrap();
    onbrick()
        .args(["pair", "--config"])
        .arg(service.folder.path())
        .arg("--answers")
        .arg(path)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// A PC's side of the window, word by word.
struct Window {
    own: KeyPair,
    socket: zmq::Socket,
    _context: zmq::Context,
}

impl Window {
    fn of(service: &Service) -> Self {
        let context = zmq::Context::new();
        let socket = context.socket(zmq::REQ).unwrap();
        let own = KeyPair::generate().unwrap();
        let (public, secret) = halves(&own);
        socket.set_curve_serverkey(well_known_key().as_bytes()).unwrap();
        socket.set_curve_publickey(&public).unwrap();
        socket.set_curve_secretkey(&secret).unwrap();
        socket.set_linger(0).unwrap();
        socket.set_rcvtimeo(30_000).unwrap();
        socket.connect(&format!("tcp://{}:5671", service.address)).unwrap();
        Self { own, socket, _context: context }
    }

    fn ask(&self, mut step: Value) -> Value {
        for (name, value) in [("version", json!(1)), ("id", json!(1)), ("op", json!("pair"))] {
            step[name] = value;
        }
        self.socket.send(step.to_string().as_bytes(), 0).unwrap();
        serde_json::from_slice(&self.socket.recv_bytes(0).unwrap()).unwrap()
    }

    /// Both steps; the code.
    fn exchange(&self, name: &str) -> String {
        let number = [3_u8; 32];
        let pc = self.own.public();
        let reply = self
            .ask(json!({"step": "commit", "name": name, "commit": commitment(b"P", &pc, &number)}));
        assert_eq!(reply["ok"]["step"], "commit", "{reply}");
        let revealed = self.ask(json!({"step": "reveal", "number": hexadecimal(&number)}));
        let brick = PublicKey::parse(revealed["ok"]["key"].as_str().unwrap()).unwrap();
        let theirs = revealed["ok"]["number"].as_str().unwrap();
        let theirs: Vec<u8> = (0..32)
            .map(|at| u8::from_str_radix(&theirs[at * 2..at * 2 + 2], 16).unwrap())
            .collect();
        assert_eq!(reply["ok"]["commit"], commitment(b"B", &brick, &theirs));
        code((&pc, &number), (&brick, &theirs))
    }
}

#[test]
fn a_pc_whose_name_is_a_trick_of_the_terminal_is_refused_and_the_brick_shows_nothing_of_it() {
    patiently("a PC whose name is a trick", || {
        let service = Service::new();
        let mut person = at_the_brick(&service, "yes\n");
        let window = Window::of(&service);
        let commit = "0".repeat(64);
        for name in ["ev\u{1b}]0;il", "a\n<3>error: b", "\u{202e}anna", "", "a b", &"x".repeat(300)]
        {
            let reply = window.ask(json!({"step": "commit", "name": name, "commit": commit}));
            assert_eq!(reply["error"]["kind"], "bad_request", "{name:?}: {reply}");
        }
        for step in ["\u{1b}[2J", "a\nb"] {
            let reply = window.ask(json!({"step": step}));
            assert_eq!(reply["error"]["kind"], "bad_request", "{step:?}: {reply}");
        }
        // A name that is one, and tries to look like a code.
        let name = "the-code-is.111-111";
        let code = window.exchange(name);
        let answer = window.ask(json!({"step": "answer", "same": true}));
        assert!(answer["ok"]["step"] == "waits" || answer["ok"]["step"] == "paired", "{answer}");
        let mut said = String::new();
        std::io::Read::read_to_string(&mut person.stderr.take().unwrap(), &mut said).unwrap();
        assert!(person.wait().unwrap().success(), "{said}");
        is_harmless(&said);
        is_harmless(&service.log());
        assert_eq!(code_before(&said, name), code);
        let authorised =
            Authorised::below(&service.path("keys")).find(&window.own.public()).unwrap();
        assert_eq!(authorised.as_deref(), Some(name));
    });
}

#[test]
fn a_pc_that_is_not_the_one_at_the_keyboard_is_not_let_in() {
    patiently("a PC in between", || {
        let service = Service::new();
        let person = at_the_brick(&service, "no\n");
        let window = Window::of(&service);
        window.exchange("eve");
        // It says yes, whatever the person says.
        window.ask(json!({"step": "answer", "same": true}));
        let said = until("the person has said no", || {
            let reply = window.ask(json!({"step": "how"}));
            (reply["ok"]["step"] != "waits").then_some(reply)
        });
        assert!(said["ok"]["step"] == "failed" || said["error"]["kind"] == "busy", "{said}");
        let output = person.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(3), "{}", text(&output.stderr));
        assert_eq!(Authorised::below(&service.path("keys")).list().unwrap(), []);
        // The window has taken its one exchange.
        let again = window.ask(json!({"step": "commit", "name": "eve", "commit": "0".repeat(64)}));
        assert_eq!(again["error"]["kind"], "busy", "{again}");
    });
}

#[test]
fn both_sides_show_the_code_alone_in_a_line_and_before_any_word_of_the_other() {
    let _machine = beside_others();
    patiently("the code on both sides", || {
        let service = Service::of("ev3-blue", &["--sim", "arena"]);
        let person = at_the_brick(&service, "yes\n");
        std::fs::write(service.path("yes"), "yes\n").unwrap();
        let yes = service.path("yes").display().to_string();
        let output = service.pc(&[
            "pair",
            &service.address,
            "--name",
            "anna",
            "--answers",
            &yes,
            "--timeout",
            "60",
        ]);
        let there = person.wait_with_output().unwrap();
        assert!(output.status.success() && there.status.success(), "{}", text(&output.stderr));
        let (here, there) = (text(&output.stderr), text(&there.stderr));
        assert_eq!(code_before(&here, "ev3-blue"), code_before(&there, "anna"));
    });
}
