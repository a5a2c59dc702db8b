//! Content of every technique of a plan for every scene, measured once and shared by all runs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context as _;
use glam::Vec3;
use lodestream_protocol::source::SceneSource;
use lodestream_store::LoadedAsset;

use super::levels::{self, Level};
use super::mesh_text;
use super::nodes::offer;
use super::offer::{Offer, Stage, Texture};
use crate::draco::Encoder;
use crate::peers::Peer;
use crate::plan::{Case, Plan};
use crate::technique::Technique;

/// Face counts of the older system's levels, in percent of all faces.
const SEED_PERCENT: [u64; 5] = [10, 30, 50, 70, 100];

/// Bits per axis of texture coordinates for Draco if the mesh has none.
const NO_UV_BITS: u8 = 12;

/// A scene in the form that a technique delivers.
#[derive(Clone, Debug)]
pub struct Content {
    /// Assets, instances and textures.
    pub stage: Arc<Stage>,
    /// By asset.
    pub offers: Vec<Offer>,
}

/// A technique's content for a scene, or the reason why it has none.
#[derive(Clone, Debug)]
pub enum Entry {
    /// The content.
    Ready(Arc<Content>),
    /// Reason why the technique is not run over the scene.
    NotRun(String),
}

/// The content of each scene, technique and peer.
#[derive(Clone, Debug, Default)]
pub struct Library(BTreeMap<(usize, Technique, Option<usize>), Entry>);

/// Lengths, and errors of levels, of one asset, for the requested techniques.
#[derive(Clone, Debug, Default, PartialEq)]
struct AssetFigures {
    obj: u64,
    obj_gzip: u64,
    draco: u64,
    chain: Vec<(u64, f32)>,
    seed_json: Vec<(u64, f32)>,
    textures: Vec<Texture>,
}

impl Library {
    /// Measures what a plan's baselines need. `scenes` are the plan's; `say` receives progress messages.
    ///
    /// # Errors
    /// A scene that cannot be read, an encoder that fails.
    pub fn prepare(
        plan: &Plan,
        scenes: &[Arc<dyn SceneSource>],
        mut say: impl FnMut(&str),
    ) -> anyhow::Result<Self> {
        let mut library = Self::default();
        for (number, (scene, named)) in scenes.iter().zip(&plan.scenes).enumerate() {
            let keys: BTreeSet<(Technique, Option<usize>)> = plan
                .cases
                .iter()
                .filter(|case| case.scene == number && !case.technique.is_ours())
                .map(|case| (case.technique, case.peer))
                .collect();
            if keys.is_empty() {
                continue;
            }
            say(&format!("measuring the baselines of {}", named.name));
            let draco = plan.draco.as_ref();
            let wanted: BTreeSet<Technique> = keys
                .iter()
                .map(|key| key.0)
                .filter(|technique| !technique.needs_draco() || draco.is_some())
                .collect();
            let measured = measure_all(&**scene, &wanted, draco)
                .with_context(|| format!("the baselines of {} cannot be measured", named.name))?;
            let stage = Arc::new(stage(&**scene, &measured)?);
            for (technique, peer) in keys {
                let entry = entry(&stage, &measured, technique, peer, plan);
                library.0.insert((number, technique, peer), entry);
            }
        }
        Ok(library)
    }

    /// The content for a case.
    pub(crate) fn find(&self, case: &Case) -> Option<&Entry> {
        self.0.get(&(case.scene, case.technique, case.peer))
    }
}

const NO_DRACO: &str = "not run: draco_encoder is not on this machine";
const NO_PEERS: &str = "not run: no file of peers is named (--peers FILE)";

/// Whether a run was skipped because a file or program is missing on this machine.
#[must_use]
pub fn lacks_something_here(ended: &str) -> bool {
    [NO_DRACO, NO_PEERS].contains(&ended)
}

fn entry(
    stage: &Arc<Stage>,
    measured: &[AssetFigures],
    technique: Technique,
    peer: Option<usize>,
    plan: &Plan,
) -> Entry {
    if technique.needs_draco() && plan.draco.is_none() {
        return Entry::NotRun(NO_DRACO.to_owned());
    }
    if technique == Technique::Nodes {
        let Some(peer) = peer.and_then(|peer| plan.peers.get(peer)) else {
            return Entry::NotRun(NO_PEERS.to_owned());
        };
        return nodes(stage, peer);
    }
    let whole = |bytes: u64| vec![(bytes, 0.0)];
    let offers = stage.assets.iter().zip(measured).map(|(asset, found)| {
        let levels = match technique {
            Technique::Obj => whole(found.obj),
            Technique::ObjGzip => whole(found.obj_gzip),
            Technique::Draco => whole(found.draco),
            Technique::Chain => found.chain.clone(),
            Technique::SeedJson => found.seed_json.clone(),
            Technique::Lodestream | Technique::Published | Technique::Nodes => Vec::new(),
        };
        Offer::chain(&levels, asset.sphere)
    });
    Entry::Ready(Arc::new(Content { stage: Arc::clone(stage), offers: offers.collect() }))
}

