//! A world with its robots, and the time in it.
//!
//! The simulation has no thread of its own: an access to a file first lets the time pass that has
//! gone by on the clock, in steps of [`STEP_NS`]. With a
//! [`VirtualClock`](crate::clock::VirtualClock) a mission runs as fast as the machine allows.

use std::any::Any;
use std::sync::{Arc, Mutex, MutexGuard};

use nix::errno::Errno;

mod beside;

use super::brick::Brick;

pub use super::brick::Plugged;
use super::driver::Took;
use super::driver::lcd::{Lcd, LcdGeometry};
use super::driver::sensor::GyroMake;
use super::fault::{
    Act, ControlError, DeviceFault, FaultError, FaultRecord, Faults, Order, Scenario,
};
use super::files::SimBrick;
use super::physics::{Bridge, Physics, STEP_NS};
use super::ports::Port;
use super::view::Trail;
use super::world_physics::WorldPhysics;
use crate::clock::{Clock, MILLISECOND_NS};
use crate::ev3dev::{Button, Platform, Technology};
use crate::threads::lock;

/// How a brick is made, where bricks differ.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Options {
    /// Which board it is.
    pub platform: &'static Platform,
    /// How gyros take a change of mode.
    pub gyro: GyroMake,
    /// What feeds the brick.
    pub cells: Technology,
    /// For so long after a device appeared its files cannot be opened for writing (EACCES), until
    /// udev has got round to it. Nanoseconds; 0 for never.
    pub access_delay_ns: i64,
    /// Files have the rights that udev's rules of ev3dev give them, instead of those they are born
    /// with. Programs look at them: some write only to what the group may write to.
    pub udev: bool,
    /// The screen.
    pub lcd: LcdGeometry,
}

/// What a simulation in real time is further behind is better lost than waited for, nanoseconds:
/// simulating so much takes some 20 ms for ten robots on a PC. For
/// [`Simulation::give_up_behind_ns`].
pub const MOST_BEHIND_NS: i64 = 500 * MILLISECOND_NS;

/// A write that reached a brick.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// When, in nanoseconds since the simulation began.
    pub time_ns: i64,
    /// Whose brick.
    pub robot: usize,
    /// Which file, relative to the brick's root.
    pub path: String,
    /// What was written.
    pub value: Vec<u8>,
    /// The number of bytes taken, or the error.
    pub answer: Result<usize, Errno>,
}

/// A world, its robots' drivers, and the clock they live by. Clones are handles on the same one.
#[derive(Debug, Clone)]
pub struct Simulation {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    clock: Arc<dyn Clock>,
    /// The simulation's zero on the clock. It moves on where time is given up for lost.
    start_ns: Mutex<i64>,
    state: Mutex<State>,
}

#[derive(Debug)]
pub(crate) struct State {
    pub(crate) physics: Box<dyn Physics>,
    pub(crate) bricks: Vec<Brick>,
    bridges: Vec<[Bridge; 4]>,
    /// Time since the simulation began; a whole number of steps.
    pub(crate) now_ns: i64,
    journal: Option<Vec<Written>>,
    most_behind_ns: Option<i64>,
    lost_ns: i64,
    pub(crate) faults: Faults,
    /// What is gathered for those who watch.
    pub(crate) trail: Option<Trail>,
    /// What a read produced, kept so that reads do not allocate.
    pub(crate) text: Vec<u8>,
}

impl Simulation {
    /// A simulation that begins now. `seed` is for the chance in the drivers; the world has its
    /// own.
    #[must_use]
    pub fn new(clock: Arc<dyn Clock>, physics: Box<dyn Physics>, seed: u64) -> Self {
        Self::with_options(clock, physics, seed, Options::default())
    }

    /// As [`Simulation::new`], with bricks that are not as usual.
    #[must_use]
    pub fn with_options(
        clock: Arc<dyn Clock>,
        mut physics: Box<dyn Physics>,
        seed: u64,
        options: Options,
    ) -> Self {
        let bricks: Vec<Brick> = (0..physics.robots())
            .zip(0..)
            .map(|(robot, nth)| {
                Brick::new(robot, physics.as_mut(), options, seed.wrapping_add(nth))
            })
            .collect();
        let bridges = vec![[Bridge::Coast; 4]; bricks.len()];
        let state = State {
            physics,
            bricks,
            bridges,
            now_ns: 0,
            journal: None,
            most_behind_ns: None,
            lost_ns: 0,
            faults: Faults::default(),
            trail: None,
            text: Vec::with_capacity(4096),
        };
        let start_ns = Mutex::new(clock.now_ns());
        Self { shared: Arc::new(Shared { clock, start_ns, state: Mutex::new(state) }) }
    }

    /// How many robots there are.
    #[must_use]
    pub fn robots(&self) -> usize {
        self.state().bricks.len()
    }

    /// The files of a robot's brick. An unknown robot has none: every path answers ENOENT.
    #[must_use]
    pub fn brick(&self, robot: usize) -> Arc<SimBrick> {
        Arc::new(SimBrick::new(self.clone(), robot))
    }

