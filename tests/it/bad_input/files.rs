//! `robot.toml`, `world.toml` and `team.toml`: mutated, cut, enormous, and with every wrong kind of
//! value in every place.

use std::path::Path;
use std::time::{Duration, Instant};

use onbrick::document::{Document, Findings};
use onbrick::link::{KnownBricks, Team};
use onbrick::robot::{DEFAULT_ROBOT, RobotConfig};
use onbrick::sim::{World, WorldPhysics};
use proptest::prelude::*;

/// A loader, and what it is given.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Robot,
    World,
    Team,
}

/// Two bricks that need not be known.
const TEAM: &str = r#"
name = "two"
mission = "map"
[brick.blue]
x_m = 0.0
y_m = 0
address = "127.0.0.1"
key = "rq:rM>}U?@Lns47E1%kR.o@n%FcmmsL/@{H8]yf7"
[brick."a red one"]
x_m = 3
y_m = 0.0
heading_deg = 90
address = "red.local"
key = "w>il{Sx3&-W+P8nSMoe)b)!kpu3Q#g>4CE<ttSWd"
"#;

impl Kind {
    /// Reads the bytes; whatever loads must also do for what comes next.
    fn load(self, bytes: &[u8]) -> Result<(), Findings> {
        match self {
            Self::Robot => RobotConfig::load("robot.toml", bytes).map(|(robot, _)| {
                assert!(robot.geometry().is_ok(), "{robot:?}");
                assert!(
                    robot.drive.max_wheel_rad_s.is_finite() && robot.drive.max_wheel_rad_s > 0.0
                );
                assert!(robot.drive.left.ratio.is_finite() && robot.drive.left.ratio != 0.0);
            }),
            Self::World => World::parse("world.toml", bytes).map(|(world, _)| {
                let _ = WorldPhysics::new(world, 1, 1);
            }),
            Self::Team => {
                let nobody = KnownBricks::load(Path::new("/not/there")).unwrap();
                Team::parse("team.toml", bytes, &nobody).map(|(team, _)| {
                    assert!(!team.members.is_empty() && team.members.len() <= 100, "{team:?}");
                    assert!(
                        team.members.iter().flat_map(|member| member.pose).all(f64::is_finite),
                        "{team:?}"
                    );
                })
            }
        }
    }

    /// Loads or refuses; a refusal has a place and is not endless.
    fn judge(self, bytes: &[u8]) -> Option<String> {
        let message = self.load(bytes).err()?.to_string();
        let name = match self {
            Self::Robot => "robot.toml",
            Self::World => "world.toml",
            Self::Team => "team.toml",
        };
        assert!(message.contains(&format!("--> {name}:")), "no place: {message}");
        assert!(message.contains("error: "), "{message}");
        assert!(message.len() < 300_000, "{} bytes of message", message.len());
        Some(message)
    }
}

fn texts() -> Vec<(Kind, &'static str)> {
    let worlds = World::names().map(|name| World::text(name).unwrap()).chain([World::TEMPLATE]);
    worlds
        .map(|text| (Kind::World, text))
        .chain([(Kind::Robot, DEFAULT_ROBOT), (Kind::Team, TEAM)])
        .collect()
}

#[test]
fn a_file_cut_anywhere_is_read_or_refused() {
    for (kind, text) in texts() {
        for end in 0..text.len() {
            kind.judge(&text.as_bytes()[..end]);
        }
    }
}

#[test]
fn files_that_are_none_are_refused_with_a_place() {
    let long = "#".repeat(Document::MAX_BYTES + 1);
    let brackets = format!("x = {}", "[".repeat(1_000_000));
    let dots = format!("{}y = 1", "x.".repeat(100_000));
    for bytes in [
        &b""[..],
        b"\n",
        b"\0\0\0\0",
        b"\x7fELF\x01\x01\x01\x00\xff\xfe",
        b"name = \"m\"\nname = \"n\"\n",
        b"{\"name\": \"m\"}",
        b"name = [[[[[[[",
        b"name = \"",
        b"\xef\xbb\xbfname = 5\n",
        long.as_bytes(),
        brackets.as_bytes(),
        dots.as_bytes(),
    ] {
        for kind in [Kind::Robot, Kind::World, Kind::Team] {
            let started = Instant::now();
            assert!(kind.judge(bytes).is_some(), "{kind:?} took {} bytes", bytes.len());
            assert!(
                started.elapsed() < Duration::from_secs(20),
                "{kind:?}: {:?}",
                started.elapsed()
            );
        }
    }
}

