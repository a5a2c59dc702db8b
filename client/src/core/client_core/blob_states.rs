//! The state of each blob, as selections read it.
//!
//! Each fact has one owner:
//!
//! | fact | owner |
//! |---|---|
//! | requested from the server, and with which priority | the session (`ClientSession::is_requested`) |
//! | bytes here, not in use | the [cache](crate::core::cache); of base meshes and index pages, the queue `undecoded` |
//! | in use, up to a truncation point or whole | the table |
//! | attempts after a failure | [`Failures`](crate::core::failures::Failures) |
//!
//! The table is [`AssetState`](lodestream_select::AssetState) with its counterparts for terrain, punctual lights and
//! parts.
//! Selections read nothing else, so it also has copies of the other facts: [`State::InFlight`], [`State::Cached`],
//! [`State::Failed`], and the number of bytes of a chunk, which [`ClientCore::sync_held`] alone writes. The core's
//! tests compare the copies with their owners whenever something has arrived.

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::time::Time;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_select::State;

use super::ClientCore;
use super::blob_error::BlobError;
#[cfg(test)]
use crate::core::asset::RefinedAsset;

impl ClientCore {
    pub(in crate::core) fn set_state(&mut self, id: BlobId, state: State) {
        if let (BlobId::Terrain(blob), Some(terrain)) = (id, &mut self.scene.terrain) {
            terrain.set_state(blob, state);
        } else if let (BlobId::PunctualLights(blob), Some(punctual_lights)) =
            (id, &mut self.scene.punctual_lights)
        {
            punctual_lights.set_state(blob, state);
        } else if let BlobId::Parts(blob) = id {
            self.parts.set_state(blob, state);
        } else if let (BlobId::Animation(model), Some(models)) = (id, &mut self.scene.animations) {
            models.set_state(model, state);
        } else {
            self.scene.set_state(id, state);
        }
    }

    /// Whether a blob is requested and has not arrived.
    pub(in crate::core) fn is_requested(&self, id: BlobId) -> bool {
        self.connection.session.as_ref().is_some_and(|session| session.is_requested(id))
    }

    /// The state of a chunk or texture level that is not in use. The rest of a cached chunk may be requested.
    pub(in crate::core) fn unused_state(&self, id: BlobId) -> State {
        if self.is_requested(id) {
            State::InFlight
        } else if self.cache.contains(id) {
            State::Cached
        } else {
            State::Absent
        }
    }

    /// Copies into the table how many leading bytes of a chunk the cache holds.
    pub(in crate::core) fn sync_held(&mut self, id: BlobId) {
        let held_bytes = self.cache.held_bytes(id);
        if let Some((state, BlobPart::Chunk(chunk))) = self.scene.asset_mut(id) {
            state.set_held(chunk, held_bytes);
        }
    }

    /// Sets up to which truncation point a chunk is applied.
    pub(in crate::core) fn set_truncation(&mut self, id: BlobId, truncation: Option<u8>) {
        if let Some((state, BlobPart::Chunk(chunk))) = self.scene.asset_mut(id) {
            state.set_truncation(chunk, truncation);
        }
    }

    /// Marks a blob as applied, or a chunk as applied up to a truncation point.
    pub(in crate::core) fn set_applied(&mut self, id: BlobId, truncation: Option<u8>) {
        self.set_truncation(id, truncation);
        if let Some(received) = self.received.get_mut(&id)
            && let Some((asset, BlobPart::Chunk(chunk))) = self.scene.asset(id)
            && let Some(info) = asset.chunk(chunk)
        {
            received.used_bytes = received.used_bytes.max(info.extent(truncation).payload_bytes.into());
        }
        if truncation.is_none() {
            self.set_state(id, State::Applied);
        }
    }

