//! Assesses the geometry of one model: sizes, speeds, quality at level ends, validity of the stated errors, and cost of
//! random access. The geometry tables of the benchmarks come from here.
//!
//! Sizes and distances are deterministic for a model and settings; times are wall-clock times on one thread, comparable
//! within one run only.

mod access;
mod budget;
mod error_ratios;
mod lattice;
mod model;
mod options;
mod quality;

use std::path::Path;
use std::time::Instant;

use anyhow::Context as _;
use lodestream_compress::{decode_base, decode_chunk, encode_base, prepare};
use lodestream_geometry::Settings;
use lodestream_geometry::mesh::Corner;
use lodestream_geometry::pool::{Serial, Silent};
use lodestream_geometry::prepare::{axis_aligned_share, suit};
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::refine::ActiveMesh;
use serde::Serialize;

pub use access::{Spot, ViewShare};
pub use budget::BytesToRms;
pub use error_ratios::{RandomSets, Ratios};
use model::{Model, surface};
pub use options::Options;
pub use quality::LevelEnd;

/// Results for a model.
#[derive(Clone, Debug, Serialize)]
pub struct Assessment {
    /// Vertices after welding.
    pub vertices: usize,
    /// Faces of the input.
    pub faces: usize,
    /// Codec of base mesh and chunks.
    pub codec: String,
    /// [`axis_aligned_share`], by which a codec is selected.
    pub axis_aligned_share: f64,
    /// Number of chunks.
    pub chunks: usize,
    /// Levels above the base.
    pub levels: u8,
    /// Faces of the base mesh.
    pub base_faces: usize,
    /// Bytes of the base blob, without materials.
    pub base_bytes: usize,
    /// Bytes of the index.
    pub index_bytes: usize,
    /// Bytes of all chunks.
    pub payload_bytes: usize,
    /// Bits per vertex of base mesh, index and chunks.
    pub bits_per_vertex: f64,
    /// Error of the base mesh relative to the diagonal.
    pub base_error: f64,
    /// Input faces prepared per second.
    pub prepare_faces_per_s: f64,
    /// Splits decoded per second.
    pub decode_splits_per_s: f64,
    /// Splits of decoded chunks applied per second.
    pub apply_splits_per_s: f64,
    /// Quality after each level, coarse to fine.
    pub level_ends: Vec<LevelEnd>,
    /// RMS distance / diagonal at 10 % of the faces, interpolated between level ends in RMS × faces.
    pub rms_at_tenth: Option<f64>,
    /// The lowest-error ancestor-closed cut within 10 % of the faces, usually between two levels.
    pub tenth: LevelEnd,
    /// Bytes required for target RMS distances.
    pub bytes_to_rms: Vec<BytesToRms>,
    /// Stated against measured errors of random ancestor-closed cuts, with leaves up to random truncation points.
    pub random: RandomSets,
    /// The same for each level up to each of its truncation points, with everything coarser applied.
    pub at_truncation_points: RandomSets,
    /// Stated against locally measured errors of each chunk.
    pub per_chunk: Ratios,
    /// Cost of refining one spot.
    pub spot: Spot,
    /// Share that a view filled by the object needs.
    pub view: ViewShare,
}

/// Assesses an OBJ file.
///
/// # Errors
/// If the file cannot be imported or prepared.
pub fn assess(path: &Path, options: &Options) -> anyhow::Result<Assessment> {
    let mut imported = lodestream_import::import_smooth(path)
        .with_context(|| format!("cannot import {}", path.display()))?;
    if options.positions_only {
        let corners = imported.mesh.faces.iter_mut().flatten();
        corners.for_each(|c| *c = Corner::at(c.position));
        imported.mesh.uvs.clear();
        imported.mesh.second_uvs.clear();
        imported.mesh.normals.clear();
        imported.mesh.colors.clear();
        imported.mesh.materials.fill(0);
    }
    let precision = Precision::Bits(options.position_bits.get());
    let mut mesh = quantise(&imported.mesh, &QuantiseSettings { precision, ..QuantiseSettings::default() })?;
    let settings = Settings {
        region_faces: options.region_faces.get(),
        level_share: options.level_share.get(),
        top_regions: options.top_regions.get(),
        coarse_grid: options.coarse_grid.get(),
        block_faces: options.block_faces.get(),
        metric: options.metric,
        round_share: options.round.share(),
        codec: options.codec.of(&mesh),
        ..Settings::default()
    };
    suit(&mut mesh, settings.codec);
    let (prepared, prepare_s) = timed(|| prepare(&mesh, &settings, &Serial, &Silent));
    let prepared = prepared?;

    let base_bytes = encode_base(&prepared.base)?;
    let mut active = ActiveMesh::new(&decode_base(&base_bytes)?);
    let mut deltas = Vec::with_capacity(prepared.chunks.len());
    let mut decode_s = 0.0;
    for (id, info) in prepared.infos.iter().enumerate() {
        let (delta, seconds) = timed(|| decode_chunk(&active, id as u32, info, &prepared.chunks[id]));
        decode_s += seconds;
        let delta = delta?;
        active.apply(&delta)?;
        deltas.push(delta);
    }
    for delta in deltas.iter().rev() {
        active.undo(delta.chunk)?;
    }
    let (applied, apply_s) = timed(|| deltas.iter().try_for_each(|d| active.apply(d).map(drop)));
    applied?;

    let splits: usize = deltas.iter().map(|d| d.vertices.len()).sum();
    let index_bytes: usize = prepared.pages.iter().map(Vec::len).sum();
    let payload_bytes: usize = prepared.chunks.iter().map(Vec::len).sum();
    let model = Model { input: surface(&mesh), mesh, prepared, deltas };
    let level_ends = quality::level_ends(&model, options)?;
    let base = &model.prepared.base;
    Ok(Assessment {
        vertices: model.mesh.positions.len(),
        faces: model.mesh.faces.len(),
        codec: base.codec.to_string(),
        axis_aligned_share: axis_aligned_share(&model.mesh),
        chunks: model.prepared.chunks.len(),
        levels: base.level_count,
        base_faces: base.faces.len(),
        base_bytes: base_bytes.len(),
        index_bytes,
        payload_bytes,
        bits_per_vertex: (base_bytes.len() + index_bytes + payload_bytes) as f64 * 8.0
            / model.mesh.positions.len() as f64,
        base_error: f64::from(base.geometric_error) / model.diagonal(),
        prepare_faces_per_s: model.mesh.faces.len() as f64 / prepare_s,
        decode_splits_per_s: splits as f64 / decode_s,
        apply_splits_per_s: splits as f64 / apply_s,
        rms_at_tenth: quality::interpolate(&level_ends, model.mesh.faces.len() as f64 * 0.1),
        level_ends,
        tenth: quality::within_faces(&model, model.mesh.faces.len() as u64 / 10, options)?,
        bytes_to_rms: budget::bytes_to_rms(&model, (base_bytes.len() + index_bytes) as u64, options)?,
        random: error_ratios::random_sets(&model, options)?,
        at_truncation_points: error_ratios::at_truncation_points(&model)?,
        per_chunk: error_ratios::per_chunk(&model)?,
        spot: access::spot(&model, options.seed),
        view: access::view_share(&model, options.seed),
    })
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64().max(1e-9))
}

