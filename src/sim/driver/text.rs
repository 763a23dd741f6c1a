//! How the kernel reads what is written to an attribute.
//!
//! All functions take the bytes of one `write`, whole. They answer with the kernel's own error
//! numbers.

use std::ops::RangeInclusive;
use std::str::FromStr;

use nix::errno::Errno;

/// The text that a store function sees: the kernel ends it at the first NUL.
pub(crate) fn text(bytes: &[u8]) -> &[u8] {
    bytes.split(|byte| *byte == 0).next().unwrap_or_default()
}

/// The same without one trailing newline (`sysfs_streq`).
fn streq(bytes: &[u8]) -> &[u8] {
    let text = text(bytes);
    text.strip_suffix(b"\n").unwrap_or(text)
}

/// Which of `words` was written; one trailing newline is allowed (`sysfs_streq`).
///
/// # Errors
///
/// EINVAL for any other text.
pub(crate) fn word<'a>(
    bytes: &[u8],
    words: impl IntoIterator<Item = &'a str>,
) -> Result<usize, Errno> {
    let text = streq(bytes);
    words.into_iter().position(|word| word.as_bytes() == text).ok_or(Errno::EINVAL)
}

/// What was written, of a table of the kernel's words; else as [`word`].
///
/// # Errors
///
/// EINVAL for any other text.
pub(crate) fn known<W: FromStr>(bytes: &[u8]) -> Result<W, Errno> {
    let text = std::str::from_utf8(streq(bytes)).map_err(|_| Errno::EINVAL)?;
    text.parse().map_err(|_| Errno::EINVAL)
}

/// A decimal integer with an optional sign and one optional trailing newline (`kstrtoint`, base
/// 10).
///
/// # Errors
///
/// EINVAL for other text, ERANGE outside 32 bits.
pub(crate) fn int(bytes: &[u8]) -> Result<i32, Errno> {
    let text = text(bytes);
    let (negative, digits) = match text {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, text),
    };
    let value = i64::try_from(magnitude(digits)?).map_err(|_| Errno::ERANGE)?;
    i32::try_from(if negative { -value } else { value }).map_err(|_| Errno::ERANGE)
}

/// An unsigned decimal integer, else as [`int`] (`kstrtoul` on the brick, whose `long` has 32
/// bits).
///
/// # Errors
///
/// EINVAL for other text, ERANGE outside 32 bits.
pub(crate) fn unsigned(bytes: &[u8]) -> Result<u32, Errno> {
    let text = text(bytes);
    u32::try_from(magnitude(text.strip_prefix(b"+").unwrap_or(text))?).map_err(|_| Errno::ERANGE)
}

/// Digits, and nothing after them but perhaps a newline.
fn magnitude(text: &[u8]) -> Result<u64, Errno> {
    let length = text.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (digits, rest) = text.split_at(length);
    let value = digits.iter().try_fold(0_u64, |value, digit| {
        value.checked_mul(10)?.checked_add(u64::from(digit - b'0'))
    });
    match (length, value, rest) {
        (1.., None, _) => Err(Errno::ERANGE),
        (1.., Some(value), b"" | b"\n") => Ok(value),
        _ => Err(Errno::EINVAL),
    }
}

/// A number that was read, within bounds.
///
/// # Errors
///
/// EINVAL outside them.
pub(crate) fn within<N: PartialOrd>(number: N, bounds: RangeInclusive<N>) -> Result<N, Errno> {
    if bounds.contains(&number) { Ok(number) } else { Err(Errno::EINVAL) }
}

/// An unsigned integer as `sscanf("%u")` takes it: leading blanks and trailing garbage do not
/// matter; it wraps at 32 bits.
///
/// # Errors
///
/// EINVAL where there is no number, and for a minus sign.
pub(crate) fn scan_unsigned(bytes: &[u8]) -> Result<u32, Errno> {
    let text = text(bytes).trim_ascii_start();
    if !text.first().is_some_and(u8::is_ascii_digit) {
        return Err(Errno::EINVAL);
    }
    let digits = text.iter().take_while(|byte| byte.is_ascii_digit());
    Ok(digits
        .fold(0_u32, |value, digit| value.wrapping_mul(10).wrapping_add(u32::from(digit - b'0'))))
}

/// A signed integer as `sscanf("%d")` takes it; see [`scan_unsigned`].
///
/// # Errors
///
/// EINVAL where there is no number.
pub(crate) fn scan_signed(bytes: &[u8]) -> Result<i32, Errno> {
    let text = text(bytes).trim_ascii_start();
    match text {
        [b'-', rest @ ..] if rest.first().is_some_and(u8::is_ascii_digit) => {
            Ok(scan_unsigned(rest)?.cast_signed().wrapping_neg())
        }
        _ => Ok(scan_unsigned(text)?.cast_signed()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_taken_as_the_kernel_takes_them() {
        let cases: [(&[u8], Result<i32, Errno>); 16] = [
            (b"5", Ok(5)),
            (b"+5", Ok(5)),
            (b"-0", Ok(0)),
            (b"007\n", Ok(7)),
            (b"-2147483648", Ok(i32::MIN)),
            (b"5\0garbage", Ok(5)),
            (b"2147483648", Err(Errno::ERANGE)),
            (b"99999999999999999999999", Err(Errno::ERANGE)),
            (b"", Err(Errno::EINVAL)),
            (b"\n", Err(Errno::EINVAL)),
            (b" 5", Err(Errno::EINVAL)),
            (b"5 ", Err(Errno::EINVAL)),
            (b"5\n\n", Err(Errno::EINVAL)),
            (b"0x10", Err(Errno::EINVAL)),
            (b"-+5", Err(Errno::EINVAL)),
            (b"1.5", Err(Errno::EINVAL)),
        ];
        for (bytes, expected) in cases {
            assert_eq!(int(bytes), expected, "{:?}", String::from_utf8_lossy(bytes));
        }
    }

    #[test]
    fn unsigned_integers_have_no_sign_but_plus() {
        assert_eq!(unsigned(b"+4294967295\n"), Ok(u32::MAX));
        assert_eq!(unsigned(b"4294967296"), Err(Errno::ERANGE));
        for refused in [b"-1".as_slice(), b"", b"+", b"++1", b"1 "] {
            assert_eq!(
                unsigned(refused),
                Err(Errno::EINVAL),
                "{:?}",
                String::from_utf8_lossy(refused)
            );
        }
    }

    #[test]
    fn scanned_numbers_tolerate_what_stands_around_them() {
        assert_eq!(scan_unsigned(b" 500abc"), Ok(500));
        assert_eq!(scan_unsigned(b"-5"), Err(Errno::EINVAL));
        assert_eq!(scan_signed(b"-5 x"), Ok(-5));
        assert_eq!(scan_signed(b"-"), Err(Errno::EINVAL));
        assert_eq!(scan_signed(b""), Err(Errno::EINVAL));
    }

    #[test]
    fn a_word_may_end_in_one_newline() {
        let words = ["coast", "brake"];
        assert_eq!(word(b"brake\n", words), Ok(1));
        assert_eq!(word(b"brake\0x", words), Ok(1));
        for refused in [b"brake\n\n".as_slice(), b" brake", b"Brake", b"brak", b""] {
            assert_eq!(
                word(refused, words),
                Err(Errno::EINVAL),
                "{:?}",
                String::from_utf8_lossy(refused)
            );
        }
    }
}
