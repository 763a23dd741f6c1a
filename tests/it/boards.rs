//! Other boards than the EV3: their names, and what a run, the menu and a person's stop button make
//! of them. Setting them up is in `setup::boards`.

use std::collections::BTreeMap;
use std::process::Command;
use std::sync::Arc;

use nix::errno::Errno;
use onbrick::clock::{Clock as _, SECOND_NS, VirtualClock};
use onbrick::ev3dev::{
    Access, BRICKPI, BRICKPI3, EV3, EVB, PISTORMS, PLATFORMS, Platform, PortAddress, TachoMotor,
    Tree,
};
use onbrick::recording::StopReason;
use onbrick::robot::{DEFAULT_ROBOT, LeasedMotor, halt, still, watch_still};
use onbrick::runtime::Refused;
use onbrick::sim::{Options, Simulation, World, WorldPhysics};

use crate::support::promised::promised;
use crate::support::stage::{Play, Played};
use crate::support::tested_program;

/// What the kernel's drivers call everything that a program looks for, written down from the
/// sources that `ev3dev::Platform` names; held against the simulated tree.
const NAMES: [(&Platform, &str); 5] = [
    (
        &EV3,
        "dev: platform-gpio_keys-event platform-sound-event fb0\n\
         leds: led0:green:brick-status/255 led0:red:brick-status/255 led1:green:brick-status/255 \
         led1:red:brick-status/255\n\
         lego-ev3-battery: current_now scope technology type voltage_max_design voltage_min_design \
         voltage_now\n\
         board0: HW_REV=7 MODEL=LEGO MINDSTORMS EV3 ROM_REV=6 SERIAL_NUM=001653500000 TYPE=main\n\
         inputs: ev3-ports:in1 ev3-ports:in2 ev3-ports:in3 ev3-ports:in4; ev3-input-port: auto \
         nxt-analog nxt-color nxt-i2c other-i2c ev3-analog ev3-uart other-uart raw\n\
         outputs: ev3-ports:outA ev3-ports:outB ev3-ports:outC ev3-ports:outD; ev3-output-port: \
         auto tacho-motor dc-motor led raw\n\
         motor: lego-ev3-l-motor; run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct \
         stop reset; coast brake hold\n\
         bus: ev3-analog-sensor ev3-uart-host legoev3-motor rcx-led rcx-motor\n",
    ),
    (
        &BRICKPI3,
        "dev:\n\
         leds: led1:amber:brick-status/100\n\
         brickpi3-battery: scope type voltage_now\n\
         board0: HW_REV=A02082 MODEL=Raspberry Pi 3 Model B Rev 1.2 SERIAL_NUM=001653500000 \
         TYPE=main\n\
         board1: FW_VER=1.4.6 HW_REV=3.2.1 MODEL=Dexter Industries BrickPi3 TYPE=aux\n\
         inputs: spi0.1:S1 spi0.1:S2 spi0.1:S3 spi0.1:S4; brickpi3-in-port: none nxt-analog \
         nxt-color nxt-i2c ev3-analog ev3-uart\n\
         outputs: spi0.1:MA spi0.1:MB spi0.1:MC spi0.1:MD; brickpi3-out-port: tacho-motor dc-motor \
         led\n\
         motor: lego-nxt-motor; run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct \
         stop reset; coast brake hold\n\
         bus: ev3-analog-sensor ev3-motor ev3-uart-sensor rcx-led rcx-motor\n",
    ),
    (
        &BRICKPI,
        "dev:\n\
         leds: led1:blue:brick-status/255 led2:blue:brick-status/255\n\
         brickpi-battery: present scope status technology type voltage_now\n\
         board0: HW_REV=A02082 MODEL=Raspberry Pi 3 Model B Rev 1.2 SERIAL_NUM=001653500000 \
         TYPE=main\n\
         board1: FW_VER=2 MODEL=Dexter Industries BrickPi TYPE=aux\n\
         inputs: serial0-0:S1 serial0-0:S2 serial0-0:S3 serial0-0:S4; brickpi-in-port: none \
         nxt-analog nxt-color nxt-i2c ev3-analog ev3-uart\n\
         outputs: serial0-0:MA serial0-0:MB serial0-0:MC serial0-0:MD; brickpi-out-port: \
         tacho-motor dc-motor led\n\
         motor: lego-nxt-motor; run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct \
         stop reset; coast hold\n\
         bus: ev3-analog-sensor ev3-motor ev3-uart-sensor rcx-led rcx-motor\n",
    ),
    (
        &PISTORMS,
        "dev: platform-3f804000.i2c-event\n\
         leds: pistorms:BA:blue:brick-status/255 pistorms:BA:green:brick-status/255 \
         pistorms:BA:red:brick-status/255 pistorms:BB:blue:brick-status/255 \
         pistorms:BB:green:brick-status/255 pistorms:BB:red:brick-status/255\n\
         pistorms-battery: present scope status technology type voltage_now\n\
         board0: HW_REV=A02082 MODEL=Raspberry Pi 3 Model B Rev 1.2 SERIAL_NUM=001653500000 \
         TYPE=main\n\
         board1: FW_VER=V2.06 MODEL=PiStorms TYPE=aux\n\
         inputs: pistorms:BAS1 pistorms:BAS2 pistorms:BBS1 pistorms:BBS2; pistorms-in-port: none \
         nxt-analog nxt-color i2c-thru ev3-analog ev3-uart\n\
         outputs: pistorms:BAM1 pistorms:BAM2 pistorms:BBM1 pistorms:BBM2; ms-nxtmmx-out-port: \
         tacho-motor\n\
         motor: lego-nxt-motor; run-forever run-to-abs-pos run-to-rel-pos run-timed stop reset; \
         coast brake hold\n\
         bus: ev3-analog-sensor ev3-motor ev3-uart-sensor rcx-led rcx-motor\n",
    ),
    (
        &EVB,
        "dev: platform-evb-buttons-event\n\
         leds:\n\
         evb-battery: scope type voltage_now\n\
         board0: MODEL=TI AM335x BeagleBone Black SERIAL_NUM=001653500000 TYPE=main\n\
         board1: MODEL=FatcatLab EVB\n\
         inputs: evb-ports:in1 evb-ports:in2 evb-ports:in3 evb-ports:in4; ev3-input-port: auto \
         nxt-analog nxt-color nxt-i2c other-i2c ev3-analog ev3-uart other-uart raw\n\
         outputs: evb-ports:outA evb-ports:outB evb-ports:outC evb-ports:outD; ev3-output-port: \
         auto tacho-motor dc-motor led raw\n\
         motor: lego-ev3-l-motor; run-forever run-to-abs-pos run-to-rel-pos run-timed run-direct \
         stop reset; coast brake hold\n\
         bus: ev3-analog-sensor ev3-uart-host legoev3-motor rcx-led rcx-motor\n",
    ),
];

