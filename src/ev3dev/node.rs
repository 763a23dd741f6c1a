//! One device's folder, its attributes as kept files, and the macro that makes accessors of a
//! table.
//!
//! An attribute is opened on its first use, once for reading and once for writing, and kept. From
//! then on a reading is one system call into a stack buffer, a write is one system call out of one,
//! and neither allocates.
//!
//! # Not here
//!
//! No retries, no sleeping, no cached values.

use std::cell::{Cell, OnceCell};
use std::marker::PhantomData;
use std::sync::Arc;
use std::time::Duration;

use nix::errno::Errno;

use super::address::PortAddress;
use super::error::{Cause, DeviceError, excerpt};
use super::tree::{Access, AttributeFile, Tree};
use super::value::{AttributeText, Legal, SHORT, Value, first_line};

/// Which way an attribute can be used: the seed's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// It can be read; mode 0444.
    Readable,
    /// It can be written; mode 0200.
    Writeable,
    /// Both; mode 0644.
    Readwriteable,
}

/// A row of a device's table: what fakes and tests enumerate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttributeSpec {
    /// The file's name below the device's folder.
    pub name: &'static str,
    /// Which way it can be used.
    pub direction: Direction,
    /// What is legal in it; its `Display` is the text for people.
    pub legal: Legal,
}

impl AttributeSpec {
    pub(crate) const fn readable(name: &'static str, legal: Legal) -> Self {
        Self { name, direction: Direction::Readable, legal }
    }

    pub(crate) const fn writeable(name: &'static str, legal: Legal) -> Self {
        Self { name, direction: Direction::Writeable, legal }
    }

    pub(crate) const fn readwriteable(name: &'static str, legal: Legal) -> Self {
        Self { name, direction: Direction::Readwriteable, legal }
    }
}

/// One device's folder of attributes.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    tree: Arc<dyn Tree>,
    pub(crate) folder: Arc<str>,
    port: Option<PortAddress>,
}

impl Node {
    pub(crate) fn new(tree: &Arc<dyn Tree>, folder: &str, port: Option<PortAddress>) -> Self {
        Self { tree: Arc::clone(tree), folder: folder.into(), port }
    }

    pub(crate) fn open(
        &self,
        attribute: &'static str,
        access: Access,
    ) -> Result<Box<dyn AttributeFile>, DeviceError> {
        self.tree.open(&format!("{}/{attribute}", self.folder), access).map_err(|errno| {
            // A missing file and a missing folder are the same error number, and different
            // remedies.
            let cause = match errno {
                Errno::ENOENT if self.tree.list(&self.folder).is_ok() => Cause::Absent(errno),
                Errno::ENOENT | Errno::ENODEV | Errno::ENXIO => Cause::Gone(errno),
                _ => Cause::Other(errno),
            };
            self.error(attribute, None, cause)
        })
    }

    pub(crate) fn error(
        &self,
        attribute: &'static str,
        value: Option<&[u8]>,
        cause: Cause,
    ) -> DeviceError {
        DeviceError {
            port: self.port.clone(),
            device: Arc::clone(&self.folder),
            attribute,
            value: value.map(excerpt),
            cause,
        }
    }

    /// A refusal of our own: nothing was written.
    pub(crate) fn refusal(
        &self,
        attribute: &'static str,
        value: &str,
        legal: Legal,
    ) -> DeviceError {
        self.error(attribute, Some(value.as_bytes()), Cause::Refused { errno: None, legal })
    }
}

/// An attribute's row with its kept files.
#[derive(Debug)]
pub(crate) struct Attribute<T> {
    spec: AttributeSpec,
    reader: OnceCell<Box<dyn AttributeFile>>,
    writer: OnceCell<Box<dyn AttributeFile>>,
    /// A range that is known only since the device was bound: `speed_sp` within `max_speed`.
    limit: Cell<Option<(i64, i64)>>,
    value: PhantomData<fn() -> T>,
}

