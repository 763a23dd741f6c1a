//! Who may ask, and what is said to whom.

use std::sync::atomic::Ordering;

use onbrick::link::client::Silence;
use onbrick::link::pairing::pair;
use onbrick::link::{ClientError, KeyPair, Patience};
use onbrick::protocol::{Caller, Chosen, Kind, Name, Pairing};

use super::bench::{Bench, client_at, onbrick, serve, text, until};
use crate::support::pass_over;

#[test]
fn every_operation_is_answered_to_a_key_under_its_name() {
    let bench = Bench::new();
    let mut client = bench.client();
    assert_eq!(client.status().unwrap().battery_v, Some(7.5));
    assert_eq!(client.missions().unwrap().missions, []);
    let started = client.start(Chosen::Name("map".to_owned()), None, &[]).unwrap();
    assert!(started.run.as_str().starts_with("map-"), "{}", started.run);
    assert!(client.stop(Some(&started.run)).unwrap().stopped);
    assert_eq!(client.runs().unwrap().runs, []);
    client.identify().unwrap();
    let asked = bench.fake.asked.lock().unwrap();
    let names: Vec<&str> = asked.iter().map(|(op, _)| op.as_str()).collect();
    assert_eq!(names, ["status", "missions", "status", "start", "stop", "runs", "identify"]);
    assert!(asked.iter().all(|(_, caller)| *caller == Caller::Key("pc".to_owned())), "{asked:?}");
}

#[test]
fn an_unknown_key_a_wrong_key_and_nobody_are_told_apart() {
    let bench = Bench::new();
    let stranger = KeyPair::generate().unwrap();
    let unknown = bench.client_of(&stranger).status().unwrap_err();
    assert!(matches!(unknown, ClientError::NotAuthorised { .. }), "{unknown}");
    let another = client_at(&bench.address(), stranger.public(), &bench.pc).status().unwrap_err();
    assert!(matches!(another, ClientError::AnotherKey { .. }), "{another}");

    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let silence = |address: &str| {
        let client =
            client_at(address, bench.brick_key(), &bench.pc).with_patience(Patience::new(1.0));
        match { client }.status().unwrap_err() {
            ClientError::NoAnswer { silence, .. } => silence,
            other => panic!("{other}"),
        }
    };
    assert_eq!(silence(&free.to_string()), Silence::NoConnection);
    assert_eq!(silence("no.such.name.invalid"), Silence::NoSuchName);
    // A listener that accepts and says nothing.
    let mute = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    assert_eq!(silence(&mute.local_addr().unwrap().to_string()), Silence::NoHandshake);
    assert!(bench.fake.asked.lock().unwrap().is_empty());
}

#[test]
fn a_key_that_begins_with_a_hyphen_is_an_argument_like_any_other() {
    let folder = tempfile::tempdir().unwrap();
    let key = |arguments: &[&str]| {
        let output = onbrick().args(arguments).arg("--keys").arg(folder.path()).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    };
    // Behind a hyphen each sign could be an option's letter, or mean the beginning of a long
    // option.
    let signs =
        "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#";
    for sign in signs.chars() {
        let public = format!("-{sign}]NE6H!s]g>!v&*Q@q{{DZ:B:6]9wV:)vVC.Dxz0");
        key(&["key", "authorise", &public, "--name", "anna"]);
        key(&["key", "revoke", &public]);
        key(&["key", "know", "brick", "127.0.0.1", &public, "--replace"]);
    }
}

#[test]
fn a_key_that_is_authorised_under_another_name_is_said_to_be_renamed() {
    let folder = tempfile::tempdir().unwrap();
    // As `key show` prints it, or alone.
    let public = KeyPair::generate().unwrap().public();
    let shown = format!("key          {public}\nfingerprint  {}\n", public.fingerprint());
    let authorise = |name: &str| {
        let key = if name == "anna" { public.to_string() } else { shown.clone() };
        let mut command = onbrick();
        command.args(["key", "authorise", &key, "--name", name, "--keys"]).arg(folder.path());
        text(&command.output().unwrap().stdout)
    };
    for (name, is_renamed) in [("anna", false), ("anna", false), ("board", true)] {
        let said = authorise(name);
        assert!(said.starts_with(&format!("{name} may ask from now on: ")), "{said}");
        assert_eq!(said.trim_end().ends_with(", which was anna before"), is_renamed, "{said}");
    }
}

