//! Events of the session: the scene, its pages, blobs and refusals.

use lodestream_protocol::client::ClientEvent;
use lodestream_protocol::message::{RefusedReason, Welcome};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::punctual_lights::PunctualLights;
use lodestream_select::State;

use super::ClientCore;
use super::source::Source;
use super::state::ReceivedBlob;
use crate::core::cache::BlobCache;
use crate::core::changes::Change;
use crate::core::config::StartView;
use crate::core::failures::Failures;
use crate::core::punctual_light_pages::PunctualLightPages;
use crate::core::scene::Scene;

/// Most blobs kept that arrived before the scene page of their asset.
const MAX_EARLY_BLOBS: usize = 256;

impl ClientCore {
    pub(super) fn handle_session_events(&mut self, now: Time) {
        while let Some(event) = self.connection.session.as_mut().and_then(Source::poll_event) {
            // Names of parts change nothing that is drawn, nor does the end of sending where nothing was wanted: a settled
            // client stays settled.
            let changes_nothing = match &event {
                ClientEvent::Blob { id: BlobId::Parts(_), .. } => true,
                ClientEvent::Done => self.counters().settled,
                _ => false,
            };
            match event {
                ClientEvent::Connected(welcome) => self.handle_welcome(now, welcome),
                ClientEvent::ScenePage(page) => match self.scene.add_page(page, self.config.max_entries) {
                    Ok(assets) => {
                        let (known, early): (Vec<_>, _) = std::mem::take(&mut self.early)
                            .into_iter()
                            .partition(|blob| blob.id.asset().is_none_or(|asset| asset < assets.end));
                        self.early = early;
                        for blob in known {
                            self.receive(now, blob);
                        }
                        self.advance_lookups(now);
                    }
                    Err(why) => self.end_session(now, &why),
                },
                ClientEvent::PunctualLights(punctual_lights) => {
                    self.set_punctual_lights(now, &punctual_lights)
                }
                ClientEvent::Parts(table) => {
                    self.parts.table.get_or_insert(table);
                    self.parts.is_announced = true;
                    self.advance_lookups(now);
                }
                ClientEvent::Animations(table) => self.set_animations(table),
                ClientEvent::Blob { id, offset, total, bytes } => {
                    if self.config.track_received {
                        self.received.entry(id).or_default().bytes += bytes.len() as u64;
                    }
                    tracing::trace!("{id}: {} of {total} bytes from {offset}", bytes.len());
                    let blob = ReceivedBlob { id, offset, total, bytes };
                    if id.asset().is_none_or(|asset| asset < self.scene.asset_count()) {
                        self.receive(now, blob);
                    } else if self.early.len() < MAX_EARLY_BLOBS {
                        self.early.push(blob);
                    } else if let Some(session) = &mut self.connection.session {
                        session.evicted(now, &[id]);
                    }
                }
                ClientEvent::Refused { id, reason } => self.handle_refusal(now, id, reason),
                ClientEvent::BasesSent => self.connection.bases_sent = true,
                ClientEvent::Done => {}
                ClientEvent::Closed(close) => {
                    tracing::debug!("session closed: {close}");
                    self.connection.closed = Some(close);
                }
            }
            self.selection.stale |= !changes_nothing;
        }
    }

    fn handle_welcome(&mut self, now: Time, welcome: Welcome) {
        let header = &welcome.scene;
        let same = self.scene.header.as_ref().is_some_and(|old| old.fingerprint == header.fingerprint);
        if !same {
            self.parts.begin_scene(self.scene.header.is_some());
            self.scene = Scene::new(header.clone());
            self.follow_animations();
            self.cache = BlobCache::new(self.config.cache_bytes);
            self.failures = Failures::default();
            self.selection.wanted.clear();
            self.selection.failed.clear();
            // Blobs that are not decoded yet belong to the old scene: `Connected` is the session's first event.
            self.undecoded.clear();
        }
        if self.view.is_none() {
            let camera = header.camera;
            match self.config.start {
                StartView::OfScene { viewport_px, target_px } => {
                    self.set_view(now, camera.view(viewport_px, target_px));
                }
                StartView::OrthographicOfScene { viewport_px, target_px } => {
                    self.set_view(now, camera.orthographic().view(viewport_px, target_px));
                }
                StartView::Given(_) => {}
            }
        }
        self.connection.welcome = Some(welcome);
    }

    /// Takes the description of the scene's punctual lights. After a reconnection to the same scene it is known
    /// already.
    fn set_punctual_lights(&mut self, now: Time, punctual_lights: &PunctualLights) {
        if self.scene.punctual_lights.is_some() {
            return;
        }
        match PunctualLightPages::new(punctual_lights) {
            Ok((pages, first_page)) => {
                self.scene.push_change(Change::PunctualLights { count: pages.count() });
                if let Some(punctual_lights) = first_page {
                    self.scene.push_change(Change::PunctualLightPage { page: 0, punctual_lights });
                }
                self.scene.punctual_lights = Some(pages);
                if !self.config.track_changes {
                    self.scene.drop_changes();
                }
            }
            Err(why) => self.end_session(now, &why),
        }
    }

    fn handle_refusal(&mut self, now: Time, id: BlobId, reason: RefusedReason) {
        self.counts.refused += 1;
        tracing::warn!("the server refuses {id}: {reason:?}");
        match reason {
            RefusedReason::QueueFull => self.set_state(id, State::Absent),
            RefusedReason::Unreadable => {
                self.failures.record_refused(now, id);
                self.set_state(id, State::Failed);
            }
            RefusedReason::NotFound | RefusedReason::TooLong | RefusedReason::OutOfRange => {
                self.failures.give_up(id);
                self.set_state(id, State::Failed);
            }
        }
        if matches!(id, BlobId::Parts(_)) {
            self.advance_lookups(now);
        }
    }
}
