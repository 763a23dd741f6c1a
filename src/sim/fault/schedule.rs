//! Faults in time: what is still to come, what ends, and the record of what was done.

use std::collections::VecDeque;

use super::{Act, DeviceFault, FaultError, Order, Port, Scenario};
use crate::ev3dev::Button;
use crate::sim::physics::Fault;
use crate::sim::simulation::State;
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
    fn note(&mut self, time_ns: i64, robot: usize, what: String) {
        if self.done.len() < MOST_DONE {
            self.done.push(FaultRecord { time_ns, robot, what });
        }
    }
}

impl State {
    /// Takes the orders of a scenario, its time counted from now, in place of what was still to
    /// come.
    pub(crate) fn plan(&mut self, scenario: &Scenario) {
        let due =
            |(at_ns, order): &(i64, Order)| (self.now_ns.saturating_add(*at_ns), order.clone());
        self.faults.pending = scenario.orders().iter().map(due).collect();
    }

    /// Does what is due of what is ordered.
    pub(crate) fn follow_plan(&mut self) {
        let now_ns = self.now_ns;
        self.end_faults();
        self.let_go(|held| held.until_ns <= now_ns);
        while self.faults.pending.front().is_some_and(|(at_ns, _)| *at_ns <= now_ns) {
            let Some((_, order)) = self.faults.pending.pop_front() else { break };
            // A scenario's order that does not fit is recorded; no caller waits for its answer.
            if let Err(error) = self.perform(&order) {
                let why = std::error::Error::source(&error)
                    .map_or(String::new(), |cause| format!(" ({cause})"));
                self.faults.note(now_ns, order.robot, format!("{}: {error}{why}", order.act));
            }
        }
        if now_ns % BATTERY_NS == 0 {
            for ramp in &self.faults.ramps {
                self.physics.fail(ramp.robot, Fault::BatteryV(ramp.volts(now_ns)));
            }
            self.faults.ramps.retain(|ramp| now_ns - ramp.start_ns < ramp.over_ns);
        }
    }

    /// Does what is ordered, now.
    ///
    /// # Errors
    ///
    /// [`FaultError`]; nothing has changed then.
    pub(crate) fn perform(&mut self, order: &Order) -> Result<(), FaultError> {
        let Order { robot, ref act } = *order;
        let (now_ns, robots) = (self.now_ns, self.bricks.len());
        let brick = self.bricks.get_mut(robot).ok_or(FaultError::NoRobot { robot, robots })?;
        let Faults { held, ramps, .. } = &mut self.faults;
        match act {
            Act::Inject(port, fault, for_ns) => {
                brick.inject(*port, fault, for_ns.map(|for_ns| now_ns.saturating_add(for_ns)))?;
                if *fault == DeviceFault::Block {
                    self.physics.fail(robot, Fault::BlockedMotor(port.place()));
                }
            }
            Act::Clear(Some(port)) => self.clear(robot, *port),
            Act::Clear(None) => {
                Port::ALL.into_iter().for_each(|port| self.clear(robot, port));
                self.let_go(|held| held.robot == robot);
                self.faults.ramps.retain(|ramp| ramp.robot != robot);
                self.physics.fail(robot, Fault::OwnBattery);
            }
            &Act::Battery { from_v, to_v, over_ns } => {
                let ramp = Ramp { robot, from_v, to_v, start_ns: now_ns, over_ns };
                self.physics.fail(robot, Fault::BatteryV(ramp.volts(now_ns)));
                ramps.retain(|ramp| ramp.robot != robot);
                ramps.push(ramp);
            }
            Act::Press(..) if brick.board.platform.buttons.is_none() => {
                return Err(FaultError::NoButtons);
            }
            &Act::Press(button, for_ns) => {
                held.retain(|held| (held.robot, held.button) != (robot, button));
                held.push(Held { robot, button, until_ns: now_ns.saturating_add(for_ns) });
                brick.buttons.set(button, true, now_ns);
            }
            &Act::Release(button) => {
                held.retain(|held| (held.robot, held.button) != (robot, button));
                brick.buttons.set(button, false, now_ns);
            }
            &Act::Tone(hz) => {
                brick.speaker.tone(hz, now_ns);
                // A melody would be all that is left of the record.
                return Ok(());
            }
            &Act::Place { x_m, y_m, heading_deg } => {
                if !self.physics.place(robot, Some([x_m, y_m, radians(heading_deg)])) {
                    return Err(FaultError::NoRoom { x_m, y_m });
                }
            }
            // Where it started, something may stand by now: another robot.
            Act::Reset if !self.physics.place(robot, None) => return Err(FaultError::Taken),
            Act::Reset | Act::Say(_) => {}
        }
        self.faults.note(now_ns, robot, act.to_string());
        Ok(())
    }

    fn clear(&mut self, robot: usize, port: Port) {
        for fault in self.bricks[robot].clear(port) {
            self.restore(robot, port, &fault);
        }
    }

    /// Ends what has lasted long enough.
    fn end_faults(&mut self) {
        for robot in 0..self.bricks.len() {
            for port in Port::ALL {
                while let Some(fault) = self.bricks[robot].take_ended(port) {
                    self.restore(robot, port, &fault);
                    self.faults.note(self.now_ns, robot, format!("{port} {fault} is over"));
                }
            }
        }
    }

    /// Lets go of the buttons that are held and fit.
    fn let_go(&mut self, fits: impl Fn(&Held) -> bool) {
        for held in self.faults.held.extract_if(.., |held| fits(held)) {
            self.bricks[held.robot].buttons.set(held.button, false, self.now_ns);
        }
    }

    /// Undoes what a fault has done to the world: a pulled plug goes in again, a blocked shaft is
    /// free.
    fn restore(&mut self, robot: usize, port: Port, fault: &DeviceFault) {
        match fault {
            DeviceFault::Unplug => self.bricks[robot].put_back(port),
            DeviceFault::Block => self.physics.fail(robot, Fault::FreedMotor(port.place())),
            _ => {}
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
