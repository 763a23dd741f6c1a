//! `onbrick sim`: the simulated brick as a mounted file system.

mod exec;
mod private;
mod stand_in;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::common::{
    chosen_robot, load_robot, load_world, number_within, read_own, warn, write_file,
};
use super::terminal::stop_flags;
use super::{Context, Exit, Failure, Hint, Output};
use crate::clock::{Clock, MILLISECOND_NS, MonotonicClock, seconds};
use crate::ev3dev::{EV3, Inventory, LocalTree, PLATFORMS, Platform, Tree};
use crate::printable::in_shell;
use crate::sim::{
    Button, DeviceFault, EventLayout, Found, LcdGeometry, MOST_BEHIND_NS, Mount, MountError,
    Options, Order, Scenario, Simulation, StartPose, WorldPhysics, still,
};
use crate::simulated::furnished;

/// Mount a simulated brick, for any program that was written for ev3dev, until Ctrl-C.
///
/// Examples:
///   onbrick sim /tmp/brick                        then: onbrick run map --brick /tmp/brick
///   onbrick sim /tmp/bricks --robots 2 --world two-arenas --page
///   onbrick sim /tmp/brick --board brickpi3
///   onbrick sim /tmp/brick --scenario loose-plug.toml --show end.svg
///   onbrick sim fault /tmp/brick in1 stuck
///   onbrick sim press /tmp/brick enter --for 1s
///   onbrick sim exec /tmp/brick -- python3 my_robot.py
#[derive(Debug, clap::Args)]
#[command(
    verbatim_doc_comment,
    args_conflicts_with_subcommands = true,
    subcommand_negates_reqs = true
)]
pub(super) struct Arguments {
    #[command(subcommand)]
    command: Option<SimCommand>,
    /// An empty folder, or one to be made; with several robots their bricks are in 1, 2 and so on
    /// below it.
    #[arg(required = true)]
    mountpoint: Option<PathBuf>,
    /// The room: a world's file, or the name of a built-in one.
    #[arg(long, default_value = "arena")]
    world: PathBuf,
    /// How the robots are built, where the world does not say: a robot's file, or the name of a
    /// shipped one; without it as ./robot.toml says, and where there is none as the mapper.
    #[arg(long)]
    robot: Option<PathBuf>,
    /// How many robots are in it; each takes one of the world's start poses.
    #[arg(long, default_value_t = 1, value_parser = number_within(1..=100_usize))]
    robots: usize,
    /// Which board it is; other boards than the EV3 call ports otherwise, and most of them do not
    /// find out what is plugged in.
    #[arg(long, default_value = EV3.name, value_parser = PLATFORMS.map(|platform| platform.name))]
    board: String,
    /// What all chance comes from.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The screen's memory, dev/fb0: pixels across, pixels down, bits of a pixel.
    #[arg(long, default_value = "178x128x32", value_name = "WxHxBITS")]
    lcd: LcdGeometry,
    /// How wide a long is in the programs that read button events: 32 for those of the brick, run
    /// in an emulator.
    #[arg(long, default_value = native_bits(), value_parser = ["32", "64"], value_name = "BITS")]
    event_bits: String,
    /// A file that says what goes wrong when, in place of what the world says: a device pulled, a
    /// sensor stuck, a wheel blocked.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Show the room in a browser on this machine, at a port of your choice or any that is free.
    #[cfg(feature = "host")]
    #[arg(
        long,
        value_name = "PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "0",
    )]
    page: Option<u16>,
    /// Serve the brick's files to programs for the seed's node, on this machine alone, at port 5555
    /// or one of your choice; with several robots, each has the port after the one before.
    #[cfg(feature = "host")]
    #[arg(
        long,
        value_name = "PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "5555",
    )]
    node: Option<u16>,
    /// At the end, draw the room, what the robots drove and what they saw.
    #[arg(long, value_name = "FILE.svg")]
    show: Option<PathBuf>,
}

/// How often it is looked whether to end.
const LOOK_NS: i64 = 50 * MILLISECOND_NS;

#[derive(Serialize)]
struct Mounted<'m> {
    mountpoint: &'m str,
    bricks: Vec<String>,
    made_folder: bool,
    cleared_stale_mount: bool,
}

#[derive(Serialize)]
struct Ended {
    simulated_s: f64,
    lost_s: f64,
    unmounted_by_others: bool,
    faults: Vec<Done>,
}

/// Something that was done to a robot on purpose.
#[derive(Serialize)]
struct Done {
    time_s: f64,
    robot: usize,
    what: String,
}

