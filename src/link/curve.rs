//! Whether the libzmq that is linked can encrypt, and that it is the one that can.
//!
//! In this package only the libzmq of `src/build.rs` is built. In another package, whose Cargo does
//! not know our configuration, the crate zmq-sys builds one without CURVE as well, and the linker
//! takes whichever comes first among what refers to it. So this file refers to libzmq itself: where
//! this library is linked, its own libzmq is linked before zmq-sys's, which then has no undefined
//! symbols left to resolve.
//!
//! # Not here
//!
//! No key: making one may wait for the kernel's random numbers ([`keys`](super::keys)). Nothing
//! here waits.

use std::ffi::{c_char, c_int};
use std::hint::black_box;

// libsodium's own crate has no other use: what it says of itself to the linker counts.
use libsodium_sys as _;

/// A function of each file of libzmq that the crate `zmq` calls: `zmq.cpp` and `zmq_utils.cpp`.
type Anchors = (
    unsafe extern "C" fn(*const c_char) -> c_int,
    unsafe extern "C" fn(*mut c_char, *mut c_char) -> c_int,
);

static ANCHORS: Anchors = (zmq_sys::zmq_has, zmq_sys::zmq_curve_keypair);

/// The libzmq that was linked has no CURVE: nothing is served, and nothing is asked.
///
/// This package's own build has it. A program that was built around this library can mend it as
/// [`link`](super) says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the libzmq in this program cannot encrypt (CURVE is not compiled in)")]
pub struct NoCurve;

/// Makes sure that sockets can encrypt.
///
/// # Errors
///
/// [`NoCurve`].
pub fn require() -> Result<(), NoCurve> {
    black_box(&ANCHORS);
    if zmq::has("curve") == Some(true) { Ok(()) } else { Err(NoCurve) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_libzmq_that_is_linked_can_encrypt() {
        assert_eq!(zmq::has("curve"), Some(true), "libzmq {:?}", zmq::version());
        assert_eq!(require(), Ok(()));
        assert_eq!(zmq::version().0, 4);
    }
}
