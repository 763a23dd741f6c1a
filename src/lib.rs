//! onbrick: a runtime that lives on the LEGO EV3 brick under ev3dev.
//!
//! It runs on ev3dev's other boards, too: [`ev3dev::Platform`].
//!
//! One static file is copied to the brick and there senses, decides, drives and maps by itself; a
//! network is never inside the control loop. The same program on a PC drives a simulated brick and
//! draws what was found. As a library it is typed bindings, a behaviour engine, a mapper and the
//! tick that joins them, for robots of your own.
//!
//! This page is the map of the code: what the parts are, which way the data flows, and what may be
//! relied on.
//!
//! # The way the data flows
//!
//! ```text
//!    ev3dev files                                                                  ev3dev files
//!   attributes ──▶ senses ──▶ estimate ──▶ map ──▶ behaviour machines ──▶ demands ──▶ attributes
//!                     │           │          │             │
//!                     └───────────┴──────────┴─────────────┴──▶ recorder ──▶ run.mcap
//!                                                               run.mcap ──▶ plot, export, replay
//! ```
//!
//! One turn of the loop is a *tick*: sense, estimate, map, decide, act, record, in this order, on
//! one thread, from one monotonic time. A tick allocates nothing, waits for no disk, socket or
//! lock, reads each attribute with one system call, and writes only what changed and the leases
//! that are due. Tests count all of that (`tests/it/tick.rs`).
//!
//! # The parts
//!
//! `use` points downwards only; a test holds it to that.
//!
//! | part | what it is |
//! |---|---|
//! | [`cli`] | one file a command; the only place that prints (feature `cli`) |
//! | [`menu`] | what stands on the brick's screen, and what its buttons do (feature `cli`) |
//! | [`report`] | pictures and exports of finished runs, the live page of others (feature `host`) |
//! | [`link`] | the network: a brick's server, the PC's client, keys (feature `link`) |
//! | [`service`] | what a brick does between and around runs: the state, the runs on disk, the operations (feature `cli`) |
//! | [`protocol`] | what is asked of a brick and what it answers, over the network and on the brick |
//! | [`simulated`] | a run on a simulated brick: what a run is handed there (feature `sim`) |
//! | [`commissioning`] | before there is a run: setting a robot up, measuring it, looking it over |
//! | [`runtime`] | a run: checks, control loop, guard, replay |
//! | [`recording`] | `run.mcap`: the recorder's thread, and reading what it wrote, whole or cut |
//! | [`robot`] | roles: which port is the left wheel, the head, the range sensor; senses and demands in SI units; leases |
//! | [`behavior`] | state machines: engine, conditions, missions from TOML, checks, graphs; pure. [`behavior::missions`] shows by examples how missions are written |
//! | [`planning`] | where to drive: frontiers of the map, ways along free cells; pure |
//! | [`mapping`] | odometry, heading, point cloud, occupancy grid, merging; pure |
//! | [`sim`] | simulated brick: world, body, driver behaviour (feature `sim`) |
//! | [`page`] | a page for a browser on this machine: the server behind live pages and that of a class (feature `host`) |
//! | [`senses`] | what a robot senses: one table from a driver's mode to a name in missions |
//! | [`ev3dev`] | typed devices over attribute files: motors, sensors, ports, lights, battery, buttons, sound |
//! | [`document`] | files that people write: places, carets, nearest names |
//! | [`printable`] | texts of others, made fit to be shown on a terminal, in a log, on a page |
//! | [`clock`] | monotonic time: real, or virtual for simulation and tests |
//! | [`units`] | quantities with a legal range, angles, whole numbers of floats |
//!
//! Absences are part of the design: only `ev3dev` touches device files; only `clock` reads a clock
//! or sleeps; `behavior` and `mapping` do no I/O and take time as an argument; what runs on the
//! tick's path knows no network and no pictures.
//!
//! # Processes
//!
//! ```text
//! run, or the service ── orders ──▶ guard ── orders, heartbeat ──▶ control
//!                     ◀── events ──       ◀── heartbeat, events ──
//! ```
//!
//! A run has processes of its own, this same file started again under hidden commands
//! ([`runtime::RunProcess`]). *Control* drives. The *guard* holds the hardware's lock and passes
//! orders and events on. Each beats, and listens to the other: when control is gone or hung
//! ([`runtime::Watch`]), the guard kills it, so that one that wakes up cannot renew a lease, brakes
//! the motors at once, and again when control is gone. When the guard is gone or hung
//! ([`runtime::Pulse`]), control stops the run. When the starter is gone, or hangs for 5 s, the
//! guard has control stop, unless the job says otherwise. A run that does not stop within 0.7 s
//! when it is asked to is ended by force ([`runtime::evict()`]), by the one that asked: the lock
//! names both processes. Who has no pipe to it asks by a lock ([`runtime::StopRequest`]). When both
//! are killed at once, the starter brakes the motors; when all three are, the leases end. The guard
//! has a higher real-time priority than control, control may not spin for more than 0.2 s, and
//! where neither is permitted, as on most PCs, the log says so. A simulated brick lives inside
//! control, and has no guard; with `run --page` it and its control are threads of the command, so
//! that the page can look into the simulation.
//!
//! `onbrick serve` starts the same processes for the clients of its transports ([`service`]); the
//! processes do not need it, and a restarted service finds a run in progress.
//!
//! # Words
//!
//! *Brick*: the root under which `sys/class/...` is found: `/` on the brick, a mount point, or the
//! in-process simulation. *Robot*: roles bound to ports (`robot.toml`). *Senses*: one tick's
//! readings in SI units. *Demands*: what the machines want of the actuators. *Machine*, *state*,
//! *transition*: one finite-state machine of a mission. *Sub-machine*: a machine inside a state.
//! *Mission*: machines that run side by side (`mission.toml`). *Run*: one execution of a mission,
//! recorded in one `run.mcap`. *World*: a simulated room (`world.toml`). *Team*: several bricks
//! with known start poses (`team.toml`). *Lease*: a motion that the kernel itself ends unless it is
//! renewed.
//!
//! # Conventions
//!
//! Everywhere x is ahead, y left, anticlockwise positive; metres, seconds and radians in code and
//! recordings; names carry the unit where a person writes them (`range_m`, `head_deg`, `left_dps`:
//! degrees a second at the wheel's axle). The gyro's clockwise-positive reading is turned round in
//! [`robot`], and nowhere else. Time is integer nanoseconds.
//!
//! What a recording can be replayed through computes the same bits on a PC and on the brick: one
//! float type (`f64`), sines and their like through `libm` (a clippy list keeps `f64::sin` and the
//! others out), no order from hash maps, ChaCha8 where there is chance.
//!
//! # Motion
//!
//! Every motion that a mission makes, the head's too, is a lease ([`robot::LeasedMotor`]):
//! `run-timed` for 300 ms, renewed about every 100 ms while the loop is healthy, ramps 0, stop
//! action brake. A position is reached by deciding the speed tick by tick. A process that is killed
//! or hangs therefore leaves motors that stop by themselves. On every other way out - the mission's
//! end, an error, a panic in any of its threads, a signal of [`runtime::STOP_SIGNALS`], Enter or
//! Back on the brick - control stops them itself. A battery that gets low
//! ([`robot::BatteryLimits`]) slows the robot down and then ends the run. A lock that names its
//! owner gives the hardware to one run at a time; between runs nothing of ours touches a motor.
//!
//! Each tick also checks one aspect of one motor, in turn, and before each command everything of
//! that motor is checked. A motor that another program has commanded or reset, or whose settings it
//! has changed, ends the run and is left alone from then on. An unplugged device is looked for by
//! its port, off the tick's path, and bound again: angles continue where they were, modes are
//! restored, a motion never. What the mission does meanwhile is its `on_lost`. A device whose
//! readings cannot be true ends the run ([`runtime::StopReason::Implausible`]).
//!
//! # What may never happen
//!
//! - A motor that turns after the process that commanded it is gone, hung, or was told to stop.
//! - A motor of ours moved by a process that is not the run's owner; another program's motor moved
//!   by us.
//! - A reading that was not read: no default, no zero, no last value without its age.
//! - A map record lost that was synced, a wrong record taken for a right one, a cut file that
//!   cannot be opened.
//! - A wait for network, entropy or disk before or during motion.
//!
//! # Features
//!
//! With none, the library is bindings: [`ev3dev`], [`senses`], [`clock`] and [`units`]. `tick` adds
//! engine, estimator, mapping, recording, leases and the tick, and all further features imply it:
//! `sim` adds the simulated brick, `host` pictures and progress bars, `cli` the commands, `link`
//! (which implies `cli`) the network. `host` implies `link` and `sim`, and is on by default; the
//! brick's file has `link` alone.
//!
//! # The interface
//!
//! Enums that grow with sensors, boards and causes of errors are `#[non_exhaustive]`: match them
//! with a last arm. [`behavior::Drive`] is not, since what executes it has to know all. Of crates
//! below 1.0, an interface has types of `arrayvec` (a tick allocates nothing), `nix` (what the
//! kernel answered, and signals), `nalgebra` (a pose as a transformation), `embedded-graphics-core`
//! (the menu's canvas) and `zmq::Error`: a breaking version of one of these is one of ours.
//!
//! [`using`] is for those who use the program, and [`changelog`] says what changed between
//! versions, and what stays compatible.

