//! Finding devices, and what is said when they are not found.

use std::sync::Arc;

use nix::errno::Errno;
use onbrick::ev3dev::{
    Cause, Class, Driver, FindError, GyroSensor, Inventory, LinearActuator, LocalTree, PortAddress,
    Sensor, TachoMotor, Tree, UltrasonicSensor, devices, find,
};

use crate::support::brick::{
    FakeTree, LINEAR, MOTOR, SENSOR, linear_tables, plug_large_motor, plug_sensor,
};

fn port(text: &str) -> PortAddress {
    text.parse().unwrap()
}

fn brick() -> FakeTree {
    let fake = FakeTree::default();
    plug_large_motor(&fake, "sys/class/tacho-motor/motor10", "ev3-ports:outA\n");
    plug_large_motor(&fake, "sys/class/tacho-motor/motor9", "ev3-ports:outB\n");
    let linear = [
        ("address", "ev3-ports:outC\n"),
        ("driver_name", "act-l12-ev3-50\n"),
        ("max_speed", "24\n"),
        ("count_per_m", "2000\n"),
        ("full_travel_count", "100\n"),
    ];
    fake.plug(LINEAR, &linear_tables(), &linear);
    fake.put("sys/class/tacho-motor/motor10", "driver_name", b"lego-ev3-m-motor\n");
    plug_sensor(&fake, SENSOR, "ev3-ports:in3\n", "lego-ev3-us\n", "US-DIST-CM US-LISTEN\n");
    plug_sensor(
        &fake,
        "sys/class/lego-sensor/sensor1",
        "ev3-ports:in1:i2c1\n",
        "lego-nxt-us\n",
        "NXT-US-CM\n",
    );
    fake
}

#[test]
fn devices_are_listed_in_the_order_of_their_numbers() {
    let names: Vec<String> = devices(&brick().tree(), Class::TachoMotor)
        .unwrap()
        .into_iter()
        .map(|found| found.name)
        .collect();
    assert_eq!(names, ["linear1", "motor9", "motor10"]);
}

#[test]
fn a_class_without_a_folder_has_no_devices() {
    assert_eq!(devices(&brick().tree(), Class::DcMotor).unwrap(), []);
}

#[test]
fn devices_are_found_by_port_and_by_driver() {
    let tree = brick().tree();
    assert_eq!(TachoMotor::at(&tree, &port("outB")).unwrap().identity().name, "motor9");
    assert_eq!(TachoMotor::at(&tree, &port("ev3-ports:outA")).unwrap().identity().name, "motor10");
    assert_eq!(
        TachoMotor::find(&tree, None, Some("lego-ev3-m-motor")).unwrap().identity().name,
        "motor10"
    );
    assert_eq!(LinearActuator::find(&tree, None, None).unwrap().count_per_m(), 2000);
    assert_eq!(LinearActuator::find(&tree, None, None).unwrap().full_travel_count(), 100);
    assert_eq!(
        UltrasonicSensor::find(&tree, None).unwrap().identity().address,
        port("ev3-ports:in3")
    );
    assert_eq!(Sensor::at(&tree, &port("in1")).unwrap().identity().driver.as_str(), "lego-nxt-us");
    assert_eq!(find(&tree, Class::LegoSensor, None, Some("lego-nxt-us")).unwrap().name, "sensor1");
}

#[test]
fn a_driver_that_is_not_known_by_name_is_found_all_the_same() {
    let fake = brick();
    fake.put(SENSOR, "driver_name", b"made-by-somebody\n");
    let found = find(&fake.tree(), Class::LegoSensor, Some(&port("in3")), None).unwrap();
    assert_eq!((found.driver.as_str(), found.known_driver()), ("made-by-somebody", None));
    let motor = find(&fake.tree(), Class::TachoMotor, Some(&port("outA")), None).unwrap();
    assert_eq!(motor.known_driver(), Some(Driver::MediumMotor));
}

