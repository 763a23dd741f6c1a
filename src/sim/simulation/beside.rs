//! What a person beside a simulated brick does, sees and hears: buttons, tones, lights; and what
//! programs have written.

use nix::errno::Errno;

use super::{Button, Simulation, Written};

impl Simulation {
    /// Presses a button, until it is let go. Nothing happens if it is down already.
    ///
    /// # Errors
    ///
    /// ENOENT without such a robot.
    pub fn press(&self, robot: usize, button: Button) -> Result<(), Errno> {
        self.set_button(robot, button, true)
    }

    /// Lets go of a button.
    ///
    /// # Errors
    ///
    /// ENOENT without such a robot.
    pub fn release(&self, robot: usize, button: Button) -> Result<(), Errno> {
        self.set_button(robot, button, false)
    }

    fn set_button(&self, robot: usize, button: Button, down: bool) -> Result<(), Errno> {
        self.with_brick(robot, |brick| {
            brick.buttons.set(button, down, brick.now_ns);
            Ok(())
        })
    }

    /// The buttons that are down.
    #[must_use]
    pub fn pressed(&self, robot: usize) -> Vec<Button> {
        self.state().bricks.get(robot).map_or_else(Vec::new, |brick| brick.buttons.pressed.clone())
    }

    /// The tone that sounds now, in hertz.
    #[must_use]
    pub fn tone_hz(&self, robot: usize) -> Option<u32> {
        self.state().bricks.get(robot)?.speaker.tone_hz
    }

    /// The last tone that was played, in hertz, also if it has ended.
    #[must_use]
    pub fn last_tone_hz(&self, robot: usize) -> Option<u32> {
        self.state().bricks.get(robot)?.speaker.last_tone_hz
    }

    /// Brightness and trigger of a status light by its name (`led0:red:brick-status`).
    #[must_use]
    pub fn led(&self, robot: usize, name: &str) -> Option<(u32, &'static str)> {
        self.state().bricks.get(robot)?.led(name)
    }

    /// Begins a new journal of all writes, or ends it.
    pub fn record_writes(&self, on: bool) {
        self.state().journal = on.then(Vec::new);
    }

    /// The writes since [`Simulation::record_writes`], or since this was last called; in their
    /// order.
    #[must_use]
    pub fn take_writes(&self) -> Vec<Written> {
        self.state().journal.as_mut().map(std::mem::take).unwrap_or_default()
    }
}
