//! From bytes to what is drawn: what becomes of a blob that has arrived.

use bytes::Bytes;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::{BlobId, BlobPart, PunctualLightBlob, TerrainBlob};
use lodestream_select::State;

use super::ClientCore;
use super::blob_error::BlobError;
use crate::core::asset::RefinedAsset;
use crate::core::changes::Change;
use crate::core::height_overrides::HeightOverrideBlobError;
use crate::core::punctual_light_pages::PunctualLightBlobError;

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
            _ if total == 0 => self.failed(now, id, &BlobError::Empty),
            BlobPart::Chunk(_) => match self.cache.extend(id, offset, bytes) {
                Some(_) => {
                    self.sync_held(id);
                    self.trim_cache(now);
                }
                // Its beginning was dropped meanwhile: it is of no use, and the server must know.
                None => self.not_here(now, id),
            },
            _ if !whole => self.failed(now, id, &BlobError::Partial),
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
        let taken = if whole { terrain.take(blob, bytes) } else { Err(HeightOverrideBlobError::Partial) };
        if !track {
            terrain.drop_changes();
        }
        match taken {
            Ok(()) => self.failures.clear(id),
            Err(why @ HeightOverrideBlobError::BeyondWorld { .. }) => self.end_session(now, &why),
            Err(why) => self.failed(now, id, &why.into()),
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
                self.failures.clear(id);
                if let Some((page, punctual_lights)) = came.filter(|_| self.config.track_changes) {
                    self.scene.push_change(Change::PunctualLightPage { page, punctual_lights });
                }
            }
            Err(why) => self.failed(now, id, &why.into()),
        }
    }

    /// Drops what exceeds the cache, but nothing that waits to be applied: without its bytes it would be
    /// fetched, dropped and fetched again.
    pub(super) fn trim_cache(&mut self, now: Time) {
        let needed = |id: BlobId| {
            matches!(self.scene.state(id), State::Cached | State::InFlight)
                && self.selection.wanted.iter().any(|wanted| wanted.id == id)
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
                self.failures.clear(id);
                self.find_textures(now, levels);
            }
            Err(why) => self.failed(now, id, &why.into()),
        }
    }

    fn take_page(&mut self, now: Time, asset: u32, page: u32, bytes: &[u8]) {
        let id = BlobId::index_page(asset, page);
        if self.state(id) == State::Applied {
            return;
        }
        let first = page.saturating_mul(CHUNKS_PER_PAGE as u32);
        match self.add_index_page(asset, page, first, bytes) {
            Ok(count) => {
                self.failures.clear(id);
                let chunks = (first..).take(count).map(|chunk| BlobId::chunk(asset, chunk));
                self.find_in_cache(chunks.collect());
            }
            Err(why) => self.failed(now, id, &why.into()),
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

    /// Levels of textures that an asset has which became known: where others have the same, they may be here or on
    /// their way.
    fn find_textures(&mut self, now: Time, levels: Vec<BlobId>) {
        for &id in &levels {
            if self.scene.is_in_flight(id) {
                self.set_state(id, State::InFlight);
            } else if !self.cache.contains(id)
                && self.scene.shared.same(id).any(|id| self.is_painted(id))
                && let Some(session) = &mut self.connection.session
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
}
