//! Pre-faulted buffers: the kernel maps a page at its first write, which must not happen in a tick.

use std::hint::black_box;

/// As `vec![value; length]`, every page of it written to.
pub(super) fn filled<T: Copy>(value: T, length: usize) -> Vec<T> {
    // `black_box` hides the zeros from the compiler, which would otherwise take zero pages from the
    // kernel: untouched pages that fault at the first write.
    let mut room = black_box(Vec::with_capacity(length));
    room.resize(length, value);
    room
}

/// An empty list with room for this many entries.
pub(super) fn reserved<T: Copy + Default>(length: usize) -> Vec<T> {
    let mut room = filled(T::default(), length);
    room.clear();
    room
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Kilobytes of this process that are in memory.
    fn resident_kb() -> i64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:")).unwrap();
        line.trim().trim_end_matches(" kB").parse().unwrap()
    }

    #[test]
    fn what_is_reserved_is_there_before_it_is_used() {
        // So much that what other tests do meanwhile does not count.
        let length = 64 * 1024 * 1024 / size_of::<u64>();
        let before_kb = resident_kb();
        let list = black_box(reserved::<u64>(length));
        let grown_kb = resident_kb() - before_kb;
        assert!(list.is_empty() && list.capacity() >= length);
        assert!(grown_kb > 48 * 1024, "{grown_kb} kB of 64 MB are there");
        let zeros = black_box(filled(0_i8, 64 * 1024 * 1024));
        let grown_kb = resident_kb() - before_kb;
        assert!(zeros.iter().all(|zero| *zero == 0));
        assert!(grown_kb > 2 * 48 * 1024, "{grown_kb} kB of 128 MB are there");
    }
}
