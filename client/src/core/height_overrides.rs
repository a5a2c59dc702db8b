//! Height overrides of terrain patches: which have arrived, and which a view needs.

use std::collections::{BTreeMap, VecDeque};

use bytes::Bytes;
use glam::Vec3;
use lodestream_geometry::DecodeError;
use lodestream_scene::blob::{BlobId, TerrainBlob};
use lodestream_scene::terrain::{
    DirectoryError, OverridePatch, PATCHES_PER_PAGE, TerrainEntry, decode_directory,
};
use lodestream_scene::view::View;
use lodestream_select::{Projection, State, Wanted, priority, shape_priority};
use lodestream_terrain::{HeightOverrides, decode_points};

use super::changes::Change;

/// Most memory of height overrides, in bytes: 16 times the bytes of their blobs, the most that a byte decodes to.
/// Beyond it, no more are requested.
const MAX_HELD_BYTES: u64 = 256 << 20;
/// Most patches of a directory: a million of them take 16 MB.
const MAX_PATCHES: u32 = 1 << 20;

/// Why a blob of the terrain cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum HeightOverrideBlobError {
    /// Only a part of it has arrived.
    #[error("only a part of it has arrived")]
    Partial,
    /// An invalid page of the directory.
    #[error(transparent)]
    Directory(#[from] DirectoryError),
    /// Invalid height overrides.
    #[error(transparent)]
    Points(#[from] DecodeError),
    /// A blob that the scene does not have.
    #[error("there is no such {0}")]
    Unknown(&'static str),
    /// A patch outside the terrain: the scene is damaged, and requesting it again does not help.
    #[error(
        "the terrain has height overrides in patch ({x}, {y}), but its patches are {lowest} to {highest} each way: the \
         server's scene is damaged"
    )]
    BeyondWorld {
        /// Column of the patch.
        x: i32,
        /// Row of the patch.
        y: i32,
        /// Lowest column and row.
        lowest: i64,
        /// Highest column and row.
        highest: i64,
    },
}

/// A patch of the directory.
#[derive(Clone, Copy, Debug)]
struct Patch {
    listed: OverridePatch,
    state: State,
}

/// States of the height overrides of all patches.
#[derive(Debug)]
pub(super) struct HeightOverridePatches {
    entry: TerrainEntry,
    pages: Vec<State>,
    /// By position in the directory; empty for pages that have not arrived.
    patches: Vec<Vec<Patch>>,
    held_bytes: u64,
    /// Bytes of the height overrides in use, by patch: a sixteenth of [`MAX_HELD_BYTES`] at most.
    used: BTreeMap<u32, Bytes>,
    /// Changes for a renderer.
    changes: VecDeque<Change>,
}

impl HeightOverridePatches {
    pub(super) fn new(entry: TerrainEntry) -> Self {
        let pages = entry.patches.min(MAX_PATCHES).div_ceil(PATCHES_PER_PAGE) as usize;
        Self {
            entry,
            pages: vec![State::Absent; pages],
            patches: vec![Vec::new(); pages],
            held_bytes: 0,
            used: BTreeMap::new(),
            changes: VecDeque::new(),
        }
    }

    fn patch_mut(&mut self, number: u32) -> Option<&mut Patch> {
        let (page, at) = (number / PATCHES_PER_PAGE, number % PATCHES_PER_PAGE);
        self.patches.get_mut(page as usize)?.get_mut(at as usize)
    }

    pub(super) fn state(&self, blob: TerrainBlob) -> State {
        match blob {
            TerrainBlob::DirectoryPage(page) => {
                self.pages.get(page as usize).copied().unwrap_or(State::Absent)
            }
            TerrainBlob::HeightOverrides(patch) => {
                let (page, at) = (patch / PATCHES_PER_PAGE, patch % PATCHES_PER_PAGE);
                let patch = self.patches.get(page as usize).and_then(|page| page.get(at as usize));
                patch.map_or(State::Absent, |patch| patch.state)
            }
        }
    }

