//! Preparation: from a quantised mesh to base mesh, index and chunk payloads.

mod by_slot;
mod codec_selection;
mod encode;
mod hooks;
pub mod training;

pub use codec_selection::{axis_aligned_share, select_codec, suit};
pub(crate) use hooks::Observer;
pub use hooks::{Hooks, Store};

use crate::asset::base::{Base, MAX_BASE_FACES, Totals};
use crate::asset::index::{ChunkInfo, Sphere};
use crate::checkpoint::InMemoryCheckpoint;
use crate::codec::base;
use crate::codec::base::mesh::{BaseFormat, BaseMesh};
use crate::codec::chunk::PrefixSize;
use crate::codec::index_page::encode_pages;
use crate::entropy::Codec;
use crate::error::MeshError;
use crate::mesh::Kinds;
use crate::mesh::vec3::Vec3;
use crate::mesh::{Face, NO_COLOR, QuantisedMesh, Wedge};
use crate::pool::{MonitoredPool, Stage};
use crate::prepare::by_slot::BySlot;
use crate::prepare::encode::{EncodedRegion, Plan, encode_all};
use crate::simplify::blocks::{in_blocks, simplify_blocks};
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::levels::{Levels, Simplified};
use crate::simplify::settings::Settings;
use crate::simplify::simplify_from;

#[cfg(test)]
mod reference_test;

/// A prepared asset.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// The base mesh with the asset's metadata.
    pub base: Base,
    /// The index entries as clients decode them, coarse to fine.
    pub infos: Vec<ChunkInfo>,
    /// Index pages.
    pub pages: Vec<Vec<u8>>,
    /// Payloads, by chunk.
    pub chunks: Vec<Vec<u8>>,
}

/// Prepares a mesh for streaming.
/// The result depends on the mesh, the settings and the stored form of payloads only, not on the pool. Cost: 21 to 33
/// µs per face on one core (docs/benchmarks/preparation.md).
///
/// # Errors
/// [`MeshError::BadSetting`] for a setting out of its range, [`MeshError::NoFaces`] for an empty mesh,
/// [`MeshError::Cancelled`] if the monitor cancels, [`MeshError::Internal`] where storing a payload fails.
pub fn prepare(mesh: &QuantisedMesh, settings: &Settings, hooks: &Hooks<'_>) -> Result<Prepared, MeshError> {
    settings.check()?;
    if mesh.faces.is_empty() {
        return Err(MeshError::NoFaces { dropped: 0 });
    }
    let in_memory = InMemoryCheckpoint::default();
    let mut pool = MonitoredPool::new(hooks.pool, hooks.monitor, mesh.faces.len());
    let mut levels = Levels::new(hooks.checkpoint.unwrap_or(&in_memory));
    let merged = if in_blocks(mesh, settings) {
        Some(simplify_blocks(mesh, settings, &mut pool, &mut levels)?)
    } else {
        None
    };
    let mut simplified = simplify_from(mesh, merged.as_ref(), settings, &mut pool, levels)?;
    pool.begin(Stage::Encode)?;
    let limit = usize::from(u16::MAX);
    let materials = mesh
        .faces
        .iter()
        .map(|f| f.material)
        .max()
        .unwrap_or(0)
        .checked_add(1)
        .ok_or(MeshError::TooLarge { kind: "materials", count: limit + 1, limit })?;
    let (mut base, first) = build_base(mesh, &simplified, materials, settings.codec)?;
    simplified.forget_faces();
    let mut chunks: Vec<Chunk> = Vec::with_capacity(simplified.levels.chunk_count());
    let plan = Plan { mesh, simplified: &simplified, base: &base };
    encode_all(&plan, first, &pool, hooks, &mut |finished| chunks.push(Chunk::of(finished)))?;

    for id in (0..chunks.len()).rev() {
        let Chunk { error, attribute_error, .. } = chunks[id];
        for at in 0..chunks[id].parents.len() {
            let parent = chunks[id].parents[at] as usize;
            let parent = &mut chunks[parent];
            parent.error = parent.error.max(error);
            parent.attribute_error = parent.attribute_error.max(attribute_error);
        }
    }
    // The error at a truncation point is at least that of the chunk's children. It may exceed the chunk's own error:
    // intermediate states can be worse.
    let mut finer = vec![0.0_f64; chunks.len()];
    for chunk in &chunks {
        for &parent in &chunk.parents {
            finer[parent as usize] = finer[parent as usize].max(chunk.error);
        }
    }
    let root = chunks.iter().map(|chunk| chunk.error).fold(simplified.stray_error, f64::max);
    base.geometric_error = round_up(root * mesh.grid.step);
    let levels = simplified.levels.count();
    drop(simplified);
    let (mut infos, mut payloads) = (Vec::with_capacity(chunks.len()), Vec::with_capacity(chunks.len()));
    for (chunk, finer) in chunks.into_iter().zip(finer) {
        infos.push(chunk.info(mesh, levels, finer));
        payloads.push(chunk.bytes);
    }
    let (pages, infos) = encode_pages(&infos).map_err(|e| MeshError::Internal { why: e.to_string() })?;
    base.geometric_error = infos.iter().map(|i| i.error).fold(base.geometric_error, f32::max);
    Ok(Prepared { base, infos, pages, chunks: payloads })
}