/// A brick on a board, in a room.
struct Bench {
    clock: Arc<VirtualClock>,
    simulation: Simulation,
    tree: Arc<dyn Tree>,
}

impl Bench {
    fn new(platform: &'static Platform) -> Self {
        let clock = Arc::new(VirtualClock::default());
        let physics = WorldPhysics::new(World::named("arena").unwrap(), 1, 1).unwrap();
        let options = Options { platform, ..Options::default() };
        let simulation = Simulation::with_options(clock.clone(), Box::new(physics), 1, options);
        let tree: Arc<dyn Tree> = simulation.brick(0);
        let bench = Self { clock, simulation, tree };
        bench.pass(3 * SECOND_NS);
        bench
    }

    fn pass(&self, span_ns: i64) {
        self.clock.sleep_ns(span_ns);
        self.simulation.catch_up();
    }

    fn list(&self, folder: &str) -> Vec<String> {
        let mut names = self.tree.list(folder).unwrap_or_default();
        names.sort();
        names
    }

    fn read(&self, path: &str) -> Result<String, Errno> {
        let mut text = [0; 1024];
        let read = self.tree.open(path, Access::Read).and_then(|file| file.read(&mut text));
        let length = read?;
        Ok(String::from_utf8_lossy(&text[..length]).trim_end().to_owned())
    }

    fn write(&self, path: &str, text: &str) -> Result<(), Errno> {
        self.tree.open(path, Access::Write)?.write(text.as_bytes()).map(drop)
    }

    /// The folder of the device with this address, in a class.
    fn at(&self, class: &str, address: &str) -> String {
        let folders = self.list(&format!("sys/class/{class}")).into_iter();
        let mut folders = folders.map(|name| format!("sys/class/{class}/{name}"));
        folders
            .find(|folder| self.read(&format!("{folder}/address")).as_deref() == Ok(address))
            .unwrap_or_else(|| panic!("no {class} at {address}"))
    }

