//! Any bytes as a request: understood or refused, by both doors; the network understands nothing
//! that the local door does not.
#![no_main]

use libfuzzer_sys::fuzz_target;
use onbrick::protocol::{parse, parse_local};

fuzz_target!(|bytes: &[u8]| {
    let network = parse(bytes);
    let local = parse_local(bytes);
    assert!(network.is_err() || local.is_ok(), "{network:?} but {local:?}");
    for refused in [network.err(), local.err()].into_iter().flatten() {
        assert!(refused.refusal.message.len() < 4096, "a refusal is short: {refused:?}");
    }
});
