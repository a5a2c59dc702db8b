//! Priorities of blobs, on one scale for all kinds.
//!
//! A priority is the bit pattern of a positive `f32`, whose order is that of the float. For refinement it is the
//! visible difference per byte, in square pixels ([`crate::difference`]): a greedy order by benefit per cost,
//! weighted by foveation.
//!
//! Base meshes of visible instances come before all refinement, those out of view after it, and occluded parts last.

use std::ops::RangeInclusive;

/// Priority of a blob; higher is first. Priorities of all kinds of blobs are comparable.
pub type Priority = u32;

/// Scale of base meshes in view: above all refinement.
const BASE: f32 = 1e20;
/// Scale of prefetched base meshes: below all refinement.
const PREFETCH: f32 = 1e-17;
/// Range of the benefit of refinement, in square pixels per byte.
const BENEFIT: RangeInclusive<f32> = 1e-6..=1e9;
/// Factor on differences that are occluded.
const HIDDEN: f32 = 1e-31;
/// Differences below this count as occluded, in square pixels.
const MIN_VISIBLE_PX2: f32 = 1e-20;
/// Range of the benefit of occluded refinement: below prefetching.
const HIDDEN_BENEFIT: RangeInclusive<f32> = 1e-37..=1e-21;

/// Priority of what requests depend on, such as directories: before all refinement, after base meshes.
pub const DIRECTORY: Priority = BENEFIT.end().to_bits();

/// Priority of a visible instance's base mesh and of its scene page, by size on the screen and foveation.
#[must_use]
pub fn base_priority(coverage_px: f32, foveation: f32) -> Priority {
    (BASE * (coverage_px.clamp(0.0, 1e9) + 1e-3) * foveation.clamp(0.1, 1.0)).to_bits()
}

/// Priority of a base mesh out of view, by size on the screen.
#[must_use]
pub fn prefetch_priority(coverage_px: f32) -> Priority {
    (PREFETCH * (coverage_px.clamp(0.0, 1e9) + 1e-3)).to_bits()
}

/// Whether a priority is that of a base mesh in view.
#[must_use]
pub const fn is_base(priority: Priority) -> bool {
    priority >= 0x5000_0000 // 8.6e9, between all refinement and all base meshes
}

/// Whether a priority is that of an occluded part.
#[must_use]
pub fn is_hidden(priority: Priority) -> bool {
    (1..=HIDDEN_BENEFIT.end().to_bits()).contains(&priority)
}

/// Priority of a blob of `bytes` that makes a visible difference of `difference_px2` square pixels; `foveation` is 1
/// in the middle of the picture and falls towards 0 outwards.
#[must_use]
pub fn refine_priority(difference_px2: f32, bytes: f32, foveation: f32) -> Priority {
    let benefit = difference_px2 / bytes.max(1.0) * foveation.clamp(0.01, 1.0).sqrt();
    let range = if difference_px2 >= MIN_VISIBLE_PX2 { BENEFIT } else { HIDDEN_BENEFIT };
    benefit.clamp(*range.start(), *range.end()).to_bits()
}

/// Scales an occluded difference for [`refine_priority`]: below all visible ones, in the same order among themselves,
/// and negligible in a sum with a visible one.
pub(crate) fn hidden(difference_px2: f32) -> f32 {
    (difference_px2 * HIDDEN).min(0.1 * MIN_VISIBLE_PX2)
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
