//! Bytes and decoding times of the two codecs, in one run on one thread.
//!
//! `cargo bench -p lodestream-sim --bench codecs -- MODEL.obj…`, 12-bit positions. Bytes are as stored and sent: base
//! mesh, index and chunks. Decoding includes decompression, up to deltas; its times are the best of some alternating
//! runs and depend on the machine: use the ratio. `--json` prints an object per line.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use lodestream_compress::{decode_base, decode_chunk, encode_base, prepare};
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::{Codec, Settings};

/// Number of times that everything is decoded.
const RUNS: usize = 7;

fn main() -> anyhow::Result<()> {
    // Cargo adds `--bench`.
    let models: Vec<PathBuf> =
        std::env::args().skip(1).filter(|a| !a.starts_with('-')).map(PathBuf::from).collect();
    let json = std::env::args().any(|a| a == "--json");
    if !json {
        println!(
            "{:<16} {:>7} | {:>6} {:>6} {:>8} | {:>6} {:>6} {:>8} | {:>7} | {:>10} {:>6}",
            "model",
            "splits",
            "range:",
            "index",
            "chunks",
            "zstd:",
            "index",
            "chunks",
            "bytes x",
            "M splits/s",
            "time x"
        );
    }
    for model in &models {
        let row = row(model)?;
        if json { println!("{}", serde_json::to_string(&row)?) } else { row.print() }
    }
    Ok(())
}

/// Results for a model.
#[derive(serde::Serialize)]
struct Row {
    model: String,
    splits: u32,
    range: Coded,
    zstd: Coded,
    zstd_over_range_bytes: f64,
    zstd_over_range_time: f64,
}

/// Results for one codec.
#[derive(serde::Serialize)]
struct Coded {
    base_bytes: usize,
    index_bytes: usize,
    chunk_bytes: usize,
    decode_splits_per_s: f64,
}

impl Coded {
    fn bytes(&self) -> f64 {
        (self.base_bytes + self.index_bytes + self.chunk_bytes) as f64
    }
}

impl Row {
    fn print(&self) {
        let Self { model, splits, range, zstd, .. } = self;
        println!(
            "{model:<16} {splits:>7} | {:>6} {:>6} {:>8} | {:>6} {:>6} {:>8} | {:>7.2} | {:>10.2} {:>6.2}",
            range.base_bytes,
            range.index_bytes,
            range.chunk_bytes,
            zstd.base_bytes,
            zstd.index_bytes,
            zstd.chunk_bytes,
            self.zstd_over_range_bytes,
            range.decode_splits_per_s / 1e6,
            self.zstd_over_range_time
        );
    }
}

fn row(model: &Path) -> anyhow::Result<Row> {
    let imported = lodestream_import::import_smooth(model)
        .with_context(|| format!("cannot import {}", model.display()))?;
    let precision = Precision::Bits(12);
    let mesh = quantise(&imported.mesh, &QuantiseSettings { precision, ..QuantiseSettings::default() })?;
    let prepared = |codec| prepare(&mesh, &Settings { codec, ..Settings::default() }, &Serial, &Silent);
    let assets = [prepared(Codec::Range)?, prepared(Codec::Zstd)?];
    let mut best = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        for (best, asset) in best.iter_mut().zip(&assets) {
            *best = best.min(decode(asset)?);
        }
    }
    let splits: u32 = assets[0].infos.iter().map(|info| info.vertices).sum();
    let coded = |asset: &Prepared, seconds: f64| {
        anyhow::Ok(Coded {
            base_bytes: encode_base(&asset.base)?.len(),
            index_bytes: asset.pages.iter().map(Vec::len).sum(),
            chunk_bytes: asset.chunks.iter().map(Vec::len).sum(),
            decode_splits_per_s: f64::from(splits) / seconds,
        })
    };
    let (range, zstd) = (coded(&assets[0], best[0])?, coded(&assets[1], best[1])?);
    Ok(Row {
        model: model.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
        splits,
        zstd_over_range_bytes: zstd.bytes() / range.bytes(),
        zstd_over_range_time: best[1] / best[0],
        range,
        zstd,
    })
}

/// Seconds to decode all chunks, without applying them.
fn decode(asset: &Prepared) -> anyhow::Result<f64> {
    let mut mesh = ActiveMesh::new(&decode_base(&encode_base(&asset.base)?)?);
    let mut seconds = 0.0;
    for (id, (info, payload)) in (0..).zip(asset.infos.iter().zip(&asset.chunks)) {
        let start = Instant::now();
        let delta = decode_chunk(&mesh, id, info, payload)?;
        seconds += start.elapsed().as_secs_f64();
        mesh.apply(&delta)?;
    }
    Ok(seconds)
}
