//! Using what is wanted and here, in the order in which it is wanted. Chunks that wait for nothing are decoded some at
//! a time, on whatever threads there are, and applied one after the other: the order, and what a budget is enough for,
//! do not depend on the threads.

use bytes::Bytes;
use lodestream_geometry::refine::ChunkDelta;
use lodestream_protocol::time::Time;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_select::{State, Wanted};

use super::ClientCore;

/// Cost of handling a blob, beside its bytes, in units of [`ClientCore::update`]'s budget.
pub(super) const BLOB_COST: u64 = 256;

/// A chunk that can be decoded now.
struct Ready {
    wanted: Wanted,
    asset: u32,
    chunk: u32,
    bytes: Bytes,
}

impl ClientCore {
    /// Uses what is wanted and here, as far as the budget goes; answers what is left of it.
    pub(super) fn use_cached(&mut self, now: Time, mut budget: u64) -> u64 {
        let mut index = 0;
        while index < self.wanted.len() && budget > 0 {
            let batch = self.next_batch(&mut index, &mut budget);
            let deltas = self.config.decoders.map(batch.len(), &|i| self.decode(&batch[i]));
            for (ready, delta) in batch.iter().zip(deltas) {
                let applied = delta.and_then(|delta| self.apply_decoded(ready, &delta));
                self.note_applied(now, &ready.wanted, applied);
                self.stale = true;
            }
            if !batch.is_empty() || index >= self.wanted.len() || budget == 0 {
                continue;
            }
            let wanted = self.wanted[index];
            index += 1;
            if let Some(bytes) = self.apply_cached(now, &wanted) {
                budget = budget.saturating_sub(BLOB_COST + bytes);
                self.stale = true;
            }
        }
        budget
    }

    /// The next chunks that can be decoded whatever becomes of one another. Stops, with `index` there, where something
    /// else is to be done first; if the batch is empty, it is what stands there.
    fn next_batch(&mut self, index: &mut usize, budget: &mut u64) -> Vec<Ready> {
        let mut batch: Vec<Ready> = Vec::new();
        while *index < self.wanted.len() && *budget > 0 && batch.len() < self.config.decoders.batch() {
            self.refresh(*index);
            let wanted = self.wanted[*index];
            if wanted.state == State::Cached {
                let BlobId::Asset { asset, part: BlobPart::Chunk(chunk) } = wanted.id else { break };
                let parents = self.scene.states.get(asset as usize).and_then(|state| state.chunk(chunk));
                let parents = parents.map_or(&[][..], |info| &info.parents);
                let waits = |ready: &Ready| {
                    ready.asset == asset && (ready.chunk == chunk || parents.contains(&ready.chunk))
                };
                // What is there up to a truncation is undone first: that is done by itself.
                let raised = self.mesh(asset).is_some_and(|mesh| mesh.is_applied(chunk));
                if raised || batch.iter().any(waits) {
                    break;
                }
                if self.is_ready(wanted.id) {
                    let Some(bytes) = self.cache.get(wanted.id) else { break };
                    *budget = budget.saturating_sub(BLOB_COST + bytes.len() as u64);
                    batch.push(Ready { wanted, asset, chunk, bytes });
                }
            }
            *index += 1;
        }
        batch
    }

    fn decode(&self, ready: &Ready) -> Result<ChunkDelta, String> {
        let &Ready { wanted: Wanted { truncation, .. }, asset, chunk, ref bytes } = ready;
        let info = self.scene.states.get(asset as usize).and_then(|state| state.chunk(chunk));
        let refined = self.scene.refined.get(asset as usize).and_then(Option::as_ref);
        let (Some(info), Some(refined)) = (info, refined) else { return Err("no such chunk".into()) };
        Self::check_length(info, truncation, bytes)?;
        refined.decode_chunk(chunk, info, truncation, bytes).map_err(|why| why.to_string())
    }

    fn apply_decoded(&mut self, ready: &Ready, delta: &ChunkDelta) -> Result<(), String> {
        let level = self.scene.states.get(ready.asset as usize).and_then(|state| state.chunk(ready.chunk));
        let level = level.map_or(0, |info| info.level);
        self.scene.note_changed(ready.asset);
        let refined = self.scene.refined.get_mut(ready.asset as usize).and_then(Option::as_mut);
        let refined = refined.ok_or("no such asset")?;
        refined.apply_decoded(level, delta).map_err(|why| why.to_string())?;
        Self::appear(refined, ready.chunk, ready.wanted.error_px);
        Ok(())
    }
}
