//! How urgent a blob is: numbers that all kinds of blobs share.
//!
//! A priority is the bit pattern of a positive `f32`, which orders as the float does. Of what refines the picture it is
//! the visible difference that a blob makes per byte, in square pixels a byte (`difference` beside this), so the order is
//! the greedy one by worth; what is near the centre of the picture comes somewhat sooner.
//!
//! Base meshes of visible instances come before all refinement, those out of view after it; what is in view but hidden
//! comes last.

use std::ops::RangeInclusive;

/// How urgent a blob is; higher is first. The numbers of all kinds of blobs compare with each other.
pub type Priority = u32;

/// Above what any refinement is worth.
const BASE: f32 = 1e20;
/// Below what any refinement is worth.
const PREFETCH: f32 = 1e-17;
/// What refinement may be worth, in square pixels a byte.
const WORTH: RangeInclusive<f32> = 1e-6..=1e9;
/// What a difference counts that is hidden.
const HIDDEN: f32 = 1e-31;
/// Differences are hidden below this, in square pixels.
const LEAST_SEEN_PX2: f32 = 1e-20;
/// What refinement of what is hidden may be worth: below what prefetching is.
const HIDDEN_WORTH: RangeInclusive<f32> = 1e-37..=1e-21;

/// Before all refinement, but after base meshes: what the client cannot know its wishes without.
pub const DIRECTORY: Priority = WORTH.end().to_bits();

/// Priority of a visible instance's base mesh (and of the scene page that places it): the larger on the
/// screen and the nearer to its centre, the sooner.
#[must_use]
pub fn base_priority(coverage_px: f32, foveation: f32) -> Priority {
    (BASE * (coverage_px.clamp(0.0, 1e9) + 1e-3) * foveation.clamp(0.1, 1.0)).to_bits()
}

/// Priority of a base mesh that is out of view: near and large first.
#[must_use]
pub fn prefetch_priority(coverage_px: f32) -> Priority {
    (PREFETCH * (coverage_px.clamp(0.0, 1e9) + 1e-3)).to_bits()
}

/// Whether the priority is that of something without which a visible instance cannot be drawn.
#[must_use]
pub const fn is_base(priority: Priority) -> bool {
    priority >= 0x5000_0000 // 8.6e9, between what refinement is worth at most and every base priority
}

/// Whether the priority is that of something which the scene's own surfaces hide.
#[must_use]
pub fn is_hidden(priority: Priority) -> bool {
    (1..=HIDDEN_WORTH.end().to_bits()).contains(&priority)
}

/// Priority of something that makes a visible difference of `difference_px2` square pixels for `bytes`; `foveation` is 1
/// in the middle of the picture and falls towards 0 outwards.
#[must_use]
pub fn refine_priority(difference_px2: f32, bytes: f32, foveation: f32) -> Priority {
    let worth = difference_px2 / bytes.max(1.0) * foveation.clamp(0.01, 1.0).sqrt();
    let range = if difference_px2 >= LEAST_SEEN_PX2 { WORTH } else { HIDDEN_WORTH };
    worth.clamp(*range.start(), *range.end()).to_bits()
}

/// A visible difference as it counts for [`refine_priority`] where something hides it: less than anything that is seen,
/// and still the more the larger. Sums with differences that are seen count as these alone.
pub(crate) fn hidden(difference_px2: f32) -> f32 {
    (difference_px2 * HIDDEN).min(0.1 * LEAST_SEEN_PX2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn difference_per_byte_decides_then_foveation() {
        assert!(refine_priority(4.0, 10.0, 1.0) > refine_priority(3.9, 10.0, 1.0));
        assert!(refine_priority(500.0, 500.0, 1.0) > refine_priority(700.0, 5000.0, 1.0));
        assert!(refine_priority(500.0, 500.0, 1.0) > refine_priority(500.0, 500.0, 0.5));
    }

    #[test]
    fn classes_do_not_mix() {
        for difference in [1e-19, 1.0, 1e6, f32::MAX] {
            let refine = refine_priority(difference, 1.0, 1.0);
            assert!(base_priority(0.0, 0.0) > refine && !is_base(refine) && refine <= DIRECTORY);
            assert!(prefetch_priority(f32::MAX) < refine_priority(difference, 1e9, 0.0));
            assert!(prefetch_priority(0.0) > refine_priority(hidden(difference), 1.0, 1.0));
        }
        let order = [0.0, 1.0, 5.0, 1e5].map(|difference| refine_priority(hidden(difference), 1e3, 1.0));
        assert!(order.iter().all(|&priority| is_hidden(priority)) && !is_hidden(prefetch_priority(0.0)));
        assert!(order.is_sorted_by(|a, b| a < b), "{order:?}");
        assert!(is_base(base_priority(0.0, 0.0)) && !is_base(DIRECTORY));
    }
}
