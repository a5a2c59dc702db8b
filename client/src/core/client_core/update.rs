//! The heavy part: selecting, decoding, applying and undoing, within a budget.

use std::time::Duration;

use lodestream_protocol::time::Time;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::SceneLighting;
use lodestream_select::{RootError, State};

use super::state::{BLOB_COST, COMPACTION_COST};
use super::{ClientCore, Progress};
use crate::core::milestones::is_drawable;

/// Round trip assumed until one is measured.
const USUAL_ROUND_TRIP: Duration = Duration::from_millis(100);

impl ClientCore {
    /// Selects, decodes, applies and undoes, within a budget of about `budget_bytes` of payload.
    pub fn update(&mut self, now: Time, budget_bytes: u64) -> Progress {
        let mut budget = budget_bytes;
        let before = budget;
        while budget > 0
            && let Some((id, bytes)) = self.undecoded.pop_front()
        {
            budget = budget.saturating_sub(BLOB_COST + bytes.len() as u64);
            self.decode_metadata(now, id, &bytes);
            // A selection may have run between two slices of this queue and must run again.
            self.selection.stale = true;
        }
        if self.selection.stale && (now >= self.next_selection() || self.awaits_first_frame()) {
            self.select(now);
        }
        budget = self.apply_wanted(now, budget);
        while budget > 0 && self.scene.compact() {
            budget = budget.saturating_sub(COMPACTION_COST);
        }
        if budget < before && self.connection.session.is_some() {
            self.send_requests(now, &[]);
        }
        if budget == 0 { Progress::More } else { Progress::Idle }
    }

    /// Whether the first frame is still to come: its time is measured, so selections are not delayed.
    fn awaits_first_frame(&self) -> bool {
        self.milestones.first_frame.is_none()
    }

    pub(super) fn next_selection(&self) -> Time {
        self.selection.selected_at.map_or(Time::ZERO, |at| at + self.config.select_interval)
    }

    fn select(&mut self, now: Time) {
        let Some(view) = self.view else { return };
        if self.scene.header.is_none() {
            return;
        }
        self.selection.stale = false;
        self.selection.selected_at = Some(now);
        self.counts.selections += 1;
        self.scene.update_occluders();
        self.scene.update_tree();
        let (faces, bytes) = self.scene.update_mesh_bytes();
        self.selection.selector.settings_mut().max_faces = self.config.max_faces(faces, bytes);
        let round_trip = self.connection.session.as_ref().and_then(|session| session.stats().rtt);
        self.selection
            .selector
            .set_travel_distance(self.motion.distance_within(now, round_trip.unwrap_or(USUAL_ROUND_TRIP)));
        let light = self.scene.header.as_ref().map(|header| header.light);
        let shines = |light: &SceneLighting| light.color.iter().any(|&part| part > 0.0);
        self.selection.selector.set_to_sun(light.filter(shines).map(|light| light.direction));
        let header = self.scene.header.as_ref();
        let root_error = header.and_then(|header| RootError::new(&header.camera, header.root_slope));
        self.selection.selector.set_root_error(root_error);
        // A server pushes the base meshes of a cut; a published scene pushes nothing.
        let pushes = self.connection.session.as_mut().is_some_and(|session| session.server().is_some());
        let awaits_push = pushes && !self.connection.bases_sent && self.awaits_first_frame();
        self.selection.selector.set_awaits_push(awaits_push);
        let selection =
            self.selection.selector.select_among(&view, self.scene.instances(), &self.scene.states);
        let (counters, cancel, undo) = (selection.counters, selection.cancel.clone(), selection.undo.clone());
        self.selection.wanted.clone_from(&selection.wanted);
        self.selection.failed.clone_from(&selection.failed);
        let terrain = self.scene.terrain.as_ref();
        self.selection.terrain_settled = terrain.is_none_or(|terrain| {
            terrain.want(&view, &mut self.selection.wanted, &mut self.selection.failed)
        });
        self.selection.punctual_lights_settled = match (&self.scene.punctual_lights, &self.scene.header) {
            (Some(punctual_lights), Some(header)) => {
                punctual_lights.want(&view, header, &mut self.selection.wanted, &mut self.selection.failed)
            }
            _ => true,
        };
        let wanted_parts = self.parts.wanted();
        self.selection.wanted.splice(0..0, wanted_parts);
        self.scene.set_cut(self.selection.selector.cut());
        let all_known =
            self.scene.is_complete() || self.connection.bases_sent || self.scene.proxies_stand_for_all();
        let started = self.connection.started.unwrap_or(now);
        self.milestones.note(started, now, self.received_bytes(), all_known, &counters);
        // Animations come after the first frame, which may just have become drawable.
        self.selection.animations_settled = self.want_animations();
        if self.config.track_changes && is_drawable(all_known, &counters) {
            self.scene.note_first_frame();
        }
        for id in undo {
            self.undo(now, id);
        }
        self.trim_cache(now);
        self.send_requests(now, &cancel);
        if self.is_settled() {
            self.counts.settled_after.get_or_insert(now.since(started));
        }
    }

