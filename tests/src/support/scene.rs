//! The served scene, and its expected final state.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use bytes::Bytes;
use lodestream_bake::prepare::{Options, prepare_cached};
use lodestream_bake::scene::{Scene, of_files};
use lodestream_client::core::{Change, IndexRun, MeshChange, NewAsset, TextureChange, TexturePixels, Vertex};
use lodestream_geometry::ancestor_closed_cut::{Budget, lowest_error};
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_scene::animation::AnimationTable;
use lodestream_scene::description::{AssetEntry, SceneHeader, ScenePage};
use lodestream_scene::parts::PartTable;
use lodestream_scene::punctual_lights::{PunctualLight, PunctualLights, decode_page};
use lodestream_scene::{BlobId, BlobPart, Tile};
use lodestream_store::{BlobCache, DEFAULT_CACHE_BYTES, LoadedAsset, PackFile, SceneStore};

use super::shapes::write_scene;

/// A prepared scene.
pub(crate) struct TestScene {
    /// The source for a daemon.
    pub(crate) store: Arc<SceneStore>,
    /// The assets with all chunks, by asset number.
    pub(crate) assets: Vec<LoadedAsset>,
}

/// Preparation options: default settings without progress output.
pub(crate) fn options() -> Options {
    Options { quiet: true, ..Options::default() }
}

/// Prepares all assets of a scene into a cache folder.
pub(crate) fn prepare_all(scene: &Scene, cache: &Path) -> Vec<PackFile> {
    scene.assets.iter().map(|asset| prepare_cached(asset, cache, &options()).unwrap().pack).collect()
}

/// Writes a scene of hills without models; `terrain`: further settings of the terrain.
pub(crate) fn write_hills(folder: &Path, terrain: &str) -> std::path::PathBuf {
    let text = format!(
        "name = \"hills\"\n[camera]\neye = [60.0, 30.0, 70.0]\ntarget = [0.0, -10.0, 0.0]\n\
         [terrain]\nseed = 5\npatch_cells = 64\npatches = 64\namplitude = 12.0\n{terrain}"
    );
    let path = folder.join("scene.toml");
    std::fs::write(&path, text).unwrap();
    path
}

impl TestScene {
    /// Opens the packs as a scene.
    pub(crate) fn open(scene: &Scene, packs: Vec<PackFile>) -> Self {
        let loaded: Vec<_> =
            scene.assets.iter().zip(&packs).map(|(a, p)| (a.name.clone(), p.load().unwrap())).collect();
        let store = Arc::new(
            lodestream_bake::compose::open(scene, packs, &BlobCache::new(DEFAULT_CACHE_BYTES)).unwrap(),
        );
        let pages = (0..store.header().page_count).map(|page| store.page(page).unwrap());
        let names: Vec<String> = pages.flat_map(|p| p.assets.clone()).map(|entry| entry.name).collect();
        let find = |name: &String| loaded.iter().find(|(n, _)| n == name).unwrap().1.clone();
        let assets = names.iter().map(find).collect();
        Self { store, assets }
    }

