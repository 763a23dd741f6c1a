//! What arrives that should not: each is refused or thrown away, memory stays bounded, and a friend is served all the while.

use std::io::Write as _;
use std::net::TcpStream;

use onbrick::service::protocol::MAX_REQUEST_BYTES;
use serde_json::{Value, json};

use super::bench::{Bench, until};

/// A request and its reply over a DEALER.
fn ask(socket: &zmq::Socket, request: &[u8]) -> Value {
    socket.send(request, 0).unwrap();
    let shown = String::from_utf8_lossy(&request[..request.len().min(200)]);
    let frames = socket.recv_multipart(0).unwrap_or_else(|error| panic!("no reply to `{shown}`: {error}"));
    serde_json::from_slice(&frames[0]).unwrap_or_else(|error| panic!("{error} in the reply to `{shown}`"))
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
        (br#"{"id":1,"version":1,"op":"jog","port":"outA","percent":100}"#.to_vec(), "unknown_operation"),
        (br#"{"id":1,"version":1,"op":"delete","run":"r"}"#.to_vec(), "unknown_operation"),
        (
            br#"{"id":1,"version":1,"op":"fetch","run":"../../etc/passwd","offset":0,"length":9}"#.to_vec(),
            "bad_request",
        ),
        (br#"{"id":1,"version":1,"op":"fetch","run":"r","offset":-1,"length":9}"#.to_vec(), "bad_request"),
        (br#"{"id":1,"version":1,"op":"fetch","run":"r","offset":0,"length":9}"#.to_vec(), "unknown_run"),
        (
            json!({"id": 1, "version": 1, "op": "stop", "run": long_mission}).to_string().into_bytes(),
            "bad_request",
        ),
    ];
    for (request, kind) in cases {
        let reply = ask(&socket, &request);
        let shown = String::from_utf8_lossy(&request[..request.len().min(80)]).into_owned();
        assert_eq!(reply["error"]["kind"], kind, "{shown}: {reply}");
        assert!(reply["id"].is_null() || reply["id"] == 1, "{shown}: {reply}");
        assert!(
            reply["error"]["message"].as_str().is_some_and(|said| !said.is_empty() && said.len() < 400),
            "{reply}"
        );
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
        socket.send(json!({"id": id, "version": 1, "op": "missions"}).to_string().as_bytes(), 0).unwrap();
    }
    // So many replies at once are more than are kept for a client that does not read meanwhile: some are dropped, and it is free to ask again.
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
    let reply = ask(&socket, json!({"id": "again", "version": 1, "op": "missions"}).to_string().as_bytes());
    assert_eq!(reply["id"], "again", "{reply}");
}

#[test]
fn random_requests_never_end_the_door() {
    // The long form: `ONBRICK_RANDOM=100000 cargo test --test it link::hostile -- --nocapture`.
    let count: u32 =
        std::env::var("ONBRICK_RANDOM").ok().and_then(|count| count.parse().ok()).unwrap_or(2000);
    let bench = Bench::new();
    let (_context, socket) = bench.raw(zmq::DEALER);
    let whole = br#"{"id":1,"version":1,"op":"start","run":"r","mission":{"name":"m"},"token":"t","set":[["a",1.0]]}"#;
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let mut chance = move |below: usize| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as usize % below
    };
    for _ in 0..count {
        let request: Vec<u8> = if chance(4) == 0 {
            (0..chance(200)).map(|_| u8::try_from(chance(256)).unwrap()).collect()
        } else {
            // A request with some of its bytes changed, doubled or gone.
            let mut request = whole.to_vec();
            for _ in 0..1 + chance(4) {
                let at = chance(request.len());
                match chance(3) {
                    0 => request[at] = u8::try_from(chance(256)).unwrap(),
                    1 => request.insert(at, b"{}[]\",:0"[chance(8)]),
                    _ => drop(request.drain(at..(at + chance(20)).min(request.len() - 1).max(at))),
                }
            }
            request
        };
        let reply = ask(&socket, &request);
        assert!(reply["ok"].is_object() || reply["error"]["kind"].is_string(), "{reply}");
    }
    println!("{count} random requests, each answered or refused");
    bench.client().status().unwrap();
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
    // Everything came from one address, this machine's, and so does the friend: its turn comes when the flood is over.
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
