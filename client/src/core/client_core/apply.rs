//! Applies cached chunks and texture levels in the order in which they are wanted. Chunks that do not depend on each
//! other are decoded in batches on the lent threads and applied one after the other: neither the order nor what fits
//! into a budget depends on the threads.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_geometry::index::ChunkInfo;
use lodestream_geometry::refine::ChunkDelta;
use lodestream_protocol::time::Time;
use lodestream_scene::asset::TextureInfo;
use lodestream_scene::blob::{BlobId, BlobPart, Tile};
use lodestream_select::{State, Wanted};

use super::ClientCore;
use super::blob_error::BlobError;
use super::state::BLOB_COST;
use crate::core::asset::{AssetError, RefinedAsset};
use crate::core::changes::{Change, TextureChange};
use crate::core::texture_file::{TextureFileError, TexturePixels};

/// Screen error above which a chunk appears at once instead of morphing, in pixels: it shows what was missing.
const MAX_MORPH_PX: u16 = 8;

/// A chunk that can be decoded now.
struct DecodeTask {
    wanted: Wanted,
    asset: u32,
    chunk: u32,
    bytes: Bytes,
}

impl ClientCore {
    /// Decodes and applies wanted blobs that are cached, within a budget; returns the rest of the budget.
    pub(super) fn apply_wanted(&mut self, now: Time, mut budget: u64) -> u64 {
        let mut index = 0;
        while index < self.selection.wanted.len() && budget > 0 {
            let batch = self.next_batch(&mut index, &mut budget);
            let deltas = self.config.decoders.map(batch.len(), &|i| self.decode(&batch[i]));
            for (ready, delta) in batch.iter().zip(deltas) {
                let applied = delta.and_then(|delta| self.apply_decoded(ready, &delta));
                self.note_applied(now, &ready.wanted, applied);
                self.selection.stale = true;
            }
            if !batch.is_empty() || index >= self.selection.wanted.len() || budget == 0 {
                continue;
            }
            let wanted = self.selection.wanted[index];
            index += 1;
            if let Some(bytes) = self.apply_cached(now, &wanted) {
                budget = budget.saturating_sub(BLOB_COST + bytes);
                self.selection.stale = true;
            }
        }
        budget
    }

    /// The next chunks that can be decoded independently of each other. Stops, with `index` at it, before a blob that
    /// must be handled by itself or after this batch.
    fn next_batch(&mut self, index: &mut usize, budget: &mut u64) -> Vec<DecodeTask> {
        let mut batch: Vec<DecodeTask> = Vec::new();
        while *index < self.selection.wanted.len()
            && *budget > 0
            && batch.len() < self.config.decoders.batch()
        {
            self.refresh(*index);
            let wanted = self.selection.wanted[*index];
            if wanted.state == State::Cached {
                let BlobId::Asset { asset, part: BlobPart::Chunk(chunk) } = wanted.id else { break };
                let parents = self.scene.states.get(asset as usize).and_then(|state| state.chunk(chunk));
                let parents = parents.map_or(&[][..], |info| &info.parents);
                let waits = |ready: &DecodeTask| {
                    ready.asset == asset && (ready.chunk == chunk || parents.contains(&ready.chunk))
                };
                // A chunk that is applied up to a truncation point is raised by itself.
                let raised = self.mesh(asset).is_some_and(|mesh| mesh.is_applied(chunk));
                if raised || batch.iter().any(waits) {
                    break;
                }
                if self.is_ready(wanted.id) {
                    let Some(bytes) = self.cache.get(wanted.id) else { break };
                    *budget = budget.saturating_sub(BLOB_COST + bytes.len() as u64);
                    batch.push(DecodeTask { wanted, asset, chunk, bytes });
                }
            }
            *index += 1;
        }
        batch
    }

    fn decode(&self, ready: &DecodeTask) -> Result<ChunkDelta, BlobError> {
        let &DecodeTask { wanted: Wanted { truncation, .. }, asset, chunk, ref bytes } = ready;
        let info = self.scene.states.get(asset as usize).and_then(|state| state.chunk(chunk));
        let refined = self.scene.refined.get(asset as usize).and_then(Option::as_ref);
        let (Some(info), Some(refined)) = (info, refined) else { return Err(BlobError::UnknownChunk) };
        Self::check_length(info, truncation, bytes)?;
        Ok(refined.decode_chunk(chunk, info, truncation, bytes).map_err(AssetError::from)?)
    }