    /// Requests wanted blobs that are absent, and cancels others.
    pub(super) fn send_requests(&mut self, now: Time, cancel: &[BlobId]) {
        (0..self.selection.wanted.len()).for_each(|index| self.refresh(index));
        let Some(session) = &mut self.connection.session else { return };
        let requested = session.set_wanted(now, &self.selection.wanted, cancel);
        for &id in cancel {
            if self.state(id) == State::InFlight {
                self.set_state(id, State::Absent);
            }
        }
        for id in requested {
            self.set_state(id, State::InFlight);
        }
    }

    /// Updates the state of an entry of the last selection.
    pub(super) fn refresh(&mut self, index: usize) {
        let wanted = &mut self.selection.wanted[index];
        if let (BlobId::Terrain(blob), Some(terrain)) = (wanted.id, &self.scene.terrain) {
            wanted.state = terrain.state(blob);
        } else if let (BlobId::PunctualLights(blob), Some(punctual_lights)) =
            (wanted.id, &self.scene.punctual_lights)
        {
            wanted.state = punctual_lights.state(blob);
        } else if let BlobId::Parts(blob) = wanted.id {
            wanted.state = self.parts.state(blob);
        } else if let (BlobId::Animation(model), Some(models)) = (wanted.id, &self.scene.animations) {
            wanted.state = models.state(model);
        } else if wanted.id.part().is_some_and(|part| part.texture().is_some()) {
            wanted.state = self.scene.state(wanted.id);
        } else if let Some((asset, _)) = self.scene.asset(wanted.id) {
            asset.refresh(wanted);
        }
    }

    fn undo_tile(&mut self, now: Time, id: BlobId) {
        self.scene.remove_tile(id);
        self.counts.undone += 1;
        if !self.config.track_changes {
            self.scene.drop_changes();
        }
        if self.cache.contains(id) {
            self.set_state(id, self.unused_state(id));
        } else {
            self.mark_absent(now, id);
        }
    }

    fn undo(&mut self, now: Time, id: BlobId) {
        let BlobId::Asset { asset, part: BlobPart::Chunk(chunk) } = id else {
            return self.undo_tile(now, id);
        };
        self.scene.note_changed(asset);
        let Some(Some(refined)) = self.scene.refined.get_mut(asset as usize) else { return };
        match refined.undo(chunk) {
            Ok(()) => {
                self.counts.undone += 1;
                self.scene.note_undone(asset);
                self.selection.stale = true;
                self.set_truncation(id, None);
                if self.cache.contains(id) {
                    self.set_state(id, self.unused_state(id));
                } else {
                    self.mark_absent(now, id);
                }
            }
            Err(why) => tracing::error!("{id} cannot be undone: {why}"),
        }
    }
}