#[cfg(feature = "tick")]
pub mod behavior;
#[doc = include_str!("CHANGELOG.md")]
pub mod changelog {}
#[cfg(feature = "cli")]
pub mod cli;
pub mod clock;
#[cfg(feature = "tick")]
pub mod commissioning;
#[cfg(feature = "tick")]
pub mod document;
pub mod ev3dev;
#[cfg(feature = "link")]
pub mod link;
#[cfg(feature = "tick")]
pub mod mapping;
#[cfg(feature = "cli")]
pub mod menu;
#[cfg(feature = "host")]
pub mod page;
#[cfg(feature = "tick")]
pub mod planning;
#[cfg(feature = "tick")]
pub mod printable;
#[cfg(feature = "tick")]
pub mod protocol;
#[cfg(feature = "tick")]
pub mod recording;
#[cfg(feature = "host")]
pub mod report;
#[cfg(feature = "tick")]
pub mod robot;
#[cfg(feature = "tick")]
pub mod runtime;
pub mod senses;
#[cfg(feature = "cli")]
pub mod service;
#[cfg(feature = "sim")]
pub mod sim;
#[cfg(feature = "sim")]
pub mod simulated;
#[cfg(feature = "tick")]
mod threads;
pub mod units;
#[doc = include_str!("USING.md")]
pub mod using {}
