//! The lists of chunks: wanted, failed, to cancel and to undo, with truncation points and priorities.

use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::screen::{visible_error, visible_error_at};

use super::{ChunkEvaluation, Selector};
use crate::difference::SubtreeBenefit;
use crate::priority::Priority;
use crate::selection::{State, Wanted};
use crate::state::AssetState;
use lodestream_scene::blob::{BlobId, BlobPart};

impl Selector {
    /// Lists the chunks of one asset that are wanted, failed, to cancel or to undo.
    pub(super) fn list_chunks(
        &mut self,
        number: u32,
        asset: &AssetState,
        threshold: f32,
        keep_out_of_view: bool,
    ) {
        let share = self.settings.attribute_share.get();
        let truncation_points = self.settings.truncation_points;
        let chunks = asset.chunks();
        let evaluations = &mut self.chunks[self.on_screen[number as usize].first_chunk..][..chunks.len()];
        let far = self.on_screen[number as usize].far;
        let counters = &mut self.selection.counters;
        // No hysteresis over budget.
        let over = counters.applied_faces > self.settings.max_faces
            || counters.applied_bytes > self.settings.max_bytes;
        let undo_below = if over { threshold } else { threshold * self.settings.undo_below.get() };
        // Children before parents: propagates benefits and `kept` upwards.
        for (index, chunk) in chunks.iter().enumerate().rev() {
            let Some(chunk) = chunk else { continue };
            let info = chunk.info();
            let evaluation = &mut evaluations[index];
            let applied = chunk.extent_in_use().is_some();
            if evaluation.error_px > threshold {
                evaluation.truncation = if truncation_points {
                    sufficient_truncation(info, evaluation, threshold, share)
                } else {
                    None
                };
                if chunk.state_up_to(evaluation.truncation) != State::Applied {
                    let left = match chunk.truncation() {
                        Some(truncation) if evaluation.own_px > 0.0 => {
                            px_at(info, evaluation, truncation, share) / evaluation.own_px
                        }
                        _ => 1.0,
                    };
                    let need = info.extent(evaluation.truncation).payload_bytes;
                    #[expect(
                        clippy::cast_precision_loss,
                        reason = "a priority needs no more of a length than 24 bits"
                    )]
                    let bytes = need.saturating_sub(chunk.held_bytes()).max(1) as f32;
                    let own = SubtreeBenefit { difference_px2: left * evaluation.difference_px2, bytes };
                    evaluation.subtree = own.with(evaluation.subtree);
                    evaluation.priority = evaluation.subtree.priority(evaluation.foveation);
                }
            }
            let out_of_view = evaluation.error_px <= 0.0 && !far;
            evaluation.kept |=
                applied && (evaluation.error_px >= undo_below || (out_of_view && keep_out_of_view));
            let ChunkEvaluation { subtree, kept, error_px, .. } = *evaluation;
            for &parent in &info.parents {
                let parent = &mut evaluations[parent as usize];
                parent.subtree.add(subtree, info.parents.len());
                parent.kept |= kept;
                parent.has_wanted_child |= error_px > threshold;
            }
            let id = BlobId::chunk(number, u32::try_from(index).unwrap_or(u32::MAX));
            if applied && !kept {
                self.selection.undo.push(id);
            } else if chunk.state() == State::InFlight && evaluations[index].error_px < undo_below {
                self.selection.cancel.push(id);
            }
        }
        // Without its base mesh an asset cannot be used.
        let baseless = asset.state(BlobPart::Base) == State::Failed;
        // Parents before children: a failed chunk blocks its descendants, and no chunk has a higher priority than a
        // parent.
        for (index, chunk) in chunks.iter().enumerate() {
            let Some(chunk) = chunk else {
                evaluations[index].blocked = true;
                continue;
            };
            let info = chunk.info();
            let blocked = baseless
                || chunk.state() == State::Failed
                || info.parents.iter().any(|&parent| evaluations[parent as usize].blocked);
            let parents = info.parents.iter().map(|&parent| evaluations[parent as usize].priority);
            let first = parents.filter(|&priority| priority > 0).min().unwrap_or(Priority::MAX);
            let evaluation = &mut evaluations[index];
            evaluation.priority = evaluation.priority.min(first);
            evaluation.blocked = blocked;
            if chunk.state() == State::Failed
                && (evaluation.error_px > threshold || evaluation.has_wanted_child)
            {
                let id = BlobId::chunk(number, u32::try_from(index).unwrap_or(u32::MAX));
                self.selection.failed.push(id);
            }
            if evaluation.error_px <= threshold {
                continue;
            }
            counters.needed_chunks += 1;
            let (truncation, held) = (evaluation.truncation, chunk.held_bytes());
            let need = info.extent(truncation).payload_bytes;
            counters.needed_bytes += u64::from(need);
            counters.shadow_bytes += if evaluation.shadow_only { u64::from(need) } else { 0 };
            let state = chunk.state_up_to(truncation);
            if state == State::Applied {
                continue;
            }
            counters.missing_chunks += 1;
            if matches!(state, State::Absent | State::InFlight) {
                counters.missing_bytes += u64::from(need.saturating_sub(held));
            }
            if !blocked {
                let id = BlobId::chunk(number, u32::try_from(index).unwrap_or(u32::MAX));
                let (bytes, end) = (Some(info.payload_bytes), truncation.map(|_| need));
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
                let error_px = evaluation.own_px as u16;
                self.selection.wanted.push(Wanted {
                    id,
                    priority: evaluation.priority,
                    bytes,
                    state,
                    held,
                    end,
                    truncation,
                    error_px,
                });
            }
        }
    }
}

/// A chunk's own screen error that remains at a truncation point.
fn px_at(info: &ChunkInfo, evaluation: &ChunkEvaluation, truncation: u8, share: f32) -> f32 {
    let whole = visible_error(info, share);
    let left = visible_error_at(info, &info.extent(Some(truncation)), share);
    if left < whole { evaluation.own_px * (left / whole) } else { evaluation.own_px }
}

/// The first truncation point of a chunk whose remaining error is not above the threshold; `None` if there is none or
/// a child is wanted.
pub(super) fn sufficient_truncation(
    info: &ChunkInfo,
    evaluation: &ChunkEvaluation,
    threshold: f32,
    share: f32,
) -> Option<u8> {
    if evaluation.has_wanted_child {
        return None;
    }
    (0_u8..)
        .take(info.truncation_points.len())
        .find(|&truncation| px_at(info, evaluation, truncation, share) <= threshold)
}
