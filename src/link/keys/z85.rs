//! Z85, the way ZeroMQ writes keys: 32 bytes as 40 signs, four bytes as five (rfc.zeromq.org/spec/32).
//!
//! libzmq's own decoder takes signs that are none; this one does not.

const SIGNS: &[u8; 85] =
    b"0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#";

/// 40 signs.
pub(super) fn encode(bytes: &[u8; 32]) -> String {
    let mut text = String::with_capacity(40);
    for four in bytes.chunks_exact(4) {
        let number = four.iter().fold(0_u64, |number, byte| number * 256 + u64::from(*byte));
        for power in [85_u64.pow(4), 85_u64.pow(3), 85_u64.pow(2), 85, 1] {
            let digit = usize::try_from(number / power % 85).unwrap_or(0);
            text.extend(SIGNS.get(digit).map(|sign| char::from(*sign)));
        }
    }
    text
}

/// `None` where the text is not 40 signs of Z85, or five of them say more than four bytes hold.
pub(super) fn decode(text: &str) -> Option<[u8; 32]> {
    let digits: Option<Vec<u64>> = text.bytes().map(digit).collect();
    let numbers: Option<Vec<u32>> = digits?
        .chunks(5)
        .map(|five| u32::try_from(five.iter().fold(0, |number, digit| number * 85 + digit)).ok())
        .collect();
    if text.len() != 40 {
        return None;
    }
    let bytes: Vec<u8> = numbers?.into_iter().flat_map(u32::to_be_bytes).collect();
    bytes.try_into().ok()
}

fn digit(sign: u8) -> Option<u64> {
    SIGNS.iter().position(|known| *known == sign).and_then(|place| u64::try_from(place).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_written_as_libzmq_writes_them() {
        let mut bytes = [0; 32];
        for (place, byte) in (0..).zip(&mut bytes) {
            *byte = u8::wrapping_add(u8::wrapping_mul(place, 37), 11);
        }
        for bytes in [bytes, [0; 32], [255; 32]] {
            let text = encode(&bytes);
            assert_eq!(text, zmq::z85_encode(&bytes).unwrap());
            assert_eq!(decode(&text), Some(bytes));
        }
    }

    #[test]
    fn what_is_no_key_is_not_taken_for_one() {
        for bad in
            ["", "0", &"0".repeat(39), &"0".repeat(41), &"#".repeat(40), &"\"".repeat(40), &"ü".repeat(20)]
        {
            assert_eq!(decode(bad), None, "{bad}");
        }
    }
}
