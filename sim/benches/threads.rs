//! Speed-up by a second core: preparing, and decoding chunks whose parents are applied, alternately on one thread and
//! on two.
//!
//! `cargo bench -p lodestream-sim --bench threads -- [MODEL.obj…]` takes the named models, else those in the folder
//! `LODESTREAM_MODELS`, else a generated mesh, at 12 bits. The command fails if results differ. Ratios of wall time are
//! medians; they need two idle cores. `--json` prints an object per line.

mod models;

use std::num::NonZeroUsize;
use std::sync::Mutex;
use std::time::Instant;

use anyhow::Context as _;
use lodestream_client::Threads;
use lodestream_geometry::Settings;
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::pool::{Pool, Silent};
use lodestream_geometry::prepare::{Hooks, Prepared, prepare};
use lodestream_geometry::refine::{ActiveMesh, ChunkDelta};

/// Number of runs on one thread and on two.
const RUNS: usize = 7;

fn main() -> anyhow::Result<()> {
    let json = std::env::args().any(|a| a == "--json");
    if !json {
        println!(
            "{:<16} {:>8} {:>7} | two threads over one: {:>9} {:>9}",
            "model", "faces", "chunks", "preparing", "decoding"
        );
    }
    for (model, _, mesh) in models::quantised(|_| ())? {
        let row = row(model, &mesh)?;
        if json {
            println!("{}", serde_json::to_string(&row)?);
        } else {
            let Row { model, faces, chunks, prepare_speedup, decode_speedup } = row;
            println!("{model:<16} {faces:>8} {chunks:>7} | {prepare_speedup:>31.2} {decode_speedup:>9.2}");
        }
    }
    Ok(())
}

/// Results for a model.
#[derive(serde::Serialize)]
struct Row {
    model: String,
    faces: usize,
    chunks: usize,
    /// Time on one thread relative to that on two.
    prepare_speedup: f64,
    decode_speedup: f64,
}

fn row(model: String, mesh: &QuantisedMesh) -> anyhow::Result<Row> {
    let pools = [NonZeroUsize::MIN, NonZeroUsize::MIN.saturating_add(1)].map(Threads::new);
    let (mut preparing, mut decoding) = (Vec::new(), Vec::new());
    let mut first: Option<(Prepared, Vec<ChunkDelta>)> = None;
    for _ in 0..RUNS {
        let mut seconds = [[0.0; 2]; 2];
        for (threads, seconds) in pools.into_iter().zip(&mut seconds) {
            let start = Instant::now();
            let prepared = prepare(mesh, &Settings::default(), &Hooks::new(&threads, &Silent))?;
            seconds[0] = start.elapsed().as_secs_f64();
            let (deltas, decoded_in) = decode(&prepared, &threads)?;
            seconds[1] = decoded_in;
            if let Some((asset, all)) = &first {
                anyhow::ensure!(*asset == prepared && *all == deltas, "what comes out depends on threads");
            } else {
                first = Some((prepared, deltas));
            }
        }
        let [one, two] = seconds;
        preparing.push(one[0] / two[0]);
        decoding.push(one[1] / two[1]);
    }
    let median = |mut ratios: Vec<f64>| {
        ratios.sort_by(f64::total_cmp);
        ratios[RUNS / 2]
    };
    let (prepared, _) = first.context("nothing was prepared")?;
    Ok(Row {
        model,
        faces: mesh.faces.len(),
        chunks: prepared.chunks.len(),
        prepare_speedup: median(preparing),
        decode_speedup: median(decoding),
    })
}

/// Decodes everything in batches of chunks whose parents are applied; returns the seconds without applying.
fn decode(prepared: &Prepared, pool: &dyn Pool) -> anyhow::Result<(Vec<ChunkDelta>, f64)> {
    let mut mesh = ActiveMesh::new(&prepared.base);
    let mut deltas: Vec<ChunkDelta> = Vec::with_capacity(prepared.chunks.len());
    let mut seconds = 0.0;
    while deltas.len() < prepared.infos.len() {
        let from = deltas.len();
        let waiting = &prepared.infos[from..];
        let ready =
            waiting.iter().take_while(|info| info.parents.iter().all(|&p| (p as usize) < from)).count();
        let batch: Vec<_> = (0..ready).map(|_| Mutex::new(None)).collect();
        let start = Instant::now();
        pool.run(ready, &|i| {
            let id = from + i;
            let delta = mesh.decode(id as u32, &prepared.infos[id], &prepared.chunks[id]);
            if let Ok(mut place) = batch[i].lock() {
                *place = Some(delta);
            }
        });
        seconds += start.elapsed().as_secs_f64();
        for place in batch {
            let delta = place.into_inner().ok().flatten().context("a chunk was not decoded")??;
            mesh.apply(&delta)?;
            deltas.push(delta);
        }
    }
    Ok((deltas, seconds))
}
