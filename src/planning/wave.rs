//! The cheapest ways from one cell to all others: Dijkstra's algorithm with a ring of buckets.
//!
//! A cell waits in the bucket of its cost. As no step costs as much as there are buckets, the next
//! bucket that has one holds the cheapest cells (Dial 1969). Buckets are lists through two links a
//! cell, so that a cell whose cost falls moves at once.

/// More than any step's cost.
const BUCKETS: usize = 32;
/// No cell, and no cost.
const NONE: u16 = u16::MAX;

#[derive(Debug, Clone)]
pub(super) struct Wave {
    costs: Vec<u16>,
    /// Of each cell that waits, the one before and the one behind it in its bucket.
    links: Vec<[u16; 2]>,
    heads: [u16; BUCKETS],
    /// The cost of the bucket that is looked at.
    cost: u16,
    waiting: u16,
}

impl Wave {
    /// For a number of cells, at most 65 000.
    pub(super) fn new(cells: usize) -> Self {
        Self {
            costs: vec![NONE; cells],
            links: vec![[NONE; 2]; cells],
            heads: [NONE; BUCKETS],
            cost: 0,
            waiting: 0,
        }
    }

    /// Forgets the costs of cells.
    pub(super) fn clear(&mut self, cells: std::ops::Range<usize>) {
        if let Some(costs) = self.costs.get_mut(cells) {
            costs.fill(NONE);
        }
    }

    /// Begins at a cell, after all costs are forgotten.
    pub(super) fn begin(&mut self, cell: u16) {
        self.heads = [NONE; BUCKETS];
        (self.cost, self.waiting) = (0, 0);
        self.offer(cell, 0, 0);
    }

    /// What it costs to come to a cell; `None` where the wave has not.
    pub(super) fn cost(&self, cell: u16) -> Option<u16> {
        self.costs.get(usize::from(cell)).copied().filter(|cost| *cost != NONE)
    }

    /// Whether no cheaper way to a cell can come.
    pub(super) fn is_final(&self, cell: u16) -> bool {
        self.cost(cell).is_some_and(|cost| cost < self.cost)
    }

    /// A cell can be come to from one of a cost by a step, which costs less than there are buckets.
    pub(super) fn offer(&mut self, cell: u16, cost: u16, step: u16) {
        let Some(known) = self.costs.get(usize::from(cell)).copied() else { return };
        let Some(cost) = cost.checked_add(step).filter(|cost| *cost < known) else { return };
        if known != NONE {
            self.unlink(cell, known);
        }
        self.costs[usize::from(cell)] = cost;
        let head = &mut self.heads[usize::from(cost) % BUCKETS];
        let behind = std::mem::replace(head, cell);
        self.links[usize::from(cell)] = [NONE, behind];
        if let Some(links) = self.links.get_mut(usize::from(behind)) {
            links[0] = cell;
        }
        self.waiting += 1;
    }

    /// The cheapest cell that waits, and its cost, which is final.
    pub(super) fn pop(&mut self) -> Option<(u16, u16)> {
        if self.waiting == 0 {
            return None;
        }
        while self.heads[usize::from(self.cost) % BUCKETS] == NONE {
            self.cost = self.cost.checked_add(1)?;
        }
        let cell = self.heads[usize::from(self.cost) % BUCKETS];
        self.unlink(cell, self.cost);
        Some((cell, self.cost))
    }

    fn unlink(&mut self, cell: u16, cost: u16) {
        let [before, behind] = self.links[usize::from(cell)];
        match self.links.get_mut(usize::from(before)) {
            Some(links) => links[1] = behind,
            None => self.heads[usize::from(cost) % BUCKETS] = behind,
        }
        if let Some(links) = self.links.get_mut(usize::from(behind)) {
            links[0] = before;
        }
        self.waiting -= 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn costs_are_those_of_the_plain_algorithm(
            weights in prop::collection::vec(1_u16..31, 400), start in 0_u16..400
        ) {
            let neighbours = |cell: usize| {
                let (column, row) = (cell % 20, cell / 20);
                let mut found = Vec::new();
                found.extend((column > 0).then(|| cell - 1));
                found.extend((column < 19).then_some(cell + 1));
                found.extend((row > 0).then(|| cell - 20));
                found.extend((row < 19).then_some(cell + 20));
                found
            };
            let mut plain = vec![u32::MAX; 400];
            plain[usize::from(start)] = 0;
            // Bellman and Ford: over all edges, until no way becomes shorter.
            let mut is_shorter = true;
            while std::mem::take(&mut is_shorter) {
                for from in 0..400 {
                    for to in neighbours(from) {
                        let cost = plain[from].saturating_add(weights[to].into());
                        is_shorter |= cost < plain[to];
                        plain[to] = plain[to].min(cost);
                    }
                }
            }
            let mut wave = Wave::new(400);
            wave.begin(start);
            let mut last = 0;
            let mut popped = 0;
            while let Some((cell, cost)) = wave.pop() {
                prop_assert!(cost >= last, "{cost} after {last}");
                last = cost;
                popped += 1;
                for to in neighbours(usize::from(cell)) {
                    wave.offer(u16::try_from(to).unwrap(), cost, weights[to]);
                }
            }
            prop_assert_eq!(popped, 400);
            let cost = |cell| u32::from(wave.cost(cell).unwrap());
            let costs: Vec<u32> = (0..400).map(cost).collect();
            prop_assert_eq!(costs, plain);
        }
    }
}
