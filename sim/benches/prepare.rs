//! Times of the stages of preparation, and of decoding and applying the result, against meshoptimizer's `simplify`, in
//! one run on one thread, and memory of preparation.
//!
//! `cargo bench -p lodestream-sim --bench prepare -- [MODEL.obj…]` takes the named models, else those in the folder
//! `LODESTREAM_MODELS`, else a generated mesh, each with its best codec. Import and quantisation are not timed. Times
//! are the best of three and depend on the machine: use ratios. `--json` prints an object per line. If Draco's programs
//! (`draco_encoder`, `draco_decoder`) are found, its decoder is timed on the same file, with a resolution of a
//! millisecond.

mod heap;
mod models;

use std::path::Path;
use std::process::Command;
use std::sync::Mutex;
use std::time::Instant;

use lodestream_geometry::Settings;
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::pool::{Monitor, Progress, Serial, Stage};
use lodestream_geometry::prepare::{Hooks, Prepared, prepare, select_codec, suit};
use lodestream_geometry::refine::ActiveMesh;

/// Number of times that each step is run.
const RUNS: usize = 3;
/// meshoptimizer's target: one face of so many.
const TARGET: usize = 100;

fn main() -> anyhow::Result<()> {
    let json = std::env::args().any(|a| a == "--json");
    if !json {
        println!(
            "{:<16} {:>8} | k faces/s: {:>8} {:>8} {:>8} {:>8} {:>11} | {:>9} | heap, B/face: {:>8} {:>8} {:>8} | \
             k splits/s: {:>8} {:>8} {:>8} {:>12} {:>12}",
            "model",
            "faces",
            "simplify",
            "measure",
            "encode",
            "all",
            "meshopt 1 %",
            "simplify",
            "simplify",
            "measure",
            "encode",
            "decode",
            "apply",
            "both",
            "both / peer",
            "both / Draco"
        );
    }
    for (name, file, mesh) in models::quantised(|_| ())? {
        let draco = file.as_deref().and_then(draco);
        let row = row(name, mesh, draco)?;
        if json { println!("{}", serde_json::to_string(&row)?) } else { row.print() }
    }
    Ok(())
}

/// Results for a model.
#[derive(serde::Serialize)]
struct Row {
    model: String,
    faces: usize,
    splits: u32,
    simplify_faces_per_s: f64,
    measure_faces_per_s: f64,
    encode_faces_per_s: f64,
    prepare_faces_per_s: f64,
    /// meshoptimizer.
    peer_faces_per_s: f64,
    simplify_heap_bytes: usize,
    measure_heap_bytes: usize,
    encode_heap_bytes: usize,
    decode_splits_per_s: f64,
    apply_splits_per_s: f64,
    /// Decoding and applying.
    refine_splits_per_s: f64,
    simplify_over_peer_time: f64,
    refine_over_peer_time: f64,
    /// Relative to Draco's decoder of the same file; `None` without Draco.
    refine_over_draco_time: Option<f64>,
}

impl Row {
    fn print(&self) {
        let heap = [self.simplify_heap_bytes, self.measure_heap_bytes, self.encode_heap_bytes]
            .map(|bytes| bytes as f64 / self.faces as f64);
        println!(
            "{:<16} {:>8} |            {:>8.0} {:>8.0} {:>8.0} {:>8.0} {:>11.0} | {:>7.1} x |               {:>8.0} {:>8.0} \
             {:>8.0} |             {:>8.0} {:>8.0} {:>8.0} {:>12.2} {:>12.2}",
            self.model,
            self.faces,
            self.simplify_faces_per_s / 1e3,
            self.measure_faces_per_s / 1e3,
            self.encode_faces_per_s / 1e3,
            self.prepare_faces_per_s / 1e3,
            self.peer_faces_per_s / 1e3,
            self.simplify_over_peer_time,
            heap[0],
            heap[1],
            heap[2],
            self.decode_splits_per_s / 1e3,
            self.apply_splits_per_s / 1e3,
            self.refine_splits_per_s / 1e3,
            self.refine_over_peer_time,
            self.refine_over_draco_time.unwrap_or(f64::NAN)
        );
    }
}

