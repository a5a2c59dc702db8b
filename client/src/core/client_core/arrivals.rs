//! From bytes to what is drawn: what becomes of a blob that has arrived.

use std::sync::Arc;

use bytes::Bytes;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, decode_stated_page};
use lodestream_protocol::time::Time;
use lodestream_scene::asset::TextureInfo;
use lodestream_scene::blob::{BlobId, BlobPart, PunctualLightBlob, TerrainBlob};
use lodestream_select::{State, Wanted};

use super::ClientCore;
use crate::core::asset::RefinedAsset;
use crate::core::changes::{Change, TextureChange};
use crate::core::height_overrides::TerrainBlobError;
use crate::core::punctual_light_pages::PunctualLightBlobError;
use crate::core::texture_file::TexturePixels;

/// Screen error above which a chunk brings what was missing rather than refines: it appears at once, without a morph, in
/// pixels.
const MAX_MORPH_PX: u16 = 8;

/// A blob, or part of it, as it arrived.
#[derive(Clone, Debug)]
pub(super) struct Arrived {
    pub(super) id: BlobId,
    /// Where in the blob the bytes begin.
    pub(super) offset: u32,
    /// Length of the whole blob.
    pub(super) total: u32,
    pub(super) bytes: Bytes,
}

impl ClientCore {
    /// A blob of the terrain or of a known asset has arrived, or part of it. Chunks and texture levels are kept
    /// until a selection wants them, what everything else depends on is used as soon as there is time.
    pub(super) fn arrive(&mut self, now: Time, arrived: Arrived) {
        match arrived.id {
            BlobId::Asset { part, .. } => self.take_asset(now, part, arrived),
            BlobId::Terrain(blob) => self.take_terrain(now, blob, &arrived),
            BlobId::PunctualLights(blob) => self.take_punctual_lights(now, blob, &arrived),
        }
    }

    fn take_asset(&mut self, now: Time, part: BlobPart, arrived: Arrived) {
        let Arrived { id, offset, total, bytes } = arrived;
        if self.state(id) == State::Applied {
            return;
        }
        let whole = offset == 0 && bytes.len() == total as usize;
        self.set_state(id, State::Cached);
        match part {
            // A chunk that came ahead of its index page would be held, and asked for, for ever.
            _ if total == 0 => self.failed(now, id, &"it is empty"),
            BlobPart::Chunk(_) => match self.cache.extend(id, offset, bytes) {
                Some(_) => {
                    self.sync_held(id);
                    self.trim_cache(now);
                }
                // Its beginning was dropped meanwhile: it is of no use, and the server must know.
                None => self.not_here(now, id),
            },
            _ if !whole => self.failed(now, id, &"only a part of it came"),
            BlobPart::Base | BlobPart::IndexPage(_) => self.arrived.push_back((id, bytes)),
            BlobPart::Texture { .. } => {
                self.cache.insert(id, bytes);
                self.trim_cache(now);
            }
        }
    }

    /// A blob of the terrain has arrived. It is small, and used at once.
    fn take_terrain(&mut self, now: Time, blob: TerrainBlob, arrived: &Arrived) {
        let &Arrived { id, offset, total, ref bytes } = arrived;
        let whole = offset == 0 && bytes.len() == total as usize;
        let track = self.config.track_changes;
        let Some(terrain) = self.scene.terrain.as_mut().filter(|t| t.state(blob) != State::Applied) else {
            return;
        };
        let taken = if whole { terrain.take(blob, bytes) } else { Err(TerrainBlobError::Partial) };
        if !track {
            terrain.drop_changes();
        }
        match taken {
            Ok(()) => self.failures.forget(id),
            Err(why @ TerrainBlobError::BeyondWorld { .. }) => self.end_session(now, &why),
            Err(why) => self.failed(now, id, &why),
        }
    }

    /// A blob of punctual lights has arrived. It is small, and used at once.
    fn take_punctual_lights(&mut self, now: Time, blob: PunctualLightBlob, arrived: &Arrived) {
        let &Arrived { id, offset, total, ref bytes } = arrived;
        let whole = offset == 0 && bytes.len() == total as usize;
        let Some(punctual_lights) = self
            .scene
            .punctual_lights
            .as_mut()
            .filter(|punctual_lights| punctual_lights.state(blob) != State::Applied)
        else {
            return;
        };
        match if whole { punctual_lights.take(blob, bytes) } else { Err(PunctualLightBlobError::Partial) } {
            Ok(came) => {
                self.failures.forget(id);
                if let Some((page, punctual_lights)) = came.filter(|_| self.config.track_changes) {
                    self.scene.push_change(Change::PunctualLightPage { page, punctual_lights });
                }
            }
            Err(why) => self.failed(now, id, &why),
        }
    }

