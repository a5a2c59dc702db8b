//! Preparation: from a quantised mesh to a base mesh, an index and chunk payloads.

pub mod training;

use crate::asset::base::{Base, MAX_BASE_FACES, Totals};
use crate::asset::index::{ChunkInfo, Sphere};
use crate::codec::base;
use crate::codec::base::mesh::{BaseFormat, BaseMesh};
use crate::codec::chunk::{Encoded, Reached, encode};
use crate::codec::index_page::encode_pages;
use crate::codec::source::Source;
use crate::entropy::Codec;
use crate::error::{DecodeError, MeshError};
use crate::mesh::Kinds;
use crate::mesh::{Face, NO_COLOR, QuantisedMesh, Wedge};
use crate::pool::{Monitor, Pool, Stage, Watched};
use crate::refine::ActiveMesh;
use crate::simplify::hierarchy::{RegionChunk, Simplified};
use crate::simplify::settings::Settings;
use crate::simplify::simplify;

#[cfg(test)]
mod reference_test;

/// A prepared asset.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// The base mesh and what describes the asset.
    pub base: Base,
    /// The index, as clients see it, coarse to fine.
    pub infos: Vec<ChunkInfo>,
    /// Index pages.
    pub pages: Vec<Vec<u8>>,
    /// Payloads, by chunk.
    pub chunks: Vec<Vec<u8>>,
}

/// What a preparation calls on: threads, who is told of progress, and what becomes of payloads.
#[derive(Clone, Copy)]
pub struct Hooks<'a> {
    pool: &'a dyn Pool,
    monitor: &'a dyn Monitor,
    store: Store<'a>,
    observe: Observer<'a>,
}

impl std::fmt::Debug for Hooks<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hooks").finish_non_exhaustive()
    }
}

impl<'a> Hooks<'a> {
    /// Works on the threads of `pool`, tells `monitor`, and leaves payloads as they are.
    #[must_use]
    pub fn new(pool: &'a dyn Pool, monitor: &'a dyn Monitor) -> Self {
        Self { pool, monitor, store: &Ok, observe: &|_, _, _| {} }
    }

    /// Payloads, and the lengths that the index says, are what `store` makes of them.
    #[must_use]
    pub fn stored_by(self, store: Store<'a>) -> Self {
        Self { store, ..self }
    }

    /// Shows each chunk to `observe` before it is encoded.
    pub(crate) fn observed_by(self, observe: Observer<'a>) -> Self {
        Self { observe, ..self }
    }
}