    /// Everything that has a name, in the form of [`NAMES`].
    fn names(&self, platform: &Platform) -> String {
        let words = |head: &str, names: Vec<String>| {
            let names: String = names.iter().map(|name| format!(" {name}")).collect();
            format!("{head}:{names}\n")
        };
        let mut devices = self.list("dev/input/by-path");
        devices.extend(self.list("dev").into_iter().filter(|name| name != "input"));
        let mut shown = words("dev", devices);
        let leds = self.list("sys/class/leds").into_iter().map(|led| {
            let most = self.read(&format!("sys/class/leds/{led}/max_brightness")).unwrap();
            format!("{led}/{most}")
        });
        shown += &words("leds", leds.collect());
        for battery in self.list("sys/class/power_supply") {
            let own = self.list(&format!("sys/class/power_supply/{battery}"));
            let common = ["device", "power", "subsystem", "uevent"];
            let own = own.into_iter().filter(|name| !common.contains(&name.as_str()));
            shown += &words(&battery, own.collect());
        }
        for board in self.list("sys/class/board-info") {
            let says = self.read(&format!("sys/class/board-info/{board}/uevent")).unwrap();
            let says =
                says.lines().map(|line| line.strip_prefix("BOARD_INFO_").unwrap().to_owned());
            shown += &words(&board, says.collect());
        }
        let mut ports: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for port in self.list("sys/class/lego-port") {
            let read =
                |name: &str| self.read(&format!("sys/class/lego-port/{port}/{name}")).unwrap();
            let modes = read("modes").replace(['[', ']'], "");
            ports
                .entry(format!("; {}: {modes}", read("driver_name")))
                .or_default()
                .push(read("address"));
        }
        let mut ports: Vec<_> = ports.into_iter().collect();
        ports.sort_by_key(|(_, addresses)| {
            platform.outputs.iter().any(|out| addresses[0].ends_with(out))
        });
        for (what, (driver, addresses)) in ["inputs", "outputs"].iter().zip(ports) {
            shown += &format!("{what}: {}{driver}\n", addresses.join(" "));
        }
        let wheel = platform.outputs[1];
        let motor = self.at("tacho-motor", &format!("{}:{wheel}", platform.parent));
        let [driver, commands, actions] = ["driver_name", "commands", "stop_actions"]
            .map(|name| self.read(&format!("{motor}/{name}")).unwrap());
        shown += &format!("motor: {driver}; {commands}; {actions}\n");
        // Of each kind of sensor one, on a board whose ports must be told.
        if !platform.detects {
            for (input, mode, driver) in
                [(0, "ev3-uart", "lego-ev3-us"), (1, "ev3-analog", "lego-ev3-touch")]
            {
                let address = format!("{}:{}", platform.parent, platform.inputs[input]);
                let port = self.at("lego-port", &address);
                self.write(&format!("{port}/mode"), mode).unwrap();
                self.write(&format!("{port}/set_device"), driver).unwrap();
                let sensor = self.at("lego-sensor", &address);
                assert_eq!(self.read(&format!("{sensor}/driver_name")).as_deref(), Ok(driver));
            }
        }
        shown + &words("bus", self.list("sys/bus/lego/drivers"))
    }
}

#[test]
fn each_boards_tree_has_the_names_of_its_kernel() {
    assert_eq!(NAMES.map(|(platform, _)| platform), PLATFORMS);
    for (platform, names) in NAMES {
        assert_eq!(Bench::new(platform).names(platform), names, "{}", platform.name);
    }
}

#[test]
fn each_board_is_found_by_what_it_says_of_itself() {
    for platform in PLATFORMS {
        assert_eq!(Platform::of(&Bench::new(platform).tree), platform);
    }
}

