//! The numbers by which the kernel knows files, and the places they stand for.

use std::collections::BTreeMap;

/// The root's number.
pub(super) const ROOT: u64 = 1;

/// A place in the mount.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct NodePath {
    /// Whose brick; none for the folder above several bricks.
    pub(super) robot: Option<usize>,
    /// Relative to the brick's root.
    pub(super) path: String,
}

#[derive(Debug)]
struct Known {
    place: NodePath,
    /// How often the kernel has been told of it, and has not forgotten.
    lookups: u64,
}

/// All the places that the kernel knows.
#[derive(Debug)]
pub(super) struct Nodes {
    root: NodePath,
    known: BTreeMap<u64, Known>,
    numbers: BTreeMap<NodePath, u64>,
    last: u64,
}

impl Nodes {
    /// A mount of one brick, or of several in folders.
    pub(super) fn new(robots: usize) -> Self {
        let root = NodePath { robot: (robots == 1).then_some(0), path: String::new() };
        Self { root, known: BTreeMap::new(), numbers: BTreeMap::new(), last: ROOT }
    }

    /// The place with a number.
    pub(super) fn place(&self, number: u64) -> Option<&NodePath> {
        if number == ROOT {
            Some(&self.root)
        } else {
            self.known.get(&number).map(|known| &known.place)
        }
    }

    /// The number of a place that the kernel knows.
    pub(super) fn number(&self, place: &NodePath) -> Option<u64> {
        if *place == self.root { Some(ROOT) } else { self.numbers.get(place).copied() }
    }

    /// Tells the kernel of a place: gives it a number, if it has none.
    pub(super) fn look_up(&mut self, place: NodePath) -> u64 {
        if place == self.root {
            return ROOT;
        }
        let number = *self.numbers.entry(place.clone()).or_insert_with(|| {
            self.last += 1;
            self.last
        });
        self.known.entry(number).or_insert(Known { place, lookups: 0 }).lookups += 1;
        number
    }

    /// The kernel has forgotten some of what it was told.
    pub(super) fn forget(&mut self, number: u64, lookups: u64) {
        let Some(known) = self.known.get_mut(&number) else { return };
        known.lookups = known.lookups.saturating_sub(lookups);
        if known.lookups == 0
            && let Some(known) = self.known.remove(&number)
        {
            self.numbers.remove(&known.place);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_keeps_its_number_until_the_kernel_has_forgotten_it() {
        let mut nodes = Nodes::new(1);
        let place = NodePath { robot: Some(0), path: "sys".to_owned() };
        let first = nodes.look_up(place.clone());
        assert_ne!(first, ROOT);
        assert_eq!(nodes.look_up(place.clone()), first);
        nodes.forget(first, 1);
        assert_eq!(nodes.number(&place), Some(first));
        nodes.forget(first, 1);
        assert_eq!((nodes.number(&place), nodes.place(first)), (None, None));
        assert_ne!(nodes.look_up(place), first, "numbers are not used again");
        nodes.forget(999, 1);
    }

    #[test]
    fn the_root_is_a_brick_or_the_folder_above_several() {
        assert_eq!(Nodes::new(1).place(ROOT).unwrap().robot, Some(0));
        assert_eq!(Nodes::new(2).place(ROOT).unwrap().robot, None);
    }
}