    /// Lets the time pass that has gone by on the clock. Every access to a file does so too.
    pub fn catch_up(&self) {
        drop(self.state());
    }

    /// Time since the simulation began, in nanoseconds, after [`Simulation::catch_up`].
    #[must_use]
    pub fn now_ns(&self) -> i64 {
        self.state().now_ns
    }

    /// Never lets more than this pass at once. A simulation that is further behind its clock gives
    /// the rest up for lost, so that no access waits long on a machine that is too slow, or that
    /// was asleep. Without it, a machine on which a second takes longer than a second to simulate
    /// falls further behind with each access, and soon is done with none.
    pub fn give_up_behind_ns(&self, most_ns: i64) {
        self.state().most_behind_ns = Some(most_ns.max(STEP_NS));
    }

    /// The time that was given up for lost, nanoseconds: by so much the simulation is behind its
    /// clock for good.
    #[must_use]
    pub fn lost_ns(&self) -> i64 {
        self.state().lost_ns
    }

    /// The picture on a robot's screen, in the layout of its [`LcdGeometry`]; empty without such a
    /// robot.
    #[must_use]
    pub fn lcd(&self, robot: usize) -> Vec<u8> {
        self.state().bricks.get(robot).map_or_else(Vec::new, |brick| brick.lcd_bytes().to_vec())
    }

    /// A robot's screen: width, height, and each pixel's grey, row by row, 0 black to 255 white;
    /// `None` without such a robot.
    #[must_use]
    pub fn screen(&self, robot: usize) -> Option<(u32, u32, Vec<u8>)> {
        self.state().bricks.get(robot)?.lcd().map(Lcd::greys)
    }

    /// Looks into the world, or changes it, at the present time. `None` if the world is not a `W`.
    pub fn inspect<W: Physics, R>(&self, look: impl FnOnce(&mut W) -> R) -> Option<R> {
        let mut state = self.state();
        let world: &mut dyn Any = state.physics.as_mut();
        world.downcast_mut().map(look)
    }

    /// Puts a device into a port. It appears after the time that detection takes: 0.4 s, a UART
    /// sensor 1.9 s.
    ///
    /// # Errors
    ///
    /// EINVAL for a motor in an input port and the reverse, ENOENT without such a robot.
    pub fn plug(&self, robot: usize, port: Port, device: Plugged) -> Result<(), Errno> {
        self.with_brick(robot, |brick| brick.plug(port, Some(device)))
    }

    /// Pulls what is in a port. The device disappears 0.1 s later.
    ///
    /// # Errors
    ///
    /// ENOENT without such a robot.
    pub fn unplug(&self, robot: usize, port: Port) -> Result<(), Errno> {
        self.with_brick(robot, |brick| brick.plug(port, None))
    }

    /// Puts a frame of raw bytes into the sensor on a port, as if it went on sending it; with
    /// `None` it measures again.
    ///
    /// # Errors
    ///
    /// ENODEV where no sensor is registered, ENOENT without such a robot.
    pub fn feed(&self, robot: usize, port: Port, frame: Option<&[u8]>) -> Result<(), Errno> {
        self.with_brick(robot, |brick| brick.feed(port, frame))
    }

    /// Makes something go wrong on a port, until it is cleared.
    ///
    /// # Errors
    ///
    /// [`FaultError`] where it does not fit or the device refuses.
    pub fn inject(&self, robot: usize, port: Port, fault: DeviceFault) -> Result<(), FaultError> {
        self.follow(&Order { robot, act: Act::Inject(port, fault, None) })
    }

    /// Takes all faults from a port; what was pulled is put back.
    ///
    /// # Errors
    ///
    /// [`FaultError::NoRobot`].
    pub fn clear(&self, robot: usize, port: Port) -> Result<(), FaultError> {
        self.follow(&Order { robot, act: Act::Clear(Some(port)) })
    }

    /// Does what is ordered, at the present time.
    ///
    /// # Errors
    ///
    /// [`FaultError`]; nothing has changed then.
    pub fn follow(&self, order: &Order) -> Result<(), FaultError> {
        self.state().perform(order)
    }

    /// Follows the orders in a text, one a line: `in1 stuck`, `outB block for 2`, `battery 6.2`,
    /// `clear`, …; `robot` is meant where a line names none.
    ///
    /// # Errors
    ///
    /// [`ControlError::Order`] where the text is not understood, and nothing was done;
    /// [`ControlError::Fault`] for the first order that could not be followed.
    pub fn control(&self, robot: usize, text: &str) -> Result<(), ControlError> {
        let orders = Order::parse(robot, text)?;
        orders.iter().try_for_each(|order| self.follow(order)).map_err(ControlError::Fault)
    }

    /// Begins a scenario now, in place of what was left of one before. Its orders are followed to
    /// the step, also when a virtual clock leaps over them.
    pub fn play(&self, scenario: &Scenario) {
        let mut state = self.state();
        state.plan(scenario);
        state.follow_plan();
    }

