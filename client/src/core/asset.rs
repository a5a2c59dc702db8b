//! One asset in the client: its mesh at the current refinement, and what has changed since the renderer's last fetch.

use std::collections::BTreeMap;

use geometry::DecodeError;
use geometry::index::ChunkInfo;
use geometry::mesh::NONE;
use geometry::refine::{ActiveMesh, ChunkDelta, ChunkError, DirtySlots, RefineError};
use lodestream_compress::{decode_base, decode_prefix};
use lodestream_geometry as geometry;
use lodestream_scene::asset::{AssetDescription, DescriptionError};
use lodestream_scene::blob::{BlobPart, Tile};
use lodestream_select::Occluder;

use super::changes::{IndexRun, MeshChange, Vertex, runs};

/// Why a chunk or base mesh cannot be used.
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
    #[error("the base mesh states {base} chunks, but the scene {scene}")]
    ChunkCount { base: u32, scene: u32 },
    #[error("the base mesh uses material {used}, but describes only {count}")]
    Material { used: u16, count: usize },
}

/// Slots whose contents have changed since the last fetch.
#[derive(Debug, Default)]
struct Dirty {
    wedges: Vec<u32>,
    draws: Vec<(u16, u32)>,
    /// Length above which duplicates are removed.
    limit: usize,
}

impl Dirty {
    fn add(&mut self, touched: DirtySlots) {
        self.wedges.extend(touched.wedges);
        self.draws.extend(touched.draws);
        // A hidden window may fetch nothing for a long time. Removing duplicates keeps memory proportional to the mesh.
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

/// An asset whose base mesh has arrived.
#[derive(Debug)]
pub(crate) struct RefinedAsset {
    pub(crate) description: AssetDescription,
    pub(crate) origin: [f64; 3],
    mesh: ActiveMesh,
    dirty: Option<Dirty>,
    /// Whether the asset is in the queue of changed assets.
    is_queued: bool,
    /// When a chunk's vertices were first handed to a renderer, in seconds: the start of their morph.
    births: BTreeMap<u32, f32>,
    /// Level of each applied chunk.
    levels: BTreeMap<u32, u8>,
    /// Faces of the last occluder.
    occluder_faces: usize,
    /// Slots of vertices and of each material's faces as of the last [`Self::take_changes`].
    fetched: (u32, Vec<u32>),
    /// Faces and bytes as of the last [`Self::growth`].
    pub(crate) counted: (u64, u64),
}

/// Faces beyond which an occluder is not refined: its error is then far below the sizes of regions.
const MAX_OCCLUDER_FACES: usize = 2048;

/// Bytes of a vertex in GPU memory. A renderer keeps up to half as many in reserve.
const RENDERER_VERTEX_BYTES: u64 = 52;
/// Slots of each kind that one step of compaction moves, and at most a chunk more: about the work of applying a few
/// chunks.
const COMPACTED_SLOTS: u32 = 1024;
/// Dirty slots beyond which compaction waits for the renderer, so that no step of changes is large because of it.
const MAX_DIRTY_COMPACTED: usize = 1 << 14;

impl RefinedAsset {
    /// Decodes a base blob. `track_changes`: record changes for a renderer.
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
            mesh: ActiveMesh::new(&base),
            dirty: track_changes.then(Dirty::default),
            is_queued: false,
            births: BTreeMap::new(),
            levels: BTreeMap::new(),
            occluder_faces: 0,
            fetched: (0, Vec::new()),
            counted: (0, 0),
        };
        asset.touch_all();
        Ok(asset)
    }

