//! A connection of libzmq's, held for a moment by a descriptor of our own.
//!
//! The monitor tells the numbers of libzmq's descriptors. libzmq may close one at any time, and
//! then the number comes to mean something else. So it is duplicated before it is looked at: what
//! the duplicate stands for does not change any more.

#![allow(
    unsafe_code,
    reason = "nothing of std, nix or rustix duplicates a descriptor that is only known by its \
              number, or takes a TCP_INFO of any length"
)]

use std::net::{IpAddr, SocketAddr};
use std::os::fd::{AsRawFd as _, BorrowedFd, OwnedFd, RawFd};

use nix::libc;
use nix::sys::socket::{
    Shutdown, SockaddrIn, SockaddrIn6, SockaddrLike as _, SockaddrStorage, getpeername,
    getsockname, shutdown,
};

/// A connection: to one of our ports, or from here to another machine's.
#[derive(Debug)]
pub(super) struct Held {
    own: OwnedFd,
    /// Who is at the other end.
    pub(super) peer: IpAddr,
}

impl Held {
    /// One to this port of ours; `None` where the number means nothing by now, or something else.
    pub(super) fn of(descriptor: RawFd, port: u16) -> Option<Self> {
        Self::where_it_is(descriptor, |own, _| own.1 == port)
    }

    /// One from here to this address; `None` where the number means nothing by now, or something
    /// else.
    pub(super) fn to(descriptor: RawFd, far: SocketAddr) -> Option<Self> {
        Self::where_it_is(descriptor, |_, peer| peer == (far.ip().to_canonical(), far.port()))
    }

    fn where_it_is(
        descriptor: RawFd,
        is_it: impl Fn((IpAddr, u16), (IpAddr, u16)) -> bool,
    ) -> Option<Self> {
        if descriptor < 0 {
            return None;
        }
        // SAFETY: the number is not -1, and all that is done with it is one fcntl(F_DUPFD_CLOEXEC).
        // Should libzmq have closed it, that fails with EBADF, or duplicates what the number means
        // now, and the duplicate is closed again without being read, written or shut.
        let own = unsafe { BorrowedFd::borrow_raw(descriptor) }.try_clone_to_owned().ok()?;
        let peer = address(&getpeername(own.as_raw_fd()).ok()?)?;
        let here = address(&getsockname(own.as_raw_fd()).ok()?)?;
        is_it(here, peer).then_some(Self { own, peer: peer.0 })
    }

    /// Ends the connection; libzmq finds that out.
    pub(super) fn shut(&self) {
        // One that is over already is what is wanted.
        let _ = shutdown(self.own.as_raw_fd(), Shutdown::Both);
    }

    /// Bytes that have come over it; `None` where the kernel does not count them (before Linux
    /// 4.2).
    pub(super) fn received(&self) -> Option<u64> {
        let (mut info, mut length) =
            ([0_u64; COUNTED as usize / 8], libc::socklen_t::from(COUNTED));
        // nix's getsockopt panics where a kernel knows less of it. SAFETY: the descriptor is open
        // for as long as `self`; the kernel writes at most `length` bytes, into numbers that may
        // have any value.
        let failed = unsafe {
            libc::getsockopt(
                self.own.as_raw_fd(),
                libc::IPPROTO_TCP,
                libc::TCP_INFO,
                (&raw mut info).cast(),
                &raw mut length,
            )
        };
        let [.., received] = info;
        (failed == 0 && length == libc::socklen_t::from(COUNTED)).then_some(received)
    }
}

fn address(address: &SockaddrStorage) -> Option<(IpAddr, u16)> {
    address.family()?;
    let v4 = |address: &SockaddrIn| (IpAddr::V4(address.ip()), address.port());
    let v6 = |address: &SockaddrIn6| (IpAddr::V6(address.ip()).to_canonical(), address.port());
    address.as_sockaddr_in().map(v4).or_else(|| address.as_sockaddr_in6().map(v6))
}

/// Bytes of the beginning of Linux's `struct tcp_info` (include/uapi/linux/tcp.h, which only ever
/// grows at its end) up to and with `tcpi_bytes_received`: eight bytes, 24 numbers of four, and
/// four of eight.
const COUNTED: u8 = 8 + 24 * 4 + 4 * 8;

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read as _, Write as _};
    use std::net::{TcpListener, TcpStream};

    #[test]
    fn a_connection_is_known_by_its_number_counted_and_shut() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let mut near = TcpStream::connect(address).unwrap();
        let (mut far, _) = listener.accept().unwrap();
        near.write_all(&[7; 12_345]).unwrap();
        far.read_exact(&mut [0; 12_345]).unwrap();
        let held = Held::of(far.as_raw_fd(), address.port()).unwrap();
        assert_eq!(held.peer, address.ip());
        // QEMU does not know this option where it stands for the kernel.
        let uncounted = cfg!(target_arch = "arm") && held.received().is_none();
        assert!(uncounted || held.received() == Some(12_345), "{:?}", held.received());
        let ours = Held::to(near.as_raw_fd(), address).unwrap();
        assert_eq!((ours.peer, ours.received().unwrap_or(0)), (address.ip(), 0));
        assert!(Held::to(far.as_raw_fd(), address).is_none(), "that is the other end");
        held.shut();
        assert_eq!(near.read(&mut [0]).unwrap(), 0);
        // The listener, the other end, a file and unused numbers are none of ours.
        let file = std::fs::File::open("/proc/self/stat").unwrap();
        for other in [listener.as_raw_fd(), near.as_raw_fd(), file.as_raw_fd(), 1_000_000, -1] {
            assert!(Held::of(other, address.port()).is_none(), "{other}");
        }
    }
}