fn nodes(stage: &Arc<Stage>, peer: &Peer) -> Entry {
    let [asset] = &stage.assets[..] else {
        let count = stage.assets.len();
        return Entry::NotRun(format!("not run: nodes are those of one model, the scene has {count}"));
    };
    let offer = offer(peer, asset.origin);
    let center = Vec3::from(asset.sphere.center);
    let touches = |piece: u32| {
        let sphere = &offer.pieces[piece as usize].sphere;
        Vec3::from(sphere.center).distance(center) <= sphere.radius + asset.sphere.radius
    };
    if !offer.roots().all(touches) {
        return Entry::NotRun(format!("not run: the nodes of {:?} lie elsewhere than the model", peer.name));
    }
    Entry::Ready(Arc::new(Content { stage: Arc::clone(stage), offers: vec![offer] }))
}

fn stage(scene: &dyn SceneSource, measured: &[AssetFigures]) -> anyhow::Result<Stage> {
    let header = scene.header();
    let (mut assets, mut instances) = (Vec::new(), Vec::new());
    for number in 0..header.page_count {
        let page = scene.page(number).with_context(|| format!("scene page {number} is missing"))?;
        assets.extend(page.assets.iter().cloned());
        instances.extend_from_slice(&page.instances);
    }
    let textures = measured.iter().map(|found| found.textures.clone()).collect();
    Ok(Stage { camera: header.camera, assets, textures, instances })
}

/// Measures all assets in parallel; the result does not depend on the number of threads.
fn measure_all(
    scene: &dyn SceneSource,
    wanted: &BTreeSet<Technique>,
    draco: Option<&Encoder>,
) -> anyhow::Result<Vec<AssetFigures>> {
    let count = scene.header().asset_count as usize;
    let found: Mutex<BTreeMap<usize, anyhow::Result<AssetFigures>>> = Mutex::default();
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(count);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let asset = next.fetch_add(1, Ordering::Relaxed);
                    if asset >= count {
                        break;
                    }
                    // From a u32.
                    let measured = measure(scene, asset as u32, wanted, draco);
                    found.lock().unwrap_or_else(PoisonError::into_inner).insert(asset, measured);
                }
            });
        }
    });
    found.into_inner().unwrap_or_else(PoisonError::into_inner).into_values().collect()
}

fn measure(
    scene: &dyn SceneSource,
    number: u32,
    wanted: &BTreeSet<Technique>,
    draco: Option<&Encoder>,
) -> anyhow::Result<AssetFigures> {
    let asset = levels::load(scene, number)?;
    let mut found = AssetFigures { textures: Texture::of(&asset.description), ..AssetFigures::default() };
    let all = levels::faces(&asset);
    let wants = |technique| wanted.contains(&technique);
    if [Technique::Obj, Technique::ObjGzip, Technique::Draco].into_iter().any(wants) {
        let text = mesh_text::obj(&levels::level(&asset, u64::MAX)?.mesh)?;
        found.obj = text.len() as u64;
        if wants(Technique::ObjGzip) {
            found.obj_gzip = mesh_text::gzip_bytes(&text)?;
        }
        if wants(Technique::Draco) {
            found.draco = draco_bytes(&asset, &text, draco)?;
        }
    }
    if wants(Technique::Chain) {
        let counts = levels::halving(all, asset.base.faces.len() as u64);
        found.chain =
            distinct(&asset, &counts, |level| draco_bytes(&asset, &mesh_text::obj(&level.mesh)?, draco))?;
    }
    if wants(Technique::SeedJson) {
        let counts = SEED_PERCENT.map(|percent| all * percent / 100);
        found.seed_json =
            distinct(&asset, &counts, |level| Ok(mesh_text::gzip_bytes(&mesh_text::json(&level.mesh)?)?))?;
    }
    Ok(found)
}

/// The levels with these face counts, without those that are no finer than their predecessor.
fn distinct(
    asset: &LoadedAsset,
    counts: &[u64],
    bytes: impl Fn(&Level) -> anyhow::Result<u64>,
) -> anyhow::Result<Vec<(u64, f32)>> {
    let (mut found, mut faces) = (Vec::new(), None);
    for &count in counts {
        let level = levels::level(asset, count)?;
        if faces.is_none_or(|before| before < level.mesh.faces.len()) {
            faces = Some(level.mesh.faces.len());
            found.push((bytes(&level)?, level.error));
        }
    }
    Ok(found)
}

fn draco_bytes(asset: &LoadedAsset, obj: &[u8], draco: Option<&Encoder>) -> anyhow::Result<u64> {
    let uv_bits = if asset.base.uv_grid.bits > 0 { asset.base.uv_grid.bits } else { NO_UV_BITS };
    draco.context("there is no Draco encoder")?.bytes(obj, asset.base.grid.bits, uv_bits)
}
