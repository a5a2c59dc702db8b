//! The scene as far as its description has arrived.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::{InstanceEntry, SceneHeader, ScenePage};
use lodestream_select::{AssetState, InstanceTree, Instances, State};

use super::asset::RefinedAsset;
use super::changes::{Change, NewAsset};
use super::height_overrides::HeightOverridePatches;
use super::punctual_light_pages::PunctualLightPages;
use super::shared::SharedTextures;

/// Pages kept that came ahead of their turn.
const MAX_EARLY_PAGES: usize = 256;

/// Instances that are looked through one by one.
const MAX_LOOSE: usize = 1024;

/// Header, pages and assets.
#[derive(Debug, Default)]
pub(crate) struct Scene {
    pub(crate) header: Option<SceneHeader>,
    instances: Vec<InstanceEntry>,
    /// Where the first of them are, so many that the rest is no more.
    tree: InstanceTree,
    /// Where the blobs of each asset are.
    pub(crate) states: Vec<AssetState>,
    /// The assets whose base mesh is here; as long as `states`.
    pub(crate) refined: Vec<Option<RefinedAsset>>,
    /// Which textures are the same.
    pub(super) shared: SharedTextures,
    /// Listed points of the terrain, if there is one.
    pub(super) terrain: Option<HeightOverridePatches>,
    /// Punctual lights, if there are some.
    pub(super) punctual_lights: Option<PunctualLightPages>,
    next_page: u32,
    early: BTreeMap<u32, ScenePage>,
    /// Changes for a renderer that say what there is: the scene, instances, assets, in order.
    changes: VecDeque<Change>,
    /// Assets whose meshes have changed since a renderer fetched them, those first that have waited longest: what is seen
    /// first is applied first.
    changed: VecDeque<u32>,
    /// Texture levels, which may be many megabytes.
    textures: VecDeque<Change>,
    waiting_bytes: usize,
    first_frame: FirstFrame,
}

/// Whether a renderer knows that it has everything of the first frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum FirstFrame {
    /// There is none yet.
    #[default]
    Ahead,
    /// It is here; the renderer is told once it has been given all of it.
    Here,
    /// The renderer was told.
    Told,
}

impl Scene {
    pub(crate) fn new(header: SceneHeader) -> Self {
        let changes = VecDeque::from([Change::Scene(Box::new(header.clone()))]);
        let terrain = header.terrain.as_deref().cloned().map(HeightOverridePatches::new);
        Self { header: Some(header), terrain, changes, ..Self::default() }
    }

