//! The nodes that a file's animations move.

use std::collections::BTreeSet;

use super::animation_json::{Animation, Target};
use super::animation_left_out::LeftOut;

/// The nodes that any channel moves.
pub(super) fn targets(animations: &[Animation], left_out: &mut LeftOut) -> BTreeSet<usize> {
    let mut targets = BTreeSet::new();
    for channel in animations.iter().flat_map(|animation| &animation.channels) {
        match (channel.target, channel.node) {
            (Target::Node(_), Some(node)) => {
                targets.insert(node);
            }
            (Target::Weights, _) => left_out.weights += 1,
            _ => left_out.others += 1,
        }
    }
    targets
}
