//! Received blobs: chunks and texture levels go to the cache, everything else is decoded.

use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};
use lodestream_protocol::time::Time;
use lodestream_scene::asset::TextureRegions;
use lodestream_scene::blob::{BlobId, BlobPart, PunctualLightBlob, TerrainBlob};
use lodestream_select::State;

use super::ClientCore;
use super::blob_error::BlobError;
use super::state::ReceivedBlob;
use crate::core::asset::RefinedAsset;
use crate::core::changes::Change;
use crate::core::height_overrides::HeightOverrideBlobError;
use crate::core::punctual_light_pages::PunctualLightBlobError;

impl ClientCore {
    /// Takes a received blob of the terrain, of punctual lights, parts, animations or of a known asset. Chunks and
    /// texture levels are cached until a selection wants them; base meshes and index pages are decoded by the next
    /// [`ClientCore::update`].
    pub(super) fn receive(&mut self, now: Time, blob: ReceivedBlob) {
        match blob.id {
            BlobId::Asset { part, .. } => self.receive_asset_blob(now, part, blob),
            BlobId::Terrain(part) => self.receive_terrain_blob(now, part, &blob),
            BlobId::PunctualLights(part) => self.receive_punctual_light_blob(now, part, &blob),
            BlobId::Parts(part) => self.receive_part_blob(now, part, blob),
            BlobId::Animation(model) => self.receive_animation(now, model, &blob),
        }
    }

    fn receive_asset_blob(&mut self, now: Time, part: BlobPart, blob: ReceivedBlob) {
        let ReceivedBlob { id, offset, total, bytes } = blob;
        if self.state(id) == State::Applied {
            return;
        }
        let whole = offset == 0 && bytes.len() == total as usize;
        self.set_state(id, State::Cached);
        match part {
            // An empty chunk ahead of its index page would be requested for ever.
            _ if total == 0 => self.mark_failed(now, id, &BlobError::Empty),
            BlobPart::Chunk(_) => match self.cache.extend(id, offset, bytes) {
                Some(_) => {
                    self.sync_held(id);
                    self.trim_cache(now);
                }
                // Its beginning has been evicted meanwhile: the server must send it again.
                None => self.mark_absent(now, id),
            },
            _ if !whole => self.mark_failed(now, id, &BlobError::Partial),
            BlobPart::Base | BlobPart::IndexPage(_) | BlobPart::TextureRegions => {
                self.undecoded.push_back((id, bytes));
            }
            BlobPart::Texture { .. } | BlobPart::Tile(_) => {
                self.cache.insert(id, bytes);
                self.trim_cache(now);
            }
        }
    }

    /// Takes a blob of the terrain. It is small and decoded at once.
    fn receive_terrain_blob(&mut self, now: Time, blob: TerrainBlob, received: &ReceivedBlob) {
        let &ReceivedBlob { id, offset, total, ref bytes } = received;
        let whole = offset == 0 && bytes.len() == total as usize;
        let track = self.config.track_changes;
        let Some(terrain) = self.scene.terrain.as_mut().filter(|t| t.state(blob) != State::Applied) else {
            return;
        };
        let taken = if whole { terrain.take(blob, bytes) } else { Err(HeightOverrideBlobError::Partial) };
        if !track {
            terrain.drop_changes();
        }
        match taken {
            Ok(()) => self.failures.clear(id),
            Err(why @ HeightOverrideBlobError::BeyondWorld { .. }) => self.end_session(now, &why),
            Err(why) => self.mark_failed(now, id, &why.into()),
        }
    }