    pub(super) fn set_state(&mut self, blob: TerrainBlob, state: State) {
        match blob {
            TerrainBlob::DirectoryPage(page) => {
                if let Some(held) = self.pages.get_mut(page as usize) {
                    *held = state;
                }
            }
            TerrainBlob::HeightOverrides(patch) => {
                if let Some(patch) = self.patch_mut(patch) {
                    patch.state = state;
                }
            }
        }
    }

    /// Adds the blobs that `view` needs to `wanted`, which is ordered by priority: pages of the directory after the
    /// base meshes, overrides by the screen error that they remove. Adds those that failed to `failed`. Returns whether
    /// none is left to request.
    pub(super) fn want(&self, view: &View, wanted: &mut Vec<Wanted>, failed: &mut Vec<BlobId>) -> bool {
        let before = wanted.len();
        let mut settled = true;
        for (page, &state) in (0..).zip(&self.pages) {
            if matches!(state, State::Absent | State::InFlight) {
                let urgent = priority::DIRECTORY;
                wanted.push(Wanted::whole(BlobId::terrain_page(page), urgent, None, state));
                settled = false;
            } else if state == State::Failed {
                failed.push(BlobId::terrain_page(page));
            }
        }
        let projection = Projection::new(view);
        let frustum = view.frustum();
        let (unit, height_unit) = (f64::from(self.entry.unit), f64::from(self.entry.height_unit));
        let patch = f64::from(1_u32 << self.entry.parameters.finest_level) * unit;
        // With erosion, overrides change the terrain beyond their patch too.
        let erosion = &self.entry.parameters.erosion;
        let reach = erosion.reach(self.entry.parameters.finest_level) as f64 * unit;
        let reach = if erosion.is_on() { reach } else { 0.0 };
        let side = patch + 2.0 * reach;
        let worst = self.entry.parameters.worst_height() as f64 * height_unit;
        let all =
            (0..).zip(&self.patches).flat_map(|(page, patches)| (page * PATCHES_PER_PAGE..).zip(patches));
        for (number, Patch { listed, state }) in all {
            if !matches!(state, State::Absent | State::InFlight | State::Failed) {
                continue;
            }
            let error = f64::from(listed.error) * height_unit;
            let from = [listed.x, listed.y].map(|at| f64::from(at) * patch - reach);
            let center = [from[0] + 0.5 * side, 0.0, from[1] + 0.5 * side];
            let relative = Vec3::from([0, 1, 2].map(|i| (center[i] - view.eye[i]) as f32));
            let radius = (0.5 * side * std::f64::consts::SQRT_2 + worst + error) as f32;
            if !frustum.sees(relative, radius) {
                continue;
            }
            // The nearest point of the patch in the plane; its height does not matter for an estimate.
            let outside = |from: f64, eye: f64| (from - eye).max(eye - from - side).max(0.0);
            let across = outside(from[0], view.eye[0]).hypot(outside(from[1], view.eye[2]));
            let px = projection.error_px(error, across.max(0.02 * patch)) as f32;
            if px <= view.target_px || self.held_bytes + 16 * u64::from(listed.bytes) > MAX_HELD_BYTES {
                continue;
            }
            let radius_px = projection.error_px(0.5 * side, across.max(0.5 * side)) as f32;
            let priority = shape_priority(view, px, radius_px, listed.bytes);
            let id = BlobId::height_overrides(number);
            if *state == State::Failed {
                failed.push(id);
                continue;
            }
            wanted.push(Wanted::whole(id, priority, Some(listed.bytes), *state));
            settled = false;
        }
        if wanted.len() > before {
            // A stable sort keeps the selection's order.
            wanted.sort_by_key(|wanted| std::cmp::Reverse(wanted.priority));
        }
        settled
    }

    /// Decodes a complete blob.
    pub(super) fn take(&mut self, blob: TerrainBlob, bytes: &[u8]) -> Result<(), HeightOverrideBlobError> {
        match blob {
            TerrainBlob::DirectoryPage(page) => {
                let first = page.saturating_mul(PATCHES_PER_PAGE);
                let count = self.entry.patches.min(MAX_PATCHES).saturating_sub(first).min(PATCHES_PER_PAGE);
                let listed = decode_directory(bytes, count)?;
                self.check_patches(&listed)?;
                let held = self.patches.get_mut(page as usize);
                let held = held.ok_or(HeightOverrideBlobError::Unknown("page of the directory"))?;
                *held = listed.into_iter().map(|listed| Patch { listed, state: State::Absent }).collect();
            }
            TerrainBlob::HeightOverrides(number) => {
                let change = self.change(number, bytes)?;
                self.held_bytes += 16 * bytes.len() as u64;
                // A copy: the bytes may be a part of a larger buffer.
                self.used.insert(number, Bytes::copy_from_slice(bytes));
                self.changes.push_back(change);
            }
        }
        self.set_state(blob, State::Applied);
        Ok(())
    }