/// Turns a payload into what is stored and sent of it.
pub type Store<'a> = &'a (dyn Fn(Vec<u8>) -> Result<Vec<u8>, DecodeError> + Sync);
/// Sees each chunk just before it is encoded.
pub(crate) type Observer<'a> = &'a (dyn Fn(&ActiveMesh, u32, &Source<'_>) + Sync);

/// Prepares a mesh for streaming.
///
/// The result depends on the mesh, the settings and what payloads are stored as alone, not on the pool. Cost: 21 to
/// 33 µs a face on one core (BENCHMARKS.md).
///
/// # Errors
/// [`MeshError::BadSetting`] for a setting out of its range, [`MeshError::NoFaces`] for an empty mesh,
/// [`MeshError::Cancelled`] if the monitor says so, [`MeshError::Internal`] where storing a payload fails.
pub fn prepare(mesh: &QuantisedMesh, settings: &Settings, hooks: &Hooks<'_>) -> Result<Prepared, MeshError> {
    settings.check()?;
    if mesh.faces.is_empty() {
        return Err(MeshError::NoFaces { dropped: 0 });
    }
    let mut pool = Watched::new(hooks.pool, hooks.monitor, mesh.faces.len());
    let simplified = simplify(mesh, settings, &mut pool)?;
    pool.begin(Stage::Encode)?;
    let order: Vec<(usize, usize)> = simplified
        .levels
        .iter()
        .enumerate()
        .rev()
        .flat_map(|(level, chunks)| (0..chunks.len()).map(move |c| (level, c)))
        .collect();
    let chunk = |id: usize| &simplified.levels[order[id].0][order[id].1];
    let parents = parents(&simplified, &order, mesh.faces.len());
    let limit = usize::from(u16::MAX);
    let materials = mesh
        .faces
        .iter()
        .map(|f| f.material)
        .max()
        .unwrap_or(0)
        .checked_add(1)
        .ok_or(MeshError::TooLarge { kind: "materials", count: limit + 1, limit })?;
    let (mut base, first) = build_base(mesh, &simplified, order.len(), materials, settings.codec)?;
    let mut encoded: Vec<Payload> = Vec::with_capacity(order.len());
    let mut keep = |e: Encoded| encoded.push(Payload::of(e));
    let plan = Plan { mesh, simplified: &simplified, order: &order, parents: &parents, base: &base };
    encode_all(&plan, first, &pool, hooks, &mut keep)?;

    let mut errors: Vec<f64> = (0..order.len()).map(|id| chunk(id).error).collect();
    let mut slides: Vec<f64> = (0..order.len()).map(|id| chunk(id).attribute_error).collect();
    for id in (0..order.len()).rev() {
        for &parent in &parents[id] {
            errors[parent as usize] = errors[parent as usize].max(errors[id]);
            slides[parent as usize] = slides[parent as usize].max(slides[id]);
        }
    }
    // A chunk is no better at a stop than its children are while they are missing. It can be worse than
    // while it is missing itself: what is far on the way need not be in the end.
    let mut finer = vec![0.0_f64; order.len()];
    for id in 0..order.len() {
        for &parent in &parents[id] {
            finer[parent as usize] = finer[parent as usize].max(errors[id]);
        }
    }
    let root = errors.iter().copied().fold(simplified.stray_error, f64::max);
    base.geometric_error = round_up(root * mesh.grid.step);
    let levels = simplified.levels.len();
    let infos: Vec<ChunkInfo> = encoded
        .iter()
        .enumerate()
        .map(|(id, e)| ChunkInfo {
            level: (levels - order[id].0).min(255) as u8,
            sphere: sphere(mesh, chunk(id)),
            error: round_up(errors[id] * mesh.grid.step),
            attribute_error: round_up(slides[id] * mesh.grid.step),
            stops: e
                .stops
                .iter()
                .zip(&chunk(id).stop_errors[chunk(id).records.coded_stops()])
                .map(|(stop, error)| stop.stop(round_up(error.max(finer[id]) * mesh.grid.step)))
                .collect(),
            parents: parents[id].clone(),
            payload_bytes: e.bytes.len() as u32,
            vertices: e.vertices,
            wedges: e.wedges,
            faces: e.faces,
        })
        .collect();
    let (pages, infos) = encode_pages(&infos).map_err(|e| MeshError::Internal { why: e.to_string() })?;
    base.geometric_error = infos.iter().map(|i| i.error).fold(base.geometric_error, f32::max);
    Ok(Prepared { base, infos, pages, chunks: encoded.into_iter().map(|e| e.bytes).collect() })
}

/// Parents of each chunk: at each of its faces, the chunk of the nearest coarser level whose region
/// held the face, whether or not it changed it (a chunk that only read a face must also come first,
/// or it would be decoded against a star that a finer chunk has altered).
fn parents(simplified: &Simplified, order: &[(usize, usize)], faces: usize) -> Vec<Vec<u32>> {
    const NOBODY: u32 = u32::MAX;
    let mut owner = vec![NOBODY; faces];
    let mut all = Vec::with_capacity(order.len());
    for (id, &(level, index)) in order.iter().enumerate() {
        let chunk = &simplified.levels[level][index];
        let mut parents: Vec<u32> =
            chunk.faces.iter().map(|&f| owner[f as usize]).filter(|&o| o != NOBODY).collect();
        parents.sort_unstable();
        parents.dedup();
        for &f in &chunk.faces {
            owner[f as usize] = id as u32;
        }
        all.push(parents);
    }
    all
}

/// The builder's ids of everything in an [`ActiveMesh`] that only grows, by slot.
struct BySlot {
    vertices: Vec<u32>,
    wedges: Vec<u32>,
    faces: Vec<u32>,
}

fn build_base(
    mesh: &QuantisedMesh,
    simplified: &Simplified,
    chunks: usize,
    materials: u16,
    codec: Codec,
) -> Result<(Base, BySlot), MeshError> {
    let live = &simplified.live;
    let faces: Vec<u32> = (0..live.alive.len() as u32).filter(|&f| live.alive[f as usize]).collect();
    let mut wedges: Vec<u32> = faces.iter().flat_map(|&f| live.face_wedges[f as usize]).collect();
    wedges.sort_unstable();
    wedges.dedup();
    let mut vertices: Vec<u32> = wedges.iter().map(|&w| live.wedges[w as usize].vertex).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let place = |list: &[u32], x: u32| list.binary_search(&x).map_or(0, |i| i as u32);
    let coarsest = BaseMesh {
        positions: vertices.iter().map(|&v| live.cell(v)).collect(),
        wedges: wedges
            .iter()
            .map(|&w| {
                let wedge = live.wedges[w as usize];
                Wedge { vertex: place(&vertices, wedge.vertex), ..wedge }
            })
            .collect(),
        faces: faces
            .iter()
            .map(|&f| Face {
                wedges: live.face_wedges[f as usize].map(|w| place(&wedges, w)),
                material: live.material[f as usize],
            })
            .collect(),
    };
    if faces.len() > MAX_BASE_FACES {
        return Err(MeshError::TooLarge { kind: "base faces", count: faces.len(), limit: MAX_BASE_FACES });
    }
    let kinds = Kinds {
        uv_bits: mesh.uv_grid.bits,
        colors: mesh.wedges.iter().any(|w| w.attributes.color != NO_COLOR),
        normals: mesh.wedges.iter().any(|w| w.attributes.normal.is_some()),
    };
    let ordered = base::ordered(&coarsest, BaseFormat::new(mesh.grid.bits, kinds, materials, &mesh.uv_grid))
        .map_err(|e| MeshError::Internal { why: e.to_string() })?;
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
        sphere: Sphere { center: center.map(|x| x as f32), radius: round_up(radius) },
        diagonal: (2.0 * radius) as f32,
        geometric_error: 0.0,
        chunk_count: chunks as u32,
        level_count: simplified.levels.len().min(255) as u8,
        material_count: materials,
        codec,
        colors: kinds.colors,
        normals: kinds.normals,
        totals: Totals {
            vertices: mesh.positions.len() as u64,
            wedges: mesh.wedges.len() as u64,
            faces: mesh.faces.len() as u64,
        },
        description: Vec::new(),
        positions: ordered.mesh.positions,
        shifts: simplified.shifts.iter().rev().copied().collect(),
        wedges: ordered.mesh.wedges,
        faces: ordered.mesh.faces,
    };
    let pick = |list: &[u32], order: &[u32]| order.iter().map(|&i| list[i as usize]).collect();
    let by_slot = BySlot {
        vertices: pick(&vertices, &ordered.vertices),
        wedges: pick(&wedges, &ordered.wedges),
        faces: pick(&faces, &ordered.faces),
    };
    Ok((base, by_slot))
}

/// What is kept of an encoded chunk: not what it adds, which is as large as the mesh.
struct Payload {
    bytes: Vec<u8>,
    stops: Vec<Reached>,
    vertices: u32,
    wedges: u32,
    faces: u32,
}

impl Payload {
    fn of(e: Encoded) -> Self {
        let [vertices, wedges, faces] = [&e.vertices, &e.wedges, &e.faces].map(|list| list.len() as u32);
        Self { bytes: e.bytes, stops: e.stops, vertices, wedges, faces }
    }
}

/// What there is to encode.
struct Plan<'a> {
    mesh: &'a QuantisedMesh,
    simplified: &'a Simplified,
    /// Level and region of each chunk.
    order: &'a [(usize, usize)],
    /// Of each chunk, those before it on which it depends.
    parents: &'a [Vec<u32>],
    base: &'a Base,
}