    fn apply_decoded(&mut self, ready: &DecodeTask, delta: &ChunkDelta) -> Result<(), BlobError> {
        let level = self.scene.states.get(ready.asset as usize).and_then(|state| state.chunk(ready.chunk));
        let level = level.map_or(0, |info| info.level);
        self.scene.note_changed(ready.asset);
        let refined = self.scene.refined.get_mut(ready.asset as usize).and_then(Option::as_mut);
        let refined = refined.ok_or(BlobError::UnknownAsset)?;
        refined.apply_decoded(level, delta).map_err(AssetError::from)?;
        Self::set_appearance(refined, ready.chunk, ready.wanted.error_px);
        Ok(())
    }

    /// Applies a cached chunk or texture level if everything that it depends on is applied. Returns the number of bytes
    /// decoded, or `None` if it has to wait.
    fn apply_cached(&mut self, now: Time, wanted: &Wanted) -> Option<u64> {
        let Wanted { id, truncation, error_px, .. } = *wanted;
        if !self.is_ready(id) {
            return None;
        }
        // Names of parts answer lookups, and change nothing that is drawn.
        if matches!(id, BlobId::Parts(_)) && self.cache.contains(id) {
            return None;
        }
        let Some(bytes) = self.cache.get(id) else {
            self.mark_absent(now, id);
            return Some(0);
        };
        let length = bytes.len() as u64;
        let applied = match id {
            BlobId::Asset { asset, part: BlobPart::Chunk(chunk) } => {
                self.apply_chunk(asset, chunk, truncation, &bytes, error_px)
            }
            BlobId::Asset { part: BlobPart::Texture { level, .. }, .. } => {
                self.apply_texture(id, level, None, &bytes)
            }
            BlobId::Asset { part: BlobPart::Tile(Tile { level, tile, .. }), .. } => {
                self.apply_texture(id, level, Some(tile), &bytes)
            }
            // Decoded when they arrive.
            BlobId::Asset {
                part: BlobPart::Base | BlobPart::IndexPage(_) | BlobPart::TextureRegions,
                ..
            }
            | BlobId::Terrain(_)
            | BlobId::PunctualLights(_)
            | BlobId::Parts(_)
            | BlobId::Animation(_) => Ok(()),
        };
        self.note_applied(now, wanted, applied);
        Some(length)
    }

    /// Updates state and counters after an attempt to apply a blob.
    fn note_applied(&mut self, now: Time, wanted: &Wanted, applied: Result<(), BlobError>) {
        let Wanted { id, truncation, .. } = *wanted;
        match applied {
            Ok(()) => {
                self.failures.clear(id);
                self.set_applied(id, truncation);
                if let Some((asset, BlobPart::Chunk(chunk))) = self.scene.asset(id)
                    && let Some(info) = asset.chunk(chunk)
                {
                    self.counts.decoded_faces += u64::from(info.extent(truncation).faces);
                }
            }
            Err(why) => {
                // Its beginning, if it was applied, has been undone.
                self.set_truncation(id, None);
                self.mark_failed(now, id, &why);
            }
        }
    }

    fn is_ready(&self, id: BlobId) -> bool {
        let Some((asset, part)) = self.scene.asset(id) else { return false };
        match part {
            BlobPart::Chunk(chunk) => {
                let is_applied = |part| asset.state(part) == State::Applied;
                asset.chunk(chunk).is_some_and(|info| {
                    is_applied(BlobPart::Base) && info.parents.iter().all(|p| is_applied(BlobPart::Chunk(*p)))
                })
            }
            BlobPart::Texture { .. } | BlobPart::Tile(_) => {
                self.scene.waiting_bytes() < self.config.max_waiting_bytes
            }
            BlobPart::Base | BlobPart::IndexPage(_) | BlobPart::TextureRegions => false,
        }
    }

