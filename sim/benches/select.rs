//! Times of selections of the demo scene's start view, with and without occlusion, at increasing refinement; then of up
//! to a million of its instances spread over a square, tested one by one and through their hierarchy.
//!
//! `cargo bench -p lodestream-sim --bench select`. Both alternate, so that load on the machine affects both. The camera
//! moves by a millimetre each time, so that occluders are rasterised anew for each selection.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_protocol::source::SceneSource;
use lodestream_scenario::plan::SceneChoice;
use lodestream_scenario::scene;
use lodestream_scenario::stopwatch::{median, paired_ratio, timed};
use lodestream_scene::description::Instance;
use lodestream_scene::view::View;
use lodestream_scene::{BlobId, BlobPart};
use lodestream_select::{AssetState, InstanceTree, Instances, Occluder, SelectSettings, Selector, State};

const TIMES: usize = 60;
/// As in `client/src/core/asset.rs`.
const OCCLUDER_FACES: usize = 2048;

fn main() -> anyhow::Result<()> {
    let cache = Path::new(env!("CARGO_TARGET_TMPDIR")).join("packs");
    let source = scene::open(&SceneChoice::Demo, None, &cache, true)?;
    let (instances, mut assets, mut meshes) = known(&*source)?;
    let view = source.header().camera.view([1280, 720], 1.0);
    many(&assets);
    println!("applied   occluders   hidden last, ms   without, ms   median of paired ratios");
    for level in 0..=8 {
        if level > 0 {
            refine(&*source, &mut assets, &mut meshes, level)?;
        }
        report(&view, &instances, &assets, &meshes);
    }
    Ok(())
}

/// Selections among instances a few metres apart, seen from their middle, 1.5 m above ground.
fn many(assets: &[AssetState]) {
    println!(
        "instances   looked at   making, ms   by hierarchy, ms   one by one, ms   median of paired ratios"
    );
    for count in [1000_u32, 10_000, 100_000, 1_000_000] {
        let side = f64::from(count).sqrt() * 5.0;
        let kinds = assets.len() as u32;
        // Weyl sequence: quasi-random and even.
        let place = |number: u32| {
            let along = |step: f64| (f64::from(number) * step).fract() * side;
            Instance::at(number % kinds, [along(0.754_877_666), 0.0, along(0.569_840_291)])
        };
        let instances: Vec<Instance> = (0..count).map(place).collect();
        let make =
            || InstanceTree::new(instances.iter(), |asset| assets.get(asset as usize).map(AssetState::entry));
        let (tree, making) = timed(make);
        let eye = [side / 2.0, 1.5, side / 2.0];
        let mut selectors = [(); 2].map(|()| Selector::default());
        let mut seconds = [Vec::new(), Vec::new()];
        let mut seen = 0;
        for turn in 0..12 {
            let angle = f64::from(turn) * 0.5;
            let target = [eye[0] + angle.cos(), eye[1], eye[2] + angle.sin()];
            let view = View::look_at(eye, target, [0.0, 1.0, 0.0], 0.9, [1280, 720]);
            let among = Instances::new(&instances, &tree);
            let [found, plain] = &mut selectors;
            let (found, took) = timed(|| found.select_among(&view, among, assets));
            seconds[0].push(took);
            let (plain, took) = timed(|| plain.select(&view, &instances, assets));
            seconds[1].push(took);
            assert_eq!(found, plain);
            seen = found.counters.visible_instances;
        }
        let ratio = paired_ratio(&seconds[1], &seconds[0]);
        let [with, without] = seconds.map(|seconds| median(seconds) * 1e3);
        let making = making * 1e3;
        println!("{count:>9}   {seen:>9}   {making:>10.1}   {with:>16.2}   {without:>14.2}   {ratio:>6.1}");
    }
}

/// All assets with base mesh and index.
fn known(source: &dyn SceneSource) -> anyhow::Result<(Vec<Instance>, Vec<AssetState>, Vec<ActiveMesh>)> {
    let (mut instances, mut assets, mut meshes) = (Vec::new(), Vec::new(), Vec::new());
    for number in 0..source.header().page_count {
        let page = source.page(number).context("no such page")?;
        instances.extend(&page.instances);
        for entry in &page.assets {
            let asset = u32::try_from(assets.len())?;
            let mut state = AssetState::new(entry.clone());
            state.set_state(BlobPart::Base, State::Applied);
            for page in 0..entry.index_pages() {
                let bytes = source.read(&BlobId::index_page(asset, page))?;
                state.add_index_page(page, decode_stated_page(&bytes, page * CHUNKS_PER_PAGE as u32)?)?;
            }
            let base = lodestream_compress::decode_base(&source.read(&BlobId::base(asset))?)?;
            let mesh = ActiveMesh::new(&base);
            look(&mut state, &mesh);
            assets.push(state);
            meshes.push(mesh);
        }
    }
    Ok((instances, assets, meshes))
}

fn look(state: &mut AssetState, mesh: &ActiveMesh) {
    let (positions, faces) = mesh.surface();
    state.set_occluder(Arc::new(Occluder::new(positions, faces)));
}

/// Applies all chunks of a level; occluders are captured when the mesh first has enough faces.
fn refine(
    source: &dyn SceneSource,
    assets: &mut [AssetState],
    meshes: &mut [ActiveMesh],
    level: u8,
) -> anyhow::Result<()> {
    for ((asset, state), mesh) in (0..).zip(assets).zip(meshes) {
        let chunks: Vec<u32> = (0..)
            .zip(state.chunks())
            .filter(|(_, chunk)| chunk.as_ref().is_some_and(|chunk| chunk.info().level == level))
            .map(|(number, _)| number)
            .collect();
        let fine = state.occluder().is_some_and(|occluder| occluder.faces().len() >= OCCLUDER_FACES);
        for chunk in chunks {
            let info = state.chunk(chunk).context("no such chunk")?.clone();
            let bytes = source.read(&BlobId::chunk(asset, chunk))?;
            mesh.apply(&lodestream_compress::decode_chunk(mesh, chunk, &info, &bytes)?)?;
            state.set_state(BlobPart::Chunk(chunk), State::Applied);
        }
        if !fine {
            look(state, mesh);
        }
    }
    Ok(())
}

fn report(view: &View, instances: &[Instance], assets: &[AssetState], meshes: &[ActiveMesh]) {
    let selector = |hidden_last| Selector::new(SelectSettings { hidden_last, ..SelectSettings::default() });
    let mut selectors = [selector(true), selector(false)];
    let mut seconds = [Vec::new(), Vec::new()];
    for turn in 0..TIMES {
        let mut view = *view;
        view.eye[0] += turn as f64 * 1e-3;
        for (selector, seconds) in selectors.iter_mut().zip(&mut seconds) {
            seconds.push(timed(|| selector.select(&view, instances, assets).wanted.len()).1);
        }
    }
    let faces: usize = meshes.iter().map(ActiveMesh::face_count).sum();
    let drawn: usize = assets.iter().filter_map(AssetState::occluder).map(|o| o.faces().len()).sum();
    let ratio = paired_ratio(&seconds[0], &seconds[1]);
    let [with, without] = seconds.map(|seconds| median(seconds) * 1e3);
    println!("{faces:>7}   {drawn:>9}   {with:>15.2}   {without:>11.2}   {ratio:>6.1}");
}
