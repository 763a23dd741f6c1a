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

/// A crate that depends on this one by path, with these features, and what it prints when it runs.
fn outside(folder: &Path, name: &str, features: &str, main: &str) -> String {
    let repository = env!("CARGO_MANIFEST_DIR");
    let place = folder.join(name);
    std::fs::create_dir_all(place.join("src")).unwrap();
    let manifest = format!(
        "[package]\nname = \"{name}\"\nversion = \"0.1.0\"\nedition = \"2024\"\n[workspace]\n\
         [dependencies]\nonbrick = {{ path = \"{repository}\"{features} }}\n"
    );
    std::fs::write(place.join("Cargo.toml"), manifest).unwrap();
    // The same versions as here, which are downloaded already.
    std::fs::copy(Path::new(repository).join("Cargo.lock"), place.join("Cargo.lock")).unwrap();
    std::fs::write(place.join("src/main.rs"), main).unwrap();
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("outside");
    let mut cargo = Command::new("cargo");
    for (key, _) in
        std::env::vars_os().filter(|(key, _)| key.to_string_lossy().starts_with("CARGO_PKG"))
    {
        cargo.env_remove(key);
    }
    // The check is that it compiles; it need not be fast or have line numbers.
    let output = cargo
        .args(["run", "--quiet", "--offline"])
        .current_dir(&place)
        .env("CARGO_TARGET_DIR", target)
        .env("CARGO_PROFILE_DEV_DEBUG", "0")
        .env("CARGO_PROFILE_DEV_OPT_LEVEL", "0")
        .env_remove("RUSTFLAGS")
        .output()
        .unwrap();
    let said = done(&output);
    assert_eq!(said.code, Some(0), "{name}: {}", said.err);
    said.out
}

#[test]
fn crates_outside_the_repository_compile_and_run() {
    if Command::new("cargo").arg("--version").output().is_err() {
        return pass_over("cargo, for crates outside the repository");
    }
    let folder = tempfile::tempdir().unwrap();
    let bindings = "use std::sync::Arc;\n\
        use onbrick::ev3dev::{LocalTree, TachoMotor, Tree};\n\
        fn main() {\n    let brick: Arc<dyn Tree> = Arc::new(LocalTree::new(\"/nowhere\"));\n\
        \x20   println!(\"{}\", TachoMotor::at(&brick, &\"outB\".parse().unwrap()).is_err());\n}\n";
    let printed = outside(folder.path(), "bindings", ", default-features = false", bindings);
    assert_eq!(printed, "true\n", "there is no motor");
    let bare = "use onbrick::mapping::{Estimator, EstimatorConfig, Geometry, Inputs, Method, \
        Pose};\n\
        fn main() {\n    let geometry = Geometry::new(0.189, 0.114).unwrap();\n\
        \x20   let mut estimator = Estimator::new(EstimatorConfig { geometry, method: \
        Method::Default }, Pose::default());\n\
        \x20   for (time_ns, rad) in [(0, 0.0), (20_000_000, 0.1)] {\n\
        \x20       let inputs = Inputs { time_ns, left_rad: Some(rad), right_rad: Some(rad), \
        ..Inputs::default() };\n\
        \x20       println!(\"{:.6}\", estimator.update(&inputs).pose.x_m);\n    }\n}\n";
    let tick = ", default-features = false, features = [\"tick\"]";
    let printed = outside(folder.path(), "tick", tick, bare);
    assert_eq!(printed, "0.000000\n0.003008\n", "a tenth of a radian of a wheel of 0.189 m");
    let linking = "fn main() {\n    let names: Vec<&str> = \
        onbrick::sim::World::names().collect();\n    println!(\"{}\", names.join(\" \"));\n\
        \x20   // Without libzmq's CURVE there is no key.\n\
        \x20   println!(\"key {}\", onbrick::link::KeyPair::generate().unwrap().public());\n}\n";
    // All features are built by `release.sh`, of the crate as it is packaged: a static program, for
    // which the linker is told another order of libraries.
    let linked = ", default-features = false, features = [\"link\", \"sim\"]";
    let printed = outside(folder.path(), "linked", linked, linking);
    assert!(printed.contains("arena") && printed.contains("\nkey "), "{printed}");
}
