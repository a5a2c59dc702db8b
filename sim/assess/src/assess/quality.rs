//! Distances of ancestor-closed cuts to the input.

use std::num::NonZeroUsize;

use lodestream_geometry::ancestor_closed_cut::{self, Budget, Member};
use serde::Serialize;

use super::model::Model;
use super::options::Options;
use crate::measure::{self, Comparison};

/// The mesh with all chunks up to a level.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LevelEnd {
    /// The level; 0 is the base mesh.
    pub level: u8,
    /// Its faces.
    pub faces: usize,
    /// Payload of its chunks.
    pub payload_bytes: u64,
    /// RMS distance, two-sided, over the diagonal.
    pub rms: f64,
    /// Largest distance found, over the diagonal.
    pub max: f64,
    /// Geometric error that the index states, over the diagonal.
    pub stated: f64,
}

/// Measures the mesh after each level but the last.
pub(super) fn level_ends(model: &Model, options: &Options) -> anyhow::Result<Vec<LevelEnd>> {
    let mut ends = Vec::new();
    let infos = &model.prepared.infos;
    for level in 0..model.prepared.base.level_count {
        let chunks = (0..infos.len() as u32).filter(|&id| infos[id as usize].level <= level);
        let set: Vec<Member> = chunks.map(|chunk| Member { chunk, truncation: None }).collect();
        let (faces, found) = distance(model, &set, options)?;
        let stated = model.left(&set).into_iter().fold(0.0, f64::max) / model.diagonal();
        let payload_bytes = payload(model, &set);
        ends.push(LevelEnd { level, faces, payload_bytes, rms: found.rms, max: found.max, stated });
    }
    Ok(ends)
}

/// Measures the ancestor-closed cut of lowest error with at most `faces` faces.
pub(super) fn within_faces(model: &Model, faces: u64, options: &Options) -> anyhow::Result<LevelEnd> {
    let prepared = &model.prepared;
    let set = ancestor_closed_cut::lowest_error(&prepared.base, &prepared.infos, 0, Budget::Faces(faces));
    let (faces, found) = distance(model, &set.members, options)?;
    let level = set.members.iter().map(|m| prepared.infos[m.chunk as usize].level).max().unwrap_or(0);
    let stated = set.error / model.diagonal();
    let payload_bytes = payload(model, &set.members);
    Ok(LevelEnd { level, faces, payload_bytes, rms: found.rms, max: found.max, stated })
}

/// Bytes of a cut's chunks, up to their truncation points.
fn payload(model: &Model, set: &[Member]) -> u64 {
    let bytes = |m: &Member| model.prepared.infos[m.chunk as usize].extent(m.truncation).payload_bytes;
    set.iter().map(|m| u64::from(bytes(m))).sum()
}

/// RMS distance at a number of faces: RMS × faces varies slowly, so it is interpolated linearly in faces.
pub(super) fn interpolate(ends: &[LevelEnd], faces: f64) -> Option<f64> {
    let pair = ends.windows(2).find(|w| w[0].faces as f64 <= faces && faces <= w[1].faces as f64)?;
    let product = |e: &LevelEnd| e.rms * e.faces as f64;
    let (low, high) = (pair[0].faces as f64, pair[1].faces as f64);
    let share = if high > low { (faces - low) / (high - low) } else { 0.0 };
    Some((product(&pair[0]) * (1.0 - share) + product(&pair[1]) * share) / faces)
}

pub(super) fn distance(
    model: &Model,
    set: &[Member],
    options: &Options,
) -> anyhow::Result<(usize, Comparison)> {
    let coarse = model.surface(set)?;
    let samples = NonZeroUsize::new(options.samples).unwrap_or(NonZeroUsize::MIN);
    let settings = measure::Settings { samples, seed: options.seed, ..Default::default() };
    Ok((coarse.triangles.len(), measure::compare(&model.input, &coarse, &settings)?))
}
