//! From what a person calls a host to where it is.

use std::net::{IpAddr, SocketAddr, ToSocketAddrs};
use std::process::Command;

/// A host, and a port where one is named.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::link) struct Address {
    /// The name or number, without brackets.
    pub(in crate::link) host: String,
    pub(in crate::link) port: u16,
}

impl Address {
    /// `name`, `name:port`, `1.2.3.4`, `1.2.3.4:port`, `::1`, `[::1]`, `[::1]:port`.
    pub(in crate::link) fn parse(text: &str, usual_port: u16) -> Self {
        let (host, port) = match text.rsplit_once(':') {
            // More colons than one without brackets are a number of IPv6.
            Some((host, port)) if !host.contains(':') || host.ends_with(']') => {
                (host, port.parse().ok())
            }
            _ => (text, Some(usual_port)),
        };
        let (host, port) = port.map_or((text, usual_port), |port| (host, port));
        let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
        Self { host: bare.to_owned(), port }
    }

    /// What [`Address::parse`] takes for the same host at another port, or at the usual one.
    pub(in crate::link) fn at(&self, port: Option<u16>) -> String {
        match port {
            None => self.host.clone(),
            Some(port) if self.host.contains(':') => format!("[{}]:{port}", self.host),
            Some(port) => format!("{}:{port}", self.host),
        }
    }

    /// Where it is now, the numbers of IPv4 first: bricks have those in every network.
    pub(super) fn resolve(&self) -> Vec<SocketAddr> {
        let asked = cfg!(target_feature = "crt-static").then(|| self.by_getent()).flatten();
        let mut found = asked.unwrap_or_else(|| {
            let found = (self.host.as_str(), self.port).to_socket_addrs();
            found.map(Iterator::collect).unwrap_or_default()
        });
        found.sort_by_key(SocketAddr::is_ipv6);
        found.dedup();
        found
    }

    /// The same by the system's program `getent`; `None` where there is none. A static program may
    /// not load the modules by which the C library resolves names, such as mDNS's for `.local`:
    /// they are for the system's C library, and it has its own.
    fn by_getent(&self) -> Option<Vec<SocketAddr>> {
        // No name begins with a hyphen, and an option does.
        if self.host.parse::<IpAddr>().is_ok() || self.host.is_empty() || self.host.starts_with('-')
        {
            return None;
        }
        let said = Command::new("getent").args(["ahosts", &self.host]).output().ok()?;
        let said = String::from_utf8_lossy(&said.stdout);
        let addresses = said.lines().filter_map(|line| line.split(' ').next()?.parse().ok());
        Some(addresses.map(|address: IpAddr| SocketAddr::new(address, self.port)).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_may_have_a_port_and_numbers_of_ipv6_colons() {
        let address = |text: &str| {
            let Address { host, port } = Address::parse(text, 5670);
            (host, port)
        };
        let expect = |host: &str, port| (host.to_owned(), port);
        assert_eq!(address("ev3.local"), expect("ev3.local", 5670));
        assert_eq!(address("ev3:80"), expect("ev3", 80));
        assert_eq!(address("10.0.0.1:80"), expect("10.0.0.1", 80));
        assert_eq!(address("::1"), expect("::1", 5670));
        assert_eq!(address("[::1]"), expect("::1", 5670));
        assert_eq!(address("[::1]:80"), expect("::1", 80));
        // No port: the name does not exist, and that is what is said.
        assert_eq!(address("ev3:http"), expect("ev3:http", 5670));
        assert_eq!(address(""), expect("", 5670));
    }

    #[test]
    fn a_host_at_another_port_is_read_as_the_same_host() {
        for host in ["ev3.local", "10.0.0.1", "fd00::5"] {
            for text in [host, &format!("[{host}]:80")] {
                let there = Address::parse(text, 5670);
                assert_eq!(Address::parse(&there.at(None), 5670), Address::parse(host, 5670));
                assert_eq!(
                    Address::parse(&there.at(Some(81)), 5670),
                    Address { port: 81, ..there }
                );
            }
        }
    }

    #[test]
    fn a_static_program_finds_the_same_by_getent() {
        let localhost = Address::parse("localhost:81", 5670);
        let mut asked = localhost.by_getent().unwrap();
        asked.sort_by_key(SocketAddr::is_ipv6);
        asked.dedup();
        assert!(!asked.is_empty() && asked == localhost.resolve(), "{asked:?}");
        // Longer than a label may be, so that no name server is asked: one that is silent costs a
        // minute and more.
        let nameless = Address::parse(&"a".repeat(64), 1);
        assert_eq!(nameless.by_getent(), Some(Vec::new()));
        for none in ["--version", "10.0.0.1", ""] {
            assert_eq!(Address::parse(none, 1).by_getent(), None, "{none}");
        }
    }

    #[test]
    fn numbers_need_nobody_to_be_asked() {
        let found = Address::parse("127.0.0.1:81", 5670).resolve();
        assert_eq!(found, ["127.0.0.1:81".parse().unwrap()]);
        assert_eq!(Address::parse("", 5670).resolve(), []);
    }
}