#[derive(Debug, clap::Subcommand)]
enum SimCommand {
    /// Make something go wrong on a mounted brick, now: `in1 stuck`, `outB block for 2`, `in4
    /// unplug`, `battery 6.2`, `clear`.
    #[command(after_help = faults())]
    Fault {
        /// Where the brick is mounted: with several robots, the folder of one.
        brick: PathBuf,
        /// What is to go wrong, and where.
        #[arg(required = true, allow_negative_numbers = true)]
        order: Vec<String>,
    },
    /// Press buttons of a mounted brick, all at once: back, enter, up, left, right, down.
    Press {
        /// Where the brick is mounted: with several robots, the folder of one.
        brick: PathBuf,
        /// Which buttons.
        #[arg(required = true, value_parser = button, value_name = "BUTTON")]
        buttons: Vec<Button>,
        /// For how long: 1s, 250ms.
        #[arg(long = "for", default_value = "200ms", value_parser = span, value_name = "TIME")]
        hold: f64,
    },
    /// Run a program in a private view in which a mounted brick's /sys, /dev/input, /dev/fb0 and
    /// speaker lie over this machine's.
    Exec {
        /// Where the brick is mounted: with several robots, the folder of one.
        brick: PathBuf,
        /// The program and its arguments.
        #[arg(required = true, last = true, value_name = "PROGRAM")]
        program: Vec<OsString>,
    },
    /// What the stand-ins for beep, aplay, espeak and amixer start.
    #[command(hide = true)]
    StandIn {
        view: PathBuf,
        name: String,
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<String>,
    },
}

fn faults() -> String {
    let words: Vec<&str> = DeviceFault::words().collect();
    format!("Faults of a port: {}; in1 clear ends those of in1.", words.join(", "))
}

fn button(name: &str) -> Result<Button, String> {
    name.parse().map_err(|_| format!("the buttons are {}", Button::WORDS.join(", ")))
}

/// A time that a button can be held, in seconds.
fn span(text: &str) -> Result<f64, String> {
    let (number, unit_s) = match (text.strip_suffix("ms"), text.strip_suffix('s')) {
        (Some(number), _) => (number, 1e-3),
        (_, Some(number)) => (number, 1.0),
        _ => (text, 1.0),
    };
    let time_s = number.parse::<f64>().map_or(f64::NAN, |number| number * unit_s);
    if (0.002..=86_400.0).contains(&time_s) {
        Ok(time_s)
    } else {
        Err("a time is 2ms to 86400s, such as 1s or 250ms".to_owned())
    }
}

/// Writes orders to a mounted brick's `sim/orders`.
fn order(brick: &Path, order: &str, output: &mut Output) -> Result<(), Failure> {
    Order::parse(0, order).map_err(|error| {
        let failure = Failure::usage(format!("`{order}`: {}", error.message));
        failure.hint(error.hint.unwrap_or_else(|| {
            "in1 stuck, outB block for 2, in4 unplug, battery 6.2, clear".to_owned()
        }))
    })?;
    let file = brick.join("sim/orders");
    if !file.exists() {
        return Err(Failure::refused(format!(
            "there is no simulated brick mounted at {}",
            brick.display()
        ))
        .hint(if brick.join("1/sim/orders").exists() {
            format!("{}, the first of the several that are", brick.join("1").display())
        } else {
            "onbrick sim FOLDER, and then the same folder here".to_owned()
        }));
    }
    let written = std::fs::write(&file, order);
    written
        .context(Exit::Failed, format_args!("`{order}` was not done"))
        .map_err(|failure| failure.hint(fitting(brick)))?;
    output.show(format!("done: {order}"), &serde_json::json!({ "done": order }));
    Ok(())
}

/// What an order can be about.
fn fitting(brick: &Path) -> String {
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(brick));
    let devices = Inventory::read(&tree).map(|found| found.devices).unwrap_or_default();
    let plugged: Vec<String> = devices
        .iter()
        .filter(|entry| entry.class != "lego-port")
        .map(|entry| format!("{} {}", Platform::short(&entry.address), entry.driver))
        .collect();
    let buttons = if Platform::of(&tree).buttons.is_none() { "; it has no buttons" } else { "" };
    format!("an order that fits what the brick has: {}{buttons}", plugged.join(", "))
}