/// What motors' drivers do otherwise, from the sources that the platform's documentation names.
#[test]
fn motors_differ_as_their_drivers_do() {
    for platform in PLATFORMS {
        let bench = Bench::new(platform);
        let name = platform.name;
        let motor =
            bench.at("tacho-motor", &format!("{}:{}", platform.parent, platform.outputs[1]));
        let read = |attribute: &str| bench.read(&format!("{motor}/{attribute}"));
        let write =
            |attribute: &str, value: &str| bench.write(&format!("{motor}/{attribute}"), value);
        let is_pistorms = *platform == PISTORMS;
        let is_brickpi3 = *platform == BRICKPI3;
        let unless = |differs: bool, errno: Errno| if differs { Err(errno) } else { Ok(()) };
        // What moves first.
        assert_eq!(write("command", "run-direct"), unless(is_pistorms, Errno::EINVAL), "{name}");
        assert_eq!(
            write("stop_action", "brake"),
            unless(*platform == BRICKPI, Errno::EINVAL),
            "{name}"
        );
        assert_eq!(write("hold_pid/Kp", "1000"), unless(is_brickpi3, Errno::EOPNOTSUPP), "{name}");
        assert_eq!(read("speed").map(drop), unless(is_pistorms, Errno::EOPNOTSUPP), "{name}");
        assert_eq!(read("duty_cycle").map(drop), unless(is_pistorms, Errno::EOPNOTSUPP), "{name}");
        write("speed_sp", "200").unwrap();
        write("command", "run-forever").unwrap();
        let still = is_pistorms || *platform == BRICKPI;
        assert_eq!(write("position", "0"), unless(still, Errno::EBUSY), "{name}");
        write("stop_action", "hold").unwrap();
        write("command", "stop").unwrap();
        let holds = if is_pistorms || is_brickpi3 { "running holding" } else { "holding" };
        assert_eq!(read("state").as_deref(), Ok(holds), "{name}");
        write("command", "reset").unwrap();
        assert_eq!(write("position", "5"), unless(is_pistorms, Errno::EINVAL), "{name}");
        assert_eq!(write("position", "0"), Ok(()), "{name}");
        // A timed run ends by the kernel's timer on each: what the lease stands on.
        for (attribute, value) in [
            ("speed_sp", "200"),
            ("time_sp", "500"),
            ("stop_action", "coast"),
            ("command", "run-timed"),
        ] {
            write(attribute, value).unwrap();
        }
        bench.pass(SECOND_NS / 4);
        assert!(read("state").unwrap().contains("running"), "{name}");
        bench.pass(SECOND_NS / 2);
        assert_eq!(read("state").as_deref(), Ok(""), "{name}");
    }
}

/// A stalled motor says so on an EV3, and never on a BrickPi3.
#[test]
fn a_brickpi3_never_says_that_a_motor_is_stalled() {
    for (platform, says) in [(&EV3, true), (&BRICKPI3, false)] {
        let bench = Bench::new(platform);
        let motor =
            bench.at("tacho-motor", &format!("{}:{}", platform.parent, platform.outputs[1]));
        bench.write("sim/orders", "outB block").unwrap();
        bench.write(&format!("{motor}/speed_sp"), "300").unwrap();
        bench.write(&format!("{motor}/command"), "run-forever").unwrap();
        bench.pass(SECOND_NS);
        let state = bench.read(&format!("{motor}/state")).unwrap();
        assert_eq!(state.contains("stalled"), says, "{}: {state}", platform.name);
    }
}

/// A motor that is held rocks by less than this, radians; one that runs turns by 3 and more.
const ROCKS_RAD: f64 = 0.1;

/// The kernel's timer ends a lease on each board, and `halt` stops a motor whatever it does.
#[test]
fn promise_1_on_each_board_a_lease_ends_by_itself_and_halt_stops_what_turns() {
    for platform in PLATFORMS {
        let bench = Bench::new(platform);
        let port: PortAddress = "outB".parse().unwrap();
        let motor = TachoMotor::at(&bench.tree, &port).unwrap();
        let mut motor = LeasedMotor::take(motor, 1.0, 10.0).unwrap();
        let angle_rad = |motor: &LeasedMotor| motor.angle_rad().unwrap();
        motor.turn(3.0, bench.clock.now_ns()).unwrap();
        bench.pass(SECOND_NS / 5);
        assert!(angle_rad(&motor) > 0.1, "{}: {} rad", platform.name, angle_rad(&motor));
        bench.pass(SECOND_NS / 2);
        let stood_rad = angle_rad(&motor);
        bench.pass(SECOND_NS);
        assert!((angle_rad(&motor) - stood_rad).abs() < ROCKS_RAD, "{}", platform.name);
        promised(&format!("{}: {stood_rad:.2} rad after one renewal", platform.name));
        let wheel = format!("{}:{}", platform.parent, platform.outputs[1]);
        let folder = bench.at("tacho-motor", &wheel);
        bench.write(&format!("{folder}/speed_sp"), "300").unwrap();
        bench.write(&format!("{folder}/command"), "run-forever").unwrap();
        bench.pass(SECOND_NS / 2);
        assert!(angle_rad(&motor) > stood_rad + 1.0, "{}", platform.name);
        assert_eq!(halt(&bench.tree).unwrap().len(), bench.list("sys/class/tacho-motor").len());
        still(&bench.tree, &[port], &*bench.clock).unwrap();
        assert_eq!(watch_still(&bench.tree, &*bench.clock, SECOND_NS / 5).unwrap(), [""; 0]);
        bench.pass(SECOND_NS / 2);
        let stood_rad = angle_rad(&motor);
        bench.pass(SECOND_NS);
        assert!((angle_rad(&motor) - stood_rad).abs() < ROCKS_RAD, "{}", platform.name);
    }
}

