//! Other people's programs: the examples of the library, and crates outside the repository.

use std::path::Path;
use std::process::Command;

use onbrick::sim::World;

use super::done;
use crate::foreign::bench::{Simulator, Truth, example};
use crate::missions::{line_points, to_ring_m};
use crate::mount::bench::{no_fuse, real_time};
use crate::support::real_time::{Pace, in_real_time};
use crate::support::{pass_over, turning_brick::TurningBrick};

#[test]
fn the_documented_program_wanders_under_leases_and_stops() {
    let Some(program) = example("wander") else { return };
    let brick = TurningBrick::new();
    let mut child = Command::new(program)
        .arg(brick.root())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    brick.await_driving();
    let read = |attribute| brick.read("tacho-motor/motor1", attribute);
    assert_eq!(["time_sp", "stop_action"].map(read), ["300", "brake"], "every motion is a lease");
    assert!(child.try_wait().unwrap().is_none(), "it drives for ten seconds");
    let said = done(&child.wait_with_output().unwrap());
    assert_eq!((said.code, said.err.as_str()), (Some(0), ""));
    assert_eq!(
        brick.commands(),
        ["reset", "stop", "stop"],
        "and drops its motors, which stops them"
    );
    // Straight for half a metre at 3 rad/s of a 0.189 m wheel, turning for a second: it is away
    // from where it began.
    let numbers: Vec<f64> =
        said.out.split([' ', ',']).filter_map(|word| word.trim().parse().ok()).collect();
    assert!(libm::hypot(numbers[0], numbers[1]) > 0.2 && numbers[2].abs() > 0.1, "{}", said.out);
}

#[test]
fn the_documented_programs_are_sixty_lines_at_most() {
    for text in [
        include_str!("../../examples/square.rs"),
        include_str!("../../examples/line.rs"),
        include_str!("../../examples/wander.rs"),
    ] {
        let lines = text
            .lines()
            .filter(|line| !line.trim().is_empty() && !line.trim().starts_with("//"))
            .count();
        assert!(lines <= 60, "{lines} lines");
    }
}

#[test]
fn the_documented_programs_say_in_words_why_they_fail() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["square", "line", "wander"] {
        let Some(program) = example(name) else { return };
        let said = done(&Command::new(program).arg(folder.path()).output().unwrap());
        assert_eq!(said.code, Some(1), "{name}: {}", said.err);
        assert!(said.err.starts_with("error: no ") && !said.err.contains('"'), "{}", said.err);
    }
}

#[test]
fn the_documented_square_is_driven_and_ends_where_it_began() {
    drives("square", "open", &[], |pace, truth| {
        let turned_deg = truth.heading_deg;
        let off_m = libm::hypot(truth.x_m, truth.y_m);
        pace.ensure(truth.travelled_m > 1.5, || format!("four sides of 0.4 m: {truth:?}"));
        pace.near("once round", turned_deg, 360.0, 20.0);
        pace.ensure(off_m < 0.1 && truth.speed_mps.abs() < 1e-3, || format!("{truth:?}"));
    });
}

#[test]
fn the_documented_line_follower_follows_the_line() {
    drives("line", "line", &["12"], |pace, truth| {
        // Of the floor's line, and the sensor is ahead of the axle.
        let points = line_points(World::text("line").unwrap());
        let heading_rad = truth.heading_deg.to_radians();
        let ahead_m = 0.07;
        let sensor = [
            truth.x_m + ahead_m * libm::cos(heading_rad),
            truth.y_m + ahead_m * libm::sin(heading_rad),
        ];
        let off_m = to_ring_m(&points, sensor);
        pace.ensure(truth.travelled_m > 0.5, || format!("{truth:?}"));
        pace.ensure(off_m < 0.04, || format!("{off_m} m from the line: {truth:?}"));
    });
}

/// Runs an example on a mounted brick in a world, and looks at where the robot is at its end.
fn drives(name: &str, world: &str, arguments: &[&str], check: impl Fn(&Pace, &Truth)) {
    let Some(program) = example(name) else { return };
    if no_fuse() {
        return;
    }
    let _alone = real_time();
    in_real_time(name, |pace| {
        let simulator = Simulator::start(pace, world);
        let said = done(
            &Pace::command(program.to_str().unwrap())
                .arg(simulator.root())
                .args(arguments)
                .output()
                .unwrap(),
        );
        assert_eq!((said.code, said.err.as_str()), (Some(0), ""));
        // What rolls on at the program's end comes to rest.
        std::thread::sleep(std::time::Duration::from_millis(500));
        check(pace, &simulator.truth());
    });
}

