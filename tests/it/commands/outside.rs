//! Other people's programs: the thirty lines of `tests/examples/wander.rs`, and crates outside the
//! repository.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::done;
use crate::support::{pass_over, turning_brick::TurningBrick};

/// The example that `cargo test` built beside this program.
fn wander() -> PathBuf {
    let test = std::env::current_exe().unwrap();
    test.ancestors().nth(2).unwrap().join("examples/wander")
}

#[test]
fn the_documented_program_wanders_under_leases_and_stops() {
    let program = wander();
    if !program.exists() {
        return pass_over(
            "the example wander, which `cargo test` builds and `cargo test --test it` does not",
        );
    }
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
fn the_documented_program_is_about_thirty_lines() {
    let text = include_str!("../../examples/wander.rs");
    let main = text.split("fn main()").nth(1).unwrap();
    let lines = main
        .lines()
        .filter(|line| !line.trim().is_empty() && !line.trim().starts_with("//"))
        .count();
    assert!(lines <= 50, "{lines} lines");
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
    let whole = "fn main() {\n    let names: Vec<&str> = \
        onbrick::sim::World::names().collect();\n    println!(\"{}\", names.join(\" \"));\n\
        \x20   // Without libzmq's CURVE there is no key.\n\
        \x20   println!(\"key {}\", onbrick::link::KeyPair::generate().unwrap().public());\n}\n";
    let printed = outside(folder.path(), "whole", "", whole);
    assert!(printed.contains("arena") && printed.contains("\nkey "), "{printed}");
}
