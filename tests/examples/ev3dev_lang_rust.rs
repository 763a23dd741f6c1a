//! A program on crates.io's `ev3dev-lang-rust`, in the style of its own examples: drives a square's
//! corner, reads every sensor, sets the lights.
//!
//! It knows nothing of onbrick, and looks for its devices in `/sys/class`. The test `foreign` runs
//! it where a simulated brick is mounted there, and compares what it prints with where the robot
//! truly is. On a real brick it does the same.
//!
//! No buttons: the library's `Button::process` panics on 64-bit machines, where it does not get the
//! number of its ioctl into an unsigned long.

#![allow(clippy::print_stdout, reason = "what it prints is its result")]

use std::time::{Duration, Instant};

use ev3dev_lang_rust::motors::{LargeMotor, MediumMotor, MotorPort};
use ev3dev_lang_rust::sensors::{
    ColorSensor, GyroSensor, Sensor as _, SensorPort, TouchSensor, UltrasonicSensor,
};
use ev3dev_lang_rust::{Device as _, Ev3Result, Led, PowerSupply};

/// What comes in the first moments after a change of mode is what that mode last measured, or 0.
const SETTLE: Duration = Duration::from_millis(300);

/// Degrees of a wheel of 188.976 mm for a quarter turn with 114.3 mm between the wheels.
const QUARTER: i32 = 171;

fn main() -> Ev3Result<()> {
    let (left, right) = (LargeMotor::get(MotorPort::OutB)?, LargeMotor::get(MotorPort::OutD)?);
    let head = MediumMotor::find()?;
    println!("motors {} {} {}", left.get_address()?, right.get_address()?, head.get_address()?);
    println!("large {}", LargeMotor::list()?.len());
    for motor in [&left, &right] {
        motor.reset()?;
        motor.set_stop_action(LargeMotor::STOP_ACTION_HOLD)?;
        motor.set_speed_sp(300)?;
    }
    go(&left, &right, [720, 720])?;
    println!("ahead {} {}", left.get_position()?, right.get_position()?);
    go(&left, &right, [-QUARTER, QUARTER])?;
    println!("turned {} {}", left.get_position()?, right.get_position()?);
    go(&left, &right, [360, 360])?;
    println!("end {} {}", left.get_position()?, right.get_position()?);
    println!("state {}", left.get_state()?.join(","));
    timed(&head)?;
    sensors()?;
    board()?;
    left.stop()?;
    right.stop()
}

/// Turns the wheels by these degrees and waits until they stand still.
fn go(left: &LargeMotor, right: &LargeMotor, degrees: [i32; 2]) -> Ev3Result<()> {
    for (motor, degrees) in [left, right].into_iter().zip(degrees) {
        motor.run_to_rel_pos(Some(degrees))?;
    }
    for motor in [left, right] {
        motor.wait_until_not_moving(Some(Duration::from_secs(10)));
    }
    std::thread::sleep(SETTLE);
    Ok(())
}

/// Half a second of the head's motor; the library waits by `epoll` on the state.
fn timed(head: &MediumMotor) -> Ev3Result<()> {
    head.set_stop_action(MediumMotor::STOP_ACTION_BRAKE)?;
    head.set_speed_sp(200)?;
    let start = Instant::now();
    head.run_timed(Some(Duration::from_millis(500)))?;
    let stood = head.wait_until_not_moving(Some(Duration::from_secs(5)));
    println!("timed {} {stood} {}", head.get_position()?, start.elapsed().as_secs_f64());
    Ok(())
}

fn sensors() -> Ev3Result<()> {
    let sonar = UltrasonicSensor::get(SensorPort::In1)?;
    sonar.set_mode_us_dist_cm()?;
    println!("cm {}", sonar.get_distance_centimeters()?);
    println!("modes {}", sonar.get_modes()?.join(","));
    println!("touch {}", TouchSensor::find()?.get_pressed_state()?);
    let eye = ColorSensor::find()?;
    eye.set_mode_col_color()?;
    std::thread::sleep(SETTLE);
    println!("colour {}", eye.get_color()?);
    eye.set_mode_rgb_raw()?;
    std::thread::sleep(SETTLE);
    println!("rgb {:?}", eye.get_rgb()?);
    let gyro = GyroSensor::find()?;
    gyro.set_mode_gyro_ang()?;
    println!("angle {}", gyro.get_angle()?);
    Ok(())
}

fn board() -> Ev3Result<()> {
    let power = PowerSupply::new()?;
    println!("volts {}", f64::from(power.get_voltage_now()?) / 1e6);
    let led = Led::new()?;
    println!("lights_at_first {:?}", led.get_color()?);
    led.set_color(Led::COLOR_ORANGE)?;
    println!("lights {:?}", led.get_color()?);
    Ok(())
}
