//! The received part of the scene: header, pages, assets, and the queue of changes for a renderer.

mod restate;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;

use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::{Instance, SceneHeader, ScenePage};
use lodestream_scene::proxy::{Cut, Proxies, Proxy, ProxyError};
use lodestream_select::{AssetState, InstanceTree, Instances, State};

use super::animated_models::AnimatedModels;
use super::asset::RefinedAsset;
use super::changes::{Change, NewAsset};
use super::height_overrides::HeightOverridePatches;
use super::punctual_light_pages::PunctualLightPages;
use super::shared_textures::{SharedTextureError, SharedTextures};

/// Most scene pages kept that arrived out of order.
const MAX_EARLY_PAGES: usize = 256;

/// Most instances outside the tree, which selections visit one by one.
const MAX_OUTSIDE_TREE: usize = 1024;

/// The received part of the scene.
#[derive(Debug, Default)]
pub(crate) struct Scene {
    pub(crate) header: Option<SceneHeader>,
    instances: Vec<Instance>,
    /// Bounding volume tree of the first instances; at most as many again are outside it.
    tree: InstanceTree,
    /// Meshes that stand for runs of instances.
    proxies: Proxies,
    /// What is drawn, and whether a renderer knows it.
    cut: (Cut, bool),
    /// States of the blobs of each asset.
    pub(crate) states: Vec<AssetState>,
    /// The assets whose base mesh has arrived; as long as `states`.
    pub(crate) refined: Vec<Option<RefinedAsset>>,
    /// Textures that assets share.
    pub(super) shared: SharedTextures,
    /// Height overrides of the terrain, if there is one.
    pub(super) terrain: Option<HeightOverridePatches>,
    /// Punctual lights, if the scene has any.
    pub(super) punctual_lights: Option<PunctualLightPages>,
    /// Animated models, if the scene has any.
    pub(super) animations: Option<AnimatedModels>,
    next_page: u32,
    /// Pages that arrived out of order.
    early: BTreeMap<u32, ScenePage>,
    /// Changes for a renderer other than meshes and textures, in order.
    changes: VecDeque<Change>,
    /// Assets whose meshes have changed since the last fetch, in the order of their first change: chunks are applied in
    /// order of priority.
    changed: VecDeque<u32>,
    /// Assets whose meshes have changed since they were counted, with repetitions.
    uncounted: Vec<u32>,
    /// Faces and bytes of all meshes, in client and renderer, as of the last count.
    counted: (u64, u64),
    /// Assets whose meshes use less than half of their slots.
    sparse: BTreeSet<u32>,
    /// Changes of textures, which may be many megabytes.
    textures: VecDeque<Change>,
    waiting_bytes: usize,
    first_frame: FirstFrame,
}

/// Why a scene page does not fit the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum ScenePageError {
    #[error("a scene page has arrived before the scene's header")]
    BeforeHeader,
    #[error("a scene page has a number beyond the last")]
    NoSuchPage,
    #[error("too many scene pages have arrived out of order")]
    TooManyEarly,
    #[error("the entries of a scene page do not follow those of the page before")]
    Gap,
    #[error("the scene has more entries than announced or allowed")]
    TooManyEntries,
    #[error("an instance refers to an asset of a later page")]
    AssetOfLaterPage,
    #[error(transparent)]
    Proxy(#[from] ProxyError),
    #[error(transparent)]
    SharedTexture(#[from] SharedTextureError),
}

/// Progress of [`Change::FirstFrame`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum FirstFrame {
    /// The first frame is not complete.
    #[default]
    Incomplete,
    /// It is complete; the renderer has not fetched all of it.
    Complete,
    /// The renderer has fetched it.
    Delivered,
}

impl Scene {
    pub(crate) fn new(header: SceneHeader) -> Self {
        let changes = VecDeque::from([Change::Scene(Box::new(header.clone()))]);
        let terrain = header.terrain.as_deref().cloned().map(HeightOverridePatches::new);
        Self { header: Some(header), terrain, changes, ..Self::default() }
    }

    /// Whether a page has arrived and is in order.
    pub(crate) const fn has_page(&self) -> bool {
        self.next_page > 0
    }