/// The lines of a file that set something: everything before the `=`, and the line's number.
fn settings(text: &str) -> Vec<(usize, &str)> {
    let lines = text.lines().enumerate();
    lines
        .filter(|(_, line)| !line.starts_with('#'))
        .filter_map(|(at, line)| Some((at, line.split_once(" =")?.0)))
        .collect()
}

fn with_line(text: &str, at: usize, line: &str) -> String {
    text.lines().enumerate().fold(String::new(), |all, (number, old)| {
        format!("{all}{}\n", if number == at { line } else { old })
    })
}

#[test]
fn every_wrong_kind_of_value_in_every_place_is_refused_or_legal() {
    let values = [
        "nan",
        "inf",
        "-inf",
        "-1",
        "0",
        "-0.0",
        "1e308",
        "-1e308",
        "9223372036854775807",
        "true",
        "\"\"",
        "\"text\"",
        "[]",
        "[nan, inf]",
        "[-1, -1]",
        "[[1, 2], [3]]",
        "[[0, 0], [0, 0]]",
        "{}",
        "{ port = 5 }",
        "1979-05-27",
        "[[[[]]]]",
    ];
    let mut refused = 0;
    for (kind, text) in texts() {
        for (at, key) in settings(text) {
            for value in values {
                refused += usize::from(
                    kind.judge(with_line(text, at, &format!("{key} = {value}")).as_bytes())
                        .is_some(),
                );
            }
            let twice = with_line(text, at, &format!("{key} = 1\n{key} = 1"));
            assert!(
                kind.judge(twice.as_bytes()).unwrap().contains("is there twice"),
                "{key} twice"
            );
            let unknown = with_line(text, at, &format!("{key}x = 1"));
            assert!(kind.judge(unknown.as_bytes()).is_some(), "`{key}x` was taken");
        }
    }
    assert!(refused > 1000, "{refused}");
    println!("{refused} were refused");
}

#[test]
fn sizes_and_places_that_make_no_sense_are_refused() {
    let world = |text: &str| Kind::World.judge(format!("name = \"w\"\n{text}\n").as_bytes());
    for (text, expected) in [
        ("[[block]]\nat = [2, 0]\nsize_m = [-1, 1]", "size_m"),
        ("[[block]]\nat = [2, 0]\nsize_m = [0, 1]", "size_m"),
        ("[[circle]]\nat = [2, 0]\nradius_m = -0.5", "radius_m"),
        ("[[circle]]\nat = [2, 0]\nradius_m = inf", "radius_m"),
        ("[[circle]]\nat = [nan, 0]\nradius_m = 1", "at"),
        ("[[wall]]\npoints = [[0, 5]]", "takes 2"),
        ("[[wall]]\npoints = []", "takes 2"),
        ("[[wall]]\npoints = [[0, 5], [1e9, 5]]", "points"),
        ("[[line]]\npoints = [[0, 5], [1, 5]]\nwidth_m = -1", "width_m"),
        ("[floor]\nreflect_pct = 101", "reflect_pct"),
        ("[[start]]\nat = [0, 0]\n[[start]]\nat = [0, 0]", "same place"),
        ("wall = 5", "wall"),
        ("[wall]\npoints = [[0, 5], [1, 5]]", "wall"),
    ] {
        let message = world(text).unwrap_or_else(|| panic!("{text} was taken"));
        assert!(message.contains(expected), "{text} should say `{expected}`:\n{message}");
    }
}