    /// All levels of the asset's textures, and all tiles of those that are cut.
    pub(crate) fn texture_images(&self) -> impl Iterator<Item = BlobPart> + use<'_> {
        (0..).zip(&self.description.textures).flat_map(|(texture, info)| {
            let whole = info.whole_levels();
            (0..).zip(0..info.levels.len()).flat_map(move |(level, at)| {
                (0..info.images(at)).map(move |tile| match u16::try_from(tile) {
                    Ok(tile) if at >= whole => BlobPart::Tile(Tile { texture, level, tile }),
                    _ => BlobPart::Texture { texture, level },
                })
            })
        })
    }

    /// Lets the next changes be the whole mesh, for a renderer that has nothing of it.
    pub(crate) fn restate(&mut self) {
        self.touch_all();
        self.is_queued = false;
    }

    /// Marks all slots as changed.
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

    /// Decodes and applies a chunk whose parents are applied, up to a truncation point or whole; a chunk that is
    /// applied up to an earlier truncation point is raised. On failure the chunk is not applied, not even its
    /// beginning, which is not trustworthy if the rest is damaged; nothing else changes.
    pub(crate) fn apply(
        &mut self,
        chunk: u32,
        info: &ChunkInfo,
        truncation: Option<u8>,
        bytes: &[u8],
    ) -> Result<(), AssetError> {
        // A raised chunk keeps its birth, so that its new vertices appear at once: they could morph only from the
        // position of their oldest ancestor, which the chunk's beginning has already moved.
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

    /// Decodes a chunk that is not applied and whose parents are, for [`Self::apply_decoded`].
    pub(crate) fn decode_chunk(
        &self,
        chunk: u32,
        info: &ChunkInfo,
        truncation: Option<u8>,
        bytes: &[u8],
    ) -> Result<ChunkDelta, ChunkError> {
        decode_prefix(&self.mesh, chunk, info, truncation, bytes)
    }

    /// Applies a decoded chunk of a level. On failure nothing changes.
    pub(crate) fn apply_decoded(&mut self, level: u8, delta: &ChunkDelta) -> Result<(), RefineError> {
        let touched = self.mesh.apply(delta)?;
        self.note(touched);
        self.levels.insert(delta.chunk, level);
        Ok(())
    }

    /// Lets a chunk that was just applied appear without a morph. Vertices that a renderer has already keep their
    /// birth.
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

    /// Whether [`Self::compact`] has work: more was undone than is applied.
    pub(crate) fn is_sparse(&self) -> bool {
        self.mesh.is_sparse()
    }

    /// Moves chunks, a few at a time, into slots that undone ones have left. Waits, and returns false, while many changes
    /// have not been fetched: what moves is fetched again.
    pub(crate) fn compact(&mut self) -> bool {
        let waits = |dirty: &Dirty| dirty.wedges.len() + dirty.draws.len() > MAX_DIRTY_COMPACTED;
        if self.dirty.as_ref().is_some_and(waits) {
            return false;
        }
        let touched = self.mesh.compact(COMPACTED_SLOTS);
        self.note(touched);
        true
    }

    fn note(&mut self, touched: DirtySlots) {
        if let Some(dirty) = &mut self.dirty {
            dirty.add(touched);
        }
    }

    /// A new occluder: the first, and each time that the mesh has grown by half, up to [`MAX_OCCLUDER_FACES`].
    pub(crate) fn better_occluder(&mut self) -> Option<Occluder> {
        let faces = self.mesh.face_count();
        if self.occluder_faces >= MAX_OCCLUDER_FACES || 2 * faces < 3 * self.occluder_faces.max(1) {
            return None;
        }
        self.occluder_faces = faces;
        let (positions, faces) = self.mesh.surface();
        Some(Occluder::new(positions, faces))
    }

    /// Faces and bytes, in client and renderer, as of the last call and now.
    pub(crate) fn growth(&mut self) -> [(u64, u64); 2] {
        let mesh = &self.mesh;
        let faces = (0..mesh.material_count()).map(|material| mesh.indices(material).len()).sum::<usize>();
        let drawn = RENDERER_VERTEX_BYTES * u64::from(mesh.wedge_slots())
            + size_of::<[u32; 3]>() as u64 * faces as u64;
        let drawn = drawn + drawn / 2;
        let now = (mesh.face_count() as u64, mesh.bytes() as u64 + drawn);
        [std::mem::replace(&mut self.counted, now), now]
    }

    /// The mesh at the current refinement.
    pub(crate) const fn mesh(&self) -> &ActiveMesh {
        &self.mesh
    }

    /// Marks the asset as queued for the renderer; returns whether it was not. Always false if changes are not
    /// recorded.
    pub(crate) fn enqueue(&mut self) -> bool {
        self.dirty.is_some() && !std::mem::replace(&mut self.is_queued, true)
    }

    /// Whether [`RefinedAsset::take_changes`] has a change.
    pub(crate) fn has_changes(&self) -> bool {
        let is_dirty = |dirty: &Dirty| !dirty.wedges.is_empty() || !dirty.draws.is_empty();
        self.dirty.as_ref().is_some_and(|dirty| is_dirty(dirty) || self.is_shorter())
    }

    /// Whether slots at the end were given up since the last call of [`Self::take_changes`].
    fn is_shorter(&self) -> bool {
        let (vertices, faces) = &self.fetched;
        let lists = faces.iter().zip(0..).any(|(&before, material)| self.index_slots(material) < before);
        lists || self.mesh.wedge_slots() < *vertices
    }

    /// Length of a material's index list.
    fn index_slots(&self, material: u16) -> u32 {
        u32::try_from(self.mesh.indices(material).len()).unwrap_or(NONE)
    }

    /// Takes the changes since the last call; all changes together give the current mesh. The morph of new vertices
    /// starts at `now_s`.
    pub(crate) fn take_changes(&mut self, asset: u32, now_s: f32) -> Option<MeshChange> {
        self.is_queued = false;
        if !self.has_changes() {
            return None;
        }
        let mut dirty = std::mem::take(self.dirty.as_mut()?);
        dirty.merge();
        let mesh = &self.mesh;
        let slots = mesh.wedge_slots();
        // Slots at the end may have been removed since.
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
        let index_slots: Vec<u32> =
            (0..mesh.material_count()).map(|material| self.index_slots(material)).collect();
        self.fetched = (slots, index_slots.clone());
        Some(MeshChange { asset, vertices, indices, vertex_slots: slots, index_slots })
    }
}

/// Birth of vertices that appear without a morph.
const LONG_AGO_S: f32 = -1e9;
/// Most unchanged slots to include instead of beginning another upload: an upload costs about as much as computing this
/// many normals.
const VERTEX_GAP: u32 = 8;
/// As [`VERTEX_GAP`], for faces, which are only copied.
const INDEX_GAP: u32 = 64;