    /// Takes a blob of punctual lights. It is small and decoded at once.
    fn receive_punctual_light_blob(&mut self, now: Time, blob: PunctualLightBlob, received: &ReceivedBlob) {
        let &ReceivedBlob { id, offset, total, ref bytes } = received;
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
                self.failures.clear(id);
                if let Some((page, punctual_lights)) = came.filter(|_| self.config.track_changes) {
                    self.scene.push_change(Change::PunctualLightPage { page, punctual_lights });
                }
            }
            Err(why) => self.mark_failed(now, id, &why.into()),
        }
    }

    /// Evicts blobs beyond the cache's capacity, but none that waits to be applied: it would be fetched, evicted and
    /// fetched again.
    pub(super) fn trim_cache(&mut self, now: Time) {
        let needed = |id: BlobId| {
            if matches!(id, BlobId::Parts(_)) {
                return self.parts.needs(id);
            }
            matches!(self.scene.state(id), State::Cached | State::InFlight)
                && self.selection.wanted.iter().any(|wanted| wanted.id == id)
        };
        let evicted = self.cache.trim(needed);
        self.mark_evicted(now, &evicted);
    }

    /// Decodes a base mesh or index page.
    pub(super) fn decode_metadata(&mut self, now: Time, id: BlobId, bytes: &[u8]) {
        let BlobId::Asset { asset, part } = id else { return };
        match part {
            BlobPart::Base => self.decode_base(now, asset, bytes),
            BlobPart::IndexPage(page) => self.decode_index_page(now, asset, page, bytes),
            BlobPart::TextureRegions => self.decode_texture_regions(now, asset, bytes),
            BlobPart::Chunk(_) | BlobPart::Texture { .. } | BlobPart::Tile(_) => {}
        }
    }

    fn decode_texture_regions(&mut self, now: Time, asset: u32, bytes: &[u8]) {
        let id = BlobId::texture_regions(asset);
        if self.state(id) == State::Applied {
            return;
        }
        let refined = self.scene.refined.get(asset as usize).and_then(Option::as_ref);
        let decoded = match (refined, TextureRegions::decode(bytes)) {
            (None, _) => Err(BlobError::UnknownAsset),
            (Some(refined), Ok(regions)) if regions.fit(&refined.description) => Ok(regions),
            (Some(_), Ok(_)) => Err(BlobError::TextureRegions),
            (_, Err(why)) => Err(why.into()),
        };
        match (decoded, self.scene.states.get_mut(asset as usize)) {
            (Ok(regions), Some(state)) => {
                state.set_texture_regions(regions);
                self.failures.clear(id);
            }
            (Ok(_), None) => {}
            (Err(why), _) => self.mark_failed(now, id, &why),
        }
    }

    fn decode_base(&mut self, now: Time, asset: u32, bytes: &[u8]) {
        let id = BlobId::base(asset);
        let Some(state) = self.scene.states.get_mut(asset as usize) else { return };
        if state.state(BlobPart::Base) == State::Applied {
            return;
        }
        match RefinedAsset::decode(bytes, state.entry().chunk_count, self.config.track_changes) {
            Ok(refined) => {
                let levels =
                    refined.texture_images().map(|part| state.entry().sent_blob(asset, part)).collect();
                state.set_state(BlobPart::Base, State::Applied);
                self.counts.decoded_faces += refined.mesh().face_count() as u64;
                self.scene.set_base(asset, refined);
                if !self.config.track_changes {
                    self.scene.drop_changes();
                }
                self.failures.clear(id);
                self.link_shared_textures(now, levels);
            }
            Err(why) => self.mark_failed(now, id, &why.into()),
        }
    }

    fn decode_index_page(&mut self, now: Time, asset: u32, page: u32, bytes: &[u8]) {
        let id = BlobId::index_page(asset, page);
        if self.state(id) == State::Applied {
            return;
        }
        let first = page.saturating_mul(CHUNKS_PER_PAGE as u32);
        match self.add_index_page(asset, page, first, bytes) {
            Ok(count) => {
                self.failures.clear(id);
                let chunks = (first..).take(count).map(|chunk| BlobId::chunk(asset, chunk));
                self.mark_cached(chunks.collect());
            }
            Err(why) => self.mark_failed(now, id, &why),
        }
    }

    /// Decodes an index page and makes its chunks known; gives their number. `first` is the first chunk's id.
    fn add_index_page(
        &mut self,
        asset: u32,
        page: u32,
        first: u32,
        bytes: &[u8],
    ) -> Result<usize, BlobError> {
        let index = decode_stated_page(bytes, first)?;
        let count = index.chunks.len();
        let state = self.scene.states.get_mut(asset as usize).ok_or(BlobError::UnknownAsset)?;
        state.add_index_page(page, index)?;
        Ok(count)
    }

    /// Sets the states of texture levels that have become known. If other assets share them, they may be cached or in
    /// flight already.
    fn link_shared_textures(&mut self, now: Time, levels: Vec<BlobId>) {
        for &id in &levels {
            if self.is_requested(id) {
                self.set_state(id, State::InFlight);
            } else if !self.cache.contains(id)
                && self.scene.shared.same(id).any(|id| self.is_texture_applied(id))
                && let Some(session) = &mut self.connection.session
            {
                // It was applied to another asset and evicted: it is needed again.
                session.evicted(now, &[id]);
            }
        }
        self.mark_cached(levels);
    }

    fn is_texture_applied(&self, id: BlobId) -> bool {
        self.scene.asset(id).is_some_and(|(asset, part)| asset.state(part) == State::Applied)
    }

    /// Sets the states of blobs that arrived before the page that describes them.
    fn mark_cached(&mut self, ids: Vec<BlobId>) {
        for id in ids {
            if self.cache.contains(id) {
                self.set_state(id, State::Cached);
                self.sync_held(id);
            }
        }
    }
}