#[test]
fn enormous_worlds_are_refused_or_read_in_bounded_time() {
    let block = |at: usize| {
        format!("[[block]]\nat = [{}, {}]\nsize_m = [0.1, 0.1]\n", 2 + at % 90, at / 90 % 90)
    };
    let many =
        |count: usize| (0..count).fold("name = \"w\"\n".to_owned(), |all, at| all + &block(at));
    for (text, refused) in [
        (many(World::MAX_THINGS), false),
        (many(World::MAX_THINGS + 1), true),
        (many(50_000), true),
    ] {
        let started = Instant::now();
        assert_eq!(Kind::World.judge(text.as_bytes()).is_some(), refused, "{} bytes", text.len());
        println!("{} bytes of world: {:?}", text.len(), started.elapsed());
        assert!(started.elapsed() < Duration::from_secs(30));
    }
}

/// One mutation of a text's bytes: what a slip of the hand, a bad disk or a curious person does.
#[derive(Debug, Clone)]
enum Mutation {
    Cut(usize),
    Remove(usize, usize),
    Insert(usize, Vec<u8>),
    Flip(usize, u8),
    RepeatLine(usize),
    Replace(usize, &'static str),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let words = prop::sample::select(vec![
        "nan",
        "inf",
        "-1",
        "1e400",
        "\"",
        "[",
        "]",
        "{",
        "}",
        "=",
        "\n",
        "#",
        "[[",
        "'''",
        "true",
        ".",
        "-",
        "99999999999999999999",
    ]);
    prop_oneof![
        any::<usize>().prop_map(Mutation::Cut),
        (any::<usize>(), 1..40_usize).prop_map(|(at, length)| Mutation::Remove(at, length)),
        (any::<usize>(), prop::collection::vec(any::<u8>(), 1..8))
            .prop_map(|(at, bytes)| Mutation::Insert(at, bytes)),
        (any::<usize>(), any::<u8>()).prop_map(|(at, bits)| Mutation::Flip(at, bits)),
        any::<usize>().prop_map(Mutation::RepeatLine),
        (any::<usize>(), words).prop_map(|(at, word)| Mutation::Replace(at, word)),
    ]
}

fn mutate(text: &str, mutations: &[Mutation]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for mutation in mutations {
        let length = bytes.len().max(1);
        match mutation {
            Mutation::Cut(at) => bytes.truncate(at % length),
            Mutation::Remove(at, count) => drop(
                bytes.drain((at % length).min(bytes.len())..(at % length + count).min(bytes.len())),
            ),
            Mutation::Insert(at, more) => drop(bytes.splice(
                (at % length).min(bytes.len())..(at % length).min(bytes.len()),
                more.iter().copied(),
            )),
            Mutation::Flip(at, bits) => {
                if let Some(byte) = bytes.get_mut(at % length) {
                    *byte ^= bits;
                }
            }
            Mutation::RepeatLine(at) => {
                let lines: Vec<&[u8]> = bytes.split(|&byte| byte == b'\n').collect();
                let line = lines[at % lines.len()].to_vec();
                bytes.push(b'\n');
                bytes.extend(line);
            }
            Mutation::Replace(at, word) => {
                // A number somewhere in the file becomes something else.
                let digits: Vec<usize> =
                    (0..bytes.len()).filter(|&at| bytes[at].is_ascii_digit()).collect();
                if let Some(&at) = digits.get(at % digits.len().max(1)) {
                    bytes.splice(at..=at, word.bytes());
                }
            }
        }
    }
    bytes
}

proptest! {
    #![proptest_config(
        ProptestConfig { cases: 1500, failure_persistence: None, ..ProptestConfig::default() }
    )]

    #[test]
    fn a_mutated_file_is_read_or_refused(
        which in any::<prop::sample::Index>(),
        mutations in prop::collection::vec(mutation(), 1..6),
    ) {
        let (kind, text) = *which.get(&texts());
        kind.judge(&mutate(text, &mutations));
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        for kind in [Kind::Robot, Kind::World, Kind::Team] {
            kind.judge(&bytes);
        }
    }
}
