//! Any bytes as a recording: read or refused, and replayed where that can be done. A mutation breaks a checksum at once, and then little of the
//! reader is reached; so the same bytes are read once more with every checksum mended.
#![no_main]

use libfuzzer_sys::fuzz_target;
use onbrick::runtime::recording::{Run, SYNC_MAGIC, SYNC_OPCODE};
use onbrick::runtime::replay;

/// Opcode and length of a record.
const FRAME: usize = 9;

fuzz_target!(|bytes: &[u8]| {
    judge(bytes);
    judge(&mended(bytes));
});

fn judge(bytes: &[u8]) {
    let Ok(checked) = Run::read_checked(bytes) else { return };
    assert!(checked.integrity.checked_bytes <= bytes.len() as u64);
    assert_eq!(checked.integrity.unchecked_messages, 0);
    let Ok(all) = Run::read(bytes) else { panic!("what is read in part is read whole") };
    assert!(all.senses.len() >= checked.senses.len());
    let _ = replay(&all);
}

/// The same bytes with every sync's start, length and checksums as they should be.
fn mended(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let mut start = 0;
    let mut at = 0;
    while let Some(head) = bytes.get(at..at + FRAME + SYNC_MAGIC.len()) {
        if head[0] != SYNC_OPCODE || head[FRAME..] != SYNC_MAGIC || at + FRAME + 44 > bytes.len() {
            at += 1;
            continue;
        }
        let crc = crc32fast::hash(&bytes[start..at]);
        let body = &mut bytes[at + FRAME..at + FRAME + 44];
        body[8..16].copy_from_slice(&(start as u64).to_le_bytes());
        body[16..24].copy_from_slice(&((at - start) as u64).to_le_bytes());
        body[36..40].copy_from_slice(&crc.to_le_bytes());
        let own = crc32fast::hash(&body[..40]);
        body[40..].copy_from_slice(&own.to_le_bytes());
        at += FRAME + 44;
        start = at;
    }
    bytes
}
