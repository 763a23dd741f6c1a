//! Where a brick listens: `address` in its configuration.

use std::sync::Arc;

use onbrick::link::{LinkState, Server, ServerConfig};
use onbrick::protocol::{Name, Operations};
use onbrick::service::config::LinkConfig;

use super::bench::{Fake, until};

/// How a server at this address begins.
fn begun(address: &str) -> LinkState {
    let folder = tempfile::tempdir().unwrap();
    let config = ServerConfig {
        keys: folder.path().to_owned(),
        name: Name::new("fake").unwrap(),
        listens: LinkConfig { address: address.to_owned(), port: 0, pairing_port: 0 },
    };
    let operations = Arc::new(Fake::default()) as Arc<dyn Operations>;
    let server = Server::start(config, operations).unwrap();
    until("the link is ready or refused", || match server.state() {
        LinkState::Waits(_) => None,
        state => Some(state),
    })
}

#[test]
fn a_brick_listens_at_its_own_addresses_and_says_of_others_that_it_has_none() {
    for address in ["*", "127.0.0.1"] {
        assert!(matches!(begun(address), LinkState::Ready { .. }), "{address}: {}", begun(address));
    }
    let why = begun("192.0.2.1").to_string();
    assert!(why.contains("192.0.2.1") && why.contains("this machine has no such address"), "{why}");
}
