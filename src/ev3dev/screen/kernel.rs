//! What the kernel must be asked for by ioctl and memory map; `unsafe` is kept in this file.
//!
//! No crate that is still looked after wraps these three calls (`linuxfb` maps with a crate that is
//! not).
//!
//! # What we count on
//!
//! - `linux/fb.h` and `linux/kd.h`: the numbers and layouts below have not changed since Linux 2.4.

#![allow(
    unsafe_code,
    reason = "frame buffer and console are ioctls and a memory map, which have no safe wrapper"
)]

use std::ffi::c_ulong;
use std::fs::File;
use std::os::fd::{AsRawFd, BorrowedFd};

use memmap2::{MmapMut, MmapOptions};
use nix::errno::Errno;

use super::ScreenLayout;

/// `struct fb_bitfield`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
struct Bitfield {
    offset: u32,
    length: u32,
    msb_right: u32,
}

/// `struct fb_var_screeninfo`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
struct Variable {
    xres: u32,
    yres: u32,
    xres_virtual: u32,
    yres_virtual: u32,
    xoffset: u32,
    yoffset: u32,
    bits_per_pixel: u32,
    grayscale: u32,
    red: Bitfield,
    green: Bitfield,
    blue: Bitfield,
    transp: Bitfield,
    rest: [u32; 20],
}

/// `struct fb_fix_screeninfo`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
struct Fixed {
    id: [u8; 16],
    smem_start: c_ulong,
    smem_len: u32,
    kind: u32,
    type_aux: u32,
    visual: u32,
    xpanstep: u16,
    ypanstep: u16,
    ywrapstep: u16,
    line_length: u32,
    mmio_start: c_ulong,
    mmio_len: u32,
    accel: u32,
    capabilities: u16,
    reserved: [u16; 2],
}

nix::ioctl_read_bad!(get_variable, 0x4600, Variable);
nix::ioctl_read_bad!(get_fixed, 0x4602, Fixed);
nix::ioctl_write_int_bad!(set_console_mode, 0x4B3A);

/// Asks a frame buffer for its layout, or what it has instead of one that this program can draw in;
/// the outer error is the kernel's: mostly that this is none.
pub(super) fn layout(fd: BorrowedFd<'_>) -> Result<Result<ScreenLayout, String>, Errno> {
    let mut variable = Variable::default();
    let mut fixed = Fixed::default();
    // SAFETY: both structs are laid out as the kernel's (a test holds their sizes), live through
    // the calls, and every bit pattern is legal in them.
    unsafe {
        get_variable(fd.as_raw_fd(), &raw mut variable)?;
        get_fixed(fd.as_raw_fd(), &raw mut fixed)?;
    }
    Ok(understood(&variable, &fixed))
}

fn understood(variable: &Variable, fixed: &Fixed) -> Result<ScreenLayout, String> {
    let &Variable { xres, yres, bits_per_pixel, .. } = variable;
    let [red, green, blue] = [variable.red, variable.green, variable.blue].map(|it| it.offset);
    // Where the panel has red, a virtual frame buffer has blue: for greys both are the same.
    let known = bits_per_pixel == 32 && matches!([red, green, blue], [16, 8, 0] | [0, 8, 16]);
    // What is mapped is what the kernel says that there is.
    let bytes = u64::from(fixed.line_length) * u64::from(yres);
    let fits = u64::from(xres) * 4 <= u64::from(fixed.line_length)
        && bytes > 0
        && bytes <= u64::from(fixed.smem_len);
    let [width, height, line_length] =
        [xres, yres, fixed.line_length].map(|number| usize::try_from(number).unwrap_or(usize::MAX));
    if known && fits {
        return Ok(ScreenLayout { width, height, line_length });
    }
    Err(format!(
        "{width}x{height}, {bits_per_pixel} bits a pixel (red {red}, green {green}, blue {blue}), \
         {line_length} bytes a row"
    ))
}

/// Maps the first `length` bytes of a frame buffer.
pub(super) fn map(file: &File, length: usize) -> std::io::Result<MmapMut> {
    // SAFETY: a frame buffer's memory cannot be truncated as a file can. Other processes may draw
    // on it meanwhile; its bytes are only ever written here, as plain bytes, and never read or
    // relied on.
    unsafe { MmapOptions::new().len(length).map_mut(file) }
}

/// Text.
pub(super) const KD_TEXT: i32 = 0;
/// Graphics: the kernel draws neither text nor cursor.
pub(super) const KD_GRAPHICS: i32 = 1;

/// Sets the mode of a console; an error where this is none.
pub(super) fn set_mode(fd: BorrowedFd<'_>, mode: i32) -> Result<(), Errno> {
    // SAFETY: the argument is a number, no pointer.
    unsafe { set_console_mode(fd.as_raw_fd(), mode)? };
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_structs_have_the_kernels_sizes() {
        assert_eq!(size_of::<Variable>(), 160);
        assert_eq!(size_of::<Fixed>(), if size_of::<c_ulong>() == 8 { 80 } else { 68 });
    }

    fn asked(
        bits: u32,
        (red, blue): (u32, u32),
        line_length: u32,
        smem_len: u32,
    ) -> Result<ScreenLayout, String> {
        let at = |offset| Bitfield { offset, length: 8, msb_right: 0 };
        let variable = Variable {
            xres: 178,
            yres: 128,
            bits_per_pixel: bits,
            red: at(red),
            green: at(8),
            blue: at(blue),
            ..Variable::default()
        };
        understood(&variable, &Fixed { line_length, smem_len, ..Fixed::default() })
    }

    #[test]
    fn the_bricks_layout_is_understood_and_others_are_named() {
        for order in [(16, 0), (0, 16)] {
            assert_eq!(
                asked(32, order, 712, 91_136),
                Ok(ScreenLayout { width: 178, height: 128, line_length: 712 })
            );
        }
        for (bits, order, line, memory) in [
            (1, (0, 0), 24, 3072),
            (32, (0, 0), 712, 91_136),
            (32, (24, 8), 712, 91_136),
            (32, (16, 0), 700, 91_136),
            (32, (16, 0), 712, 91_135),
        ] {
            let other = asked(bits, order, line, memory).unwrap_err();
            assert!(other.contains(&format!("{bits} bits a pixel (red {}", order.0)), "{other}");
        }
    }
}