    /// The small scene, prepared once for all tests. Its files are removed; the packs stay open.
    pub(crate) fn small() -> &'static Self {
        static SMALL: OnceLock<TestScene> = OnceLock::new();
        SMALL.get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let scene = of_files(&[write_scene(folder.path())]).unwrap();
            Self::open(&scene, prepare_all(&scene, &folder.path().join("cache")))
        })
    }

    pub(crate) fn source(&self) -> Arc<dyn SceneSource> {
        self.store.clone()
    }

    /// Number of an asset, by its name.
    pub(crate) fn asset(&self, name: &str) -> u32 {
        let number = self.assets.iter().position(|a| a.description.name == name).unwrap();
        u32::try_from(number).unwrap()
    }

    /// An asset's entry in the scene's pages.
    pub(crate) fn entry(&self, number: u32) -> AssetEntry {
        let pages = (0..self.store.header().page_count).map(|page| self.store.page(page).unwrap());
        pages.flat_map(|page| page.assets.clone()).nth(number as usize).unwrap()
    }

    /// Total bytes of all blobs.
    pub(crate) fn total_bytes(&self) -> u64 {
        let textures = |a: &LoadedAsset| {
            a.description.textures.iter().flat_map(|t| &t.levels).map(|l| u64::from(l.bytes)).sum::<u64>()
        };
        let chunks = |a: &LoadedAsset| a.chunks.iter().map(|c| c.len() as u64).sum::<u64>();
        self.assets.iter().map(|a| a.head_bytes() + chunks(a) + textures(a)).sum()
    }

    /// All punctual lights, in the order of their pages.
    pub(crate) fn punctual_lights(&self) -> Vec<PunctualLight> {
        let count = self.store.punctual_lights().map_or(0, |punctual_lights| punctual_lights.count);
        self.punctual_light_pages(count).flatten().collect()
    }

    fn punctual_light_pages(&self, count: u32) -> impl Iterator<Item = Vec<PunctualLight>> {
        (0..PunctualLights::pages_of(count)).map(move |page| {
            let bytes = self.store.read(&BlobId::punctual_light_page(page)).unwrap();
            decode_page(&bytes, PunctualLights::on_page(count, page)).unwrap()
        })
    }

    /// Faces of all assets, each counted once.
    pub(crate) fn faces(&self) -> u64 {
        let chunks = |a: &LoadedAsset| a.infos.iter().map(|info| u64::from(info.faces)).sum::<u64>();
        self.assets.iter().map(|a| a.base.faces.len() as u64 + chunks(a)).sum()
    }

    /// The changes for a renderer with everything applied: without network or selection, with all chunks and texture
    /// levels.
    pub(crate) fn whole(&self) -> Vec<Change> {
        self.refined(0.0)
    }

    /// The same with as few chunks as an error in the asset's units allows.
    pub(crate) fn refined(&self, error: f64) -> Vec<Change> {
        let header = self.store.header();
        let mut changes = vec![Change::Scene(Box::new(header.clone()))];
        for page in 0..header.page_count {
            changes.push(Change::Instances(self.store.page(page).unwrap().instances.clone()));
        }
        if let Some(&PunctualLights { count, .. }) = self.store.punctual_lights() {
            changes.push(Change::PunctualLights { count });
            let pages = (0..).zip(self.punctual_light_pages(count));
            changes.extend(pages.map(|(page, punctual_lights)| Change::PunctualLightPage {
                page,
                punctual_lights: punctual_lights.into(),
            }));
        }
        for (number, asset) in (0..).zip(&self.assets) {
            self.refined_asset(number, asset, error, &mut changes);
        }
        changes
    }

    fn refined_asset(&self, number: u32, asset: &LoadedAsset, error: f64, changes: &mut Vec<Change>) {
        let description = &asset.description;
        changes.push(Change::Asset(NewAsset {
            asset: number,
            origin: asset.base.grid.origin,
            center: asset.base.sphere.center,
            radius: asset.base.sphere.radius,
            materials: description.materials.clone(),
            textures: description.textures.clone(),
            shared: self.entry(number).shared,
        }));
        let budget = if error > 0.0 { Budget::Error(error) } else { Budget::Everything };
        let set = lowest_error(&asset.base, &asset.infos, 0, budget);
        assert!(set.error <= error && (error > 0.0 || set.members.len() == asset.infos.len()));
        let mesh = asset.refined(&set.members).unwrap();
        let vertex = |slot| Vertex { data: mesh.render_vertex(slot), birth_s: 0.0, level: 0 };
        let run = |material| IndexRun { material, first: 0, faces: mesh.indices(material).to_vec() };
        changes.push(Change::Mesh(MeshChange {
            asset: number,
            vertices: vec![(0, (0..mesh.wedge_slots()).map(vertex).collect())],
            indices: (0..mesh.material_count()).map(run).collect(),
            vertex_slots: mesh.wedge_slots(),
            index_slots: (0..mesh.material_count()).map(|m| mesh.indices(m).len() as u32).collect(),
        }));
        for (texture, info) in (0..).zip(&description.textures) {
            let images = (0..info.levels.len()).flat_map(|level| {
                let tiled = level >= info.whole_levels();
                (0..info.images(level)).map(move |tile| (level as u8, tiled.then_some(tile as u16)))
            });
            for (level, tile) in images {
                let whole = BlobPart::Texture { texture, level };
                let part = tile.map_or(whole, |tile| BlobPart::Tile(Tile { texture, level, tile }));
                let file = self.store.read(&BlobId::Asset { asset: number, part }).unwrap();
                let pixels = TexturePixels::decode(&file, info, (u32::from(level), tile)).unwrap().into();
                changes.push(Change::Texture(TextureChange { asset: number, texture, level, tile, pixels }));
            }
        }
    }
}

/// A scene with one blob missing.
pub(crate) struct Lacking {
    pub(crate) scene: Arc<dyn SceneSource>,
    pub(crate) blob: BlobId,
}

impl SceneSource for Lacking {
    fn header(&self) -> &SceneHeader {
        self.scene.header()
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        self.scene.page(page)
    }

    fn punctual_lights(&self) -> Option<&PunctualLights> {
        self.scene.punctual_lights()
    }

    fn parts(&self) -> Option<PartTable> {
        self.scene.parts()
    }

    fn animations(&self) -> Option<AnimationTable> {
        self.scene.animations()
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        self.scene.blob_len(id)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        if *id == self.blob { Err(SourceError::NotFound(*id)) } else { self.scene.read(id) }
    }
}