#[test]
fn root_puts_no_key_where_the_service_could_not_read_it() {
    if !nix::unistd::geteuid().is_root() {
        return pass_over("root, who has what would be the service's");
    }
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::chown(folder.path(), Some(1000), None).unwrap();
    let public = KeyPair::generate().unwrap().public().to_string();
    for arguments in [&["new"][..], &["authorise", &public, "--name", "anna"], &["revoke", "anna"]]
    {
        let output =
            onbrick().arg("key").args(arguments).arg("--keys").arg(folder.path()).output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{arguments:?}: {said}");
        assert!(said.contains("sudo -u onbrick onbrick key"), "{arguments:?}: {said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing was put there");
}

#[test]
fn a_key_that_is_revoked_is_refused_on_the_connection_that_it_has() {
    let bench = Bench::new();
    let mut client = bench.client();
    client.status().unwrap();
    bench.authorised().remove("pc").unwrap();
    let refused = client.stop(None).unwrap_err();
    assert!(matches!(refused, ClientError::NotAuthorised { .. }), "{refused}");
    assert!(
        matches!(bench.client().status(), Err(ClientError::NotAuthorised { .. })),
        "nor on a new one"
    );
    bench.authorised().add(&bench.pc.public(), "pc-again").unwrap();
    client.status().unwrap();
    let asked = bench.fake.asked.lock().unwrap();
    assert_eq!(asked.len(), 2, "{asked:?}");
    assert_eq!(asked[1].1, Caller::Key("pc-again".to_owned()));
}

#[test]
fn a_brick_that_was_set_up_anew_is_not_taken_for_the_old_one() {
    let bench = Bench::new();
    let old = bench.brick_key();
    bench.client().status().unwrap();
    let Bench { folder, fake, server, pc } = bench;
    drop(server);
    std::fs::remove_file(folder.path().join("own.key")).unwrap();
    let server = serve(folder.path(), &fake);
    let address = format!("127.0.0.1:{}", server.port());
    let refused = client_at(&address, old, &pc).status().unwrap_err();
    assert!(matches!(refused, ClientError::AnotherKey { .. }), "{refused}; {:?}", server.state());
    let new = KeyPair::load(folder.path()).unwrap().public();
    client_at(&address, new, &pc).status().unwrap();
}

#[test]
fn a_start_with_an_old_token_is_tried_with_a_fresh_one_and_drives_once() {
    let bench = Bench::new();
    bench.fake.stale.store(2, Ordering::Relaxed);
    let started = bench.client().start(Chosen::Name("map".to_owned()), None, &[]).unwrap();
    assert!(!started.repeated);
    assert_eq!(*bench.fake.started.lock().unwrap(), [started.run]);
}

fn name(text: &str) -> Name {
    Name::new(text).unwrap()
}

#[test]
fn a_pc_is_introduced_when_both_persons_see_the_same_code() {
    let bench = Bench::new();
    let anna = KeyPair::generate().unwrap();
    let at = |port: u16| format!("127.0.0.1:{port}");
    let closed =
        pair(&at(1), &anna, &name("anna"), Patience::new(1.0), &mut |_, _| true).unwrap_err();
    assert!(matches!(closed, ClientError::NoAnswer { .. }), "{closed}");

    let window = bench.server.window();
    let opened = |seconds| {
        window.open(seconds);
        until("the window is open", || Some(bench.server.pairing_port()).filter(|port| *port != 0))
    };
    // No PC comes in while only one side has agreed; both see one code.
    let port = opened(60);
    let introduced = std::thread::scope(|scope| {
        let person = scope.spawn(|| {
            let code = until("a code is shown", || match window.state() {
                Pairing::Compare { code, name } => Some((code, name)),
                _ => None,
            });
            assert_eq!(bench.authorised().find(&anna.public()).unwrap(), None);
            window.answer(true);
            code
        });
        let mut seen = String::new();
        let introduced =
            pair(&at(port), &anna, &name("anna"), Patience::new(60.0), &mut |brick, code| {
                seen = code.to_owned();
                brick.name.as_str() == "fake"
            });
        assert_eq!(person.join().unwrap(), (seen, "anna".to_owned()));
        introduced.unwrap()
    });
    assert_eq!((introduced.name.as_str(), introduced.key), ("fake", bench.brick_key()));
    bench.client_of(&anna).status().unwrap();

    // And a person at the PC who says no.
    let eve = KeyPair::generate().unwrap();
    window.open(0);
    let port = opened(60);
    let refused = until("the window takes a PC again", || {
        match pair(&at(port), &eve, &name("eve"), Patience::new(10.0), &mut |_, _| false)
            .unwrap_err()
        {
            ClientError::Refused(refusal) if refusal.kind == Kind::NotAuthorised => Some(refusal),
            _ => None,
        }
    });
    assert!(refused.message.contains("you said no"), "{refused}");
    assert!(matches!(bench.client_of(&eve).status(), Err(ClientError::NotAuthorised { .. })));
}