/// What crates outside the repository are made of: their names, their programs, and what these say.
const OUTSIDE: [(&str, &str, &str); 3] = [
    (
        "bindings",
        r#"use std::sync::Arc;
use onbrick::ev3dev::{LocalTree, TachoMotor, Tree};
fn main() {
    let brick: Arc<dyn Tree> = Arc::new(LocalTree::new("/nowhere"));
    println!("{}", TachoMotor::at(&brick, &"outB".parse().unwrap()).is_err());
}
"#,
        // There is no motor.
        "true\n",
    ),
    (
        "estimator",
        r#"use onbrick::mapping::{Estimator, EstimatorConfig, Geometry, Inputs, Method, Pose};
fn main() {
    let config =
        EstimatorConfig { geometry: Geometry::new(0.189, 0.114).unwrap(), method: Method::Default };
    let mut estimator = Estimator::new(config, Pose::default());
    for (time_ns, rad) in [(0, 0.0), (20_000_000, 0.1)] {
        let inputs =
            Inputs { time_ns, left_rad: Some(rad), right_rad: Some(rad), ..Inputs::default() };
        println!("{:.6}", estimator.update(&inputs).pose.x_m);
    }
}
"#,
        // A tenth of a radian of a wheel of 0.189 m.
        "0.000000\n0.003008\n",
    ),
    (
        "linked",
        r#"fn main() {
    println!("{}", onbrick::sim::World::names().any(|name| name == "arena"));
    // Without libzmq's CURVE there is no key.
    println!("{}", onbrick::link::KeyPair::generate().unwrap().public().to_string().len());
}
"#,
        "true\n40\n",
    ),
];

/// One package with all of the programs, and with the features that they need together: that the
/// library compiles with fewer, `.ci/run` checks; with all, `brick-image/release.sh` builds it of
/// the crate as it is packaged, as a static program, for which the linker is told another order of
/// libraries.
#[test]
fn crates_outside_the_repository_compile_and_run() {
    if Command::new("cargo").arg("--version").output().is_err() {
        return pass_over("cargo, for crates outside the repository");
    }
    let folder = tempfile::tempdir().unwrap();
    let repository = env!("CARGO_MANIFEST_DIR");
    let manifest = format!(
        "[package]\nname = \"outside\"\nversion = \"0.1.0\"\nedition = \"2024\"\n[workspace]\n\
         [dependencies.onbrick]\npath = \"{repository}\"\ndefault-features = false\n\
         features = [\"link\", \"sim\"]\n"
    );
    std::fs::write(folder.path().join("Cargo.toml"), manifest).unwrap();
    // The same versions as here, which are downloaded already.
    std::fs::copy(Path::new(repository).join("Cargo.lock"), folder.path().join("Cargo.lock"))
        .unwrap();
    std::fs::create_dir_all(folder.path().join("src/bin")).unwrap();
    for (name, program, _) in OUTSIDE {
        std::fs::write(folder.path().join(format!("src/bin/{name}.rs")), program).unwrap();
    }
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("outside");
    let mut cargo = Command::new("cargo");
    for (key, _) in
        std::env::vars_os().filter(|(key, _)| key.to_string_lossy().starts_with("CARGO_PKG"))
    {
        cargo.env_remove(key);
    }
    // The check is that it compiles; it need not be fast or have line numbers.
    let built = cargo
        .args(["build", "--quiet", "--offline"])
        .current_dir(folder.path())
        .env("CARGO_TARGET_DIR", &target)
        .env("CARGO_PROFILE_DEV_DEBUG", "0")
        .env("CARGO_PROFILE_DEV_OPT_LEVEL", "0")
        .env_remove("RUSTFLAGS")
        .output()
        .unwrap();
    let built = done(&built);
    assert_eq!(built.code, Some(0), "{}", built.err);
    for (name, _, expected) in OUTSIDE {
        let said = done(&Command::new(target.join("debug").join(name)).output().unwrap());
        assert_eq!((said.code, said.out.as_str()), (Some(0), expected), "{name}: {}", said.err);
    }
}
