//! What a PC's lists say and cost, and what its commands know of a brick's name.

use std::os::unix::fs::PermissionsExt;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use onbrick::link::{ClientError, KeyPair, KnownBrick, KnownBricks, Patience};

use super::bench::{Bench, Service, client_at, onbrick, text};
use super::commands::SHORT;
use crate::support::real_time::patiently;

#[test]
fn missions_are_a_line_each_and_findings_come_with_v() {
    let service = Service::new();
    service.introduce();
    service.mission("short", SHORT);
    service.mission("broken", &SHORT.replace("time_s > 2", "tims_s > 2"));
    let lines = service.done(&["missions"]);
    let lines: Vec<&str> = lines.lines().collect();
    assert_eq!(lines.len(), 2, "{lines:?}");
    assert!(
        lines[0].starts_with("sim  broken  -  ") && lines[0].ends_with("not in order: -v says why"),
        "{lines:?}"
    );
    assert!(lines[1].starts_with("sim  short  60 s"), "{lines:?}");
    service.says(&["missions", "-v"], "did you mean `time_s`");
    // Between runs a simulated battery has no voltage.
    service.says(&["status"], "sim  ready  simulated  ");
}

#[test]
fn bricks_that_are_not_there_cost_a_list_two_seconds_all_together() {
    patiently("a list with absent bricks", || {
        let service = Service::new();
        service.introduce();
        let mut known = KnownBricks::load(&service.path("pc")).unwrap();
        // A port without a listener; listeners that accept and say nothing; a name without an
        // address.
        let mute = [(); 2].map(|()| std::net::TcpListener::bind("127.0.0.1:0").unwrap());
        let [one, other] = mute.each_ref().map(|mute| mute.local_addr().unwrap().to_string());
        for (name, address) in [
            ("gone", "127.0.0.1:1"),
            ("mute", &one),
            ("mute-too", &other),
            ("nameless", "no.such.name.invalid"),
        ] {
            let key = KeyPair::generate().unwrap().public();
            let brick = KnownBrick { name: name.to_owned(), address: address.to_owned(), key };
            known.put(&brick, None).unwrap();
        }
        for list in ["missions", "bricks"] {
            let begun = Instant::now();
            let output = service.pc(&[list]);
            let took = begun.elapsed();
            let said = text(&output.stdout);
            println!("`{list}` with four absent bricks took {took:?}");
            assert!(took < Duration::from_secs(4), "{took:?}: {said}");
            assert!(
                said.contains("sim  ") && said.matches("no answer from").count() == 4,
                "{said}"
            );
        }
    });
}

#[test]
fn a_slow_brick_has_its_time_where_an_absent_one_is_given_up() {
    let bench = Bench::new();
    let patience = || Patience::new(60.0).if_absent(1.0);
    bench.fake.slow_ms.store(3000, Ordering::Relaxed);
    bench.client().with_patience(patience()).missions().unwrap();
    let begun = Instant::now();
    let absent = client_at("127.0.0.1:1", bench.brick_key(), &bench.pc).with_patience(patience());
    let silent = match { absent }.status().unwrap_err() {
        ClientError::NoAnswer { waited_s, .. } => waited_s,
        other => panic!("{other}"),
    };
    assert!(silent < 10.0 && begun.elapsed() < Duration::from_secs(20), "{silent} s");
}

#[test]
fn push_finds_a_brick_by_the_name_under_which_it_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let key = KeyPair::generate().unwrap().public();
    let brick =
        KnownBrick { name: "ev3-blue".to_owned(), address: "10.1.2.3:5999".to_owned(), key };
    KnownBricks::load(&path("keys")).unwrap().put(&brick, None).unwrap();
    // What would be asked of ssh.
    std::fs::create_dir(path("bin")).unwrap();
    std::fs::write(path("bin/ssh"), "#!/bin/sh\necho \"$2\" >asked\ncat >/dev/null\n").unwrap();
    std::fs::set_permissions(path("bin/ssh"), std::fs::Permissions::from_mode(0o755)).unwrap();
    std::fs::write(path("short.toml"), SHORT).unwrap();
    let search = format!("{}:{}", path("bin").display(), std::env::var("PATH").unwrap());
    for (host, asked) in [
        ("ev3-blue", "robot@10.1.2.3"),
        ("ev3-red.local", "robot@ev3-red.local"),
        ("me@ev3-blue", "me@ev3-blue"),
    ] {
        let output = onbrick()
            .env("PATH", &search)
            .current_dir(folder.path())
            .args(["push", host, "short.toml", "--keys", "keys"])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert_eq!(std::fs::read_to_string(path("asked")).unwrap().trim(), asked);
    }
}