fn row(model: String, mut mesh: QuantisedMesh, draco: Option<f64>) -> anyhow::Result<Row> {
    let settings = Settings { codec: select_codec(&mesh), ..Settings::default() };
    suit(&mut mesh, settings.codec);
    let mesh = &mesh;
    let mut best = [f64::INFINITY; 5];
    let mut heap = [0; 3];
    let mut refining = [f64::INFINITY; 2];
    let mut splits = 0;
    for _ in 0..RUNS {
        let before = heap::used();
        let watch = StopWatch::new();
        let start = Instant::now();
        let prepared = prepare(mesh, &settings, &Hooks::new(&Serial, &watch))?;
        let all = start.elapsed().as_secs_f64();
        let ([simplify, measure, encode], peaks) = watch.finish();
        splits = prepared.infos.iter().map(|i| i.vertices).sum();
        for (best, time) in refining.iter_mut().zip(refine(&prepared)?) {
            *best = best.min(time);
        }
        drop(prepared);
        heap = peaks.map(|peak| peak.saturating_sub(before));
        let peer = meshoptimizer(mesh)?;
        for (best, time) in best.iter_mut().zip([simplify, measure, encode, all, peer]) {
            *best = best.min(time);
        }
    }
    let [simplify, measure, encode, all, peer] = best;
    let [decode, apply] = refining;
    let (faces, split_count) = (mesh.faces.len() as f64, f64::from(splits));
    Ok(Row {
        model,
        faces: mesh.faces.len(),
        splits,
        simplify_faces_per_s: faces / simplify,
        measure_faces_per_s: faces / measure,
        encode_faces_per_s: faces / encode,
        prepare_faces_per_s: faces / all,
        peer_faces_per_s: faces / peer,
        simplify_heap_bytes: heap[0],
        measure_heap_bytes: heap[1],
        encode_heap_bytes: heap[2],
        decode_splits_per_s: split_count / decode,
        apply_splits_per_s: split_count / apply,
        refine_splits_per_s: split_count / (decode + apply),
        simplify_over_peer_time: simplify / peer,
        refine_over_peer_time: (decode + apply) / peer,
        refine_over_draco_time: draco.map(|draco| (decode + apply) / draco),
    })
}

/// Seconds of Draco's decoder for a file encoded at the same precision: the best of some runs.
fn draco(model: &Path) -> Option<f64> {
    let folder = tempfile::tempdir().ok()?;
    let [coded, back] = ["coded.drc", "back.ply"].map(|name| folder.path().join(name));
    let run = |program: &str, from: &Path, to: &Path, more: &[&str]| {
        let output = Command::new(program).arg("-i").arg(from).arg("-o").arg(to).args(more).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).into_owned())
    };
    run("draco_encoder", model, &coded, &["-qp", "12", "-qt", "12", "-cl", "7"])?;
    let milliseconds = |_| {
        let said = run("draco_decoder", &coded, &back, &[])?;
        said.split_once('(')?.1.split_once(" ms to decode")?.0.parse::<f64>().ok()
    };
    let best = (0..3 * RUNS).filter_map(milliseconds).fold(f64::INFINITY, f64::min);
    (best > 0.0 && best.is_finite()).then_some(best / 1e3)
}

/// Seconds of decoding and of applying all chunks.
fn refine(prepared: &Prepared) -> anyhow::Result<[f64; 2]> {
    let mut mesh = ActiveMesh::new(&prepared.base);
    let mut seconds = [0.0; 2];
    for (id, (info, payload)) in prepared.infos.iter().zip(&prepared.chunks).enumerate() {
        let start = Instant::now();
        let delta = mesh.decode(id as u32, info, payload)?;
        let decoded = Instant::now();
        mesh.apply(&delta)?;
        seconds[0] += decoded.duration_since(start).as_secs_f64();
        seconds[1] += decoded.elapsed().as_secs_f64();
    }
    Ok(seconds)
}

/// Adds up time between reports and records peak memory, by stage.
struct StopWatch(Mutex<Split>);

struct Split {
    last: Instant,
    stage: Stage,
    seconds: [f64; 3],
    peaks: [usize; 3],
}

impl StopWatch {
    fn new() -> Self {
        heap::take_peak();
        let (seconds, peaks) = ([0.0; 3], [0; 3]);
        Self(Mutex::new(Split { last: Instant::now(), stage: Stage::Simplify, seconds, peaks }))
    }

    /// Seconds and bytes of simplification, measuring and encoding.
    fn finish(self) -> ([f64; 3], [usize; 3]) {
        self.report(Progress::default());
        self.0.into_inner().map_or(([0.0; 3], [0; 3]), |split| (split.seconds, split.peaks))
    }
}

impl Monitor for StopWatch {
    fn report(&self, progress: Progress) -> bool {
        if let Ok(mut split) = self.0.lock() {
            let now = Instant::now();
            let stage = match split.stage {
                Stage::Simplify => 0,
                Stage::Measure => 1,
                Stage::Encode => 2,
            };
            split.seconds[stage] += now.duration_since(split.last).as_secs_f64();
            let peak = heap::take_peak();
            split.peaks[stage] = split.peaks[stage].max(peak);
            (split.last, split.stage) = (now, progress.stage);
        }
        true
    }
}

/// Seconds of meshoptimizer for simplifying the mesh to 1 % of its faces.
fn meshoptimizer(mesh: &QuantisedMesh) -> anyhow::Result<f64> {
    let indices: Vec<u32> =
        mesh.faces.iter().flat_map(|f| f.wedges.map(|w| mesh.wedges[w as usize].vertex)).collect();
    let positions: Vec<f32> = mesh.positions.iter().flatten().map(|&x| x as f32).collect();
    let bytes: Vec<u8> = positions.iter().flat_map(|x| x.to_ne_bytes()).collect();
    let vertices = meshopt::VertexDataAdapter::new(&bytes, 12, 0)?;
    let target = indices.len() / TARGET / 3 * 3;
    let start = Instant::now();
    let left = meshopt::simplify(&indices, &vertices, target, f32::MAX, meshopt::SimplifyOptions::None, None);
    let seconds = start.elapsed().as_secs_f64();
    anyhow::ensure!(left.len() < indices.len(), "meshoptimizer has done nothing");
    Ok(seconds)
}
