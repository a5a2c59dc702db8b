//! Accounts for the chunk bytes of a run: how many the client's selections needed.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_client::core::{ClientCore, Received};
use lodestream_scene::{BlobId, BlobPart, TerrainBlob};
use lodestream_select::{Selection, State};
use serde::Serialize;

/// Payload bytes by use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Use {
    /// Blobs of all kinds of which at least one byte was received.
    pub blobs: u64,
    /// Chunk bytes received.
    pub chunk_bytes: u64,
    /// Of these, bytes of chunks that no selection of the run requested. A selection also requests the ancestors of its
    /// chunks.
    pub wasted_bytes: u64,
    /// Of these, bytes beyond the last truncation point up to which any selection requested a chunk: vertex splits that
    /// are finer than needed.
    pub finer_bytes: u64,
    /// Of these, bytes that were never drawn: of chunks, or ends of chunks, that were never applied.
    pub undrawn_bytes: u64,
    /// Of these, bytes received before.
    pub repeated_bytes: u64,
    /// Bytes of blobs of any kind that stayed incomplete: cancelled, or cut off by the end of the run.
    pub unfinished_bytes: u64,
    /// Chunks that were undone, requested again, and still in the cache.
    pub cache_hits: u64,
    /// Chunks that were undone, requested again, and downloaded again.
    pub cache_misses: u64,
}

/// Demand of all selections for one chunk.
#[derive(Clone, Copy, Debug)]
struct ChunkDemand {
    /// Most bytes requested.
    end: u32,
    /// Length of the chunk.
    length: u32,
}

/// Records the demand of selections, and chunks that were undone.
#[derive(Debug, Default)]
pub(super) struct Ledger {
    selections: u64,
    wishes: BTreeMap<BlobId, ChunkDemand>,
    undone: BTreeSet<BlobId>,
    hits: u64,
    misses: u64,
}

impl Ledger {
    /// Records the client's last selection, unless it is recorded already. To be called after every update.
    pub(super) fn observe(&mut self, core: &ClientCore) {
        let (number, selection) = core.last_selection();
        if number > self.selections {
            self.selections = number;
            self.note(selection);
        }
    }

    fn note(&mut self, selection: &Selection) {
        for wanted in &selection.wanted {
            if !matches!(wanted.id.part(), Some(BlobPart::Chunk(_))) {
                continue;
            }
            let length = wanted.bytes.unwrap_or(u32::MAX);
            let end = wanted.end.unwrap_or(length);
            let wish = self.wishes.entry(wanted.id).or_insert(ChunkDemand { end, length });
            wish.end = wish.end.max(end);
            if self.undone.remove(&wanted.id) {
                let here = wanted.state == State::Cached;
                *(if here { &mut self.hits } else { &mut self.misses }) += 1;
            }
        }
        self.undone.extend(&selection.undo);
    }

    /// The totals, at the end of the run.
    pub(super) fn close(&self, core: &ClientCore) -> Use {
        self.reckon(core.received(), core.stats().session.blob_bytes)
    }

    fn reckon(&self, received: &BTreeMap<BlobId, Received>, blob_bytes: u64) -> Use {
        let mut found = Use { cache_hits: self.hits, cache_misses: self.misses, ..Use::default() };
        found.blobs = received.len() as u64;
        found.unfinished_bytes = blob_bytes.saturating_sub(received.values().map(|came| came.bytes).sum());
        for (id, came) in received.iter().filter(|(id, _)| is_refinement(id)) {
            let Received { bytes, used_bytes } = *came;
            found.chunk_bytes += bytes;
            match self.wishes.get(id) {
                None => {
                    found.wasted_bytes += bytes;
                    found.undrawn_bytes += bytes;
                }
                Some(wish) => {
                    let once = bytes.min(u64::from(wish.length));
                    found.repeated_bytes += bytes - once;
                    found.finer_bytes += once.saturating_sub(u64::from(wish.end));
                    found.undrawn_bytes += once.saturating_sub(used_bytes);
                }
            }
        }
        found
    }
}

/// Whether a blob is not part of selections' demand: everything but chunks and height overrides of a terrain.
const fn is_refinement(id: &BlobId) -> bool {
    matches!(
        id,
        BlobId::Asset { part: BlobPart::Chunk(_), .. } | BlobId::Terrain(TerrainBlob::HeightOverrides(_))
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_select::Wanted;

    fn wanted(chunk: u32, end: Option<u32>, state: State) -> Wanted {
        Wanted { end, ..Wanted::whole(BlobId::chunk(0, chunk), 1, Some(100), state) }
    }

    #[test]
    fn bytes_are_compared_with_the_furthest_request() {
        let mut ledger = Ledger::default();
        let first = vec![wanted(1, Some(40), State::Absent), wanted(2, Some(40), State::Absent)];
        ledger.note(&Selection { wanted: first, ..Selection::default() });
        let second = vec![wanted(1, Some(30), State::Absent), wanted(2, None, State::Absent)];
        ledger.note(&Selection { wanted: second, ..Selection::default() });
        let came = |bytes, used_bytes| Received { bytes, used_bytes };
        let received: BTreeMap<BlobId, Received> = [
            // 20 bytes beyond the last truncation point requested; drawn up to an earlier one.
            (BlobId::chunk(0, 1), came(60, 30)),
            // All of it requested and drawn, and 30 bytes received twice.
            (BlobId::chunk(0, 2), came(130, 100)),
            // Never requested.
            (BlobId::chunk(0, 3), came(70, 0)),
            // Not a chunk.
            (BlobId::base(0), came(500, 0)),
        ]
        .into();
        let expected = Use {
            blobs: 4,
            chunk_bytes: 260,
            wasted_bytes: 70,
            finer_bytes: 20,
            undrawn_bytes: 30 + 70,
            repeated_bytes: 30,
            unfinished_bytes: 40,
            ..Use::default()
        };
        assert_eq!(ledger.reckon(&received, 800), expected);
    }

    #[test]
    fn an_undone_chunk_requested_again_is_one_hit_or_miss() {
        let mut ledger = Ledger::default();
        let undo = vec![BlobId::chunk(0, 1), BlobId::chunk(0, 2), BlobId::chunk(0, 3)];
        ledger.note(&Selection { undo, ..Selection::default() });
        let again = vec![wanted(1, None, State::Cached), wanted(2, None, State::Absent)];
        for _ in 0..2 {
            ledger.note(&Selection { wanted: again.clone(), ..Selection::default() });
        }
        let found = ledger.reckon(&BTreeMap::new(), 0);
        assert_eq!((found.cache_hits, found.cache_misses), (1, 1));
    }
}