    /// Removes a blob's bytes and marks it as absent; the server may send it again.
    pub(in crate::core) fn mark_absent(&mut self, now: Time, id: BlobId) {
        self.cache.remove(id);
        self.sync_held(id);
        self.set_state(id, self.unused_state(id));
        if let Some(session) = &mut self.connection.session {
            session.evicted(now, &[id]);
        }
    }

    pub(in crate::core) fn state(&self, id: BlobId) -> State {
        match (id, &self.scene.terrain, &self.scene.punctual_lights) {
            (BlobId::Terrain(blob), Some(terrain), _) => terrain.state(blob),
            (BlobId::PunctualLights(blob), _, Some(punctual_lights)) => punctual_lights.state(blob),
            (BlobId::Parts(blob), ..) => self.parts.state(blob),
            (BlobId::Animation(_), ..) => self.animation_state(id).unwrap_or_default(),
            _ => self.scene.state(id),
        }
    }

    /// Marks a blob that cannot be used as failed, and schedules another attempt
    /// ([`Failures`](crate::core::failures::Failures)).
    pub(super) fn mark_failed(&mut self, now: Time, id: BlobId, why: &BlobError) {
        self.counts.decode_failures += 1;
        let again = self.failures.record_damaged(now, id);
        tracing::warn!("{id} cannot be used{}: {why}", if again { ", requesting it again" } else { "" });
        self.mark_absent(now, id);
        self.set_state(id, State::Failed);
        self.selection.stale = true;
    }

    /// Ends the session because the server breaks the protocol; connecting again does not help.
    pub(in crate::core) fn end_session(&mut self, now: Time, why: &dyn std::fmt::Display) {
        tracing::warn!("the session ends: {why}");
        if let Some(session) = &mut self.connection.session {
            session.close(now, CloseCode::Protocol, &why.to_string());
        }
    }

    /// Marks evicted blobs as absent and tells the server.
    pub(in crate::core) fn mark_evicted(&mut self, now: Time, evicted: &[BlobId]) {
        self.counts.evicted += evicted.len() as u64;
        for &id in evicted {
            self.sync_held(id);
            // Applied blobs stay applied; they are fetched again only once they are undone and wanted again.
            if self.state(id) == State::Cached {
                self.set_state(id, State::Absent);
            }
        }
        let evicted: Vec<BlobId> =
            evicted.iter().copied().filter(|id| self.state(*id) == State::Absent).collect();
        if !evicted.is_empty()
            && let Some(session) = &mut self.connection.session
        {
            session.evicted(now, &evicted);
        }
    }
}

#[cfg(test)]
impl ClientCore {
    /// Compares the table's copies with their owners.
    pub(crate) fn check_states(&self) {
        let Some(session) = self.connection.session.as_ref().filter(|_| self.connection.closed.is_none())
        else {
            return;
        };
        for id in session.requested() {
            assert_eq!(self.state(id), State::InFlight, "{id} is requested");
        }
        for (asset, state) in (0..).zip(&self.scene.states) {
            let pages = (0..state.entry().index_pages()).map(BlobPart::IndexPage);
            let chunks = (0..).zip(state.chunks()).map(|(chunk, _)| BlobPart::Chunk(chunk));
            let refined = self.scene.refined.get(asset as usize).and_then(Option::as_ref);
            let textures = refined.into_iter().flat_map(RefinedAsset::texture_images);
            for part in std::iter::once(BlobPart::Base).chain(pages).chain(chunks).chain(textures) {
                let id = state.entry().sent_blob(asset, part);
                match state.state(part) {
                    State::InFlight => assert!(session.is_requested(id), "{id} is not requested"),
                    State::Cached => {
                        let undecoded = self.undecoded.iter().any(|(waiting, _)| *waiting == id);
                        assert!(undecoded || self.cache.contains(id), "{id} is not cached");
                    }
                    State::Absent | State::Applied | State::Failed => {}
                }
                if let BlobPart::Chunk(chunk) = part {
                    assert_eq!(state.held_bytes(chunk), self.cache.held_bytes(id), "{id}");
                }
            }
        }
    }
}