    /// Drops what exceeds the cache, but nothing that waits to be applied: without its bytes it would be
    /// fetched, dropped and fetched again.
    pub(super) fn trim_cache(&mut self, now: Time) {
        let needed = |id: BlobId| {
            matches!(self.scene.state(id), State::Cached | State::InFlight)
                && self.wanted.iter().any(|wanted| wanted.id == id)
        };
        let gone = self.cache.trim(needed);
        self.dropped(now, &gone);
    }

    /// Uses a base mesh or index page.
    pub(super) fn take(&mut self, now: Time, id: BlobId, bytes: &[u8]) {
        let BlobId::Asset { asset, part } = id else { return };
        match part {
            BlobPart::Base => self.take_base(now, asset, bytes),
            BlobPart::IndexPage(page) => self.take_page(now, asset, page, bytes),
            BlobPart::Chunk(_) | BlobPart::Texture { .. } => {}
        }
    }

    fn take_base(&mut self, now: Time, asset: u32, bytes: &[u8]) {
        let id = BlobId::base(asset);
        let Some(state) = self.scene.states.get_mut(asset as usize) else { return };
        if state.state(BlobPart::Base) == State::Applied {
            return;
        }
        match RefinedAsset::decode(bytes, state.entry().chunk_count, self.config.track_changes) {
            Ok(refined) => {
                let levels =
                    refined.texture_levels().map(|part| state.entry().sent_blob(asset, part)).collect();
                state.set_state(BlobPart::Base, State::Applied);
                self.counts.decoded_faces += refined.mesh().face_count() as u64;
                self.scene.set_base(asset, refined);
                if !self.config.track_changes {
                    self.scene.drop_changes();
                }
                self.failures.forget(id);
                self.find_textures(now, levels);
            }
            Err(why) => self.failed(now, id, &why),
        }
    }

    fn take_page(&mut self, now: Time, asset: u32, page: u32, bytes: &[u8]) {
        let id = BlobId::index_page(asset, page);
        if self.state(id) == State::Applied {
            return;
        }
        let first = page.saturating_mul(CHUNKS_PER_PAGE as u32);
        let added = decode_stated_page(bytes, first).map_err(|why| why.to_string()).and_then(|infos| {
            let count = infos.chunks.len();
            let state = self.scene.states.get_mut(asset as usize).ok_or("no such asset")?;
            state.add_index_page(page, infos).map_err(|why| why.to_string())?;
            Ok(count)
        });
        match added {
            Ok(count) => {
                self.failures.forget(id);
                let chunks = (first..).take(count).map(|chunk| BlobId::chunk(asset, chunk));
                self.find_in_cache(chunks.collect());
            }
            Err(why) => self.failed(now, id, &why),
        }
    }

    /// Levels of textures that an asset has which became known: where others have the same, they may be here or on
    /// their way.
    fn find_textures(&mut self, now: Time, levels: Vec<BlobId>) {
        for &id in &levels {
            if self.scene.is_in_flight(id) {
                self.set_state(id, State::InFlight);
            } else if !self.cache.contains(id)
                && self.scene.shared.same(id).any(|id| self.is_painted(id))
                && let Some(session) = &mut self.session
            {
                // It was here, and will be needed again.
                session.evicted(now, &[id]);
            }
        }
        self.find_in_cache(levels);
    }

    fn is_painted(&self, id: BlobId) -> bool {
        self.scene.asset(id).is_some_and(|(asset, part)| asset.state(part) == State::Applied)
    }

    /// Blobs may come before what tells that they exist.
    fn find_in_cache(&mut self, ids: Vec<BlobId>) {
        for id in ids {
            if self.cache.contains(id) {
                self.set_state(id, State::Cached);
                self.sync_held(id);
            }
        }
    }

    /// Puts a chunk or texture level to use whose bytes are here, if all it needs is in place. Gives the
    /// length of what was decoded, or `None` if it has to wait.
    pub(super) fn apply_cached(&mut self, now: Time, wanted: &Wanted) -> Option<u64> {
        let Wanted { id, truncation, error_px, .. } = *wanted;
        if !self.is_ready(id) {
            return None;
        }
        let Some(bytes) = self.cache.get(id) else {
            self.not_here(now, id);
            return Some(0);
        };
        let length = bytes.len() as u64;
        let applied = match id {
            BlobId::Asset { asset, part: BlobPart::Chunk(chunk) } => {
                self.apply_chunk(asset, chunk, truncation, &bytes, error_px)
            }
            BlobId::Asset { part: BlobPart::Texture { level, .. }, .. } => {
                self.apply_texture(id, level, &bytes)
            }
            // Used as they arrive.
            BlobId::Asset { part: BlobPart::Base | BlobPart::IndexPage(_), .. }
            | BlobId::Terrain(_)
            | BlobId::PunctualLights(_) => Ok(()),
        };
        self.note_applied(now, wanted, applied);
        Some(length)
    }

