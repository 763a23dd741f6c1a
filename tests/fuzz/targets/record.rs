//! Any bytes as a recording: read or refused, and replayed where that can be done. A mutation
//! breaks a checksum at once, and then little of the reader is reached; so the same bytes are read
//! once more with every checksum mended.
#![no_main]

use libfuzzer_sys::fuzz_target;
use onbrick::recording::Run;
use onbrick::runtime::replay;

/// Opcode and length of a record; what a chunk has before its records, and where its checksum is.
const FRAME: usize = 9;
const HEAD: usize = FRAME + 40;
const CRC: usize = FRAME + 24;

const CHUNK: u8 = 0x06;
const ATTACHMENT: u8 = 0x09;

fuzz_target!(|bytes: &[u8]| {
    judge(bytes);
    judge(&mended(bytes));
});

fn judge(bytes: &[u8]) {
    let Ok(run) = Run::read(bytes) else { return };
    let damaged: u64 = run.integrity.damaged.iter().map(|range| range.end - range.start).sum();
    assert!(damaged + run.integrity.cut_bytes <= bytes.len() as u64);
    let _ = replay(&run);
}

/// The same bytes with the checksum of every chunk and attachment as it should be.
fn mended(bytes: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let mut at = 8;
    while let Some(head) = bytes.get(at..at + FRAME) {
        let opcode = head[0];
        let length = u64::from_le_bytes(head[1..].try_into().unwrap_or_default());
        let whole = usize::try_from(length).ok().and_then(|length| length.checked_add(at + FRAME));
        let Some(end) = whole else { break };
        if end > bytes.len() {
            break;
        }
        if opcode == CHUNK && end >= at + HEAD {
            let crc = crc32fast::hash(&bytes[at + HEAD..end]);
            bytes[at + CRC..at + CRC + 4].copy_from_slice(&crc.to_le_bytes());
        }
        if opcode == ATTACHMENT && end >= at + FRAME + 4 {
            let crc = crc32fast::hash(&bytes[at + FRAME..end - 4]);
            bytes[end - 4..end].copy_from_slice(&crc.to_le_bytes());
        }
        at = end;
    }
    bytes
}
