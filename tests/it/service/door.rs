//! The local socket: rights, many clients, slow ones, garbage; and what systemd hears.

use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixDatagram, UnixStream};
use std::time::Duration;

use onbrick::protocol::{Kind, MAX_REQUEST_BYTES, Outcome, Reply, Request, State, Status};
use onbrick::recording::Run;
use onbrick::service::client::Client;

use super::{Served, folder};
use crate::support::real_time::patiently;
use crate::support::turning_brick::await_that;

fn connect(served: &Served) -> UnixStream {
    let stream = UnixStream::connect(served.path("socket")).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream
}

/// The next line as a reply.
fn reply(reader: &mut impl BufRead) -> Reply {
    let mut line = String::new();
    reader.read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|error| panic!("{line}: {error}"))
}

#[test]
fn a_hundred_clients_are_answered_whatever_a_slow_and_a_silent_one_do() {
    let group = nix::unistd::Group::from_gid(nix::unistd::getegid()).unwrap().unwrap();
    let config = format!("[socket]\ngroup = \"{}\"", group.name);
    let served = Served::started(folder(&config), &["--sim", "arena"], |command| command);
    let socket = std::fs::metadata(served.path("socket")).unwrap();
    assert_eq!((socket.permissions().mode() & 0o777, socket.gid()), (0o660, group.gid.as_raw()));
    let _silent = connect(&served);
    let mut half = connect(&served);
    half.write_all(b"{\"version\":1,").unwrap();
    let mut long = connect(&served);
    long.write_all(&vec![b' '; 40_000]).unwrap();
    // One that asks and never reads: its replies fill the socket's buffers.
    let deaf = connect(&served);
    deaf.set_nonblocking(true).unwrap();
    while (&deaf).write(b"{\"version\":1,\"id\":1,\"op\":\"missions\"}\n").is_ok() {}
    let socket = served.path("socket");
    std::thread::scope(|scope| {
        for at in 0..100 {
            let socket = &socket;
            scope.spawn(move || {
                let mut client = Client::at(socket);
                for _ in 0..5 {
                    let status: Status =
                        client.ask(&Request::Status, Duration::from_secs(30)).unwrap();
                    assert_eq!(status.state, State::Ready, "client {at}");
                }
            });
        }
    });
}

#[test]
fn a_stop_says_whether_it_was_the_menus_or_a_programs() {
    patiently("a stop of the menu's", || {
        for (is_menu, who) in
            [(true, "stopped on the brick (menu)"), (false, "stopped on the brick (here)")]
        {
            let mut served = Served::simulated("");
            if is_menu {
                served.client = Client::of_menu_at(served.path("socket"));
            }
            let run = served.drive("straight");
            assert_eq!(served.status().run.unwrap().by, if is_menu { "menu" } else { "here" });
            served.stop();
            let last = served.await_state(State::Stopped).last.unwrap();
            assert_eq!(
                (last.stop.reason.word().as_str(), last.is_wanted(), last.to_string().as_str()),
                ("here", true, who)
            );
            let recorded =
                Run::open(&served.path("runs").join(run.as_str()).join("run.mcap")).unwrap();
            assert_eq!(recorded.ending.unwrap().stop.to_string(), "stopped on the brick");
        }
    });
}

#[test]
fn too_many_clients_are_told_so_and_there_is_room_again_when_others_go() {
    let mut served = Served::started(folder(""), &["--sim", "arena"], |command| command);
    let crowd: Vec<UnixStream> = (0..140).map(|_| connect(&served)).collect();
    let mut last = BufReader::new(crowd.last().unwrap());
    let Reply { outcome: Outcome::Error(refusal), .. } = reply(&mut last) else { panic!("let in") };
    assert_eq!(refusal.kind, Kind::TooMany, "{refusal}");
    drop(crowd);
    await_that("there is room again", || {
        served.client.ask::<Status>(&Request::Status, Duration::from_secs(5)).is_ok()
    });
}

#[test]
fn garbage_gets_a_refusal_and_costs_nobody_else_anything() {
    let mut served = Served::started(folder(""), &["--sim", "arena"], |command| command);
    let mut stream = connect(&served);
    let mut reader = BufReader::new(stream.try_clone().unwrap());
    for line in [
        &b"nonsense"[..],
        b"",
        b"\xff\xfe\x00",
        b"{}",
        b"{\"version\":1,\"id\":5,\"op\":\"reboot\"}",
        b"{\"version\":1,\"id\":5,\"op\":\"stop\",\"run\":\"../../etc\"}",
        &[b'['; 10_000],
    ] {
        stream.write_all(line).unwrap();
        stream.write_all(b"\n").unwrap();
        let Outcome::Error(refusal) = reply(&mut reader).outcome else {
            panic!("{line:?} was done")
        };
        assert!([Kind::BadRequest, Kind::UnknownOperation].contains(&refusal.kind), "{refusal}");
    }
    // After all of it the same connection is in order.
    stream.write_all(b"{\"version\":1,\"id\":\"x\",\"op\":\"status\",\"new\":true}\n").unwrap();
    assert!(matches!(reply(&mut reader).outcome, Outcome::Ok(_)));
    // A line without an end is not waited for for ever, and not kept.
    let endless = vec![b'x'; MAX_REQUEST_BYTES + 100];
    let _ = stream.write_all(&endless);
    let Outcome::Error(refusal) = reply(&mut reader).outcome else { panic!("done") };
    assert!(refusal.message.contains("at most"), "{refusal}");
    assert_eq!(reader.read(&mut [0; 1]).unwrap_or(0), 0, "and the connection is closed");
    assert_eq!(served.status().state, State::Ready);
}

#[test]
fn systemd_hears_that_it_is_ready_alive_and_about_to_end() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("notify");
    let systemd = UnixDatagram::bind(&path).unwrap();
    systemd.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let mut served = Served::started(folder(""), &["--sim", "arena"], |mut command| {
        command
            .env("NOTIFY_SOCKET", &path)
            .env("WATCHDOG_USEC", "2000000")
            .env("JOURNAL_STREAM", "1:2");
        command
    });
    let mut heard = Vec::new();
    let mut hear = |until: &str| {
        while !heard.iter().any(|word: &String| word.contains(until)) {
            let mut word = [0; 200];
            let length = systemd
                .recv(&mut word)
                .unwrap_or_else(|error| panic!("{until} after {heard:?}: {error}"));
            heard.push(String::from_utf8_lossy(&word[..length]).into_owned());
        }
    };
    hear("READY=1");
    hear("WATCHDOG=1");
    assert_eq!(served.end(), Some(0));
    hear("STOPPING=1");
    let log = std::fs::read_to_string(served.path("log")).unwrap();
    let levels = ["<3>", "<4>", "<6>", "<7>"];
    let has_level = |line: &str| levels.iter().any(|level| line.starts_with(level));
    assert!(
        log.contains("<6>") && log.lines().all(has_level),
        "levels that the journal understands: {log}"
    );
}