/// Encodes all chunks, level by level: within a level each against the same mesh, at the same time. `by_slot` is the
/// base's; `keep` gets chunks in order.
fn encode_all(
    plan: &Plan<'_>,
    mut by_slot: BySlot,
    pool: &Watched<'_>,
    hooks: &Hooks<'_>,
    keep: &mut dyn FnMut(Encoded),
) -> Result<(), MeshError> {
    let &Plan { mesh, simplified, order, parents, base } = plan;
    let mut active = ActiveMesh::growing(base);
    let mut slot_of_vertex = vec![u32::MAX; mesh.positions.len()];
    for (slot, &v) in by_slot.vertices.iter().enumerate() {
        slot_of_vertex[v as usize] = slot as u32;
    }
    let mut first = 0;
    for run in order.chunk_by(|a, b| a.0 == b.0) {
        let results = pool.map(run.len(), &|i| {
            let chunk: &RegionChunk = &simplified.levels[run[i].0][run[i].1];
            let source = Source {
                records: &chunk.records,
                place: &|v| simplified.live.placed(v),
                moves: &chunk.moves,
                shift: simplified.shifts[run[i].0],
                wedges: &simplified.live.wedges,
                materials: &simplified.live.material,
                vertex_by_slot: &by_slot.vertices,
                wedge_by_slot: &by_slot.wedges,
                face_by_slot: &by_slot.faces,
                slot_of_vertex: &slot_of_vertex,
                interior: &|v| chunk.interior.binary_search(&v).is_ok(),
            };
            (hooks.observe)(&active, (first + i) as u32, &source);
            let encoded = encode(&active, (first + i) as u32, parents[first + i].clone(), &source)?;
            Ok(Encoded { bytes: (hooks.store)(encoded.bytes)?, ..encoded })
        })?;
        for result in results {
            let encoded: Encoded =
                result.map_err(|e: DecodeError| MeshError::Internal { why: e.to_string() })?;
            active.apply(&encoded.delta).map_err(|e| MeshError::Internal { why: e.to_string() })?;
            for &v in &encoded.vertices {
                slot_of_vertex[v as usize] = by_slot.vertices.len() as u32;
                by_slot.vertices.push(v);
            }
            by_slot.wedges.extend(&encoded.wedges);
            by_slot.faces.extend(&encoded.faces);
            keep(encoded);
        }
        first += run.len();
    }
    Ok(())
}

/// A chunk's sphere in the asset's units, relative to the grid's origin.
fn sphere(mesh: &QuantisedMesh, chunk: &RegionChunk) -> Sphere {
    let middle = f64::from(1_u32 << mesh.grid.bits) * 0.5;
    let center = chunk.center.map(|x| (x + middle) * mesh.grid.step);
    Sphere { center: center.map(|x| x as f32), radius: round_up(chunk.radius * mesh.grid.step) }
}

/// A float not below `x`, with a little to spare for the rounding of what it is added to.
fn round_up(x: f64) -> f32 {
    (x * (1.0 + 1e-6)) as f32
}