impl<T> Attribute<T> {
    pub(crate) const fn new(spec: AttributeSpec) -> Self {
        Self {
            spec,
            reader: OnceCell::new(),
            writer: OnceCell::new(),
            limit: Cell::new(None),
            value: PhantomData,
        }
    }

    /// Narrows the legal range from now on.
    pub(crate) fn limit(&self, first: i64, last: i64) {
        self.limit.set(Some((first, last)));
    }

    /// Reads bytes, with one system call once the file is open.
    pub(crate) fn read_bytes(&self, node: &Node, buffer: &mut [u8]) -> Result<usize, DeviceError> {
        let file = kept(&self.reader, || node.open(self.spec.name, Access::Read))?;
        file.read(buffer).map_err(|errno| node.error(self.spec.name, None, self.read_cause(errno)))
    }

    /// Writes bytes as one store.
    pub(crate) fn write_bytes(&self, node: &Node, bytes: &[u8]) -> Result<(), DeviceError> {
        let file = kept(&self.writer, || node.open(self.spec.name, Access::Write))?;
        let cause = match file.write(bytes) {
            Ok(taken) if taken == bytes.len() => return Ok(()),
            Ok(_) => Cause::Other(Errno::EIO),
            Err(errno) => self.write_cause(errno),
        };
        Err(node.error(self.spec.name, Some(first_line(bytes)), cause))
    }

    /// The error for a value that was read, and cannot be.
    pub(crate) fn malformed(&self, node: &Node, value: &str, legal: Legal) -> DeviceError {
        node.error(self.spec.name, Some(value.as_bytes()), Cause::Malformed(legal))
    }

    /// Waits until the driver says that the attribute changed.
    pub(crate) fn wait_changed(&self, node: &Node, timeout: Duration) -> Result<bool, DeviceError> {
        let file = kept(&self.reader, || node.open(self.spec.name, Access::Read))?;
        file.wait_changed(timeout)
            .map_err(|errno| node.error(self.spec.name, None, self.read_cause(errno)))
    }

    /// Opens the file for writing, which shows whether one may, and writes nothing.
    pub(crate) fn open_for_writing(&self, node: &Node) -> Result<(), DeviceError> {
        kept(&self.writer, || node.open(self.spec.name, Access::Write)).map(|_| ())
    }

    pub(crate) fn is_open_for_writing(&self) -> bool {
        self.writer.get().is_some()
    }

    fn legal(&self) -> Legal {
        self.limit
            .get()
            .map_or_else(|| self.spec.legal.clone(), |(first, last)| Legal::Range(first, last))
    }

    fn read_cause(&self, errno: Errno) -> Cause {
        match errno {
            // A sensor always has a first value, unless it is just building its tables again.
            Errno::ENXIO if self.spec.name == "value0" => Cause::Gone(errno),
            Errno::ENODEV | Errno::ENOENT => Cause::Gone(errno),
            Errno::ENXIO | Errno::EOPNOTSUPP | Errno::ENOSYS => Cause::Absent(errno),
            _ => Cause::Other(errno),
        }
    }

    fn write_cause(&self, errno: Errno) -> Cause {
        match errno {
            Errno::ENODEV | Errno::ENOENT | Errno::ENXIO => Cause::Gone(errno),
            Errno::EINVAL | Errno::ERANGE | Errno::EOPNOTSUPP | Errno::ENOSYS | Errno::EBUSY => {
                Cause::Refused { errno: Some(errno), legal: self.legal() }
            }
            _ => Cause::Other(errno),
        }
    }
}

impl<T: Value> Attribute<T> {
    /// Reads and understands the attribute's first line.
    pub(crate) fn read(&self, node: &Node) -> Result<T, DeviceError> {
        if T::LONG {
            self.read_into(node, &mut [0; 4096])
        } else {
            self.read_into(node, &mut [0; SHORT])
        }
    }

