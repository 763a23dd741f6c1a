//! Faults in time: what is still to come, what ends, and the record of what was done.

use std::collections::VecDeque;

use super::{Act, DeviceFault, FaultError, Order, Port, Scenario};
use crate::ev3dev::Button;
use crate::sim::brick::Brick;
use crate::sim::physics::{Fault, Physics};
use crate::units::radians;

/// A battery is set this often while it changes: each time that the driver looks at it.
const BATTERY_NS: i64 = 10_000_000;

/// The record keeps this many entries; what is done after that is done without one.
const MOST_DONE: usize = 100_000;

/// Something that was done to a robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaultRecord {
    /// When, nanoseconds since the simulation began.
    pub time_ns: i64,
    /// Whose, from 0.
    pub robot: usize,
    /// What: an order's text; `… is over` at a fault's end; a failed order of a scenario with the
    /// reason.
    pub what: String,
}

/// What is ordered and what was done, for all robots.
#[derive(Debug, Default)]
pub(crate) struct Faults {
    /// In order of time.
    pending: VecDeque<(i64, Order)>,
    ramps: Vec<Ramp>,
    held: Vec<Held>,
    /// What was done so far.
    pub(crate) done: Vec<FaultRecord>,
}

/// A button that is down until some time, nanoseconds.
#[derive(Debug, Clone, Copy)]
struct Held {
    robot: usize,
    button: Button,
    until_ns: i64,
}

/// A battery that changes.
#[derive(Debug, Clone, Copy)]
struct Ramp {
    robot: usize,
    from_v: f64,
    to_v: f64,
    start_ns: i64,
    over_ns: i64,
}

impl Faults {
    /// Takes the orders of a scenario, its time counted from `now_ns`, in place of what was still
    /// to come.
    pub(crate) fn plan(&mut self, scenario: &Scenario, now_ns: i64) {
        let orders = scenario.orders().iter();
        self.pending =
            orders.map(|(at_ns, order)| (now_ns.saturating_add(*at_ns), order.clone())).collect();
    }

    /// Does what is due.
    pub(crate) fn step(&mut self, now_ns: i64, bricks: &mut [Brick], physics: &mut dyn Physics) {
        self.end(now_ns, bricks, physics);
        self.let_go(now_ns, bricks, |held| held.until_ns <= now_ns);
        while self.pending.front().is_some_and(|(at_ns, _)| *at_ns <= now_ns) {
            let Some((_, order)) = self.pending.pop_front() else { break };
            // A scenario's order that does not fit is recorded; no caller waits for its answer.
            if let Err(error) = self.perform(&order, now_ns, bricks, physics) {
                let why = std::error::Error::source(&error)
                    .map_or(String::new(), |cause| format!(" ({cause})"));
                self.note(now_ns, order.robot, format!("{}: {error}{why}", order.act));
            }
        }
        if now_ns % BATTERY_NS == 0 {
            self.discharge(now_ns, physics);
        }
    }

