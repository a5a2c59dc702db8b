//! The whole scene as changes again, for a renderer that has lost its own copy.

use std::sync::Arc;

use lodestream_scene::animation::Animations;
use lodestream_scene::blob::BlobId;
use lodestream_select::State;

use super::{FirstFrame, Scene};
use crate::core::changes::Change;

/// Instances per change, so that steps stay small.
const INSTANCES_PER_CHANGE: usize = 8192;

impl Scene {
    /// Replaces the queued changes by all that make up the scene now, in the order of a first time: header, punctual
    /// lights, proxies, instances, animations, assets, whole meshes, first frame, height overrides. Texture levels and tiles are left
    /// out: they are marked as not applied, and returned as the blobs that were requested for them, each once.
    pub(crate) fn restate(&mut self) -> Vec<BlobId> {
        let Some(header) = self.header.clone() else { return Vec::new() };
        self.drop_changes();
        self.changed.clear();
        self.push_change(Change::Scene(Box::new(header)));
        if let Some(lights) = &self.punctual_lights {
            let count = Change::PunctualLights { count: lights.count() };
            let pages: Vec<_> = lights.pages().collect();
            self.push_change(count);
            for (page, punctual_lights) in pages {
                self.push_change(Change::PunctualLightPage { page, punctual_lights });
            }
        }
        let proxies: Vec<_> = self.proxies.nodes().iter().map(|node| node.proxy).collect();
        if !proxies.is_empty() {
            self.push_change(Change::Proxies(proxies));
            self.cut.1 = false;
        }
        let instances: Vec<_> = self.instances.chunks(INSTANCES_PER_CHANGE).map(<[_]>::to_vec).collect();
        for some in instances {
            self.push_change(Change::Instances(some));
        }
        let animations = self.animations.as_ref().map(|models| models.arrived.clone());
        for (number, model) in animations.iter().flat_map(Animations::models) {
            self.push_change(Change::Animation { number, model: Arc::clone(model) });
        }
        let mut levels = Vec::new();
        for asset in 0..self.asset_count() {
            let Some(new) = self.new_asset(asset) else { continue };
            self.push_change(Change::Asset(new));
            if let Some(refined) = &mut self.refined[asset as usize] {
                refined.restate();
                let entry = self.states[asset as usize].entry();
                levels.extend(refined.texture_images().map(|part| entry.sent_blob(asset, part)));
            }
            self.note_changed(asset);
        }
        if self.first_frame == FirstFrame::Delivered {
            self.first_frame = FirstFrame::Complete;
        }
        if let Some(terrain) = &mut self.terrain {
            terrain.restate();
        }
        levels.sort_unstable();
        levels.dedup();
        levels.retain(|&id| self.shared.same(id).any(|same| self.is_applied(same)));
        for &id in &levels {
            self.set_unapplied(id);
        }
        levels
    }

    fn is_applied(&self, id: BlobId) -> bool {
        self.asset(id).is_some_and(|(asset, part)| asset.state(part) == State::Applied)
    }
}
