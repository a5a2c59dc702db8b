//! The screen error above which chunks are wanted: the view's target, or more if the budgets would be exceeded.

use super::{ChunkEvaluation, Selector};
use crate::settings::SelectSettings;
use crate::state::{AssetState, Chunk};

/// The threshold returns to the target at once below 9/10 of the budgets.
const RELAXED_SHARE: u64 = 10;
/// The threshold falls only by at least this factor.
const THRESHOLD_FALL: f32 = 0.8;
/// Bins per octave of the histogram of errors: a resolution of 1/8 octave, 9 %.
pub(super) const BIN_SHIFT: u32 = 20;
pub(super) const BINS: usize = 1 << (31 - BIN_SHIFT);

impl Selector {
    /// Propagates errors to parents and chooses the least threshold within the budgets.
    pub(super) fn choose_threshold(&mut self, target_px: f32, assets: &[AssetState]) -> f32 {
        self.histogram.clear();
        self.histogram.resize(BINS, (0, 0));
        let (mut faces, mut bytes) = (0_u64, 0_u64);
        for (on_screen, asset) in self.on_screen.iter().zip(assets) {
            if !on_screen.visible {
                continue;
            }
            let evaluations = &mut self.chunks[on_screen.first_chunk..];
            for (index, chunk) in asset.chunks().iter().enumerate().rev() {
                let Some(info) = chunk.as_ref().map(Chunk::info) else { continue };
                let ChunkEvaluation { error_px, foveation, .. } = evaluations[index];
                if error_px <= 0.0 {
                    continue;
                }
                for &parent in &info.parents {
                    let parent = &mut evaluations[parent as usize];
                    parent.error_px = parent.error_px.max(error_px);
                    parent.foveation = parent.foveation.max(foveation);
                }
                if error_px > target_px {
                    let bin = &mut self.histogram[(error_px.to_bits() >> BIN_SHIFT) as usize % BINS];
                    bin.0 += u64::from(info.faces);
                    bin.1 += u64::from(info.payload_bytes);
                    faces += u64::from(info.faces);
                    bytes += u64::from(info.payload_bytes);
                }
            }
        }
        let SelectSettings { max_faces, max_bytes, .. } = self.settings;
        let relaxed = |budget: u64| budget - budget / RELAXED_SHARE;
        if faces <= relaxed(max_faces) && bytes <= relaxed(max_bytes) {
            self.threshold_px = target_px;
            return target_px;
        }
        let needed = threshold_within(&self.histogram, max_faces, max_bytes, target_px);
        if needed > self.threshold_px || needed < self.threshold_px * THRESHOLD_FALL {
            self.threshold_px = needed;
        }
        self.threshold_px = self.threshold_px.max(target_px);
        self.threshold_px
    }
}

/// The least threshold, at least `least_px`, above which a histogram of errors has at most `max_faces` and `max_bytes`.
pub(super) fn threshold_within(
    histogram: &[(u64, u64)],
    max_faces: u64,
    max_bytes: u64,
    least_px: f32,
) -> f32 {
    let (mut faces, mut bytes) = (0_u64, 0_u64);
    for (bin, (more_faces, more_bytes)) in histogram.iter().enumerate().rev() {
        faces += more_faces;
        bytes += more_bytes;
        if faces > max_faces || bytes > max_bytes {
            #[expect(clippy::cast_possible_truncation, reason = "bins fit into 11 bits")]
            let above = f32::from_bits((bin as u32 + 1) << BIN_SHIFT);
            return if above.is_finite() { above.max(least_px) } else { f32::MAX };
        }
    }
    least_px
}
