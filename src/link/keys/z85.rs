//! Z85, in which ZeroMQ writes keys: 32 bytes as 40 characters (rfc.zeromq.org/spec/32), by libzmq.
#![allow(unsafe_code, reason = "`zmq::z85_decode` leaks each text and does not report a wrong one")]

use std::ffi::CString;

/// 40 characters.
pub(super) fn encode(bytes: &[u8; 32]) -> String {
    // The only error is a length that is no multiple of 4.
    zmq::z85_encode(bytes).unwrap_or_default()
}

/// `None` unless the text is 40 characters of Z85, of which each five hold a number of 32 bits.
pub(super) fn decode(text: &str) -> Option<[u8; 32]> {
    let text = CString::new(text).ok().filter(|text| text.as_bytes().len() == 40)?;
    let mut bytes = [0; 32];
    // SAFETY: the text ends with a NUL, and libzmq writes four bytes for each five of its 40.
    let decoded = unsafe { zmq_sys::zmq_z85_decode(bytes.as_mut_ptr(), text.as_ptr()) };
    (!decoded.is_null()).then_some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_comes_back_from_its_text() {
        // The example of rfc.zeromq.org/spec/32, four times.
        let bytes = [0x86, 0x4F, 0xD2, 0x6F, 0xB5, 0x59, 0xF7, 0x5B].repeat(4).try_into().unwrap();
        assert_eq!(encode(&bytes), "HelloWorld".repeat(4));
        for bytes in [bytes, [0; 32], [255; 32]] {
            assert_eq!(decode(&encode(&bytes)), Some(bytes));
        }
    }

    #[test]
    fn what_is_no_key_is_not_taken_for_one() {
        for bad in [
            "",
            "0",
            &"0".repeat(39),
            &"0".repeat(41),
            &"#".repeat(40),
            &"\"".repeat(40),
            &"ü".repeat(20),
            &"0\u{0}00".repeat(10),
        ] {
            assert_eq!(decode(bad), None, "{bad}");
        }
    }
}