fn build_base(
    mesh: &QuantisedMesh,
    simplified: &Simplified<'_>,
    materials: u16,
    codec: Codec,
) -> Result<(Base, BySlot), MeshError> {
    let faces = simplified.faces();
    let all_wedges = &simplified.wedges;
    let mut wedges: Vec<u32> = faces.iter().flat_map(|&(_, wedges)| wedges).collect();
    wedges.sort_unstable();
    wedges.dedup();
    let mut vertices: Vec<u32> = wedges.iter().map(|&w| all_wedges.get(w).vertex).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let place = |list: &[u32], x: u32| list.binary_search(&x).map_or(0, |i| i as u32);
    let coarsest = BaseMesh {
        positions: vertices.iter().map(|&v| simplified.placed(v).cell).collect(),
        wedges: wedges
            .iter()
            .map(|&w| {
                let wedge = all_wedges.get(w);
                Wedge { vertex: place(&vertices, wedge.vertex), ..wedge }
            })
            .collect(),
        faces: faces
            .iter()
            .map(|&(f, corners)| Face {
                wedges: corners.map(|w| place(&wedges, w)),
                material: mesh.faces[f as usize].material,
            })
            .collect(),
        parts: vertices.iter().filter_map(|&v| mesh.parts.get(v as usize).copied()).collect(),
        skins: vertices.iter().filter_map(|&v| mesh.skins.get(v as usize).copied()).collect(),
    };
    let sizes = LevelSizes {
        chunks: simplified.levels.chunk_count() as u32,
        levels: simplified.levels.count().min(255) as u8,
        shifts: simplified.shifts.iter().rev().copied().collect(),
    };
    let (base, ordered) = ordered_base(mesh, &coarsest, materials, codec, sizes)?;
    let pick = |list: &[u32], order: &[u32]| order.iter().map(|&i| list[i as usize]).collect();
    let by_slot = BySlot {
        vertices: pick(&vertices, &ordered.vertices),
        wedges: pick(&wedges, &ordered.wedges),
        faces: ordered.faces.iter().map(|&i| faces[i as usize].0).collect(),
    };
    Ok((base, by_slot))
}

/// What is above a base mesh: see [`Base`].
struct LevelSizes {
    chunks: u32,
    levels: u8,
    shifts: Vec<u8>,
}

/// The base mesh of a mesh whose coarsest form is given, with its vertices, wedges and faces by their numbers there.
fn ordered_base(
    mesh: &QuantisedMesh,
    coarsest: &BaseMesh,
    materials: u16,
    codec: Codec,
    sizes: LevelSizes,
) -> Result<(Base, Order), MeshError> {
    let parts = mesh.part_count();
    if coarsest.faces.len() > MAX_BASE_FACES {
        return Err(MeshError::TooLarge {
            kind: "base faces",
            count: coarsest.faces.len(),
            limit: MAX_BASE_FACES,
        });
    }
    let kinds = Kinds {
        uv_bits: mesh.uv_grid.bits,
        second_uv_bits: mesh.second_uv_grid.bits,
        colors: mesh.wedges.iter().any(|w| w.attributes.color != NO_COLOR),
        normals: mesh.wedges.iter().any(|w| w.attributes.normal.is_some()),
        skins: !mesh.skins.is_empty(),
    };
    let uv_grids = [&mesh.uv_grid, &mesh.second_uv_grid];
    let format = BaseFormat::new(mesh.grid.bits, kinds, materials, parts, uv_grids);
    let ordered = base::ordered(coarsest, format).map_err(|e| MeshError::Internal { why: e.to_string() })?;
    let mut min = [i32::MAX; 3];
    let mut max = [i32::MIN; 3];
    for p in &mesh.positions {
        for axis in 0..3 {
            min[axis] = min[axis].min(p[axis]);
            max[axis] = max[axis].max(p[axis]);
        }
    }
    let half = [0, 1, 2].map(|k| f64::from(max[k] - min[k]) * 0.5 * mesh.grid.step);
    let center = [0, 1, 2].map(|k| f64::from(max[k] + min[k]) * 0.5 * mesh.grid.step);
    let radius = (half[0] * half[0] + half[1] * half[1] + half[2] * half[2]).sqrt();
    let base = Base {
        grid: mesh.grid,
        uv_grid: mesh.uv_grid,
        second_uv_grid: mesh.second_uv_grid,
        sphere: Sphere { center: center.map(|x| x as f32), radius: round_up(radius) },
        diagonal: (2.0 * radius) as f32,
        geometric_error: 0.0,
        chunk_count: sizes.chunks,
        level_count: sizes.levels,
        material_count: materials,
        part_count: parts,
        codec,
        colors: kinds.colors,
        normals: kinds.normals,
        skinned: kinds.skins,
        totals: Totals {
            vertices: mesh.positions.len() as u64,
            wedges: mesh.wedges.len() as u64,
            faces: mesh.faces.len() as u64,
        },
        description: Vec::new(),
        positions: ordered.mesh.positions,
        shifts: sizes.shifts,
        wedges: ordered.mesh.wedges,
        faces: ordered.mesh.faces,
        parts: ordered.mesh.parts,
        skins: ordered.mesh.skins,
    };
    Ok((base, Order { vertices: ordered.vertices, wedges: ordered.wedges, faces: ordered.faces }))
}