    /// Adds a page; returns the numbers of the assets that have become known.
    ///
    /// # Errors
    /// The page does not fit the scene.
    pub(crate) fn add_page(
        &mut self,
        page: ScenePage,
        max_entries: u32,
    ) -> Result<std::ops::Range<u32>, ScenePageError> {
        let first = self.asset_count();
        let Some(header) = &self.header else { return Err(ScenePageError::BeforeHeader) };
        let (page_count, asset_count, instance_count) =
            (header.page_count, header.asset_count, header.instance_count);
        if page.page >= page_count {
            return Err(ScenePageError::NoSuchPage);
        }
        if page.page < self.next_page {
            return Ok(first..first);
        }
        if page.page > self.next_page && self.early.len() >= MAX_EARLY_PAGES {
            return Err(ScenePageError::TooManyEarly);
        }
        self.early.insert(page.page, page);
        while let Some(page) = self.early.remove(&self.next_page) {
            let (assets, instances) = (self.states.len(), self.instances.len());
            if page.first_asset as usize != assets || page.first_instance as usize != instances {
                return Err(ScenePageError::Gap);
            }
            let assets = assets + page.assets.len();
            let instances = instances + page.instances.len();
            if assets > (asset_count.min(max_entries)) as usize
                || instances > (instance_count.min(max_entries)) as usize
            {
                return Err(ScenePageError::TooManyEntries);
            }
            if page.instances.iter().any(|i| i.asset as usize >= assets) {
                return Err(ScenePageError::AssetOfLaterPage);
            }
            for (number, entry) in (page.first_asset..).zip(page.assets) {
                self.shared.add(number, &entry, &self.states)?;
                self.states.push(AssetState::new(entry));
            }
            self.refined.resize_with(self.states.len(), || None);
            self.proxies.add(page.first_proxy, &page.proxies, self.asset_count(), instance_count)?;
            if self.proxies.len() > max_entries {
                return Err(ScenePageError::TooManyEntries);
            }
            if !page.proxies.is_empty() {
                self.push_change(Change::Proxies(page.proxies));
            }
            self.instances.extend(&page.instances);
            if !page.instances.is_empty() {
                self.push_change(Change::Instances(page.instances));
            }
            self.next_page += 1;
        }
        Ok(first..self.asset_count())
    }

    /// Rebuilds the tree of instances once as many are outside it as in it, so that all builds together cost at most
    /// twice the last one.
    pub(crate) fn update_tree(&mut self) {
        if self.instances.len() - self.tree.len() > self.tree.len().max(MAX_OUTSIDE_TREE) {
            let asset = |number: u32| self.states.get(number as usize).map(AssetState::entry);
            self.tree = InstanceTree::new(self.instances.iter(), asset);
        }
    }

