//! What a worker computes in a tab equals what the same code computes natively, bit for bit.

use std::path::Path;

use lodestream_bake::preparation_settings::CodecChoice;
use lodestream_bake::scene::of_files;
use lodestream_geometry::Codec;
use lodestream_scenario::plan::SceneChoice;
use lodestream_terrain::{Terrain, encode_points, encode_stamps};
use lodestream_web::{PackCheck, TerrainCheck};
use serde_json::{Value, json};

use super::devtools::WEBGL;
use super::files::Files;
use super::{built, tab_with};
use crate::support::scene::write_hills;

/// Runs a folder's task in a worker.
const PAGE: &str = "<!doctype html>
<script type='module'>
  const worker = new Worker('worker.js', { type: 'module' });
  worker.onmessage = ({ data }) => (window.result = data);
  worker.onerror = ({ message }) => (window.result = { error: message });
</script>";

/// The worker: for each pack of the task its hash, number of chunks and times in milliseconds; the hash of the terrain.
const WORKER: &str = "
import init, { PackCheck, TerrainCheck } from './checks.js';
const bytes = async (name) => new Uint8Array(await (await fetch(name)).arrayBuffer());
const run = async () => {
  await init();
  const { packs, rounds, patches, spacings, reach } = await (await fetch('task.json')).json();
  const results = [];
  for (let number = 0; number < packs; number += 1) {
    const pack = new PackCheck(await bytes(`${number}.pack`));
    const times = [];
    for (let round = 0; round < rounds; round += 1) {
      const begun = performance.now();
      pack.refine();
      times.push(performance.now() - begun);
    }
    results.push({ hash: pack.hash(), chunks: pack.chunks(), times });
    pack.free();
  }
  if (!patches) return { packs: results };
  const terrain = new TerrainCheck(await bytes('parameters'), await bytes('stamps'));
  for (const [number, [x, y]] of patches.entries()) terrain.set_points(x, y, await bytes(`${number}.points`));
  return { packs: results, terrain: terrain.hash(spacings, reach) };
};
run().then(postMessage, (why) => postMessage({ error: String(why) }));
";

/// Spacings and reach of the tiles that are compared: beyond the terrain's features.
const SPACINGS: u8 = 5;
const REACH: i32 = 6;

/// All packs below a folder, in the order of their paths.
pub(super) fn packs_below(folder: &Path) -> Vec<Vec<u8>> {
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let files = paths.iter().filter(|path| path.is_file()).map(|path| std::fs::read(path).unwrap());
    files.filter(|bytes| bytes.starts_with(b"LODSPACK")).collect()
}

/// Runs the checks in a worker of a tab: packs that are refined `rounds` times each, and a terrain. `None` if tests in a
/// browser are skipped.
pub(super) fn in_a_worker(packs: &[Vec<u8>], rounds: u32, terrain: Option<&Terrain>) -> Option<Value> {
    let mut tab = tab_with([64, 64], WEBGL)?;
    let module = built("web-checks", "checks.js");
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    for name in ["checks.js", "checks_bg.wasm"] {
        write(name, &std::fs::read(module.join(name)).unwrap());
    }
    write("worker.js", WORKER.as_bytes());
    for (number, pack) in packs.iter().enumerate() {
        write(&format!("{number}.pack"), pack);
    }
    let mut task = json!({ "packs": packs.len(), "rounds": rounds, "spacings": SPACINGS, "reach": REACH });
    if let Some(terrain) = terrain {
        write("parameters", &terrain.parameters().encode());
        write("stamps", &encode_stamps(terrain.stamps()).unwrap());
        for (number, (_, points)) in patches(terrain).iter().enumerate() {
            write(&format!("{number}.points"), points);
        }
        task["patches"] = patches(terrain).into_iter().map(|(patch, _)| patch).collect();
    }
    write("task.json", task.to_string().as_bytes());
    let site = Files::start(folder.path().to_owned(), PAGE.to_owned());
    tab.navigate(&format!("{}/page.html", site.origin()));
    let result = tab.wait("the checks", "window.result", |result| !result.is_null());
    assert!(result["error"].is_null(), "{}", result["error"]);
    Some(result)
}

/// Column, row and encoded height overrides of each patch that has them.
fn patches(terrain: &Terrain) -> Vec<([i32; 2], Vec<u8>)> {
    let finest = terrain.parameters().finest_level;
    let all = terrain.patches_with_points().map(|(x, y)| {
        let points = encode_points(finest, terrain.points(x, y).unwrap()).unwrap();
        ([x, y].map(|number| i32::try_from(number).unwrap()), points)
    });
    all.collect()
}

/// Eroded hills with stamps and, in four patches, height overrides.
fn terrain(folder: &Path) -> Terrain {
    let pit = (-20..=20_i32).flat_map(|y| (-20..=20_i32).map(move |x| (x, y)));
    let pit: Vec<_> = pit.map(|(x, y)| json!([x, y, -2500 + 4 * (x * x + y * y)])).collect();
    std::fs::write(folder.join("pit.json"), json!({ "mode": "fixed", "points": pit }).to_string()).unwrap();
    let settings = r#"features = "pit.json"
distribution = "gaussian"
roughness = 0.55
erosion = { level = 5, passes = 6, talus_degrees = 30 }
[[terrain.stamp]]
kind = "ridge"
from = [-200, -150]
to = [200, -190]
half_width = 60
height = 40
[[terrain.stamp]]
kind = "crater"
centre = [90, 60]
radius = 40
depth = 12
rim = 4
"#;
    let scene = of_files(&[write_hills(folder, settings)]).unwrap();
    scene.terrain.unwrap().terrain
}

#[test]
fn a_tab_decodes_chunks_and_generates_terrain_as_the_native_client() {
    let folder = tempfile::tempdir().unwrap();
    let mut packs = Vec::new();
    for codec in [Codec::Range, Codec::AxisAligned, Codec::Zstd] {
        let cache = folder.path().join(codec.to_string());
        lodestream_scenario::scene::open(
            &SceneChoice::DemoSmall,
            Some(CodecChoice::Codec(codec)),
            &cache,
            true,
        )
        .unwrap();
        packs.extend(packs_below(&cache));
    }
    assert!(packs.len() > 9, "{} packs", packs.len());
    let terrain = terrain(folder.path());
    assert_eq!(patches(&terrain).len(), 4);
    let Some(found) = in_a_worker(&packs, 1, Some(&terrain)) else { return };

    let mut chunks = 0;
    for (number, pack) in packs.iter().enumerate() {
        let mut native = PackCheck::new(pack).unwrap();
        native.refine().unwrap();
        chunks += native.chunks();
        assert_eq!(found["packs"][number]["hash"], native.hash().unwrap(), "pack {number}");
    }
    println!("{chunks} chunks of {} packs", packs.len());
    assert!(chunks > 50, "{chunks} chunks");

    let parameters = terrain.parameters().encode();
    let stamps = encode_stamps(terrain.stamps()).unwrap();
    let mut native = TerrainCheck::new(&parameters, &stamps).unwrap();
    let bare = native.hash(SPACINGS, REACH);
    for ([x, y], points) in patches(&terrain) {
        native.set_points(x, y, &points).unwrap();
    }
    let expected = native.hash(SPACINGS, REACH);
    assert_ne!(bare, expected, "the compared tiles have overrides");
    assert_eq!(found["terrain"], expected);
}