/// Numbers of vertices, wedges and faces in a given mesh, by those in its base mesh.
struct Order {
    vertices: Vec<u32>,
    wedges: Vec<u32>,
    faces: Vec<u32>,
}

/// A base mesh that is a whole mesh, without chunks. Cost: as coding it.
///
/// # Errors
/// [`MeshError::NoFaces`] for an empty mesh, [`MeshError::TooLarge`] beyond [`MAX_BASE_FACES`].
pub fn whole(mesh: &QuantisedMesh, codec: Codec) -> Result<Base, MeshError> {
    let Some(last) = mesh.faces.iter().map(|face| face.material).max() else {
        return Err(MeshError::NoFaces { dropped: 0 });
    };
    let limit = usize::from(u16::MAX);
    let materials =
        last.checked_add(1).ok_or(MeshError::TooLarge { kind: "materials", count: limit + 1, limit })?;
    let coarsest = BaseMesh {
        positions: mesh.positions.clone(),
        wedges: mesh.wedges.clone(),
        faces: mesh.faces.clone(),
        parts: mesh.parts.clone(),
        skins: mesh.skins.clone(),
    };
    let sizes = LevelSizes { chunks: 0, levels: 0, shifts: vec![0] };
    Ok(ordered_base(mesh, &coarsest, materials, codec, sizes)?.0)
}

/// The part of an encoded chunk that is kept: not its delta, since all deltas are as large as the mesh.
struct Chunk {
    bytes: Vec<u8>,
    /// The level, counted from the finest.
    level: usize,
    parents: Vec<u32>,
    /// In grid cells; see [`RegionChunk`].
    error: f64,
    attribute_error: f64,
    center: Vec3,
    radius: f64,
    /// Each with its error.
    truncation_points: Vec<(PrefixSize, f64)>,
    vertices: u32,
    wedges: u32,
    faces: u32,
}

impl Chunk {
    fn of(EncodedRegion { level, region, parents, encoded: e }: EncodedRegion) -> Self {
        let [vertices, wedges, faces] = [&e.vertices, &e.wedges, &e.faces].map(|list| list.len() as u32);
        let RegionChunk { records, error, attribute_error, truncation_errors, center, radius, .. } = region;
        let truncation_errors = truncation_errors[records.coded_truncation_points()].iter().copied();
        let truncation_points = e.truncation_points.into_iter().zip(truncation_errors).collect();
        Self {
            bytes: e.bytes,
            level,
            parents,
            error,
            attribute_error,
            center,
            radius,
            truncation_points,
            vertices,
            wedges,
            faces,
        }
    }

    /// Its index entry; `finer` is the largest error of its children.
    fn info(&self, mesh: &QuantisedMesh, levels: usize, finer: f64) -> ChunkInfo {
        let step = mesh.grid.step;
        let truncation = |&(truncation, error): &(PrefixSize, f64)| {
            truncation.truncation(round_up(error.max(finer) * step))
        };
        ChunkInfo {
            level: (levels - self.level).min(255) as u8,
            sphere: self.sphere(mesh),
            error: round_up(self.error * step),
            attribute_error: round_up(self.attribute_error * step),
            truncation_points: self.truncation_points.iter().map(truncation).collect(),
            parents: self.parents.clone(),
            payload_bytes: self.bytes.len() as u32,
            vertices: self.vertices,
            wedges: self.wedges,
            faces: self.faces,
        }
    }

    /// Its bounding sphere in the asset's units, relative to the grid's origin.
    fn sphere(&self, mesh: &QuantisedMesh) -> Sphere {
        let middle = f64::from(1_u32 << mesh.grid.bits) * 0.5;
        let center = self.center.map(|x| (x + middle) * mesh.grid.step);
        Sphere { center: center.map(|x| x as f32), radius: round_up(self.radius * mesh.grid.step) }
    }
}

/// The nearest f32 not below `x`, with a margin for later roundings.
fn round_up(x: f64) -> f32 {
    (x * (1.0 + 1e-6)) as f32
}