impl std::fmt::Display for Assessment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{} vertices, {} faces, axis-aligned share {:.3}; codec {}, {} chunks in {} levels",
            self.vertices, self.faces, self.axis_aligned_share, self.codec, self.chunks, self.levels
        )?;
        writeln!(
            f,
            "bytes: base {} ({} faces, error {:.2} % of the diagonal), index {}, chunks {}; {:.2} bits/vertex",
            self.base_bytes,
            self.base_faces,
            self.base_error * 100.0,
            self.index_bytes,
            self.payload_bytes,
            self.bits_per_vertex
        )?;
        writeln!(
            f,
            "speed on one thread: prepare {:.0} faces/s, decode {:.0} splits/s, apply {:.0} splits/s",
            self.prepare_faces_per_s, self.decode_splits_per_s, self.apply_splits_per_s
        )?;
        writeln!(f, "level  faces      RMS x1e-5  max x1e-5  stated x1e-5")?;
        for end in &self.level_ends {
            writeln!(
                f,
                "{:>5}  {:<9}  {:<9.1}  {:<9.1}  {:.1}",
                end.level,
                end.faces,
                end.rms * 1e5,
                end.max * 1e5,
                end.stated * 1e5
            )?;
        }
        if let Some(rms) = self.rms_at_tenth {
            writeln!(f, "RMS at 10 % of the faces (interpolated in RMS x faces): {:.1}e-5", rms * 1e5)?;
        }
        writeln!(
            f,
            "ancestor-closed cut of lowest error within 10 % of the faces: {} faces, RMS {:.1}e-5, max {:.1}e-5",
            self.tenth.faces,
            self.tenth.rms * 1e5,
            self.tenth.max * 1e5
        )?;
        for b in &self.bytes_to_rms {
            writeln!(
                f,
                "RMS {:.0}e-5 with {} bytes: {} faces, RMS {:.1}e-5",
                b.target * 1e5,
                b.bytes,
                b.faces,
                b.rms * 1e5
            )?;
        }
        writeln!(
            f,
            "stated / measured error of {} random ancestor-closed cuts: least {:.3}, median {:.3}, greatest {:.3}; least \
             at a point {:.3}",
            self.random.whole.count,
            self.random.whole.least,
            self.random.whole.median,
            self.random.whole.greatest,
            self.random.least_at_a_point
        )?;
        writeln!(
            f,
            "stated / measured error of {} levels up to a truncation: least {:.3}, median {:.3}, greatest {:.3}; least \
             at a point {:.3}",
            self.at_truncation_points.whole.count,
            self.at_truncation_points.whole.least,
            self.at_truncation_points.whole.median,
            self.at_truncation_points.whole.greatest,
            self.at_truncation_points.least_at_a_point
        )?;
        writeln!(
            f,
            "stated / measured error of {} chunks, each where it would change the mesh: least {:.3}, median \
             {:.3}, 90 % below {:.3}, greatest {:.3}",
            self.per_chunk.count,
            self.per_chunk.least,
            self.per_chunk.median,
            self.per_chunk.p90,
            self.per_chunk.greatest
        )?;
        writeln!(
            f,
            "refining a ball of 5 % of the diagonal: {:.0} bytes, {:.2} x those of its finest chunks",
            self.spot.bytes, self.spot.ratio
        )?;
        write!(
            f,
            "a view that it fills needs {:.1} % of all splits and {:.1} % of the payload ({:.1} % in whole chunks) at 1 px, \
             1280x720",
            self.view.splits * 100.0,
            self.view.bytes * 100.0,
            self.view.whole_bytes * 100.0
        )
    }
}