    /// Does what is ordered, now.
    ///
    /// # Errors
    ///
    /// [`FaultError`]; nothing has changed then.
    pub(crate) fn perform(
        &mut self,
        order: &Order,
        now_ns: i64,
        bricks: &mut [Brick],
        physics: &mut dyn Physics,
    ) -> Result<(), FaultError> {
        let Order { robot, ref act } = *order;
        let robots = bricks.len();
        let brick = bricks.get_mut(robot).ok_or(FaultError::NoRobot { robot, robots })?;
        match act {
            Act::Inject(port, fault, for_ns) => {
                let until_ns = for_ns.map(|for_ns| now_ns.saturating_add(for_ns));
                brick.inject(*port, fault, until_ns, now_ns)?;
                if *fault == DeviceFault::Block {
                    physics.fail(robot, Fault::BlockedMotor(port.place()));
                }
            }
            Act::Clear(port) => {
                let ports =
                    Port::ALL.into_iter().filter(|other| port.is_none_or(|port| port == *other));
                for port in ports {
                    for fault in brick.clear(port) {
                        restore(brick, robot, port, &fault, now_ns, physics);
                    }
                }
                if port.is_none() {
                    self.let_go(now_ns, bricks, |held| held.robot == robot);
                    self.ramps.retain(|ramp| ramp.robot != robot);
                    physics.fail(robot, Fault::OwnBattery);
                }
            }
            &Act::Battery { from_v, to_v, over_ns } => {
                let ramp = Ramp { robot, from_v, to_v, start_ns: now_ns, over_ns };
                physics.fail(robot, Fault::BatteryV(ramp.volts(now_ns)));
                self.ramps.retain(|ramp| ramp.robot != robot);
                self.ramps.push(ramp);
            }
            &Act::Press(button, for_ns) => {
                let until_ns = now_ns.saturating_add(for_ns);
                self.held.retain(|held| (held.robot, held.button) != (robot, button));
                self.held.push(Held { robot, button, until_ns });
                brick.buttons.set(button, true, now_ns);
            }
            &Act::Release(button) => {
                self.held.retain(|held| (held.robot, held.button) != (robot, button));
                brick.buttons.set(button, false, now_ns);
            }
            &Act::Tone(hz) => {
                brick.speaker.tone(hz, now_ns);
                // A melody would be all that is left of the record.
                return Ok(());
            }
            &Act::Place { x_m, y_m, heading_deg } => {
                if !physics.place(robot, Some([x_m, y_m, radians(heading_deg)])) {
                    return Err(FaultError::NoRoom { x_m, y_m });
                }
            }
            // Where it started, something may stand by now: another robot.
            Act::Reset if !physics.place(robot, None) => return Err(FaultError::Taken),
            Act::Reset | Act::Say(_) => {}
        }
        self.note(now_ns, robot, act.to_string());
        Ok(())
    }

    /// Ends what has lasted long enough.
    fn end(&mut self, now_ns: i64, bricks: &mut [Brick], physics: &mut dyn Physics) {
        for (robot, brick) in bricks.iter_mut().enumerate() {
            for port in Port::ALL {
                while let Some(fault) = brick.take_ended(port, now_ns) {
                    restore(brick, robot, port, &fault, now_ns, physics);
                    self.note(now_ns, robot, format!("{port} {fault} is over"));
                }
            }
        }
    }

    /// Lets go of the buttons that are held and fit.
    fn let_go(&mut self, now_ns: i64, bricks: &mut [Brick], fits: impl Fn(&Held) -> bool) {
        for held in self.held.extract_if(.., |held| fits(held)) {
            if let Some(brick) = bricks.get_mut(held.robot) {
                brick.buttons.set(held.button, false, now_ns);
            }
        }
    }

    fn discharge(&mut self, now_ns: i64, physics: &mut dyn Physics) {
        for ramp in &self.ramps {
            physics.fail(ramp.robot, Fault::BatteryV(ramp.volts(now_ns)));
        }
        self.ramps.retain(|ramp| now_ns - ramp.start_ns < ramp.over_ns);
    }

    fn note(&mut self, time_ns: i64, robot: usize, what: String) {
        if self.done.len() < MOST_DONE {
            self.done.push(FaultRecord { time_ns, robot, what });
        }
    }
}

impl Ramp {
    fn volts(&self, now_ns: i64) -> f64 {
        let share = crate::clock::seconds(now_ns - self.start_ns)
            / crate::clock::seconds(self.over_ns.max(1));
        self.from_v + (self.to_v - self.from_v) * share.clamp(0.0, 1.0)
    }
}

/// Undoes what a fault has done to the world: a pulled plug goes in again, a blocked shaft is free.
fn restore(
    brick: &mut Brick,
    robot: usize,
    port: Port,
    fault: &DeviceFault,
    now_ns: i64,
    physics: &mut dyn Physics,
) {
    match fault {
        DeviceFault::Unplug => brick.put_back(port, now_ns),
        DeviceFault::Block => physics.fail(robot, Fault::FreedMotor(port.place())),
        _ => {}
    }
}
