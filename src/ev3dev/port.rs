//! The ports themselves: class `lego-port`.

use std::sync::Arc;

use super::address::PortAddress;
use super::error::{DeviceError, FindError};
use super::find::{Class, Identity, find};
use super::node::{Attribute, AttributeSpec, Node, attributes};
use super::tree::Tree;
use super::value::{Legal, Value, Word, Words};
use super::words::PortMode;

/// A port. Writing its mode, even the same one, makes the kernel detect the device again: it gets a
/// new number and loses every set point. That restarts a device that hangs without pulling its
/// cable.
#[derive(Debug)]
pub struct LegoPort {
    node: Node,
    files: PortFiles,
    identity: Identity,
    modes: Words,
}

attributes! {
    /// The class's attributes.
    PortFiles of [impl LegoPort] {
        /// Which port it is, as the kernel says now.
        pub readable "address" => address: PortAddress;
        /// Input or output port, by its driver's name.
        pub readable "driver_name" => driver_name: Word;
        /// The modes that this port has, read each time.
        pub readable "modes" => read_modes: Words;
        readwriteable "mode" => mode_word / write_mode: Word;
        writeable "set_device" => write_set_device: Word;
        /// What was found at the port, or the mode that was set.
        pub readable "status" => status: Word;
    }
}

impl LegoPort {
    /// The port of this address.
    ///
    /// # Errors
    ///
    /// [`FindError`], which says what ports there are.
    pub fn at(tree: &Arc<dyn Tree>, port: &PortAddress) -> Result<Self, FindError> {
        Ok(Self::bind(tree, find(tree, Class::LegoPort, Some(port), None)?)?)
    }

    /// The port that was found as `identity`.
    ///
    /// # Errors
    ///
    /// Whatever comes of reading its modes.
    pub fn bind(tree: &Arc<dyn Tree>, identity: Identity) -> Result<Self, DeviceError> {
        let node = identity.node(tree);
        let files = PortFiles::new();
        let modes = files.read_modes.read(&node)?;
        Ok(Self { node, files, identity, modes })
    }

    /// What identifies the port, as it was found.
    #[must_use]
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// The modes that this port has.
    #[must_use]
    pub fn modes(&self) -> &Words {
        &self.modes
    }

    /// The mode in force, as the kernel spells it; other platforms have other words than
    /// [`PortMode`].
    ///
    /// # Errors
    ///
    /// Any [`Cause`](super::Cause) but `Refused`.
    pub fn mode(&self) -> Result<Word, DeviceError> {
        self.mode_word()
    }

    /// Sets the mode, which makes the kernel detect the device again.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](super::Cause::Refused) for a mode that this port does not have.
    pub fn set_mode(&self, mode: PortMode) -> Result<(), DeviceError> {
        if !self.modes.contains(mode.as_str()) {
            return Err(self.node.refusal("mode", mode.as_str(), self.modes.as_legal()));
        }
        self.write_mode(Word::from(mode.as_str()).unwrap_or_default())
    }

    /// Names the driver for what is plugged in, where the port cannot find out: on input ports in
    /// the mode `nxt-analog`, on output ports in `tacho-motor`.
    ///
    /// # Errors
    ///
    /// [`Cause::Refused`](super::Cause::Refused) in any other mode.
    pub fn set_device(&self, driver: &str) -> Result<(), DeviceError> {
        match Word::from(driver) {
            Ok(word) => self.write_set_device(word),
            Err(_) => Err(self.node.refusal("set_device", driver, Legal::Text)),
        }
    }
}
