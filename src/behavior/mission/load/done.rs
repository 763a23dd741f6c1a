//! Whether `done` can hold where it is asked for.

use super::Reader;
use super::actions::actions;
use crate::behavior::mission::TransitionPlan;
use crate::document::{Item, Severity};

/// What `done` needs.
const NOTHING_ENDS: &str = "`done` can never hold: nothing that the state does comes to an end";
const ENDING_KEYS: [&str; 8] =
    ["drive_m", "turn_deg", "arc", "goto", "explore_m", "head_deg", "motor_deg", "tune"];

/// Whether a state may be to do something that ends, be it written in a way that is refused.
pub(super) fn is_to_end(state: &Item<'_>) -> bool {
    let known = actions();
    let may_end = |key: &str| ENDING_KEYS.contains(&key) || !known.contains(&key);
    let doing = state.get("do").filter(Item::is_table).and_then(|doing| doing.section());
    doing.is_some_and(|doing| doing.items().iter().any(|item| may_end(item.key())))
}

impl Reader<'_, '_, '_> {
    /// Says so where `done` is asked for and nothing ends.
    pub(super) fn can_be_done(&self, next: &[TransitionPlan], ends: bool) {
        for next in next.iter().filter(|next| next.when.asks_whether_done() && !ends) {
            let keys = ENDING_KEYS.map(|key| format!("`{key}`")).join(", ");
            self.root.note(next.place.clone(), Severity::Error, NOTHING_ENDS).hint(format!(
                "{keys} end, and so does a sub-machine with a final state; to wait, write \
                 `state_s > 2`"
            ));
        }
    }
}
