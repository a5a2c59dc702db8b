//! Levels of textures that a view seeks, each listed once however many assets seek it.

use super::priority::refine_priority;
use super::selection::{Selection, State, Wanted};
use crate::blob::BlobId;

/// A level of a texture that one asset seeks.
#[derive(Clone, Copy, Debug)]
pub(super) struct SoughtLevel {
    /// What is asked for: of a shared texture the same for all assets.
    pub(super) id: BlobId,
    pub(super) bytes: u32,
    pub(super) state: State,
    /// Visible difference that it makes to this asset.
    pub(super) difference_px2: f32,
    pub(super) centrality: f32,
}

/// Adds to a selection what was sought, and empties the list. What several assets seek makes the sum of the differences
/// that it makes to each.
pub(super) fn list(sought: &mut Vec<SoughtLevel>, selection: &mut Selection) {
    sought.sort_by_key(|level| level.id);
    for same in sought.chunk_by(|a, b| a.id == b.id) {
        let SoughtLevel { id, bytes, .. } = same[0];
        if same.iter().any(|level| level.state == State::Failed) {
            selection.failed.push(id);
            continue;
        }
        let difference_px2 = same.iter().map(|level| level.difference_px2).sum();
        let centrality = same.iter().map(|level| level.centrality).fold(0.0, f32::max);
        // On its way for one, it is for all.
        let state = same.iter().map(|level| level.state).max().unwrap_or_default();
        #[expect(clippy::cast_precision_loss)]
        let priority = refine_priority(difference_px2, bytes as f32, centrality);
        selection.wanted.push(Wanted::whole(id, priority, Some(bytes), state));
    }
    sought.clear();
}