    /// What was done to the robots on purpose so far, in its order.
    #[must_use]
    pub fn faults_done(&self) -> Vec<FaultRecord> {
        self.state().faults.done.clone()
    }

    /// What is wrong with a robot's ports now.
    #[must_use]
    pub fn faults_active(&self, robot: usize) -> Vec<(Port, DeviceFault)> {
        self.state().bricks.get(robot).map_or_else(Vec::new, |brick| {
            brick.faults_active().map(|(port, fault)| (port, fault.clone())).collect()
        })
    }

    /// Adds an output of a third-party servo controller; returns its name in class `servo-motor`.
    ///
    /// # Errors
    ///
    /// ENOENT without such a robot.
    pub fn add_servo(&self, robot: usize, address: &str, has_rate: bool) -> Result<String, Errno> {
        self.with_brick(robot, |brick| Ok(brick.add_servo(address, has_rate)))
    }

    /// The pulse that a servo gets, in microseconds; `None` while it floats.
    #[must_use]
    pub fn servo_pulse_us(&self, robot: usize, name: &str) -> Option<i32> {
        self.state().bricks.get(robot)?.servo_pulse_us(name)
    }

    /// The state as of now.
    pub(crate) fn state(&self) -> MutexGuard<'_, State> {
        // A panic under the lock cannot leave a step half done in a way that matters to a
        // simulation.
        let mut state = lock(&self.shared.state);
        let most_ns = state.most_behind_ns.unwrap_or(i64::MAX);
        let behind_ns = self.time_ns() - state.now_ns;
        let until_ns = state.now_ns + behind_ns.min(most_ns);
        while state.now_ns + STEP_NS <= until_ns {
            state.step();
        }
        if behind_ns > most_ns {
            // Includes the time that it took to get here, or the next reader would wait for it.
            // Whole steps, so that moments stay where they were within a step.
            let lost_ns = (self.time_ns() - state.now_ns).div_euclid(STEP_NS) * STEP_NS;
            state.lost_ns += lost_ns;
            *lock(&self.shared.start_ns) += lost_ns;
        }
        state
    }

    /// Keeps the caller waiting until a time of the simulation.
    pub(crate) fn wait_until(&self, time_ns: i64) {
        // A signal may end a sleep early, or time may have been lost; a driver's wait continues.
        while self.time_ns() < time_ns {
            self.shared.clock.sleep_until_ns(self.start_ns() + time_ns);
        }
    }

    /// The time on the simulation's clock, which may be within a step.
    pub(crate) fn time_ns(&self) -> i64 {
        self.shared.clock.now_ns() - self.start_ns()
    }

    fn start_ns(&self) -> i64 {
        *lock(&self.shared.start_ns)
    }

    fn with_brick<R>(
        &self,
        robot: usize,
        act: impl FnOnce(&mut Brick) -> Result<R, Errno>,
    ) -> Result<R, Errno> {
        act(self.state().bricks.get_mut(robot).ok_or(Errno::ENOENT)?)
    }
}

impl State {
    fn step(&mut self) {
        self.now_ns += STEP_NS;
        self.bricks.iter_mut().for_each(|brick| brick.now_ns = self.now_ns);
        self.follow_plan();
        for (bridges, brick) in self.bridges.iter_mut().zip(&self.bricks) {
            *bridges = brick.bridges();
        }
        self.physics.step(&self.bridges);
        for brick in &mut self.bricks {
            brick.step(self.physics.as_mut());
        }
        let world: &dyn Any = self.physics.as_ref();
        if let Some((trail, world)) = self.trail.as_mut().zip(world.downcast_ref()) {
            trail.step(self.now_ns, &self.bricks, world);
        }
    }

    /// Stores what one `write` brought to an attribute; what a port registers is there when it
    /// returns.
    ///
    /// # Errors
    ///
    /// ENODEV for a device that is gone; else the driver's.
    pub(crate) fn store(&mut self, robot: usize, id: u32, attribute: &str, bytes: &[u8]) -> Took {
        let brick = self.bricks.get_mut(robot).ok_or(Errno::ENODEV)?;
        let stored = brick.store(id, attribute, bytes);
        brick.settle_port(id, self.physics.as_mut());
        stored
    }

    /// The world, if the physics is one.
    pub(crate) fn world(&self) -> Option<&WorldPhysics> {
        let world: &dyn Any = self.physics.as_ref();
        world.downcast_ref()
    }

    /// Notes a write, if there is a journal.
    pub(crate) fn note(
        &mut self,
        robot: usize,
        path: &str,
        value: &[u8],
        answer: Result<usize, Errno>,
    ) {
        let time_ns = self.now_ns;
        if let Some(journal) = &mut self.journal {
            journal.push(Written {
                time_ns,
                robot,
                path: path.to_owned(),
                value: value.to_vec(),
                answer,
            });
        }
    }
}