/// A board that does not find out has no sensor, takes what it is told, and knows no unplugging.
#[test]
fn a_port_that_is_told_has_a_sensor_whatever_is_plugged_in() {
    let bench = Bench::new(&BRICKPI3);
    assert!(bench.list("sys/class/lego-sensor").is_empty());
    let port = bench.at("lego-port", "spi0.1:S1");
    let set = |attribute: &str, value: &str| bench.write(&format!("{port}/{attribute}"), value);
    assert_eq!(set("set_device", "lego-ev3-us"), Err(Errno::EOPNOTSUPP));
    set("mode", "ev3-uart").unwrap();
    assert_eq!(set("set_device", "lego-ev3-touch"), Err(Errno::EINVAL));
    // In the arena's robot this port has the ultrasonic sensor.
    set("set_device", "lego-ev3-us").unwrap();
    let sensor = bench.at("lego-sensor", "spi0.1:S1");
    bench.pass(SECOND_NS);
    let value = || bench.read(&format!("{sensor}/value0")).unwrap().parse::<i32>().unwrap();
    let before = value();
    assert!(before > 0);
    bench.write("sim/orders", "in1 unplug").unwrap();
    bench.pass(3 * SECOND_NS);
    assert_eq!(value(), before);
    // What is not there measures nothing.
    set("set_device", "lego-ev3-gyro").unwrap();
    let sensor = bench.at("lego-sensor", "spi0.1:S1");
    bench.pass(SECOND_NS);
    assert_eq!(bench.read(&format!("{sensor}/value0")).as_deref(), Ok("0"));
}

/// The shipped robot, whose touch sensor is its stop button instead of its bumper.
fn with_stop_button() -> String {
    let robot = DEFAULT_ROBOT.replace("\n[touch] ", "\n[stop_button] ");
    assert_ne!(robot, DEFAULT_ROBOT);
    robot
}

fn mapping_on(platform: &'static Platform) -> Play {
    let mut play = Play::of("map", "arena", 1).seconds(8.0);
    play.platform = platform;
    play
}

/// The robot stands, and no motor is under a command; one that cannot be braked is held.
fn assert_stands(played: &Played, platform: &Platform) {
    if *platform == BRICKPI {
        assert_eq!(played.states, ["holding"; 3]);
        assert!(played.truth.speed_mps.abs() < 1e-3, "{} m/s", played.truth.speed_mps);
    } else {
        played.assert_at_rest(platform.name);
    }
}

#[test]
fn the_shipped_robot_drives_on_each_board_by_the_same_file_and_stands_still_after() {
    for platform in PLATFORMS {
        let name = platform.name;
        let mut play = mapping_on(platform);
        play.no_button = platform.buttons.is_none();
        let played = play.play().unwrap_or_else(|refused| panic!("{name}: {}", refused.stop()));
        assert_eq!(played.reason, StopReason::Finished, "{name}: {}", played.ended);
        let run = played.run();
        assert_eq!(run.info.as_ref().unwrap().board, platform);
        let first = &played.truths[0];
        let went_m = played
            .truths
            .iter()
            .map(|truth| libm::hypot(truth.x_m - first.x_m, truth.y_m - first.y_m));
        let went_m = went_m.fold(0.0, f64::max);
        assert!(went_m > 0.2, "{name}: {went_m} m");
        assert!(!run.points.is_empty(), "{name}: nothing was mapped");
        assert_stands(&played, platform);
    }
}

#[test]
fn a_run_without_a_stop_button_is_refused_unless_that_was_said() {
    for platform in PLATFORMS {
        let played = mapping_on(platform).play();
        if platform.buttons.is_some() {
            assert!(played.is_ok(), "{}", platform.name);
            continue;
        }
        let refused = played.unwrap_err();
        assert!(matches!(&refused, Refused::NoButton(_)), "{refused}");
        let way_out = refused.way_out(None).unwrap();
        assert!(way_out.contains("[stop_button]") && way_out.contains("--no-button"), "{way_out}");
    }
}

