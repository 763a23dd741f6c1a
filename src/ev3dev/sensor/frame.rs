//! One frame of a sensor's `bin_data`: several values of the same moment.

use arrayvec::ArrayVec;

use crate::ev3dev::words::BinFormat;

/// Values that the sensor sent together.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    values: ArrayVec<f64, { Self::SIZE }>,
}

impl Frame {
    /// Bytes that the driver delivers, whatever the mode; those behind the values mean nothing.
    pub const SIZE: usize = 32;

    pub(crate) fn new(
        bytes: [u8; Self::SIZE],
        length: usize,
        format: BinFormat,
        count: usize,
    ) -> Option<Self> {
        // The driver may claim more values than fit into its 32 bytes.
        let count = count.min(Self::SIZE / format.size());
        let read = bytes.get(..length)?.get(..count * format.size())?;
        let values = read.chunks_exact(format.size()).map(|chunk| number(chunk, format));
        values.collect::<Option<_>>().map(|values| Self { values })
    }

    /// The values in the mode's order, not yet divided by ten to the power of `decimals`.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// A value as a whole number; `None` if there is none, or none that is whole.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "every whole value of 32 bits fits; a cast from float saturates"
    )]
    pub fn whole(&self, index: usize) -> Option<i64> {
        self.values
            .get(index)
            .filter(|value| value.is_finite() && libm::trunc(**value).to_bits() == value.to_bits())
            .map(|value| *value as i64)
    }
}

fn number(chunk: &[u8], format: BinFormat) -> Option<f64> {
    Some(match format {
        BinFormat::U8 => f64::from(u8::from_le_bytes(chunk.try_into().ok()?)),
        BinFormat::S8 => f64::from(i8::from_le_bytes(chunk.try_into().ok()?)),
        BinFormat::U16 => f64::from(u16::from_le_bytes(chunk.try_into().ok()?)),
        BinFormat::S16 => f64::from(i16::from_le_bytes(chunk.try_into().ok()?)),
        BinFormat::S16Be => f64::from(i16::from_be_bytes(chunk.try_into().ok()?)),
        BinFormat::S32 => f64::from(i32::from_le_bytes(chunk.try_into().ok()?)),
        BinFormat::S32Be | BinFormat::S32BeManual => {
            f64::from(i32::from_be_bytes(chunk.try_into().ok()?))
        }
        BinFormat::Float => f64::from(f32::from_le_bytes(chunk.try_into().ok()?)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(bytes: &[u8], format: BinFormat, count: usize) -> Option<Frame> {
        let mut whole = [0xaa; Frame::SIZE];
        whole[..bytes.len()].copy_from_slice(bytes);
        Frame::new(whole, bytes.len(), format, count)
    }

    #[test]
    fn every_format_reads_as_it_is_laid_out() {
        #[rustfmt::skip]
        let cases: &[(BinFormat, &[u8], f64)] = &[
            (BinFormat::U8,          &[0xff],                   255.0),
            (BinFormat::S8,          &[0x80],                   -128.0),
            (BinFormat::U16,         &[0xff, 0xff],             65535.0),
            (BinFormat::S16,         &[0xa6, 0xff],             -90.0),
            (BinFormat::S16Be,       &[0xff, 0xa6],             -90.0),
            (BinFormat::S32,         &[0, 0, 0, 0x80],          f64::from(i32::MIN)),
            (BinFormat::S32Be,       &[0, 0, 1, 0],             256.0),
            (BinFormat::S32BeManual, &[0, 0, 1, 0],             256.0),
            (BinFormat::Float,       &[0, 0, 0xc0, 0x3f],       1.5),
        ];
        for (format, bytes, value) in cases {
            assert_eq!(frame(bytes, *format, 1).unwrap().values(), [*value], "{format}");
        }
    }

    #[test]
    fn a_short_frame_is_none_and_a_claim_of_too_many_values_is_cut() {
        assert_eq!(frame(&[1, 0, 2], BinFormat::S16, 2), None);
        assert_eq!(frame(&[0; 32], BinFormat::S32, 200).unwrap().values().len(), 8);
        assert_eq!(frame(&[], BinFormat::S8, 0).unwrap().values(), [0.0; 0]);
    }

    #[test]
    fn only_whole_values_are_whole() {
        let floats =
            frame(&[0, 0, 0xc0, 0x3f, 0, 0, 0, 0x40, 0, 0, 0xc0, 0x7f], BinFormat::Float, 3)
                .unwrap();
        assert_eq!(
            [floats.whole(0), floats.whole(1), floats.whole(2), floats.whole(3)],
            [None, Some(2), None, None]
        );
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_frame_or_none(
            bytes in any::<[u8; 32]>(), length in 0_usize..40, count in 0_usize..300,
            format in 0..BinFormat::ALL.len()
        ) {
            let _ = Frame::new(bytes, length, BinFormat::ALL[format], count);
        }
    }
}
