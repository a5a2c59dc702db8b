//! One asset as the client has it: its refined mesh, and what changed since a renderer last looked.

use std::collections::BTreeMap;

use geometry::DecodeError;
use geometry::base::Base;
use geometry::index::ChunkInfo;
use geometry::mesh::NONE;
use geometry::refine::{ActiveMesh, ChunkDelta, ChunkError, RefineError, Touched};
#[cfg(feature = "zstd")]
use lodestream_compress::{decode_base, decode_prefix};
use lodestream_geometry as geometry;
use lodestream_scene::asset::{AssetDescription, DescriptionError};
use lodestream_scene::blob::BlobPart;
use lodestream_select::Occluder;

use super::changes::{IndexRun, MeshChange, Vertex, runs};
#[cfg(not(feature = "zstd"))]
use super::stored::{decode_base, decode_prefix};

/// A chunk or base mesh that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum AssetError {
    #[error(transparent)]
    Decode(#[from] DecodeError),
    #[error("description: {0}")]
    Description(#[from] DescriptionError),
    #[error(transparent)]
    Refine(#[from] RefineError),
    #[error(transparent)]
    Chunk(#[from] ChunkError),
    #[error("the base mesh tells of {base} chunks, the scene of {scene}")]
    ChunkCount { base: u32, scene: u32 },
    #[error("the base mesh names material {used}, but only {count} are described")]
    Material { used: u16, count: usize },
}

/// Slots that a renderer must fetch again.
#[derive(Debug, Default)]
struct Dirty {
    wedges: Vec<u32>,
    draws: Vec<(u16, u32)>,
    /// Length above which the lists are worth sorting out.
    limit: usize,
}

impl Dirty {
    fn add(&mut self, touched: Touched) {
        self.wedges.extend(touched.wedges);
        self.draws.extend(touched.draws);
        // Nobody may be looking for a long time (a hidden window): the same slots are then noted again
        // and again, and memory stays proportional to the mesh only if they are merged.
        if self.wedges.len() + self.draws.len() > self.limit {
            self.merge();
            self.limit = (2 * (self.wedges.len() + self.draws.len())).max(1 << 16);
        }
    }

    fn merge(&mut self) {
        self.wedges.sort_unstable();
        self.wedges.dedup();
        self.draws.sort_unstable();
        self.draws.dedup();
    }
}

/// An asset whose base mesh is here.
#[derive(Debug)]
pub(crate) struct RefinedAsset {
    pub(crate) description: AssetDescription,
    pub(crate) origin: [f64; 3],
    /// Texture coordinates per asset unit; 0 where there are none.
    pub(crate) uv_per_unit: f32,
    mesh: ActiveMesh,
    dirty: Option<Dirty>,
    /// It stands among those whose changes wait to be fetched.
    waits: bool,
    /// When a chunk's vertices were first handed to a renderer, in seconds.
    births: BTreeMap<u32, f32>,
    levels: BTreeMap<u32, u8>,
    /// Faces of the surface that is known to hide things.
    occluding_faces: usize,
}

/// A surface of so many faces hides as well as a finer one: its error is far below the sizes of regions.
const OCCLUDER_FACES: usize = 2048;

impl RefinedAsset {
    /// Decodes a base blob. `track_changes`: a renderer will ask for changes.
    pub(crate) fn decode(bytes: &[u8], chunk_count: u32, track_changes: bool) -> Result<Self, AssetError> {
        let base = decode_base(bytes)?;
        if base.chunk_count != chunk_count {
            return Err(AssetError::ChunkCount { base: base.chunk_count, scene: chunk_count });
        }
        let description = AssetDescription::decode(&base.description)?;
        let count = description.materials.len().max(1);
        if let Some(face) = base.faces.iter().find(|face| usize::from(face.material) >= count) {
            return Err(AssetError::Material { used: face.material, count });
        }
        let mut asset = Self {
            description,
            origin: base.grid.origin,
            uv_per_unit: uv_per_unit(&base),
            mesh: ActiveMesh::new(&base),
            dirty: track_changes.then(Dirty::default),
            waits: false,
            births: BTreeMap::new(),
            levels: BTreeMap::new(),
            occluding_faces: 0,
        };
        asset.touch_all();
        Ok(asset)
    }

    /// All levels of the asset's textures.
    pub(crate) fn texture_levels(&self) -> impl Iterator<Item = BlobPart> + use<'_> {
        (0..).zip(&self.description.textures).flat_map(|(texture, info)| {
            (0..).zip(&info.levels).map(move |(level, _)| BlobPart::Texture { texture, level })
        })
    }

    /// Notes everything as changed: a new renderer starts from nothing.
    pub(crate) fn touch_all(&mut self) {
        if let Some(dirty) = &mut self.dirty {
            dirty.wedges = (0..self.mesh.wedge_slots()).collect();
            dirty.draws.clear();
            for material in 0..self.mesh.material_count() {
                let slots = u32::try_from(self.mesh.indices(material).len()).unwrap_or(NONE);
                dirty.draws.extend((0..slots).map(|slot| (material, slot)));
            }
        }
    }

    /// Decodes and applies a chunk whose parents are applied, up to a truncation or whole; one that is applied up to a truncation is
    /// taken on from there. On failure it is not applied, and nothing else has changed: where the rest is damaged, its
    /// beginning is not to be trusted either.
    pub(crate) fn apply(
        &mut self,
        chunk: u32,
        info: &ChunkInfo,
        truncation: Option<u8>,
        bytes: &[u8],
    ) -> Result<(), AssetError> {
        // What is raised keeps its birth, and what is new of it appears as it is: it has no place to
        // morph from but that of its oldest ancestor, which the beginning has moved on from.
        let touched = if self.mesh.applied_truncation(chunk).is_some() {
            match self.mesh.raise(chunk, info, truncation, bytes) {
                Ok(touched) => touched,
                Err(why) => {
                    self.undo(chunk)?;
                    return Err(why.into());
                }
            }
        } else {
            let delta = self.decode_chunk(chunk, info, truncation, bytes)?;
            self.mesh.apply(&delta)?
        };
        self.note(touched);
        self.levels.insert(chunk, info.level);
        Ok(())
    }

    /// Decodes a chunk that is not applied, whose parents are: for [`Self::apply_decoded`].
    pub(crate) fn decode_chunk(
        &self,
        chunk: u32,
        info: &ChunkInfo,
        truncation: Option<u8>,
        bytes: &[u8],
    ) -> Result<ChunkDelta, ChunkError> {
        decode_prefix(&self.mesh, chunk, info, truncation, bytes)
    }

    /// Applies a decoded chunk of a level. On failure nothing has changed.
    pub(crate) fn apply_decoded(&mut self, level: u8, delta: &ChunkDelta) -> Result<(), RefineError> {
        let touched = self.mesh.apply(delta)?;
        self.note(touched);
        self.levels.insert(delta.chunk, level);
        Ok(())
    }

    /// What a chunk that was just applied brings does not move to its place: it is there. What was handed to a renderer
    /// already keeps its birth.
    pub(crate) fn appear_at_once(&mut self, chunk: u32) {
        self.births.entry(chunk).or_insert(LONG_AGO_S);
    }

    /// Undoes an applied chunk that no applied chunk needs.
    pub(crate) fn undo(&mut self, chunk: u32) -> Result<(), AssetError> {
        let touched = self.mesh.undo(chunk)?;
        self.note(touched);
        self.births.remove(&chunk);
        self.levels.remove(&chunk);
        Ok(())
    }

    fn note(&mut self, touched: Touched) {
        if let Some(dirty) = &mut self.dirty {
            dirty.add(touched);
        }
    }

    /// The surface as it is now, where it is worth while: at first, and once it has grown by half since, until it is fine
    /// enough for all that it hides.
    pub(crate) fn better_occluder(&mut self) -> Option<Occluder> {
        let faces = self.mesh.face_count();
        if self.occluding_faces >= OCCLUDER_FACES || 2 * faces < 3 * self.occluding_faces.max(1) {
            return None;
        }
        self.occluding_faces = faces;
        let (positions, faces) = self.mesh.surface();
        Some(Occluder::new(positions, faces))
    }

    /// The mesh as it is now.
    pub(crate) const fn mesh(&self) -> &ActiveMesh {
        &self.mesh
    }

    /// Notes that its changes wait to be fetched; whether they did not before. Never where nobody fetches them.
    pub(crate) fn begins_to_wait(&mut self) -> bool {
        self.dirty.is_some() && !std::mem::replace(&mut self.waits, true)
    }

    /// Whether [`RefinedAsset::take_changes`] has something.
    pub(crate) fn has_changes(&self) -> bool {
        self.dirty.as_ref().is_some_and(|d| !d.wedges.is_empty() || !d.draws.is_empty())
    }

    /// What changed since the last call; together with all earlier changes it is the mesh as it is now.
    /// Vertices that appear for the first time are born at `now_s`.
    pub(crate) fn take_changes(&mut self, asset: u32, now_s: f32) -> Option<MeshChange> {
        self.waits = false;
        let dirty = self.dirty.as_mut()?;
        if dirty.wedges.is_empty() && dirty.draws.is_empty() {
            return None;
        }
        let mut dirty = std::mem::take(dirty);
        dirty.merge();
        let mesh = &self.mesh;
        let slots = mesh.wedge_slots();
        // Slots at the end may have gone since they were noted.
        dirty.wedges.retain(|slot| *slot < slots);
        let mut vertices = Vec::new();
        for run in runs(&dirty.wedges, VERTEX_GAP) {
            let first = run.start;
            let data = run
                .map(|slot| {
                    let chunk = mesh.wedge_chunk(slot).filter(|c| self.levels.contains_key(c));
                    let (birth_s, level) = chunk.map_or((0.0, 0), |chunk| {
                        let birth = *self.births.entry(chunk).or_insert(now_s);
                        (birth, self.levels.get(&chunk).copied().unwrap_or(0))
                    });
                    Vertex { data: mesh.render_vertex(slot), birth_s, level: u32::from(level) }
                })
                .collect();
            vertices.push((first, data));
        }
        let mut indices = Vec::new();
        for of_material in dirty.draws.chunk_by(|a, b| a.0 == b.0) {
            let material = of_material[0].0;
            let list = mesh.indices(material);
            let slots: Vec<u32> =
                of_material.iter().map(|d| d.1).filter(|slot| (*slot as usize) < list.len()).collect();
            for run in runs(&slots, INDEX_GAP) {
                let faces = list[run.start as usize..run.end as usize].to_vec();
                indices.push(IndexRun { material, first: run.start, faces });
            }
        }
        Some(MeshChange { asset, vertices, indices })
    }
}

/// Birth of vertices whose morph is over when they are first seen.
const LONG_AGO_S: f32 = -1e9;
/// Unchanged slots that are sent along rather than beginning a new upload: an upload costs about as much
/// as computing this many normals.
const VERTEX_GAP: u32 = 8;
/// The same for faces, which are only copied.
const INDEX_GAP: u32 = 64;

/// Texture coordinates per unit of length: square root of uv area over surface area in the base mesh; 0 without
/// texture coordinates.
#[must_use]
pub fn uv_per_unit(base: &Base) -> f32 {
    let (mut surface, mut uv) = (0.0_f64, 0.0_f64);
    for face in &base.faces {
        let Some([a, b, c]) = wedges_of(base, face.wedges) else { continue };
        let p = [a, b, c].map(|w| base.positions.get(w.vertex as usize).map(|&q| base.grid.position(q)));
        let [Some(p), Some(q), Some(r)] = p else { continue };
        let (p, q, r) = (glam::DVec3::from(p), glam::DVec3::from(q), glam::DVec3::from(r));
        let [s, t, u] = [a, b, c].map(|w| glam::DVec2::from(base.uv_grid.uv(w.attributes.uv)));
        surface += (q - p).cross(r - p).length();
        uv += (t - s).perp_dot(u - s).abs();
    }
    // A density, not a count.
    if surface > 0.0 { (uv / surface).sqrt() as f32 } else { 0.0 }
}

fn wedges_of(base: &Base, wedges: [u32; 3]) -> Option<[geometry::mesh::Wedge; 3]> {
    let get = |w: u32| base.wedges.get(w as usize).copied();
    Some([get(wedges[0])?, get(wedges[1])?, get(wedges[2])?])
}