    /// The instances.
    pub(crate) fn instances(&self) -> Instances<'_> {
        Instances::new(&self.instances, &self.tree).with_proxies(&self.proxies)
    }

    /// What is drawn.
    pub(crate) const fn cut(&self) -> &Cut {
        &self.cut.0
    }

    /// The proxies that are drawn, with their numbers.
    pub(crate) fn drawn_proxies(&self) -> impl Iterator<Item = (u32, &Proxy)> {
        let node = |&number: &u32| Some((number, &self.proxies.nodes().get(number as usize)?.proxy));
        self.cut.0.proxies.iter().filter_map(node)
    }

    /// Whether an instance is drawn, rather than a proxy.
    pub(crate) fn is_drawn(&self, instance: u32) -> bool {
        self.proxies.is_empty() || self.cut.0.draws(instance)
    }

    /// Whether proxies stand for all instances of the scene, so that pictures are whole before all pages have arrived.
    pub(crate) fn proxies_stand_for_all(&self) -> bool {
        let Some(header) = self.header.as_ref().filter(|_| !self.proxies.is_empty()) else { return false };
        let mut end = 0;
        for &root in self.proxies.roots() {
            let of = self.proxies.nodes()[root as usize].proxy.instances();
            if of.start != end {
                return false;
            }
            end = of.end;
        }
        end == header.instance_count
    }

    /// Sets what is drawn. The renderer gets to know it after the meshes of which it consists.
    pub(crate) fn set_cut(&mut self, cut: &Cut) {
        if self.cut.0 != *cut {
            self.cut = (cut.clone(), false);
        }
    }

    /// Whether all pages have arrived.
    pub(crate) fn is_complete(&self) -> bool {
        self.header.as_ref().is_some_and(|h| self.next_page >= h.page_count)
    }

    /// The asset that a blob belongs to, if it is known, and the part that the blob is.
    pub(crate) fn asset(&self, id: BlobId) -> Option<(&AssetState, BlobPart)> {
        let BlobId::Asset { asset, part } = id else { return None };
        self.states.get(asset as usize).map(|state| (state, part))
    }

    /// As [`Scene::asset`], mutable.
    pub(crate) fn asset_mut(&mut self, id: BlobId) -> Option<(&mut AssetState, BlobPart)> {
        let BlobId::Asset { asset, part } = id else { return None };
        self.states.get_mut(asset as usize).map(|state| (state, part))
    }

    /// The assets and textures that share a texture level or tile and do not have it applied yet.
    pub(crate) fn unapplied_sharers(&self, id: BlobId) -> Vec<(u32, u16)> {
        let of = |id| {
            let (asset, part) = self.asset(id)?;
            let waits = asset.has_image(part) && asset.state(part) != State::Applied;
            Some((id.asset()?, part.texture()?)).filter(|_| waits)
        };
        self.shared.same(id).filter_map(of).collect()
    }

    /// State of an asset's blob. For a shared texture: the state for those assets that do not have it applied yet.
    pub(crate) fn state(&self, id: BlobId) -> State {
        let Some((asset, part)) = self.asset(id) else { return State::Absent };
        if part.texture().is_none() {
            return asset.state(part);
        }
        // Assets without a base mesh have no known textures yet.
        let described = self
            .shared
            .same(id)
            .filter_map(|id| self.asset(id).filter(|(asset, part)| asset.has_image(*part)));
        let states = described.map(|(asset, part)| asset.state(part));
        states.reduce(|one, other| if one == State::Applied { other } else { one }).unwrap_or_default()
    }

    /// Sets the state of an asset's blob; for a shared texture, of all assets that do not have it applied.
    pub(crate) fn set_state(&mut self, id: BlobId, new: State) {
        for id in self.shared.same(id) {
            let BlobId::Asset { asset, part } = id else { continue };
            let Some(state) = self.states.get_mut(asset as usize) else { continue };
            let is_applied = part.texture().is_some() && state.state(part) == State::Applied;
            if !is_applied {
                state.set_state(part, new);
            }
        }
    }

    /// Marks a texture level or tile as not applied, for all assets that share it.
    pub(crate) fn set_unapplied(&mut self, id: BlobId) {
        for id in self.shared.same(id) {
            let BlobId::Asset { asset, part } = id else { continue };
            if let Some(state) = self.states.get_mut(asset as usize).filter(|_| part.texture().is_some()) {
                state.set_state(part, State::Absent);
            }
        }
    }

    /// Takes a tile from all assets that have it applied.
    pub(crate) fn remove_tile(&mut self, id: BlobId) {
        let applied =
            |id: &BlobId| self.asset(*id).is_some_and(|(asset, part)| asset.state(part) == State::Applied);
        let applied: Vec<BlobId> = self.shared.same(id).filter(applied).collect();
        self.set_unapplied(id);
        for id in applied {
            if let BlobId::Asset { asset, part: BlobPart::Tile(tile) } = id {
                self.push_change(Change::TileRemoved { asset, tile });
            }
        }
    }

    /// Number of known assets.
    pub(crate) fn asset_count(&self) -> u32 {
        u32::try_from(self.states.len()).unwrap_or(u32::MAX)
    }

    /// Adds an asset's decoded base mesh.
    pub(crate) fn set_base(&mut self, asset: u32, mut refined: RefinedAsset) {
        let Some(state) = self.states.get_mut(asset as usize) else { return };
        if let Some(before) = &self.refined[asset as usize] {
            refined.counted = before.counted;
        }
        state.set_description(&refined.description);
        self.refined[asset as usize] = Some(refined);
        if let Some(new) = self.new_asset(asset) {
            self.push_change(Change::Asset(new));
        }
        self.note_changed(asset);
    }

    /// An asset whose base mesh has arrived, as a renderer first gets it.
    fn new_asset(&self, asset: u32) -> Option<NewAsset> {
        let refined = self.refined.get(asset as usize)?.as_ref()?;
        let entry = self.states.get(asset as usize)?.entry();
        let mut materials = refined.description.materials.clone();
        if materials.is_empty() {
            materials.push(lodestream_scene::asset::Material::default());
        }
        Some(NewAsset {
            asset,
            origin: refined.origin,
            center: entry.sphere.center,
            radius: entry.sphere.radius,
            materials,
            textures: refined.description.textures.clone(),
            shared: entry.shared.clone(),
        })
    }

    /// Queues an asset whose mesh has changed for the renderer, unless it is queued already.
    pub(crate) fn note_changed(&mut self, asset: u32) {
        if self.uncounted.last() != Some(&asset) {
            self.uncounted.push(asset);
        }
        let refined = self.refined.get_mut(asset as usize).and_then(Option::as_mut);
        if refined.is_some_and(RefinedAsset::enqueue) {
            self.changed.push_back(asset);
        }
    }

    /// Notes an asset of which a chunk was undone.
    pub(crate) fn note_undone(&mut self, asset: u32) {
        let refined = self.refined.get(asset as usize).and_then(Option::as_ref);
        if refined.is_some_and(RefinedAsset::is_sparse) {
            self.sparse.insert(asset);
        }
    }

    /// Takes a step of compacting a mesh that uses less than half of its slots; returns whether there was one.
    pub(crate) fn compact(&mut self) -> bool {
        let mut sparse = std::mem::take(&mut self.sparse);
        let mut compacted = None;
        sparse.retain(|&asset| {
            let refined = self.refined.get_mut(asset as usize).and_then(Option::as_mut);
            let Some(refined) = refined.filter(|refined| refined.is_sparse()) else { return false };
            if compacted.is_none() && refined.compact() {
                compacted = Some(asset);
            }
            refined.is_sparse()
        });
        self.sparse = sparse;
        compacted.inspect(|&asset| self.note_changed(asset)).is_some()
    }

    /// Faces and bytes of all meshes, in client and renderer. Costs what has changed since the last call.
    pub(crate) fn update_mesh_bytes(&mut self) -> (u64, u64) {
        for asset in self.uncounted.drain(..) {
            let refined = self.refined.get_mut(asset as usize).and_then(Option::as_mut);
            let Some([before, now]) = refined.map(RefinedAsset::growth) else { continue };
            self.counted.0 = self.counted.0 + now.0 - before.0;
            self.counted.1 = self.counted.1 + now.1 - before.1;
        }
        self.counted
    }

    /// Updates the occluders that selections use.
    pub(crate) fn update_occluders(&mut self) {
        for (state, refined) in self.states.iter_mut().zip(&mut self.refined) {
            if let Some(occluder) = refined.as_mut().and_then(RefinedAsset::better_occluder) {
                state.set_occluder(Arc::new(occluder));
            }
        }
    }

    /// Queues a change other than a mesh's.
    pub(crate) fn push_change(&mut self, change: Change) {
        self.waiting_bytes += change.bytes();
        match change {
            Change::Texture(_) | Change::TileRemoved { .. } => self.textures.push_back(change),
            _ => self.changes.push_back(change),
        }
    }

    /// Records that everything for the first frame has arrived.
    pub(crate) fn note_first_frame(&mut self) {
        if self.first_frame == FirstFrame::Incomplete {
            self.first_frame = FirstFrame::Complete;
        }
    }

    /// Drops all queued changes: there is no renderer.
    pub(crate) fn drop_changes(&mut self) {
        self.changes.clear();
        self.textures.clear();
        self.waiting_bytes = 0;
    }

    /// Memory of the queued changes in bytes, meshes not counted.
    pub(crate) const fn waiting_bytes(&self) -> usize {
        self.waiting_bytes
    }

    /// Whether [`Scene::take_changes`] has a change.
    pub(crate) fn has_changes(&self) -> bool {
        let terrain = self.terrain.as_ref().is_some_and(HeightOverridePatches::has_changes);
        let other = !self.changes.is_empty() || !self.textures.is_empty();
        let first_frame = self.first_frame == FirstFrame::Complete || self.has_new_cut();
        other || first_frame || terrain || self.changed.iter().any(|&asset| self.has_mesh_changes(asset))
    }

    /// Whether a renderer does not know what is drawn. Without proxies, all instances are.
    fn has_new_cut(&self) -> bool {
        !self.proxies.is_empty() && !self.cut.1
    }

    fn has_mesh_changes(&self, asset: u32) -> bool {
        self.refined.get(asset as usize).and_then(Option::as_ref).is_some_and(RefinedAsset::has_changes)
    }

    /// Takes changes in order, about `max_bytes` of them, but at least one. Meshes come before textures, so that no
    /// object is absent while others get their textures.
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
        if self.has_new_cut() {
            self.cut.1 = true;
            taken.push(Change::Cut(self.cut.0.clone()));
        }
        if self.first_frame == FirstFrame::Complete {
            self.first_frame = FirstFrame::Delivered;
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
    use lodestream_scene::description::{AssetEntry, Camera, SceneLighting};

    fn header(pages: u32) -> SceneHeader {
        SceneHeader {
            name: "test".into(),
            fingerprint: [1; 16],
            asset_count: pages,
            instance_count: pages,
            page_count: pages,
            light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.1; 3] },
            background: [0.0; 3],
            terrain: None,
            camera: Camera { eye: [0.0, 0.0, 5.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 },
            root_slope: 0.0,
        }
    }

    fn page(number: u32) -> ScenePage {
        ScenePage {
            page: number,
            first_asset: number,
            first_instance: number,
            assets: vec![AssetEntry::default()],
            instances: vec![Instance::at(number, [0.0; 3])],
            ..ScenePage::default()
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
    fn pages_that_do_not_fit_are_errors() {
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
