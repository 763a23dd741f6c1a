//! CRC32 (that of IEEE 802.3, zip and MCAP) of what is being recorded, as it grows: eight bytes at a time by eight tables (Kounavis and Berry, *A
//! systematic approach to building high performance software-based CRC generators*, 2005).
//!
//! # Not here
//!
//! Checking what was recorded: that is the crate `crc32fast`'s, with which a test compares this one.
//!
//! # Why not that crate
//!
//! A recording's bytes are a tenth of what a tick costs, and the brick's program is in Thumb, which has no instruction that looks a table up by a
//! shifted index: 9 instructions a byte there, 4 in ARM. A crate's functions cannot be had in ARM one by one, a function of ours can.

/// The polynomial, its bits turned round.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// What a byte contributes that so many bytes come after.
static TABLES: [[u32; 256]; 8] = tables();

const fn tables() -> [[u32; 256]; 8] {
    let mut tables = [[0; 256]; 8];
    let mut byte = 0;
    while byte < 256 {
        #[expect(clippy::cast_possible_truncation, reason = "below 256")]
        let mut crc = byte as u32;
        let mut after = 0;
        while after < 8 {
            let mut bit = 0;
            while bit < 8 {
                crc = if crc & 1 == 0 { crc >> 1 } else { crc >> 1 ^ POLYNOMIAL };
                bit += 1;
            }
            tables[after][byte] = crc;
            after += 1;
        }
        byte += 1;
    }
    tables
}

/// The CRC of the bytes so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Crc(u32);

impl Crc {
    /// Takes the next bytes.
    pub(super) fn update(&mut self, bytes: &[u8]) {
        self.0 = !updated(!self.0, bytes);
    }

    pub(super) fn value(self) -> u32 {
        self.0
    }
}

/// In its loop there is nothing that could be a call: what is in Thumb is not inlined into ARM.
#[cfg_attr(target_arch = "arm", instruction_set(arm::a32))]
fn updated(before: u32, bytes: &[u8]) -> u32 {
    let [t0, t1, t2, t3, t4, t5, t6, t7] = &TABLES;
    let mut crc = before;
    let (eights, rest) = bytes.as_chunks::<8>();
    let mut at = 0;
    while at < eights.len() {
        let [a, b, c, d, e, f, g, h] = eights[at];
        let [i, j, k, l] = crc.to_le_bytes();
        crc = t7[usize::from(a ^ i)]
            ^ t6[usize::from(b ^ j)]
            ^ t5[usize::from(c ^ k)]
            ^ t4[usize::from(d ^ l)]
            ^ t3[usize::from(e)]
            ^ t2[usize::from(f)]
            ^ t1[usize::from(g)]
            ^ t0[usize::from(h)];
        at += 1;
    }
    for byte in rest {
        let [low, ..] = crc.to_le_bytes();
        crc = t0[usize::from(low ^ *byte)] ^ (crc >> 8);
    }
    crc
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_the_crates_however_the_bytes_come(parts in proptest::collection::vec(any::<Vec<u8>>(), 0..5)) {
            let mut crc = Crc::default();
            parts.iter().for_each(|part| crc.update(part));
            prop_assert_eq!(crc.value(), crc32fast::hash(&parts.concat()));
        }
    }
}