    /// Notes what became of a blob that was to be used.
    pub(super) fn note_applied(&mut self, now: Time, wanted: &Wanted, applied: Result<(), String>) {
        let Wanted { id, truncation, .. } = *wanted;
        match applied {
            Ok(()) => {
                self.failures.forget(id);
                self.set_applied(id, truncation);
                if let Some((asset, BlobPart::Chunk(chunk))) = self.scene.asset(id)
                    && let Some(info) = asset.chunk(chunk)
                {
                    self.counts.decoded_faces += u64::from(info.extent(truncation).faces);
                }
            }
            Err(why) => {
                // What was there of it up to a truncation was undone.
                self.set_truncation(id, None);
                self.failed(now, id, &why);
            }
        }
    }

    pub(super) fn is_ready(&self, id: BlobId) -> bool {
        let Some((asset, part)) = self.scene.asset(id) else { return false };
        match part {
            BlobPart::Chunk(chunk) => {
                let is_applied = |part| asset.state(part) == State::Applied;
                asset.chunk(chunk).is_some_and(|info| {
                    is_applied(BlobPart::Base) && info.parents.iter().all(|p| is_applied(BlobPart::Chunk(*p)))
                })
            }
            BlobPart::Texture { .. } => self.scene.waiting_bytes() < self.config.max_waiting_bytes,
            BlobPart::Base | BlobPart::IndexPage(_) => false,
        }
    }

    fn apply_chunk(
        &mut self,
        asset: u32,
        chunk: u32,
        truncation: Option<u8>,
        bytes: &[u8],
        error_px: u16,
    ) -> Result<(), String> {
        self.scene.note_changed(asset);
        let info = self.scene.states.get(asset as usize).and_then(|state| state.chunk(chunk));
        let refined = self.scene.refined.get_mut(asset as usize).and_then(Option::as_mut);
        let (Some(info), Some(refined)) = (info, refined) else { return Err("no such chunk".into()) };
        Self::check_length(info, truncation, bytes)?;
        refined.apply(chunk, info, truncation, bytes).map_err(|why| why.to_string())?;
        Self::appear(refined, chunk, error_px);
        Ok(())
    }

    /// Whether there are as many bytes of a chunk as a truncation takes, and not more than there are in all.
    pub(super) fn check_length(info: &ChunkInfo, truncation: Option<u8>, bytes: &[u8]) -> Result<(), String> {
        let needed = info.extent(truncation).payload_bytes as usize;
        if bytes.len() < needed || bytes.len() > info.payload_bytes as usize {
            return Err(format!("{} bytes, but the index says {needed}", bytes.len()));
        }
        Ok(())
    }

    /// Lets a chunk that was just applied appear, by what its absence showed.
    pub(super) fn appear(refined: &mut RefinedAsset, chunk: u32, error_px: u16) {
        if error_px > MAX_MORPH_PX {
            refined.appear_at_once(chunk);
        }
    }

    /// Paints all that have the texture and are known. What is the same for all is decoded once.
    fn apply_texture(&mut self, id: BlobId, level: u8, bytes: &[u8]) -> Result<(), String> {
        let unpainted = self.scene.unpainted(id);
        if unpainted.is_empty() {
            return Err("no such texture".into());
        }
        let texels = |info: &TextureInfo| (info.kind, info.width, info.height, info.levels.len());
        let mut decoded: Vec<(_, Arc<TexturePixels>)> = Vec::new();
        let mut changes = Vec::new();
        for (asset, texture) in unpainted.into_iter().filter(|_| self.config.track_changes) {
            let refined = self.scene.refined.get(asset as usize).and_then(Option::as_ref);
            let info = refined.and_then(|r| r.description.textures.get(usize::from(texture)));
            let info = info.ok_or("no such texture")?;
            let pixels = match decoded.iter().find(|(other, _)| *other == texels(info)) {
                Some((_, pixels)) => Arc::clone(pixels),
                None => {
                    let pixels = TexturePixels::decode(bytes, info, u32::from(level));
                    Arc::new(pixels.map_err(|why| why.to_string())?)
                }
            };
            decoded.push((texels(info), Arc::clone(&pixels)));
            changes.push(TextureChange { asset, texture, level, pixels });
        }
        for change in changes {
            self.scene.push_change(Change::Texture(change));
        }
        self.counts.texture_levels += 1;
        Ok(())
    }
}