#[test]
fn what_was_not_found_says_what_there_is() {
    let tree = brick().tree();
    let messages = [
        UltrasonicSensor::at(&tree, &port("in2")).unwrap_err().to_string(),
        GyroSensor::at(&tree, &port("in3")).unwrap_err().to_string(),
        GyroSensor::find(&tree, None).unwrap_err().to_string(),
        TachoMotor::find(&tree, None, None).unwrap_err().to_string(),
        TachoMotor::at(&tree, &port("outC")).unwrap_err().to_string(),
        TachoMotor::at(&FakeTree::default().tree(), &port("outC")).unwrap_err().to_string(),
    ];
    let sensors = "there is lego-ev3-us on in3, lego-nxt-us on in1:i2c1";
    let motors =
        "there is act-l12-ev3-50 on outC, lego-ev3-l-motor on outB, lego-ev3-m-motor on outA";
    let expected = [
        format!("no ultrasonic sensor on in2; {sensors}"),
        format!("no gyro sensor on in3, but lego-ev3-us; {sensors}"),
        format!("no gyro sensor; {sensors}"),
        "more than one motor, name a port; there is lego-ev3-l-motor on outB, \
         lego-ev3-m-motor on outA"
            .to_owned(),
        format!("no motor on outC, but act-l12-ev3-50; {motors}"),
        "no motor on outC; nothing of this kind is plugged in".to_owned(),
    ];
    assert_eq!(messages, expected);
}

#[test]
fn a_device_that_is_pulled_while_we_look_is_left_out() {
    let fake = brick();
    fake.fail("sys/class/tacho-motor/motor9", "driver_name", Some(Errno::ENODEV), None);
    let names: Vec<String> = devices(&fake.tree(), Class::TachoMotor)
        .unwrap()
        .into_iter()
        .map(|found| found.name)
        .collect();
    assert_eq!(names, ["linear1", "motor10"]);
}

#[test]
fn a_device_without_an_address_is_an_error_and_not_left_out() {
    let fake = brick();
    fake.put("sys/class/tacho-motor/motor9", "address", b"\n");
    let error = devices(&fake.tree(), Class::TachoMotor).unwrap_err();
    let FindError::Device(error) = error else { panic!("{error}") };
    assert!(matches!(error.cause, Cause::Malformed(_)), "{error}");
}

#[test]
fn the_inventory_reads_everything_and_changes_nothing() {
    let fake = brick();
    fake.put("sys/class/tacho-motor/motor9", "position", b"-12\n");
    fake.put(SENSOR, "value0", b"1234\n");
    fake.put(SENSOR, "decimals", b"1\n");
    fake.put(SENSOR, "units", b"cm\n");
    fake.fail("sys/class/tacho-motor/motor10", "speed", Some(Errno::EIO), None);
    let inventory = Inventory::read(&fake.tree()).unwrap();
    let lines: Vec<String> = inventory
        .devices
        .iter()
        .map(|entry| {
            let readings: Vec<String> = entry
                .readings
                .iter()
                .map(|live| format!("{}={}{}", live.name, live.value, live.unit))
                .collect();
            format!(
                "{} {} {} {}",
                entry.name,
                entry.address,
                readings.join(" "),
                entry.problem.is_some()
            )
        })
        .collect();
    assert_eq!(
        lines,
        [
            "linear1 ev3-ports:outC position=0counts speed=0counts/s duty_cycle=0% state= false",
            "motor9 ev3-ports:outB position=-12counts speed=0counts/s duty_cycle=0% state= false",
            "motor10 ev3-ports:outA position=0counts true",
            "sensor0 ev3-ports:in3 US-DIST-CM=123.4cm false",
            "sensor1 ev3-ports:in1:i2c1 NXT-US-CM=0 false",
        ]
    );
    assert_eq!(inventory.battery, None);
    assert_eq!(fake.calls().writes, 0);
    assert!(serde_json::to_string(&inventory).unwrap().contains("\"driver\":\"lego-nxt-us\""));
}

#[test]
fn a_machine_that_is_no_brick_has_an_empty_inventory() {
    let folder = tempfile::tempdir().unwrap();
    let tree: Arc<dyn Tree> = Arc::new(LocalTree::new(folder.path()));
    let inventory = Inventory::read(&tree).unwrap();
    assert_eq!((inventory.devices.len(), inventory.battery), (0, None));
}

#[test]
fn a_found_motor_on_its_port_is_the_one_that_was_named() {
    let fake = FakeTree::default();
    plug_large_motor(&fake, MOTOR, "spi0.1:MA\n");
    assert_eq!(
        TachoMotor::at(&fake.tree(), &port("spi0.1:MA")).unwrap().identity().address.as_str(),
        "spi0.1:MA"
    );
}
