//! Slots of tiles in GPU memory, and least-recently-used eviction. Holds no GPU object itself.

use std::collections::BTreeMap;

use super::select::SelectedTile;
use super::tile::{TILE_MARGIN, TileId};

/// Maps tiles to slots; evicts the tiles that were not needed for the longest time.
#[derive(Clone, Debug)]
pub struct TileStore {
    /// Tile to (slot, frame in which it was last needed).
    held: BTreeMap<TileId, (u32, u64)>,
    free: Vec<u32>,
    frame: u64,
}

impl TileStore {
    /// A store of `slots` slots, all free.
    #[must_use]
    pub fn new(slots: u32) -> Self {
        Self { held: BTreeMap::new(), free: (0..slots).rev().collect(), frame: 0 }
    }

    /// Number of tiles held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.held.len()
    }

    /// Whether none is held.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// Begins a frame: what is touched from here on counts as needed in it.
    pub fn begin(&mut self) {
        self.frame += 1;
    }

    /// The slot of a tile, if it has one.
    #[must_use]
    pub fn slot(&self, tile: TileId) -> Option<u32> {
        self.held.get(&tile).map(|(slot, _)| *slot)
    }

    /// The tiles of a selection that have no slot.
    #[must_use]
    pub fn absent(&self, selected: &[SelectedTile]) -> Vec<TileId> {
        selected.iter().map(|part| part.tile).filter(|tile| !self.held.contains_key(tile)).collect()
    }

    /// Marks a tile as needed in this frame. Returns whether it has a slot.
    pub fn touch(&mut self, tile: TileId) -> bool {
        let held = self.held.get_mut(&tile);
        held.map(|entry| entry.1 = self.frame).is_some()
    }

    /// Gives a tile a slot, evicting old tiles if none is free. Returns `None` if all tiles are needed in this frame.
    pub fn insert(&mut self, tile: TileId) -> Option<u32> {
        if let Some(entry) = self.held.get_mut(&tile) {
            entry.1 = self.frame;
            return Some(entry.0);
        }
        if self.free.is_empty() {
            self.evict();
        }
        let slot = self.free.pop()?;
        self.held.insert(tile, (slot, self.frame));
        Some(slot)
    }

    /// Frees up to an eighth of the slots, least recently needed first; keeps tiles that are needed in this frame.
    fn evict(&mut self) {
        let mut ages: Vec<(u64, TileId)> = self
            .held
            .iter()
            .map(|(tile, (_, used))| (*used, *tile))
            .filter(|(used, _)| *used < self.frame)
            .collect();
        ages.sort_unstable();
        ages.truncate((self.held.len() / 8).max(1));
        for (_, tile) in ages {
            if let Some((slot, _)) = self.held.remove(&tile) {
                self.free.push(slot);
            }
        }
    }

    /// Frees the slots of all tiles that overlap a square of grid units, margins included.
    pub fn invalidate(&mut self, origin: [i64; 2], side: i64) {
        let free = &mut self.free;
        self.held.retain(|tile, (slot, _)| {
            let margin = i64::from(TILE_MARGIN) << tile.spacing;
            let overlaps = [0, 1].iter().all(|&i| {
                let from = tile.origin()[i];
                from - margin <= origin[i] + side && origin[i] <= from + tile.side() + margin
            });
            if overlaps {
                free.push(*slot);
            }
            !overlaps
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(x: i32) -> TileId {
        TileId { spacing: 0, x, y: 0 }
    }

    #[test]
    fn tiles_needed_in_this_frame_are_never_evicted() {
        let mut store = TileStore::new(4);
        store.begin();
        for x in 0..4 {
            assert_eq!(store.insert(tile(x)), Some(x as u32));
        }
        assert_eq!(store.insert(tile(9)), None);
        store.begin();
        assert!(store.touch(tile(1)) && store.touch(tile(2)) && !store.touch(tile(7)));
        assert_eq!(store.insert(tile(4)), Some(0));
        assert_eq!(store.insert(tile(5)), Some(3));
        assert_eq!(store.insert(tile(6)), None);
        assert_eq!((store.len(), store.slot(tile(1)), store.slot(tile(0))), (4, Some(1), None));
    }

    #[test]
    fn tiles_that_touch_a_changed_square_are_invalidated() {
        let mut store = TileStore::new(8);
        for x in 0..8 {
            store.insert(tile(x));
        }
        // Points 16 to 32, borders included: tiles 1 (8 to 16), 2, 3 and 4 (32 to 40).
        store.invalidate([16, 0], 16);
        assert_eq!(store.len(), 4);
        assert!([1, 2, 3, 4].iter().all(|&x| store.slot(tile(x)).is_none()));
    }
}
