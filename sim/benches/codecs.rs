//! Bytes and decoding times of the two codecs, in one run on one thread.
//!
//! `cargo bench -p lodestream-sim --bench codecs -- MODEL.obj…`, 12-bit positions. Bytes are as stored and
//! sent: base mesh, index and chunks. Decoding is from there to deltas, decompression included; its times
//! are the best of some runs by turns and vary with the machine: use the ratio.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use lodestream_compress::{decode_base, decode_chunk, encode_base, prepare};
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::{Codec, Settings};

/// Times everything is decoded.
const RUNS: usize = 7;

fn main() -> anyhow::Result<()> {
    // Cargo adds `--bench`.
    let models: Vec<PathBuf> =
        std::env::args().skip(1).filter(|a| !a.starts_with('-')).map(PathBuf::from).collect();
    println!(
        "{:<16} {:>7} | {:>6} {:>7} {:>8} | {:>6} {:>8} | {:>8} {:>9} | {:>8} {:>9}",
        "model",
        "splits",
        "index",
        "range:",
        "chunks",
        "zstd:",
        "chunks",
        "bytes x",
        "M splits/s",
        "zstd",
        "time x"
    );
    models.iter().try_for_each(|model| row(model))
}

fn row(model: &Path) -> anyhow::Result<()> {
    let imported = lodestream_server::import::import(model)
        .with_context(|| format!("cannot import {}", model.display()))?;
    let precision = Precision::Bits(12);
    let mesh = quantise(&imported.mesh, &QuantiseSettings { precision, ..QuantiseSettings::default() })?;
    let prepared = |codec| prepare(&mesh, &Settings { codec, ..Settings::default() }, &Serial, &Silent);
    let assets = [prepared(Codec::Range)?, prepared(Codec::Plain)?];
    let mut best = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        for (best, asset) in best.iter_mut().zip(&assets) {
            *best = best.min(decode(asset)?);
        }
    }
    let splits: u32 = assets[0].infos.iter().map(|info| info.vertices).sum();
    let index: usize = assets[0].pages.iter().map(Vec::len).sum();
    let mut bases = [0; 2];
    for (bytes, asset) in bases.iter_mut().zip(&assets) {
        *bytes = encode_base(&asset.base)?.len();
    }
    let chunks = assets.each_ref().map(|asset| asset.chunks.iter().map(Vec::len).sum::<usize>());
    let all = [0, 1].map(|i| (bases[i] + chunks[i]) as f64 + index as f64);
    let rate = best.map(|seconds| f64::from(splits) / seconds / 1e6);
    println!(
        "{:<16} {splits:>7} | {index:>6} {:>7} {:>8} | {:>6} {:>8} | {:>8.2} {:>9.2} | {:>8.2} {:>9.2}",
        model.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned()),
        bases[0],
        chunks[0],
        bases[1],
        chunks[1],
        all[1] / all[0],
        rate[0],
        rate[1],
        best[1] / best[0]
    );
    Ok(())
}

/// Seconds to decode all chunks; applying them is not counted.
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
