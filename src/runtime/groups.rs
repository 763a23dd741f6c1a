//! The numbers of the machine's groups.
//!
//! A static file reads `/etc/group` itself: glibc's function would load the modules that
//! `/etc/nsswitch.conf` names, which a static file can only do with the glibc that it was built
//! with, and a brick's is another one.

use std::io;

use nix::unistd::Gid;

/// The number of the group of this name, if there is one.
#[cfg(not(target_feature = "crt-static"))]
pub(crate) fn number_of(name: &str) -> io::Result<Option<Gid>> {
    Ok(nix::unistd::Group::from_name(name)?.map(|group| group.gid))
}

/// The number of the group of this name, if there is one.
#[cfg(target_feature = "crt-static")]
pub(crate) fn number_of(name: &str) -> io::Result<Option<Gid>> {
    Ok(listed(&std::fs::read("/etc/group")?, name))
}

/// A line is `name:password:number:members`.
#[cfg(any(test, target_feature = "crt-static"))]
fn listed(groups: &[u8], name: &str) -> Option<Gid> {
    groups.split(|&byte| byte == b'\n').find_map(|line| {
        let mut fields = line.split(|&byte| byte == b':');
        let is_it = fields.next() == Some(name.as_bytes());
        let number = is_it.then(|| fields.nth(1)).flatten()?;
        std::str::from_utf8(number).ok()?.parse().ok().map(Gid::from_raw)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_is_found_by_its_whole_name() {
        let number = |name| {
            listed(
                b"root:x:0:\n\n# ev3dev:x:1:\nev3:x:2:\nev3dev:x:999:robot,\xff\n+:::\nlast:x:7",
                name,
            )
        };
        assert_eq!(number("root"), Some(Gid::from_raw(0)));
        assert_eq!(number("ev3dev"), Some(Gid::from_raw(999)));
        assert_eq!(number("last"), Some(Gid::from_raw(7)));
        assert_eq!(
            (number("x"), number("+"), number("video"), number("")),
            (None, None, None, None)
        );
    }

    #[test]
    fn what_the_machine_says_is_what_its_file_says() {
        assert_eq!(number_of("root").unwrap(), Some(Gid::from_raw(0)));
        assert_eq!(number_of("nobody-has-this-group").unwrap(), None);
    }
}