    fn apply_chunk(
        &mut self,
        asset: u32,
        chunk: u32,
        truncation: Option<u8>,
        bytes: &[u8],
        error_px: u16,
    ) -> Result<(), BlobError> {
        self.scene.note_changed(asset);
        let info = self.scene.states.get(asset as usize).and_then(|state| state.chunk(chunk));
        let refined = self.scene.refined.get_mut(asset as usize).and_then(Option::as_mut);
        let (Some(info), Some(refined)) = (info, refined) else { return Err(BlobError::UnknownChunk) };
        Self::check_length(info, truncation, bytes)?;
        refined.apply(chunk, info, truncation, bytes)?;
        Self::set_appearance(refined, chunk, error_px);
        Ok(())
    }

    /// Checks that a chunk has enough bytes for a truncation point, and not more than the index states.
    fn check_length(info: &ChunkInfo, truncation: Option<u8>, bytes: &[u8]) -> Result<(), BlobError> {
        let needed = info.extent(truncation).payload_bytes as usize;
        if bytes.len() < needed || bytes.len() > info.payload_bytes as usize {
            return Err(BlobError::Length { got_bytes: bytes.len(), needed_bytes: needed });
        }
        Ok(())
    }

    /// Chooses whether a chunk that was just applied morphs or appears at once, by the screen error without it.
    fn set_appearance(refined: &mut RefinedAsset, chunk: u32, error_px: u16) {
        if error_px > MAX_MORPH_PX {
            refined.appear_at_once(chunk);
        }
    }

    /// Applies a texture level or a tile of one to all known assets that share it; identical ones are decoded once.
    fn apply_texture(
        &mut self,
        id: BlobId,
        level: u8,
        tile: Option<u16>,
        bytes: &Bytes,
    ) -> Result<(), BlobError> {
        let sharers = self.scene.unapplied_sharers(id);
        if sharers.is_empty() {
            return Err(BlobError::UnknownTexture);
        }
        let texels =
            |info: &TextureInfo| (info.kind, info.width, info.height, info.levels.len(), info.planes());
        let mut decoded: Vec<(_, Arc<TexturePixels>)> = Vec::new();
        let mut changes = Vec::new();
        for (asset, texture) in sharers.into_iter().filter(|_| self.config.track_changes) {
            let refined = self.scene.refined.get(asset as usize).and_then(Option::as_ref);
            let info = refined.and_then(|r| r.description.textures.get(usize::from(texture)));
            let info = info.ok_or(BlobError::UnknownTexture)?;
            let pixels = match decoded.iter().find(|(other, _)| *other == texels(info)) {
                Some((_, pixels)) => Arc::clone(pixels),
                None => Arc::new(self.pixels(bytes, info, (u32::from(level), tile))?),
            };
            decoded.push((texels(info), Arc::clone(&pixels)));
            changes.push(TextureChange { asset, texture, level, tile, pixels });
        }
        for change in changes {
            self.scene.push_change(Change::Texture(change));
        }
        self.counts.texture_levels += 1;
        Ok(())
    }

    fn pixels(
        &self,
        file: &Bytes,
        info: &TextureInfo,
        image: (u32, Option<u16>),
    ) -> Result<TexturePixels, TextureFileError> {
        #[cfg(feature = "images")]
        if !self.config.host_decodes_textures {
            return TexturePixels::decode(file, info, image);
        }
        TexturePixels::for_host(file, info, image)
    }

    /// Takes the host's word that it cannot decode a texture level or tile that a change gave it: it counts as damaged,
    /// as one that this crate cannot decode.
    pub fn handle_texture_failure(
        &mut self,
        now: Time,
        (asset, texture): (u32, u16),
        (level, tile): (u8, Option<u16>),
        why: String,
    ) {
        let whole = BlobPart::Texture { texture, level };
        let part = tile.map_or(whole, |tile| BlobPart::Tile(Tile { texture, level, tile }));
        let id = BlobId::Asset { asset, part };
        let described = self.scene.refined.get(asset as usize).and_then(Option::as_ref);
        let Some(info) = described.and_then(|r| r.description.textures.get(usize::from(texture))) else {
            return;
        };
        let why = TextureFileError::by_host(info, (level.into(), tile), why);
        self.scene.set_unapplied(id);
        self.mark_failed(now, id, &why.into());
    }
}