    /// The change of a patch to the height overrides in these bytes.
    fn change(&self, number: u32, bytes: &[u8]) -> Result<Change, HeightOverrideBlobError> {
        let overrides: HeightOverrides = decode_points(self.entry.parameters.finest_level, bytes)?;
        let (page, at) = (number / PATCHES_PER_PAGE, number % PATCHES_PER_PAGE);
        let patch = self.patches.get(page as usize).and_then(|page| page.get(at as usize));
        let Patch { listed, .. } = patch.ok_or(HeightOverrideBlobError::Unknown("patch"))?;
        Ok(Change::HeightOverrides { x: listed.x.into(), y: listed.y.into(), overrides })
    }

    /// Replaces the queued changes by those of all height overrides in use.
    pub(super) fn restate(&mut self) {
        // They have been decoded before, so none fails.
        let all = self.used.iter().filter_map(|(&number, bytes)| self.change(number, bytes).ok());
        self.changes = all.collect();
    }

    /// Checks that all patches are inside the terrain.
    fn check_patches(&self, listed: &[OverridePatch]) -> Result<(), HeightOverrideBlobError> {
        let edge = 1_i64 << self.entry.parameters.extent_log2;
        let inside = |at: i32| (-edge..edge).contains(&i64::from(at));
        match listed.iter().find(|patch| !inside(patch.x) || !inside(patch.y)) {
            Some(&OverridePatch { x, y, .. }) => {
                Err(HeightOverrideBlobError::BeyondWorld { x, y, lowest: -edge, highest: edge - 1 })
            }
            None => Ok(()),
        }
    }

    pub(super) fn has_changes(&self) -> bool {
        !self.changes.is_empty()
    }

    pub(super) fn take_change(&mut self) -> Option<Change> {
        self.changes.pop_front()
    }

    /// Drops the changes and what they were made from: there is no renderer.
    pub(super) fn drop_changes(&mut self) {
        self.changes.clear();
        self.used.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_scene::terrain::encode_directory;
    use lodestream_terrain::{HeightOverride, Mode, Parameters, encode_points};

    #[test]
    fn height_overrides_in_use_are_stated_again_and_others_are_not() {
        let patch = |x| OverridePatch { x, y: 1, error: 9, bytes: 100 };
        let mut patches = HeightOverridePatches::new(TerrainEntry {
            parameters: Parameters { extent_log2: 3, ..Parameters::default() },
            unit: 1.0,
            height_unit: 0.01,
            zones: [0.0, 120.0, 300.0],
            stamps: Vec::new(),
            patches: 3,
            water: None,
        });
        let listed = [-2, 0, 1].map(patch);
        patches.take(TerrainBlob::DirectoryPage(0), &encode_directory(&listed).unwrap()).unwrap();
        let finest = patches.entry.parameters.finest_level;
        for (number, height) in [(2, 7), (0, -3)] {
            let points = vec![HeightOverride { x: 1, y: 2, mode: Mode::Fixed, height }];
            let points = HeightOverrides::new(finest, points).unwrap();
            let bytes = encode_points(finest, &points).unwrap();
            patches.take(TerrainBlob::HeightOverrides(number), &bytes).unwrap();
        }
        let mut all = || {
            let taken = std::iter::from_fn(|| patches.take_change()).map(|change| format!("{change:?}"));
            let mut taken: Vec<_> = taken.collect();
            taken.sort_unstable();
            patches.restate();
            taken
        };
        let first = all();
        assert_eq!(first.len(), 2);
        assert_eq!(all(), first);
        patches.drop_changes();
        patches.restate();
        assert!(!patches.has_changes(), "without a renderer nothing is kept");
    }
}