pub(super) fn run(arguments: &Arguments, output: &mut Output) -> Result<(), Failure> {
    match &arguments.command {
        Some(SimCommand::Fault { brick, order: words }) => {
            return order(brick, &words.join(" "), output);
        }
        Some(SimCommand::Press { brick, buttons, hold }) => {
            let press = |button: &Button| format!("press {} for {hold}", button.as_str());
            return order(brick, &buttons.iter().map(press).collect::<Vec<_>>().join("\n"), output);
        }
        Some(SimCommand::Exec { brick, program }) => return exec::exec(brick, program, output),
        Some(SimCommand::StandIn { view, name, arguments }) => {
            return exec::stand_in(view, name, arguments, output);
        }
        None => {}
    }
    let Some(mountpoint) = &arguments.mountpoint else {
        return Err(Failure::usage("where is the brick to be mounted?").hint("onbrick sim FOLDER"));
    };
    // Before anything is mounted, so that no signal can leave it behind.
    let flags = stop_flags()?;
    let (simulation, starts) = simulation(arguments, output)?;
    // A still that cannot be written is known now, and not when there was something to see.
    let is_svg = |file: &Path| file.extension().is_some_and(|end| end.eq_ignore_ascii_case("svg"));
    if let Some(file) = arguments.show.as_deref().filter(|file| !is_svg(file)) {
        let message = format!("the room is drawn as SVG, and {} is none", file.display());
        return Err(Failure::usage(message).hint("--show with a name that ends in .svg"));
    }
    arguments.show.as_ref().map_or(Ok(()), |file| draw(file, &simulation))?;
    let events =
        if arguments.event_bits == "32" { EventLayout::Bits32 } else { EventLayout::Bits64 };
    let (mount, found) =
        Mount::new(&simulation, mountpoint, events).map_err(|error| refused(&error))?;
    tell(arguments, &mount, &starts, found, output);
    #[cfg(feature = "host")]
    let _page = page(arguments, &simulation, output)?;
    #[cfg(feature = "host")]
    let nodes = nodes(arguments, &mount, output)?;
    while !flags.is_raised() && !mount.is_over() {
        MonotonicClock.sleep_ns(LOOK_NS);
    }
    let unmounted_by_others = mount.is_over();
    // What they have open would keep the brick mounted.
    #[cfg(feature = "host")]
    drop(nodes);
    mount.unmount().map_err(|error| {
        Failure::from_error(Exit::Failed, "cannot take the mount away", &error).hint(error.hint())
    })?;
    tell_end(&simulation, unmounted_by_others, output);
    match &arguments.show {
        Some(file) => draw(file, &simulation),
        None => Ok(()),
    }
}

/// Says how long it was, and what was done to the robots on purpose.
fn tell_end(simulation: &Simulation, unmounted_by_others: bool, output: &mut Output) {
    let (simulated_s, lost_s) = (seconds(simulation.now_ns()), seconds(simulation.lost_ns()));
    let lost = if lost_s >= 0.05 {
        format!(", and {lost_s:.1} s were lost: this machine was too slow")
    } else {
        String::new()
    };
    let by = if unmounted_by_others { " by another program" } else { "" };
    let done = simulation.faults_done().into_iter().map(|record| Done {
        time_s: seconds(record.time_ns),
        robot: record.robot + 1,
        what: record.what,
    });
    let faults: Vec<Done> = done.collect();
    let told: String = faults
        .iter()
        .map(|done| format!("\n{:8.3} s, robot {}: {}", done.time_s, done.robot, done.what))
        .collect();
    output.show(
        format!("unmounted{by} after {simulated_s:.1} simulated seconds{lost}{told}"),
        &Ended { simulated_s, lost_s, unmounted_by_others, faults },
    );
}

/// Writes the still.
fn draw(file: &Path, simulation: &Simulation) -> Result<(), Failure> {
    write_file(file, still(simulation).as_bytes())
}

/// Serves the page, where it is asked for.
#[cfg(feature = "host")]
fn page(
    arguments: &Arguments,
    simulation: &Simulation,
    output: &mut Output,
) -> Result<Option<crate::report::live::LocalPage>, Failure> {
    use crate::report::live::{Board, Sources};
    let Some(port) = arguments.page else { return Ok(None) };
    let board = Board::default();
    let title = arguments.world.display().to_string();
    board.show(Sources { title, simulation: Some(simulation.clone()), ..Sources::default() });
    let page = board.serve(port, &[], |_| ())?;
    output
        .show(format!("the room is at {}", page.url()), &serde_json::json!({ "page": page.url() }));
    Ok(Some(page))
}

/// Serves the bricks' files, where it is asked for.
#[cfg(feature = "host")]
fn nodes(
    arguments: &Arguments,
    mount: &Mount,
    output: &mut Output,
) -> Result<Vec<crate::link::Node>, Failure> {
    let Some(first) = arguments.node else { return Ok(Vec::new()) };
    let mut nodes = Vec::new();
    for robot in 0..arguments.robots {
        // From 0 on, each takes any that is free.
        let beyond = if first == 0 { 0 } else { robot };
        let port = u16::try_from(beyond).ok().and_then(|beyond| first.checked_add(beyond));
        let port = port.ok_or_else(|| {
            Failure::usage(format!("there are too few ports from {first} on"))
                .hint("--node with a smaller number")
        })?;
        let served = crate::link::Node::serve(&mount.root(robot), &format!("127.0.0.1:{port}"));
        let node = served.context(Exit::Refused, "no node").hint("--node with another number")?;
        output.show(
            format!("the files of robot {} are at tcp://{}", robot + 1, node.address()),
            &serde_json::json!({ "robot": robot + 1, "node": node.address() }),
        );
        nodes.push(node);
    }
    Ok(nodes)
}

