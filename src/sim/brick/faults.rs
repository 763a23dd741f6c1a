//! The faults on a brick's ports: `sim::fault` says what they do.

use super::{Brick, Device};
use crate::ev3dev::Direction;
use crate::sim::fault::{DeviceFault, FaultError, PortFaults};
use crate::sim::ports::Port;
use nix::errno::Errno;

impl Brick {
    /// Puts a fault on a port, or does it where it is momentary.
    ///
    /// # Errors
    ///
    /// [`FaultError`] where it does not fit or a driver refuses.
    pub(crate) fn inject(
        &mut self,
        port: Port,
        fault: &DeviceFault,
        until_ns: Option<i64>,
    ) -> Result<(), FaultError> {
        fault.fit(port, self.ports[port.index()].home)?;
        match fault {
            DeviceFault::Plug => {
                self.put_back(port);
                self.faults[port.index()].remove(&DeviceFault::Unplug);
                return Ok(());
            }
            DeviceFault::Write { attribute, value } => {
                return self
                    .write_as_another(port, attribute, value)
                    .map_err(|source| FaultError::Refused { port, fault: fault.clone(), source });
            }
            DeviceFault::Unplug => self.ports[port.index()].pull(self.now_ns),
            _ => {}
        }
        self.faults[port.index()].add(fault.clone(), until_ns);
        Ok(())
    }

    /// Takes the faults from a port; what they were is for the caller to undo.
    pub(crate) fn clear(&mut self, port: Port) -> Vec<DeviceFault> {
        self.faults[port.index()].clear()
    }

    /// Takes one fault whose end has come from a port; what it was is for the caller to undo.
    pub(crate) fn take_ended(&mut self, port: Port) -> Option<DeviceFault> {
        self.faults[port.index()].take_ended(self.now_ns)
    }

    /// Puts what belongs into a port into it, if it is empty.
    pub(crate) fn put_back(&mut self, port: Port) {
        self.ports[port.index()].put_back(self.now_ns);
    }

    /// What is wrong with the ports now.
    pub(crate) fn faults_active(&self) -> impl Iterator<Item = (Port, &DeviceFault)> {
        let ports = Port::ALL.into_iter().zip(&self.faults);
        ports.flat_map(|(port, faults)| faults.active().map(move |fault| (port, fault)))
    }

    /// The faults of the port that a device is on.
    pub(super) fn faults_of(&self, id: u32) -> Option<&PortFaults> {
        let node = self.node(id)?;
        match node.device {
            Device::Tacho(_) | Device::Dc(_) | Device::Sensor(_) => {
                node.port.map(|port| &self.faults[port.index()])
            }
            _ => None,
        }
    }

    fn write_as_another(&mut self, port: Port, attribute: &str, value: &str) -> Result<(), Errno> {
        let id = self.ports[port.index()].device.ok_or(Errno::ENODEV)?;
        let spec = self.attribute(id, attribute).ok_or(Errno::ENOENT)?;
        if spec.direction == Direction::Readable {
            return Err(Errno::EACCES);
        }
        // The program that waits for the end of the write is another one.
        self.store(id, spec.name, value.as_bytes()).map(|_| ())
    }
}