    /// Takes a page; gives the numbers of the assets that became known, or why the page does not fit.
    pub(crate) fn add_page(
        &mut self,
        page: ScenePage,
        max_entries: u32,
    ) -> Result<std::ops::Range<u32>, &'static str> {
        let first = self.asset_count();
        let Some(header) = &self.header else { return Err("a scene page came before the scene") };
        let (page_count, asset_count, instance_count) =
            (header.page_count, header.asset_count, header.instance_count);
        if page.page >= page_count {
            return Err("a scene page is beyond the last");
        }
        if page.page < self.next_page {
            return Ok(first..first);
        }
        if page.page > self.next_page && self.early.len() >= MAX_EARLY_PAGES {
            return Err("too many scene pages came ahead of their turn");
        }
        self.early.insert(page.page, page);
        while let Some(page) = self.early.remove(&self.next_page) {
            let (assets, instances) = (self.states.len(), self.instances.len());
            if page.first_asset as usize != assets || page.first_instance as usize != instances {
                return Err("scene pages leave a gap");
            }
            let assets = assets + page.assets.len();
            let instances = instances + page.instances.len();
            if assets > (asset_count.min(max_entries)) as usize
                || instances > (instance_count.min(max_entries)) as usize
            {
                return Err("the scene has more entries than announced or allowed");
            }
            if page.instances.iter().any(|i| i.asset as usize >= assets) {
                return Err("an instance refers to an asset of a later page");
            }
            for (number, entry) in (page.first_asset..).zip(page.assets) {
                self.shared.add(number, &entry, &self.states)?;
                self.states.push(AssetState::new(entry));
            }
            self.refined.resize_with(self.states.len(), || None);
            self.instances.extend(&page.instances);
            self.push_change(Change::Instances(page.instances));
            self.next_page += 1;
        }
        Ok(first..self.asset_count())
    }

    /// Makes the hierarchy of instances anew where those that it does not know are many: as many as it knows, so that all
    /// its makings together take no longer than two of the last.
    pub(crate) fn renew_tree(&mut self) {
        if self.instances.len() - self.tree.len() > self.tree.len().max(MAX_LOOSE) {
            let asset = |number: u32| self.states.get(number as usize).map(AssetState::entry);
            self.tree = InstanceTree::new(self.instances.iter(), asset);
        }
    }

    /// The instances.
    pub(crate) fn instances(&self) -> Instances<'_> {
        Instances::new(&self.instances, &self.tree)
    }

    /// Whether all pages are here.
    pub(crate) fn is_complete(&self) -> bool {
        self.header.as_ref().is_some_and(|h| self.next_page >= h.page_count)
    }

    /// The asset that a blob is a part of, if it is known, and which part.
    pub(crate) fn asset(&self, id: BlobId) -> Option<(&AssetState, BlobPart)> {
        let BlobId::Asset { asset, part } = id else { return None };
        self.states.get(asset as usize).map(|state| (state, part))
    }

    /// The same, to be changed.
    pub(crate) fn asset_mut(&mut self, id: BlobId) -> Option<(&mut AssetState, BlobPart)> {
        let BlobId::Asset { asset, part } = id else { return None };
        self.states.get_mut(asset as usize).map(|state| (state, part))
    }

    /// The assets and textures that are painted with a level of one that was asked for, and are not yet.
    pub(crate) fn unpainted(&self, id: BlobId) -> Vec<(u32, u16)> {
        let of = |id| match self.asset(id)? {
            (asset, part @ BlobPart::Texture { texture, .. }) => {
                let waits = asset.blob_bytes(part).is_some() && asset.state(part) != State::Applied;
                waits.then_some((id.asset()?, texture))
            }
            _ => None,
        };
        self.shared.same(id).filter_map(of).collect()
    }

    /// Where a blob of an asset is. Of a texture that several have: where it is for those that do not use it yet.
    pub(crate) fn state(&self, id: BlobId) -> State {
        let Some((asset, part)) = self.asset(id) else { return State::Absent };
        if !matches!(part, BlobPart::Texture { .. }) {
            return asset.state(part);
        }
        // Those whose base mesh is not here have no level yet.
        let described = self
            .shared
            .same(id)
            .filter_map(|id| self.asset(id).filter(|(asset, part)| asset.blob_bytes(*part).is_some()));
        let states = described.map(|(asset, part)| asset.state(part));
        states.reduce(|one, other| if one == State::Applied { other } else { one }).unwrap_or_default()
    }

    /// Says where a blob of an asset is; of a texture that several have, for all of them. What is painted stays so.
    pub(crate) fn set_state(&mut self, id: BlobId, new: State) {
        for id in self.shared.same(id) {
            let BlobId::Asset { asset, part } = id else { continue };
            let Some(state) = self.states.get_mut(asset as usize) else { continue };
            let painted = matches!(part, BlobPart::Texture { .. }) && state.state(part) == State::Applied;
            if !painted {
                state.set_state(part, new);
            }
        }
    }

    /// Whether a blob is requested: of a texture that several assets share, whether it is for any of them.
    pub(crate) fn is_in_flight(&self, id: BlobId) -> bool {
        let state = |id| self.asset(id).map(|(asset, part)| asset.state(part));
        self.shared.same(id).any(|id| state(id) == Some(State::InFlight))
    }

    /// Marks all requested blobs as absent: the connection that they were requested over is gone.
    pub(crate) fn reset_in_flight(&mut self) {
        for (state, refined) in self.states.iter_mut().zip(&self.refined) {
            let pages = (0..state.entry().index_pages()).map(BlobPart::IndexPage);
            let chunks = (0..).zip(state.chunks()).map(|(chunk, _)| BlobPart::Chunk(chunk));
            let textures = refined.iter().flat_map(RefinedAsset::texture_levels);
            let parts = std::iter::once(BlobPart::Base).chain(pages).chain(chunks).chain(textures);
            let in_flight: Vec<_> = parts.filter(|part| state.state(*part) == State::InFlight).collect();
            for part in in_flight {
                state.set_state(part, State::Absent);
            }
        }
        if let Some(terrain) = &mut self.terrain {
            terrain.reset_in_flight();
        }
        if let Some(punctual_lights) = &mut self.punctual_lights {
            punctual_lights.reset_in_flight();
        }
    }

    /// Number of known assets.
    pub(crate) fn asset_count(&self) -> u32 {
        u32::try_from(self.states.len()).unwrap_or(u32::MAX)
    }

    /// Puts a base mesh in place.
    pub(crate) fn set_base(&mut self, asset: u32, refined: RefinedAsset) {
        let Some(state) = self.states.get_mut(asset as usize) else { return };
        state.set_description(&refined.description, refined.uv_per_unit);
        let (sphere, shared) = (state.entry().sphere, state.entry().shared.clone());
        let mut materials = refined.description.materials.clone();
        if materials.is_empty() {
            materials.push(lodestream_scene::asset::Material::default());
        }
        self.push_change(Change::Asset(NewAsset {
            asset,
            origin: refined.origin,
            center: sphere.center,
            radius: sphere.radius,
            materials,
            textures: refined.description.textures.clone(),
            shared,
        }));
        self.refined[asset as usize] = Some(refined);
        self.note_changed(asset);
    }

    /// Puts an asset whose mesh changes behind those that wait to be fetched, unless it waits itself.
    pub(crate) fn note_changed(&mut self, asset: u32) {
        let refined = self.refined.get_mut(asset as usize).and_then(Option::as_mut);
        if refined.is_some_and(RefinedAsset::begins_to_wait) {
            self.changed.push_back(asset);
        }
    }

    /// Tells selections what surfaces are known by now.
    pub(crate) fn renew_occluders(&mut self) {
        for (state, refined) in self.states.iter_mut().zip(&mut self.refined) {
            if let Some(occluder) = refined.as_mut().and_then(RefinedAsset::better_occluder) {
                state.set_occluder(Arc::new(occluder));
            }
        }
    }

    /// Notes a change that does not belong to a mesh.
    pub(crate) fn push_change(&mut self, change: Change) {
        self.waiting_bytes += change.bytes();
        match change {
            Change::Texture(_) => self.textures.push_back(change),
            _ => self.changes.push_back(change),
        }
    }

    /// Everything that the first frame needs is here.
    pub(crate) fn note_first_frame(&mut self) {
        if self.first_frame == FirstFrame::Ahead {
            self.first_frame = FirstFrame::Here;
        }
    }

    /// Drops the changes of a scene that nobody draws.
    pub(crate) fn drop_changes(&mut self) {
        self.changes.clear();
        self.textures.clear();
        self.waiting_bytes = 0;
    }

    /// Bytes of the changes that wait to be taken, meshes not counted.
    pub(crate) const fn waiting_bytes(&self) -> usize {
        self.waiting_bytes
    }

    /// Whether [`Scene::take_changes`] has something.
    pub(crate) fn has_changes(&self) -> bool {
        let terrain = self.terrain.as_ref().is_some_and(HeightOverridePatches::has_changes);
        let other = !self.changes.is_empty() || !self.textures.is_empty();
        let mark = self.first_frame == FirstFrame::Here;
        other || mark || terrain || self.changed.iter().any(|&asset| self.has_mesh_changes(asset))
    }

    fn has_mesh_changes(&self, asset: u32) -> bool {
        self.refined.get(asset as usize).and_then(Option::as_ref).is_some_and(RefinedAsset::has_changes)
    }

    /// Changes, in order, until they hold about `max_bytes`; at least one if there is any. Shapes come before textures, so
    /// that no object is absent while others are painted.
    pub(crate) fn take_changes(&mut self, now_s: f32, max_bytes: usize) -> Vec<Change> {
        let mut taken = Vec::new();
        let mut bytes = 0;
        while bytes < max_bytes
            && let Some(change) = self.changes.pop_front()
        {
            bytes += change.bytes();
            self.waiting_bytes = self.waiting_bytes.saturating_sub(change.bytes());
            taken.push(change);
        }
        if !self.changes.is_empty() {
            return taken;
        }
        while let Some(&asset) = self.changed.front() {
            if bytes >= max_bytes {
                return taken;
            }
            self.changed.pop_front();
            let refined = self.refined.get_mut(asset as usize).and_then(Option::as_mut);
            if let Some(change) = refined.and_then(|refined| refined.take_changes(asset, now_s)) {
                let change = Change::Mesh(change);
                bytes += change.bytes();
                taken.push(change);
            }
        }
        if self.first_frame == FirstFrame::Here {
            self.first_frame = FirstFrame::Told;
            taken.push(Change::FirstFrame);
        }
        while bytes < max_bytes
            && let Some(change) = self.terrain.as_mut().and_then(HeightOverridePatches::take_change)
        {
            bytes += change.bytes();
            taken.push(change);
        }
        while bytes < max_bytes
            && let Some(change) = self.textures.pop_front()
        {
            bytes += change.bytes();
            self.waiting_bytes = self.waiting_bytes.saturating_sub(change.bytes());
            taken.push(change);
        }
        taken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_scene::description::{AssetEntry, Camera, Light};

    fn header(pages: u32) -> SceneHeader {
        SceneHeader {
            name: "test".into(),
            fingerprint: [1; 16],
            asset_count: pages,
            instance_count: pages,
            page_count: pages,
            light: Light { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.1; 3] },
            background: [0.0; 3],
            terrain: None,
            camera: Camera { eye: [0.0, 0.0, 5.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 },
        }
    }

    fn page(number: u32) -> ScenePage {
        ScenePage {
            page: number,
            first_asset: number,
            first_instance: number,
            assets: vec![AssetEntry::default()],
            instances: vec![InstanceEntry::at(number, [0.0; 3])],
        }
    }

    #[test]
    fn pages_may_come_in_any_order_and_twice() {
        let mut scene = Scene::new(header(3));
        assert_eq!(scene.add_page(page(2), 100), Ok(0..0));
        assert_eq!(scene.add_page(page(0), 100), Ok(0..1));
        assert!(!scene.is_complete());
        assert_eq!(scene.add_page(page(0), 100), Ok(1..1));
        assert_eq!(scene.add_page(page(1), 100), Ok(1..3));
        assert!(scene.is_complete());
        assert_eq!(scene.instances.iter().map(|i| i.asset).collect::<Vec<_>>(), [0, 1, 2]);
        let changes = scene.take_changes(0.0, usize::MAX);
        assert!(matches!(changes[0], Change::Scene(_)));
        assert_eq!(changes.len(), 4);
    }

    #[test]
    fn pages_that_do_not_fit_are_refused() {
        let mut scene = Scene::new(header(2));
        assert!(scene.add_page(page(2), 100).is_err());
        let mut gap = page(0);
        gap.first_asset = 1;
        assert!(scene.add_page(gap, 100).is_err());
        let mut scene = Scene::new(header(2));
        let mut dangling = page(0);
        dangling.instances[0].asset = 1;
        assert!(scene.add_page(dangling, 100).is_err());
        assert!(Scene::new(header(2)).add_page(page(0), 0).is_err());
    }
}