/// The scenario, read before anything is mounted.
fn scenario(arguments: &Arguments) -> Result<Option<Scenario>, Failure> {
    let Some(path) = &arguments.scenario else { return Ok(None) };
    const SHOWN: &str = "onbrick explain using, which shows one";
    let source = read_own(path, SHOWN)?;
    let parsed = Scenario::parse(&source.name, source.text.as_bytes());
    let (scenario, warnings) = parsed.map_err(Failure::from).hint(SHOWN)?;
    warn(&warnings);
    Ok(Some(scenario))
}

/// The simulation, and where its robots start.
fn simulation(
    arguments: &Arguments,
    output: &mut Output,
) -> Result<(Simulation, Vec<StartPose>), Failure> {
    let scenario = scenario(arguments)?;
    let (mut source, _) = load_world(&arguments.world)?;
    if let Some(path) = chosen_robot(arguments.robot.as_deref(), output) {
        source = furnished(source, &load_robot(Some(&path))?.config);
    }
    let (world, _) = source.world()?;
    let starts = world.starts().to_vec();
    let scenario = scenario.unwrap_or_else(|| world.scenario().clone());
    let physics = WorldPhysics::new(world, arguments.robots, arguments.seed).map_err(|error| {
        Failure::refused(error.to_string())
            .hint("fewer --robots, or a world with more start poses (onbrick new world)")
    })?;
    let platform = Platform::named(&arguments.board).unwrap_or_default();
    let options = Options { platform, lcd: arguments.lcd, udev: true, ..Options::default() };
    let clock = Arc::new(MonotonicClock);
    let simulation = Simulation::with_options(clock, Box::new(physics), arguments.seed, options);
    simulation.give_up_behind_ns(MOST_BEHIND_NS);
    if arguments.show.is_some() {
        simulation.watch();
    }
    simulation.play(&scenario);
    Ok((simulation, starts))
}

fn refused(error: &MountError) -> Failure {
    let exit =
        if matches!(error, MountError::Failed { .. }) { Exit::Failed } else { Exit::Refused };
    Failure::from_error(exit, "no simulated brick", error).hint(error.hint())
}

/// The way to a run is shown for the first robots.
const MOST_SHOWN: usize = 4;

fn tell(
    arguments: &Arguments,
    mount: &Mount,
    starts: &[StartPose],
    found: Found,
    output: &mut Output,
) {
    let point = mount.point().display().to_string();
    let bricks: Vec<String> =
        (0..arguments.robots).map(|robot| mount.root(robot).display().to_string()).collect();
    if found.stale {
        output.line(format!("took away what a simulator had left mounted at {point}"));
    }
    if found.made {
        output.line(format!("made the folder {point}"));
    }
    let first = in_shell(&mount.root(0));
    let what = if bricks.len() == 1 {
        "a simulated brick".to_owned()
    } else {
        format!("{} simulated bricks", bricks.len())
    };
    let board = Platform::named(&arguments.board).unwrap_or_default();
    let no_button = if board.buttons.is_none() { " --no-button" } else { "" };
    // Several recordings make one map where each robot knows where it stands.
    let is_alone = arguments.robots == 1;
    let runs = starts.iter().take(arguments.robots.min(MOST_SHOWN)).enumerate();
    let runs: String = runs
        .map(|(robot, start)| {
            let pose = if is_alone { String::new() } else { format!(" --pose={start}") };
            let brick = in_shell(&mount.root(robot));
            format!("\x20 onbrick run map --brick {brick}{no_button}{pose}\n")
        })
        .collect();
    output.show(
        format!(
            "mounted {what} at {point}; Ctrl-C unmounts. Try, in another terminal:\n\
             \x20 onbrick devices --brick {first}\n\
             {runs}\
             \x20 cat {first}/sys/class/tacho-motor/motor0/position"
        ),
        &Mounted {
            mountpoint: &point,
            bricks,
            made_folder: found.made,
            cleared_stale_mount: found.stale,
        },
    );
}

fn native_bits() -> &'static str {
    if EventLayout::NATIVE == EventLayout::Bits32 { "32" } else { "64" }
}
