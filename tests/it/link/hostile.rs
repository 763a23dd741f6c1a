//! What arrives that should not: each is refused or thrown away, memory stays bounded, and a friend
//! is served all the while.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use onbrick::link::KeyPair;
use onbrick::protocol::{MAX_REQUEST_BYTES, parse};
use serde_json::{Value, json};

use super::bench::{Bench, Service, halves, until};
use super::commands::{SHORT, newest};
use crate::support::chance::Chance;
use crate::support::real_time::{beside_others, patiently};
use crate::support::wall_clock::{replace, shim};

/// A request and its reply over a DEALER.
fn ask(socket: &zmq::Socket, request: &[u8]) -> Value {
    socket.send(request, 0).unwrap();
    let shown = String::from_utf8_lossy(&request[..request.len().min(200)]);
    let frames =
        socket.recv_multipart(0).unwrap_or_else(|error| panic!("no reply to `{shown}`: {error}"));
    serde_json::from_slice(&frames[0])
        .unwrap_or_else(|error| panic!("{error} in the reply to `{shown}`"))
}

#[test]
fn bad_requests_are_refused_each_under_its_own_name_and_the_next_is_answered() {
    let bench = Bench::new();
    let (_context, socket) = bench.raw(zmq::DEALER);
    let nested = format!(r#"{{"id":1,"version":1,"op":"status","x":{}"#, "[".repeat(100_000));
    let long_mission = "x".repeat(70_000);
    let cases: Vec<(Vec<u8>, &str)> = vec![
        (b"".to_vec(), "bad_request"),
        (b"\xff\xfe\x00".to_vec(), "bad_request"),
        (br#"{"id":1,"version":1,"op":"sta"#.to_vec(), "bad_request"),
        (nested.into_bytes(), "bad_request"),
        (br#"{"id":1,"version":1,"op":"status","op":"stop"}"#.to_vec(), "bad_request"),
        (br#"{"id":1,"version":2,"op":"status"}"#.to_vec(), "version"),
        (br#"{"id":1,"version":1,"op":"reboot"}"#.to_vec(), "unknown_operation"),
        (
            br#"{"id":1,"version":1,"op":"jog","port":"outA","percent":100}"#.to_vec(),
            "unknown_operation",
        ),
        (br#"{"id":1,"version":1,"op":"delete","run":"r"}"#.to_vec(), "unknown_operation"),
        (
            br#"{"id":1,"version":1,"op":"fetch","run":"../../etc/passwd","offset":0,"length":9}"#
                .to_vec(),
            "bad_request",
        ),
        (
            br#"{"id":1,"version":1,"op":"fetch","run":"r","offset":-1,"length":9}"#.to_vec(),
            "bad_request",
        ),
        (
            br#"{"id":1,"version":1,"op":"fetch","run":"r","offset":0,"length":9}"#.to_vec(),
            "unknown_run",
        ),
        (
            json!({"id": 1, "version": 1, "op": "stop", "run": long_mission})
                .to_string()
                .into_bytes(),
            "bad_request",
        ),
    ];
    for (request, kind) in cases {
        let reply = ask(&socket, &request);
        let shown = String::from_utf8_lossy(&request[..request.len().min(80)]).into_owned();
        assert_eq!(reply["error"]["kind"], kind, "{shown}: {reply}");
        assert!(reply["id"].is_null() || reply["id"] == 1, "{shown}: {reply}");
        assert!(
            reply["error"]["message"]
                .as_str()
                .is_some_and(|said| !said.is_empty() && said.len() < 400),
            "{reply}"
        );
    }
    // An older one and a newer one, either way: who asks is told which is which, and what to do.
    for (version, who, way_out) in [
        (0, "the onbrick that was asked is newer", "where this was asked"),
        (2, "the onbrick that was asked is older", "brick-image/install.sh"),
    ] {
        let request = json!({"id": 1, "version": version, "op": "status"}).to_string();
        let refused = &ask(&socket, request.as_bytes())["error"];
        assert!(refused["message"].as_str().unwrap().starts_with(who), "{refused}");
        assert!(refused["hint"].as_str().unwrap().contains(way_out), "{refused}");
    }
    let reply = ask(&socket, br#"{"id":"last","version":1,"op":"status","from the future":[1]}"#);
    assert_eq!((&reply["id"], &reply["ok"]["brick"]), (&json!("last"), &json!("fake")));
}

#[test]
fn a_request_in_several_frames_is_refused_and_req_and_dealer_are_both_clients() {
    let bench = Bench::new();
    let (_context, dealer) = bench.raw(zmq::DEALER);
    dealer.send_multipart([&b"{}"[..], b"{}", b"{}"], 0).unwrap();
    let reply: Value = serde_json::from_slice(&dealer.recv_multipart(0).unwrap()[0]).unwrap();
    assert_eq!(reply["error"]["kind"], "bad_request");
    // Several under way at once, and a delimiter as REQ has it.
    for id in 0..8 {
        let request = json!({"id": id, "version": 1, "op": "status"}).to_string();
        dealer.send_multipart([&b""[..], request.as_bytes()], 0).unwrap();
    }
    for id in 0..8 {
        let frames = dealer.recv_multipart(0).unwrap();
        let reply: Value = serde_json::from_slice(&frames[1]).unwrap();
        assert_eq!((frames[0].len(), &reply["id"]), (0, &json!(id)));
    }
    let (_context, req) = bench.raw(zmq::REQ);
    for id in 0..3 {
        let reply = ask(&req, json!({"id": id, "version": 1, "op": "runs"}).to_string().as_bytes());
        assert_eq!(reply, json!({"id": id, "ok": {"runs": []}}));
    }
}

#[test]
fn more_requests_than_can_wait_are_refused_and_the_rest_is_answered() {
    let bench = Bench::new();
    bench.fake.slow_ms.store(30, std::sync::atomic::Ordering::Relaxed);
    let (_context, socket) = bench.raw(zmq::DEALER);
    const ASKED: u32 = 100;
    for id in 0..ASKED {
        socket
            .send(json!({"id": id, "version": 1, "op": "missions"}).to_string().as_bytes(), 0)
            .unwrap();
    }
    // This many replies at once are more than are kept for a client that does not read meanwhile:
    // some are dropped, and it is free to ask again.
    let (mut answered, mut refused) = (0_u32, 0_u32);
    socket.set_rcvtimeo(2000).unwrap();
    while let Ok(bytes) = socket.recv_bytes(0) {
        let reply: Value = serde_json::from_slice(&bytes).unwrap();
        match reply["error"]["kind"].as_str() {
            None => answered += 1,
            Some("too_many") => refused += 1,
            Some(other) => panic!("{other}: {reply}"),
        }
    }
    assert!(
        answered > 0 && refused > 0 && answered + refused <= ASKED,
        "{answered} answered, {refused} refused"
    );
    socket.set_rcvtimeo(30_000).unwrap();
    let reply =
        ask(&socket, json!({"id": "again", "version": 1, "op": "missions"}).to_string().as_bytes());
    assert_eq!(reply["id"], "again", "{reply}");
}

/// Random bytes, or a request with some of its bytes changed, doubled or gone.
fn random_request(chance: &mut Chance) -> Vec<u8> {
    if chance.below(4) == 0 {
        return (0..chance.below(200)).map(|_| u8::try_from(chance.below(256)).unwrap()).collect();
    }
    let mut request =
        br#"{"id":1,"version":1,"op":"start","run":"r","mission":{"name":"m"},"token":"t","set":[["a",1.0]]}"#.to_vec();
    for _ in 0..1 + chance.below(4) {
        let at = chance.below(request.len());
        match chance.below(3) {
            0 => request[at] = u8::try_from(chance.below(256)).unwrap(),
            1 => request.insert(at, *chance.of(b"{}[]\",:0")),
            _ => drop(request.drain(at..(at + chance.below(20)).min(request.len() - 1).max(at))),
        }
    }
    request
}

/// How many over a socket. The long form: `ONBRICK_RANDOM=100000 cargo test --test it link::hostile
/// -- --nocapture`; ten times as many in process.
fn random_count() -> u32 {
    std::env::var("ONBRICK_RANDOM").ok().and_then(|count| count.parse().ok()).unwrap_or(2000)
}

#[test]
fn random_requests_never_end_the_door() {
    let count = random_count();
    let bench = Bench::new();
    let (_context, socket) = bench.raw(zmq::DEALER);
    let mut chance = Chance::new(1);
    for _ in 0..count {
        let reply = ask(&socket, &random_request(&mut chance));
        assert!(reply["ok"].is_object() || reply["error"]["kind"].is_string(), "{reply}");
    }
    println!("{count} random requests over a socket, each answered or refused");
    bench.client().status().unwrap();
}

#[test]
fn random_requests_are_understood_or_refused_with_a_short_reason() {
    let count = 10 * random_count();
    let mut chance = Chance::new(2);
    let mut understood = 0_u32;
    for _ in 0..count {
        let request = random_request(&mut chance);
        let said = match parse(&request) {
            Ok(_) => {
                understood += 1;
                continue;
            }
            Err(error) => error.refusal.to_string(),
        };
        let shown = String::from_utf8_lossy(&request);
        assert!(
            !said.is_empty() && said.len() < 1000 && !said.contains('\n'),
            "{said:?} of `{shown}`"
        );
    }
    println!("{count} random requests in process: {understood} understood, the others refused");
    assert!(understood > 0 && understood < count);
}

#[test]
fn a_request_that_is_too_long_costs_its_sender_the_connection_and_nobody_else() {
    let bench = Bench::new();
    let (_context, socket) = bench.raw(zmq::DEALER);
    socket.set_rcvtimeo(300).unwrap();
    let most = vec![b' '; MAX_REQUEST_BYTES];
    socket.send(most, 0).unwrap();
    until("the longest request is refused", || socket.recv_bytes(0).ok());
    for _ in 0..20 {
        let _ = socket.send(vec![b'x'; 16 << 20], zmq::DONTWAIT);
        assert!(socket.recv_bytes(0).is_err(), "it is not even read");
    }
    drop(socket);
    bench.client().status().unwrap();
}

#[test]
fn garbage_and_half_open_connections_by_the_hundred_leave_room_for_a_friend() {
    let bench = Bench::new();
    bench.client().status().unwrap();
    let mut half_open = Vec::new();
    for number in 0..300_u32 {
        let Ok(mut stream) = TcpStream::connect(bench.address()) else { continue };
        let said: &[u8] = match number % 4 {
            0 => b"",
            1 => b"GET / HTTP/1.1\r\n\r\n",
            2 => &[0xff, 0, 0, 0, 0, 0, 0, 0, 1, 0x7f, 3, 0],
            _ => &[0; 700],
        };
        let _ = stream.write_all(said);
        half_open.push(stream);
    }
    // What is too much is shut, so the door never holds more than its limit.
    let held = until("what is too much is shut", || {
        let held = connections_to(bench.server.port());
        (held <= 16).then_some(held)
    });
    println!("{} connections, {held} of them held", half_open.len());
    // Everything came from one address, this machine's, and so does the friend: its turn comes when
    // the flood is over.
    drop(half_open);
    bench.client().status().unwrap();
}

/// Connections that the side which listens at this port holds open.
fn connections_to(port: u16) -> usize {
    let established = |table: &str| {
        let table = std::fs::read_to_string(table).unwrap_or_default();
        let local = format!(":{port:04X}");
        let is_held = |line: &&str| {
            let fields: Vec<&str> = line.split_whitespace().collect();
            // proc(5): local address, remote address, state; 01 is ESTABLISHED.
            fields.len() > 3 && fields[1].ends_with(&local) && fields[3] == "01"
        };
        table.lines().filter(is_held).count()
    };
    established("/proc/net/tcp") + established("/proc/net/tcp6")
}

#[test]
fn a_request_with_lines_in_its_names_forges_none_in_the_log() {
    let service = Service::new();
    service.introduce();
    let (public, secret) = halves(&KeyPair::load(&service.path("pc")).unwrap());
    let context = zmq::Context::new();
    let socket = context.socket(zmq::DEALER).unwrap();
    socket
        .set_curve_serverkey(KeyPair::load(&service.path("keys")).unwrap().public().as_bytes())
        .unwrap();
    socket.set_curve_publickey(&public).unwrap();
    socket.set_curve_secretkey(&secret).unwrap();
    socket.set_linger(0).unwrap();
    socket.set_rcvtimeo(30_000).unwrap();
    socket.connect(&format!("tcp://{}:5670", service.address)).unwrap();
    let forged = "x\n<3>error: the brick is on fire\u{1b}[2J\u{9b}31m\u{202e}\u{2028}";
    for request in [
        json!({"id": 1, "version": 1, "op": forged}),
        json!({"id": 1, "version": 1, "op": "stop", "run": forged}),
        json!({"id": 1, "version": 1, "op": "start", "run": "r", "mission": {forged: 1}}),
        json!({
            "id": 1,
            "version": 1,
            "op": "start",
            "run": "r",
            "mission": {"name": forged},
            "token": "t",
        }),
        json!({
            "id": 1,
            "version": 1,
            "op": "start",
            "run": "r",
            "mission": {"name": "map"},
            "set": [[forged, "x"]],
        }),
    ] {
        let reply = ask(&socket, request.to_string().as_bytes());
        let message = reply["error"]["message"].as_str().unwrap();
        assert!(!message.contains(|letter: char| letter.is_control()), "{message:?}");
    }
    until("it is in the log", || service.log().contains("on fire").then_some(()));
    let log = service.log();
    let is_forged = |line: &str| line.starts_with("<3>") || line.starts_with("error: the brick");
    assert!(!log.lines().any(is_forged), "{log}");
    let acts =
        |letter: char| letter != '\n' && letter.is_control() || "\u{202e}\u{2028}".contains(letter);
    assert!(!log.contains(acts), "{log:?}");
}

/// A way to a brick that carries 64 KiB in five milliseconds, and no more.
pub fn slow_way(to: String) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for near in listener.incoming().map_while(Result::ok) {
            let Ok(far) = TcpStream::connect(&to) else { continue };
            let back = (far.try_clone().unwrap(), near.try_clone().unwrap());
            std::thread::spawn(move || carry_slowly(near, far));
            std::thread::spawn(move || carry_slowly(back.0, back.1));
        }
    });
    address
}

fn carry_slowly(mut from: TcpStream, mut to: TcpStream) {
    let mut piece = vec![0; 64 << 10];
    while let Ok(read @ 1..) = from.read(&mut piece) {
        if to.write_all(&piece[..read]).is_err() {
            break;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
}

#[test]
#[cfg_attr(
    target_arch = "arm",
    ignore = "QEMU's user mode knows no TCP_INFO, by which the service sees it"
)]
fn a_message_of_frames_without_end_does_not_come_into_the_services_memory() {
    const FRAME: usize = 64 << 10;
    const FRAMES: usize = 2000;
    let service = Service::new();
    service.introduce();
    service.done(&["status", "sim"]);
    let before = service.peak_kb();
    let (public, secret) = halves(&KeyPair::load(&service.path("pc")).unwrap());
    let context = zmq::Context::new();
    let socket = context.socket(zmq::DEALER).unwrap();
    socket
        .set_curve_serverkey(KeyPair::load(&service.path("keys")).unwrap().public().as_bytes())
        .unwrap();
    socket.set_curve_publickey(&public).unwrap();
    socket.set_curve_secretkey(&secret).unwrap();
    socket.set_linger(0).unwrap();
    socket.set_reconnect_ivl(-1).unwrap();
    socket.set_rcvtimeo(60_000).unwrap();
    let way = slow_way(format!("{}:5670", service.address));
    socket.connect(&format!("tcp://{way}")).unwrap();
    assert_eq!(ask(&socket, br#"{"id":1,"version":1,"op":"status"}"#)["ok"]["brick"], "sim");
    for _ in 0..FRAMES {
        socket.send(vec![b'x'; FRAME], zmq::SNDMORE).unwrap();
    }
    socket.send("the end", 0).unwrap();
    until("the sender is shut out", || {
        service.log().contains("sends much and asks nothing").then_some(())
    });
    let more = service.peak_kb() - before;
    println!(
        "{} MB in one message: the service's peak has grown by {more} kB",
        (FRAMES * FRAME) >> 20
    );
    // The message has 125 MB. How much of it comes before it is looked at again depends on how busy
    // this machine is.
    assert!(more < 80 << 10, "{more} kB");
    service.done(&["status", "sim"]);
}

#[test]
#[cfg_attr(target_arch = "arm", ignore = "a static program takes no LD_PRELOAD")]
fn a_wall_clock_that_jumps_under_the_service_changes_nothing_of_the_link() {
    let _machine = beside_others();
    patiently("a wall clock that jumps under the service", jumping_wall_clock);
}

fn jumping_wall_clock() {
    let mut service = Service::new();
    let Some(library) = shim(service.folder.path()) else { return };
    service.introduce();
    service.mission("short", &SHORT.replace("time_s > 2", "time_s > 5"));
    service.kill();
    let now = service.path("now");
    // As a brick wakes up that has no network and no battery for its clock.
    replace(&now, "@600");
    service.environment = vec![("LD_PRELOAD", library), ("WALL_CLOCK", now.clone())];
    service.start();
    service.done(&["start", "short", "sim"]);
    let first = newest(&service);
    for (number, jump) in ["+262", "-262", "@1", "-3600", "+0"].iter().enumerate() {
        replace(&now, jump);
        let said = service.done(&["--json", "status", "sim"]);
        let status: Value = serde_json::from_str(said.lines().next().unwrap()).unwrap();
        let lasted_s = status["status"]["state_s"].as_f64().unwrap_or_else(|| panic!("{status}"));
        assert!((0.0..600.0).contains(&lasted_s), "jump {number}: {status}");
        std::thread::sleep(Duration::from_millis(100));
    }
    service.done(&["fetch", "sim", "--run", &first]);
    let home = std::fs::read(service.path("out").join(format!("{first}.mcap"))).unwrap();
    assert!(home == std::fs::read(service.path("runs").join(&first).join("run.mcap")).unwrap());
    // A token of before the jump is as old as it is, and the newest run is the one that was started
    // last.
    replace(&now, "@1");
    service.done(&["start", "short", "sim"]);
    let second = newest(&service);
    assert_ne!(first, second);
    service.done(&["stop"]);
    service.done(&["status", "sim"]);
}