/// A board whose ports find out says that a motor is gone; on another one it is a wheel that does
/// not turn. Another program's hand is seen on each.
#[test]
fn promise_4_on_each_board_what_becomes_of_a_wheel_ends_the_run() {
    for platform in PLATFORMS {
        for kind in ["block", "unplug", "write stop_action coast"] {
            let what = format!("{}, {kind}", platform.name);
            let mut play = mapping_on(platform);
            play.no_button = platform.buttons.is_none();
            let fault = format!("[[fault]]\nat_s = 2\nport = \"outB\"\nkind = \"{kind}\"\n");
            let played = play.scenario(&fault).play().unwrap();
            let gone = kind == "unplug" && platform.detects;
            let as_promised = match played.reason {
                StopReason::Lost(_) => gone,
                StopReason::Stalled => !gone && !kind.starts_with("write"),
                StopReason::Outside(_) => kind.starts_with("write"),
                _ => false,
            };
            assert!(as_promised, "{what}: {}", played.ended);
            promised(&format!("{what}: ended {:.2} s after it", played.drove_s - 2.0));
            assert!(played.drove_s < 5.0, "{what}: {} s", played.drove_s);
        }
    }
}

#[test]
fn a_touch_sensor_stops_a_run_where_the_file_says_so() {
    for platform in [&BRICKPI3, &BRICKPI, &PISTORMS, &EV3] {
        let play = Play { robot_toml: with_stop_button(), ..mapping_on(platform) };
        let pressed = play.scenario("[[fault]]\nat_s = 3\nport = \"in2\"\nkind = \"wrong\"\n");
        let played = pressed.play().unwrap();
        assert_eq!(played.reason, StopReason::Button, "{}: {}", platform.name, played.ended);
        // A PiStorms is asked once a second.
        let by_s = if *platform == PISTORMS { 4.5 } else { 3.5 };
        assert!((3.0..by_s).contains(&played.drove_s), "{}: {} s", platform.name, played.drove_s);
        assert_stands(&played, platform);
    }
}

/// A button on a GPIO is an input device like the EV3's own buttons, which stand in for it here.
#[test]
fn a_stop_button_can_be_an_input_device_and_a_run_is_refused_without_it() {
    let with = |device: &str| Play {
        robot_toml: format!("{DEFAULT_ROBOT}\n[stop_button]\ndevice = \"{device}\"\n"),
        ..mapping_on(&EV3)
    };
    let own = with("/dev/input/by-path/platform-gpio_keys-event");
    let pressed = own.scenario("[[press]]\nat_s = 3\nbutton = \"back\"\n").play().unwrap();
    assert_eq!(pressed.reason, StopReason::Button, "{}", pressed.ended);
    assert!((3.0..3.2).contains(&pressed.drove_s), "{} s", pressed.drove_s);
    let refused = with("/dev/input/by-path/platform-button@4-event").play().unwrap_err();
    let said = refused.stop().to_string();
    assert!(said.contains("stop_button"), "{said}");
}

#[test]
fn a_board_without_buttons_has_none_to_be_pressed() {
    for platform in PLATFORMS {
        let pressed = Bench::new(platform).simulation.control(0, "press enter");
        let said = pressed.map_err(|error| error.to_string());
        let expected = platform.buttons.map(drop).ok_or("the board has no buttons".to_owned());
        assert_eq!(said, expected, "{}", platform.name);
    }
}

#[test]
fn the_menu_is_refused_in_words_where_the_board_has_no_screen_for_it() {
    for platform in PLATFORMS {
        let Err(why) = platform.screen else { continue };
        let folder = tempfile::tempdir().unwrap();
        let board = folder.path().join("sys/class/board-info/board0");
        std::fs::create_dir_all(&board).unwrap();
        let says = format!("BOARD_INFO_MODEL={}\n", platform.models[0]);
        std::fs::write(board.join("uevent"), says).unwrap();
        let root = folder.path().to_str().unwrap();
        let menu = Command::new(tested_program())
            .args(["menu", "--brick", root, "--config", root])
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&menu.stderr);
        assert_eq!(menu.status.code(), Some(3), "{said}");
        assert!(said.contains(platform.what) && said.contains(why), "{said}");
        assert!(said.contains("onbrick run here"), "no way out: {said}");
    }
}
