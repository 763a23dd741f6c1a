//! A connection of libzmq's, held for a moment by a descriptor of our own.
//!
//! The monitor tells the numbers of libzmq's descriptors. libzmq may close one at any time, and then the number comes to mean something else. So it is
//! duplicated before it is looked at: what the duplicate stands for does not change any more.

#![allow(
    unsafe_code,
    reason = "nothing of std, nix or rustix duplicates a descriptor that is only known by its number"
)]

use std::net::IpAddr;
use std::os::fd::{AsRawFd as _, BorrowedFd, OwnedFd, RawFd};

use nix::sys::socket::{
    Shutdown, SockaddrIn, SockaddrIn6, SockaddrLike as _, SockaddrStorage, getpeername, getsockname,
    getsockopt, shutdown,
};
use nix::{getsockopt_impl, libc, sockopt_impl};

/// A connection to one of our ports.
#[derive(Debug)]
pub(super) struct Held {
    own: OwnedFd,
    peer: IpAddr,
}

impl Held {
    /// `None` where the number is nobody's by now, or not that of a connection to this port.
    pub(super) fn of(descriptor: RawFd, port: u16) -> Option<Self> {
        if descriptor < 0 {
            return None;
        }
        // SAFETY: the number is not -1, and all that is done with it is one fcntl(F_DUPFD_CLOEXEC). Should libzmq have closed it, that fails with
        // EBADF, or duplicates what the number means now, and the duplicate is closed again without being read, written or shut.
        let own = unsafe { BorrowedFd::borrow_raw(descriptor) }.try_clone_to_owned().ok()?;
        let peer = address(&getpeername(own.as_raw_fd()).ok()?)?.0;
        let (_, own_port) = address(&getsockname(own.as_raw_fd()).ok()?)?;
        (own_port == port).then_some(Self { own, peer })
    }

    /// Who is at the other end.
    pub(super) fn peer(&self) -> IpAddr {
        self.peer
    }

    /// Ends the connection; libzmq finds that out.
    pub(super) fn shut(&self) {
        // One that is over already is what is wanted.
        let _ = shutdown(self.own.as_raw_fd(), Shutdown::Both);
    }

    /// Bytes that have come over it; `None` where the kernel does not count them (before Linux 4.2).
    pub(super) fn received(&self) -> Option<u64> {
        getsockopt(&self.own, CountedBytes).ok().map(|info| info.received)
    }
}

fn address(address: &SockaddrStorage) -> Option<(IpAddr, u16)> {
    address.family()?;
    let v4 = |address: &SockaddrIn| (IpAddr::V4(address.ip()), address.port());
    let v6 = |address: &SockaddrIn6| (IpAddr::V6(address.ip()).to_canonical(), address.port());
    address.as_sockaddr_in().map(v4).or_else(|| address.as_sockaddr_in6().map(v6))
}

/// The beginning of Linux's `struct tcp_info` (include/uapi/linux/tcp.h), which only ever grows at its end.
#[derive(Debug, Clone, Copy)]
#[repr(C)]
#[allow(unreachable_pub, reason = "nix makes the option's name public, and its value may be no less")]
pub struct TcpInfo {
    states: [u8; 8],
    numbers: [u32; 24],
    rates: [u64; 2],
    acknowledged: u64,
    received: u64,
}

sockopt_impl!(
    /// `TCP_INFO`, as far as the bytes that were received.
    CountedBytes,
    GetOnly,
    libc::IPPROTO_TCP,
    libc::TCP_INFO,
    TcpInfo
);

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
        assert_eq!((held.peer(), held.received()), (address.ip(), Some(12_345)));
        held.shut();
        assert_eq!(near.read(&mut [0]).unwrap(), 0);
        // The listener, the other end, a file, and numbers of nobody are none of ours.
        let file = std::fs::File::open("/proc/self/stat").unwrap();
        for other in [listener.as_raw_fd(), near.as_raw_fd(), file.as_raw_fd(), 1_000_000, -1] {
            assert!(Held::of(other, address.port()).is_none(), "{other}");
        }
    }
}