    fn read_into(&self, node: &Node, buffer: &mut [u8]) -> Result<T, DeviceError> {
        let length = self.read_bytes(node, buffer)?;
        let read = buffer.get(..length).unwrap_or_default();
        let line = first_line(read);
        // A line that fills the buffer may go on: what was not read must not be guessed.
        let whole = line.len() < buffer.len();
        T::parse(line).filter(|_| whole).ok_or_else(|| {
            node.error(self.spec.name, Some(line), Cause::Malformed(self.spec.legal.clone()))
        })
    }

    /// Checks a value and writes it as one store that ends with a newline.
    pub(crate) fn write(&self, node: &Node, value: &T) -> Result<(), DeviceError> {
        let mut line = AttributeText::new();
        let fits = value.render(&mut line).is_ok() && !line.contains('\n');
        let legal = self.legal();
        let allowed =
            legal.admits(&line) && value.number().is_none_or(|number| legal.allows(number));
        if !(fits && allowed && line.try_push('\n').is_ok()) {
            return Err(node.refusal(self.spec.name, &line, legal));
        }
        self.write_bytes(node, line.as_bytes())
    }
}

fn kept(
    file: &OnceCell<Box<dyn AttributeFile>>,
    open: impl FnOnce() -> Result<Box<dyn AttributeFile>, DeviceError>,
) -> Result<&dyn AttributeFile, DeviceError> {
    if let Some(file) = file.get() {
        return Ok(file.as_ref());
    }
    let opened = open()?;
    Ok(file.get_or_init(|| opened).as_ref())
}

/// Makes a table's struct of kept files, its `ATTRIBUTES`, and the accessors of the device that
/// holds them as `files` beside its `node`.
///
/// A row: visibility, direction, file, name of the reader (or of the only accessor), name of the
/// writer, type, legal values if the type does not say.
macro_rules! attributes {
    ($(#[$doc:meta])* $files:ident of [$($owner:tt)+] {
        $(
            $(#[$row:meta])*
            $vis:vis $dir:ident $file:literal => $name:ident $(/ $setter:ident)?: $ty:ty
            $(, $legal:expr)?;
        )+
    }) => {
        $(#[$doc])*
        #[derive(Debug)]
        struct $files { $($name: Attribute<$ty>,)+ }

        impl $files {
            const fn new() -> Self {
                Self { $($name: Attribute::new(attributes!(@spec $dir $file $ty $(, $legal)?)),)+ }
            }
        }

        $($owner)+ {
            /// The table's rows.
            pub const ATTRIBUTES: &'static [AttributeSpec] =
                &[$(attributes!(@spec $dir $file $ty $(, $legal)?),)+];

            $(attributes!(@$dir [$(#[$row])* $vis] $name $name $($setter)?: $ty);)+
        }
    };
    (@spec $dir:ident $file:literal $ty:ty) => {
        AttributeSpec::$dir($file, <$ty as Value>::LEGAL)
    };
    (@spec $dir:ident $file:literal $ty:ty, $legal:expr) => { AttributeSpec::$dir($file, $legal) };
    (@readwriteable [$($head:tt)*] $field:ident $name:ident $setter:ident: $ty:ty) => {
        attributes!(@readable [$($head)*] $field $name: $ty);
        attributes!(@writeable [$($head)*] $field $setter: $ty);
    };
    (@readable [$(#[$row:meta])* $vis:vis] $field:ident $name:ident: $ty:ty) => {
        $(#[$row])*
        ///
        /// # Errors
        ///
        /// Any [`Cause`](crate::ev3dev::Cause) but `Refused`.
        $vis fn $name(&self) -> Result<$ty, DeviceError> { self.files.$field.read(&self.node) }
    };
    (@writeable [$(#[$row:meta])* $vis:vis] $field:ident $name:ident: $ty:ty) => {
        $(#[$row])*
        ///
        /// # Errors
        ///
        /// [`Cause::Refused`](crate::ev3dev::Cause::Refused) for a value that is not legal, with
        /// what is; any other but `Malformed`.
        $vis fn $name(&self, value: $ty) -> Result<(), DeviceError> {
            self.files.$field.write(&self.node, &value)
        }
    };
}

pub(super) use attributes;
