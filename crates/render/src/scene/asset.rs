//! An asset in GPU memory: vertices, an index list per material, materials and textures.

use std::collections::BTreeSet;
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, Vec3};
use lodestream_scene::asset::Material;
use lodestream_scene::parts::PartTransform;

use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::paged_buffer::PagedBuffer;
use crate::resources::pages::PageRange;
use crate::resources::stamp::new_stamp;
use crate::resources::texture::Texture;
use crate::resources::texture_data::TextureData;
#[cfg(feature = "client")]
use crate::resources::uploads::Uploads;
#[cfg(any(test, feature = "methods"))]
use crate::resources::vertex::HostMesh;
use crate::resources::vertex::PackedVertex;
#[cfg(feature = "client")]
use crate::scene::attribute_table::RareAttributes;
use crate::scene::bound_material::{BoundMaterial, Features};
use crate::scene::index_set::IndexSet;
use crate::scene::material_bindings::MaterialBindings;
use crate::scene::mesh_pools::MeshPools;
use crate::scene::part_states::PartStates;
use crate::scene::part_table::Written;
use crate::scene::vertex_tables::VertexTables;

/// Largest gap between touched slots that is bridged by one upload. Each vertex costs the computation of a star, faces
/// cost nothing.
const MAX_VERTEX_GAP: u32 = 2;
const MAX_FACE_GAP: u32 = 64;

/// Ascending numbers as ranges; gaps of at most `gap` missing numbers are bridged.
fn runs(slots: &[u32], gap: u32) -> impl Iterator<Item = RangeInclusive<u32>> + '_ {
    slots
        .chunk_by(move |a, b| b.saturating_sub(*a) <= gap + 1)
        .filter_map(|run| Some(*run.first()?..=*run.last()?))
}

/// An asset that the renderer draws. Created by [`crate::Renderer::create_asset`].
///
/// Vertices are addressed by wedge slot, faces by face slot within their material; an unused face
/// slot holds `[0, 0, 0]`, which covers no pixel.
#[derive(Debug)]
pub struct AssetGpu {
    number: u64,
    kit: MaterialBindings,
    origin: DVec3,
    bounds: Option<(DVec3, f64)>,
    reach: VertexBounds,
    stamp: u64,
    look_stamp: u64,
    vertices: PagedBuffer<PackedVertex>,
    parts: Vec<Part>,
    textures: Vec<Texture>,
    /// Numbers of the states of textures' tiles.
    tile_stamps: Vec<Arc<AtomicU64>>,
    tables: VertexTables,
    /// Indices of the placements that are drawn; all if `None`.
    drawn: Option<IndexSet>,
}

/// Bounds of all vertices ever written, and when their morphs end.
#[derive(Debug)]
struct VertexBounds {
    /// Corners of the bounding box of positions and morph origins.
    extent: [Vec3; 2],
    /// Latest birth of a morphing vertex.
    moved_s: f32,
}

impl VertexBounds {
    const NONE: Self = Self { extent: [Vec3::INFINITY, Vec3::NEG_INFINITY], moved_s: f32::NEG_INFINITY };

    fn note(&mut self, vertex: &PackedVertex) {
        for at in [vertex.position, vertex.morph_from].map(Vec3::from) {
            let [low, high] = self.extent;
            self.extent = [low.min(at), high.max(at)];
        }
        if vertex.morph_from != vertex.position {
            self.moved_s = self.moved_s.max(vertex.birth_s);
        }
    }
}

/// The faces of one material.
#[derive(Debug)]
struct Part {
    material: Material,
    bound: Arc<BoundMaterial>,
    indices: PagedBuffer<[u32; 3]>,
}

/// Kinds of an asset's materials.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Look {
    /// Any is transparent.
    pub(crate) blends: bool,
    /// Any opaque one emits.
    pub(crate) emits: bool,
    /// Any opaque one has specular reflection that is not the usual.
    pub(crate) specular: bool,
}

/// Inputs of one material's draw call.
pub(crate) struct PartDraw<'a> {
    pub(crate) material: &'a BoundMaterial,
    pub(crate) indices: &'a PageRange,
    pub(crate) faces: u32,
}

impl AssetGpu {
    pub(crate) fn new(
        gpu: &Gpu,
        (kit, pools): (MaterialBindings, &MeshPools),
        origin: DVec3,
        materials: &[Material],
        textures: Vec<Texture>,
    ) -> Self {
        textures.iter().for_each(|texture| texture.attach(gpu, &kit.tiles));
        let tile_stamps = textures.iter().filter_map(Texture::tile_stamp).collect();
        let parts = materials
            .iter()
            .map(|material| Part {
                material: material.clone(),
                bound: kit.bind(gpu, material, &textures, &VertexTables::default()),
                indices: PagedBuffer::new(&pools.faces),
            })
            .collect();
        Self {
            number: new_stamp(),
            kit,
            origin,
            bounds: None,
            reach: VertexBounds::NONE,
            stamp: new_stamp(),
            look_stamp: new_stamp(),
            vertices: PagedBuffer::new(&pools.vertices),
            parts,
            textures,
            tile_stamps,
            tables: VertexTables::default(),
            drawn: None,
        }
    }

    /// The point that vertex positions are relative to, in the asset's units.
    #[must_use]
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Sets a bounding sphere (centre relative to the origin, asset units) of all vertices; instances whose sphere
    /// lies outside the view are culled.
    pub fn set_bounds(&mut self, centre: DVec3, radius: f64) {
        self.bounds = Some((centre, radius));
    }

    /// The sphere set by [`AssetGpu::set_bounds`].
    #[must_use]
    pub fn bounds(&self) -> Option<(DVec3, f64)> {
        self.bounds
    }

    /// A bounding sphere of all vertices: as set, else of the vertices written.
    pub(crate) fn sphere(&self) -> (DVec3, f64) {
        let [low, high] = self.reach.extent.map(Vec3::as_dvec3);
        self.bounds.unwrap_or((0.5 * (low + high), 0.5 * low.distance(high)))
    }

    /// The same of an instance, with its moved parts.
    pub(crate) fn sphere_of(&self, instance: usize) -> (DVec3, f64) {
        let (centre, radius) = self.sphere();
        let mut moves = self.tables.states.moves(instance).peekable();
        if moves.peek().is_none() {
            return (centre, radius);
        }
        let (centre, radius) = PartTransform::bounds(moves, (self.origin + centre, radius));
        (centre - self.origin, radius)
    }

    /// Equal for equal geometry at the same place in memory, morphs aside.
    pub(crate) fn stamp(&self) -> u64 {
        self.stamp
    }

    /// Unique number of the asset.
    pub(crate) fn number(&self) -> u64 {
        self.number
    }

    /// Equal for equal geometry ([`AssetGpu::stamp`]), for equal materials and textures, and for equal tiles of these.
    pub(crate) fn stamps(&self) -> [u64; 3] {
        [self.stamp, self.look_stamp, self.tile_stamp()]
    }

    /// Equal for equal tiles of textures, 0 without: each change has a greater number than all before.
    fn tile_stamp(&self) -> u64 {
        self.tile_stamps.iter().map(|stamp| stamp.load(Ordering::Relaxed)).max().unwrap_or(0)
    }

    /// The same if tiles may have holes, which shadows show; else 0.
    pub(crate) fn hole_stamp(&self) -> u64 {
        if self.parts.iter().any(|part| part.bound.features.mask) { self.tile_stamp() } else { 0 }
    }

    /// Latest birth of a vertex that morphs.
    pub(crate) fn moved_s(&self) -> f32 {
        self.reach.moved_s
    }

    /// Replaces the vertices from slot `first` on. The buffer grows as needed; slots skipped over
    /// are zero.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] past the device's buffer limit; nothing is changed then.
    pub fn update_vertices(
        &mut self,
        gpu: &Gpu,
        first: usize,
        vertices: &[PackedVertex],
    ) -> Result<(), RenderError> {
        self.vertices.write(gpu, first as u64, vertices)?;
        self.stamp = new_stamp();
        for vertex in vertices {
            self.reach.note(vertex);
        }
        Ok(())
    }

    /// Stages vertices, each with its other attributes, among other uploads; they take effect with [`AssetGpu::commit`].
    #[cfg(feature = "client")]
    pub(crate) fn stage_vertices(
        &mut self,
        gpu: &Gpu,
        uploads: &mut Uploads,
        first: usize,
        vertices: impl ExactSizeIterator<Item = (PackedVertex, RareAttributes)>,
    ) -> Result<(), RenderError> {
        let (reach, table) = (&mut self.reach, &mut self.tables.attributes);
        let vertices = vertices.map(|(vertex, attributes)| {
            reach.note(&vertex);
            table.number(attributes).map_or(vertex, |number| vertex.numbered(number))
        });
        self.vertices.stage(gpu, uploads, first as u64, vertices)?;
        if self.tables.attributes.write(gpu) {
            self.bind_again(gpu);
        }
        Ok(())
    }

    /// Forgets vertex slots, and face slots of each material, past these lengths with the next [`AssetGpu::commit`].
    #[cfg(feature = "client")]
    pub(crate) fn stage_lengths(&mut self, vertices: u32, faces: &[u32]) {
        self.vertices.stage_len(vertices.into());
        for (part, &len) in self.parts.iter_mut().zip(faces) {
            part.indices.stage_len(len.into());
        }
    }

    /// Moves vertices and faces out of pages that are evacuated, and out of buffers that have become too large. Nothing may
    /// be staged; the uploads must be submitted before the next frame. Returns the number of bytes copied.
    #[cfg(feature = "client")]
    pub(crate) fn repack(&mut self, gpu: &Gpu, uploads: &mut Uploads) -> Result<u64, RenderError> {
        let mut bytes = self.vertices.stage_repacked(gpu, uploads)?;
        for part in &mut self.parts {
            bytes += part.indices.stage_repacked(gpu, uploads)?;
        }
        if bytes > 0 {
            self.commit();
        }
        Ok(bytes)
    }

    /// Whether a buffer has become too large.
    #[cfg(feature = "client")]
    pub(crate) fn is_roomy(&self) -> bool {
        self.vertices.is_roomy() || self.parts.iter().any(|part| part.indices.is_roomy())
    }

    /// Makes staged data current; its uploads must be submitted before the next frame.
    #[cfg(feature = "client")]
    pub(crate) fn commit(&mut self) {
        self.vertices.commit();
        for part in &mut self.parts {
            part.indices.commit();
        }
        self.stamp = new_stamp();
    }

    /// Replaces single vertex slots, in ascending order, by `vertex(slot)`. Nearby slots are uploaded in one piece, so
    /// `vertex` may also be called for slots in between; it must know every slot up to the largest.
    ///
    /// # Errors
    /// As [`AssetGpu::update_vertices`].
    pub fn update_vertex_slots(
        &mut self,
        gpu: &Gpu,
        slots: &[u32],
        mut vertex: impl FnMut(u32) -> PackedVertex,
    ) -> Result<(), RenderError> {
        for run in runs(slots, MAX_VERTEX_GAP) {
            let first = *run.start() as usize;
            let vertices: Vec<_> = run.map(&mut vertex).collect();
            self.update_vertices(gpu, first, &vertices)?;
        }
        Ok(())
    }

    /// Replaces the given face slots (ascending) from `faces`, the material's whole list.
    ///
    /// # Errors
    /// As [`AssetGpu::update_indices`]; [`RenderError::NoSuch`] for a slot past the list's end.
    pub fn update_index_slots(
        &mut self,
        gpu: &Gpu,
        material: usize,
        slots: &[u32],
        faces: &[[u32; 3]],
    ) -> Result<(), RenderError> {
        for run in runs(slots, MAX_FACE_GAP) {
            let (first, last) = (*run.start() as usize, *run.end() as usize);
            let piece = faces.get(first..=last).ok_or(RenderError::NoSuch {
                what: "face slot",
                index: last,
                count: faces.len(),
            })?;
            self.update_indices(gpu, material, first, piece)?;
        }
        Ok(())
    }

    /// Replaces faces of `material` from face slot `first` on. Every index must name a vertex slot
    /// that has been written; faces that name a later one draw nothing sensible, but are harmless.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`] for an unknown material, [`RenderError::TooLarge`] past the device's
    /// buffer limit.
    pub fn update_indices(
        &mut self,
        gpu: &Gpu,
        material: usize,
        first: usize,
        faces: &[[u32; 3]],
    ) -> Result<(), RenderError> {
        self.part(material)?.indices.write(gpu, first as u64, faces)?;
        self.stamp = new_stamp();
        Ok(())
    }

    /// Stages faces among other uploads; they take effect with [`AssetGpu::commit`].
    #[cfg(feature = "client")]
    pub(crate) fn stage_indices(
        &mut self,
        gpu: &Gpu,
        uploads: &mut Uploads,
        material: usize,
        first: usize,
        faces: impl ExactSizeIterator<Item = [u32; 3]>,
    ) -> Result<(), RenderError> {
        self.part(material)?.indices.stage(gpu, uploads, first as u64, faces)
    }

    fn part(&mut self, material: usize) -> Result<&mut Part, RenderError> {
        let count = self.parts.len();
        self.parts.get_mut(material).ok_or(RenderError::NoSuch { what: "material", index: material, count })
    }

    /// Removes the face slots of `material` from `len` on.
    pub fn truncate_indices(&mut self, material: usize, len: usize) {
        if let Some(part) = self.parts.get_mut(material) {
            part.indices.truncate(len as u64);
            self.stamp = new_stamp();
        }
    }

    /// Replaces one material; the textures it names must be those given at creation.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`] for an unknown material.
    pub fn set_material(&mut self, gpu: &Gpu, index: usize, material: Material) -> Result<(), RenderError> {
        let count = self.parts.len();
        let part = self.parts.get_mut(index).ok_or(RenderError::NoSuch { what: "material", index, count })?;
        part.bound = self.kit.bind(gpu, &material, &self.textures, &self.tables);
        part.material = material;
        self.changed_look(true);
        Ok(())
    }

    /// Uploads one decoded mip level (0 = coarsest, as on the wire) of a texture. Levels may come in any order; the
    /// unbroken run from the coarsest up is used. Levels longer than 8192 texels or the device's limit are dropped. A
    /// shared texture takes each level once, but each asset uses it only after its own call.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`] or [`RenderError::LevelSize`]; nothing is changed then.
    pub fn update_texture(
        &mut self,
        gpu: &Gpu,
        texture: usize,
        level: u32,
        data: TextureData<'_>,
    ) -> Result<(), RenderError> {
        self.update_texture_rows(gpu, texture, level, data, 0..u32::MAX)
    }

    /// Uploads some rows of a level, whole in `data`, so that a large level does not delay a frame. Rows come in
    /// order; the level is used after the last.
    ///
    /// # Errors
    /// As [`AssetGpu::update_texture`].
    pub fn update_texture_rows(
        &mut self,
        gpu: &Gpu,
        texture: usize,
        level: u32,
        data: TextureData<'_>,
        rows: Range<u32>,
    ) -> Result<(), RenderError> {
        if self.texture(texture)?.upload(gpu, level, data, &rows)? {
            let mut holes = false;
            for part in &mut self.parts {
                let material = &part.material;
                if material.textures().any(|used| usize::from(used) == texture) {
                    part.bound = self.kit.bind(gpu, material, &self.textures, &self.tables);
                    holes |= part.bound.features.mask;
                }
            }
            self.changed_look(holes);
        }
        Ok(())
    }

    /// [`Texture::set_tile`] of one of the asset's textures.
    ///
    /// # Errors
    /// As there; [`RenderError::NoSuch`] for an unknown texture.
    pub fn update_texture_tile(
        &self,
        gpu: &Gpu,
        texture: usize,
        level: u32,
        [column, row]: [u32; 2],
        data: TextureData<'_>,
    ) -> Result<(), RenderError> {
        self.texture(texture)?.set_tile(gpu, level, column, row, data)
    }

    /// [`Texture::remove_tile`] of one of the asset's textures.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`] for an unknown texture, level or place.
    pub fn remove_texture_tile(
        &self,
        texture: usize,
        level: u32,
        [column, row]: [u32; 2],
    ) -> Result<bool, RenderError> {
        self.texture(texture)?.remove_tile(level, column, row)
    }

    fn texture(&self, index: usize) -> Result<&Texture, RenderError> {
        let count = self.textures.len();
        self.textures.get(index).ok_or(RenderError::NoSuch { what: "texture", index, count })
    }

    /// Hides, tints or moves parts ([`PackedVertex::of_part`]) of the asset's instances, which are numbered as in
    /// [`crate::Drawable::instances`]; replaces all earlier states. PN triangles and ink follow only where a whole
    /// instance is hidden. Costs one write to the device, in proportion to the largest part listed of each instance; the
    /// first time, pipelines for such vertices are compiled.
    ///
    /// # Errors
    /// [`RenderError::NoSuch`] for a part from [`crate::MAX_PARTS`] on, [`RenderError::TooLarge`] past the device's
    /// limit of textures; nothing is changed then.
    pub fn set_part_states(&mut self, gpu: &Gpu, states: PartStates) -> Result<(), RenderError> {
        let written = self.tables.states.set(gpu, states, self.origin)?;
        if written == Written::NewTexture {
            self.bind_again(gpu);
        }
        if written != Written::Nothing {
            self.changed_look(true);
        }
        Ok(())
    }

    /// Binds all materials again, to other tables.
    fn bind_again(&mut self, gpu: &Gpu) {
        for part in &mut self.parts {
            part.bound = self.kit.bind(gpu, &part.material, &self.textures, &self.tables);
        }
    }

    /// Sets which placements are drawn, numbered as in [`crate::Drawable::instances`]; all if `None`, the default.
    pub fn set_drawn(&mut self, drawn: Option<BTreeSet<u32>>) {
        if self.drawn.as_ref().map(IndexSet::indices) != drawn.as_ref() {
            self.drawn = drawn.map(IndexSet::new);
            self.changed_look(true);
        }
    }

    /// Whether all placements are drawn, as they are.
    pub(crate) fn has_no_states(&self) -> bool {
        self.drawn.is_none() && self.tables.states.texture().is_none()
    }

    /// Where the states of an instance's parts begin; `None` if nothing of it is drawn.
    pub(crate) fn part_states(&self, instance: usize) -> Option<u32> {
        let index = u32::try_from(instance).unwrap_or(u32::MAX);
        if self.drawn.as_ref().is_some_and(|drawn| !drawn.contains(index)) {
            return None;
        }
        self.tables.states.start(instance)
    }

    /// Number of the states of its parts, another for each change.
    pub(crate) fn part_states_version(&self) -> u64 {
        self.tables.states.version()
    }

    /// The same if any part is moved, which changes [`AssetGpu::sphere_of`]; else 0.
    pub(crate) fn part_moves_version(&self) -> u64 {
        if self.tables.states.moves_any() { self.tables.states.version() } else { 0 }
    }

    /// Where the states of this number begin of an instance that is drawn, if they were the last ones drawn; else where
    /// the present ones do.
    pub(crate) fn part_states_before(&self, instance: usize, version: u64) -> u32 {
        self.tables
            .states
            .start_before(instance, version)
            .or_else(|| self.tables.states.start(instance))
            .unwrap_or(0)
    }

    /// Marks materials, textures or part states as changed; `holes`: what is drawn at all, and thus shadows, may have
    /// changed.
    fn changed_look(&mut self, holes: bool) {
        self.look_stamp = new_stamp();
        if holes {
            self.stamp = new_stamp();
        }
    }

    /// Finest level of a texture in use; `None` until its coarsest has arrived.
    #[must_use]
    pub fn finest_texture_level(&self, texture: usize) -> Option<u32> {
        self.textures.get(texture).and_then(Texture::finest)
    }

    /// Textures, in the order of creation.
    #[must_use]
    pub fn textures(&self) -> &[Texture] {
        &self.textures
    }

    /// GPU memory of vertices and indices, in bytes.
    #[must_use]
    pub fn geometry_bytes(&self) -> u64 {
        self.vertices.bytes() + self.parts.iter().map(|p| p.indices.bytes()).sum::<u64>()
    }

    #[cfg(any(test, feature = "methods"))]
    /// Number of vertex slots.
    pub(crate) fn slots(&self) -> u64 {
        self.vertices.len()
    }

    /// The vertices and the parts with faces; `None` without vertices.
    pub(crate) fn draws(&self) -> Option<(&PageRange, impl Iterator<Item = PartDraw<'_>>)> {
        let parts = self.parts.iter().filter_map(|part| {
            let faces = u32::try_from(part.indices.len()).unwrap_or(u32::MAX).min(u32::MAX / 3);
            Some(PartDraw { material: &part.bound, indices: part.indices.range()?, faces })
                .filter(|draw| draw.faces > 0)
        });
        Some((self.vertices.range()?, parts))
    }

    #[cfg(any(test, feature = "reference"))]
    /// Reads back the corners of opaque triangles at their final positions, relative to the origin; alpha-tested holes
    /// are not left out. Waits for the device.
    pub(crate) fn triangles(&self, gpu: &Gpu) -> Result<Vec<[Vec3; 3]>, RenderError> {
        let vertices = self.vertices.read(gpu)?;
        let mut triangles = Vec::new();
        for part in self.parts.iter().filter(|part| !part.bound.features.blend) {
            let faces = part.indices.read(gpu)?;
            // Skip unused slots.
            let used = faces.iter().filter(|[a, b, c]| a != b && b != c && c != a);
            triangles.extend(used.filter_map(|face| {
                let [a, b, c] = face.map(|i| vertices.get(i as usize).map(|v| Vec3::from(v.position)));
                Some([a?, b?, c?])
            }));
        }
        Ok(triangles)
    }

    #[cfg(any(test, feature = "methods"))]
    /// Reads back the vertices and the first material's triangles. Waits for the device.
    pub(crate) fn read(&self, gpu: &Gpu) -> Result<HostMesh, RenderError> {
        let faces = self.parts.first().map_or(Ok(Vec::new()), |part| part.indices.read(gpu))?;
        // Skip unused slots.
        let used = faces.into_iter().filter(|[a, b, c]| a != b && b != c && c != a);
        Ok((self.vertices.read(gpu)?, used.collect()))
    }

    /// Kinds of materials with faces; `None` if there is nothing to draw.
    pub(crate) fn look(&self) -> Option<Look> {
        let drawn = self.parts.iter().filter(|part| part.indices.len() > 0);
        let looks = drawn.map(|part| {
            let Features { blend: blends, emits, specular, .. } = part.bound.features;
            Look { blends, emits: emits && !blends, specular: specular && !blends }
        });
        let all = |a: Look, b: Look| Look {
            blends: a.blends | b.blends,
            emits: a.emits | b.emits,
            specular: a.specular | b.specular,
        };
        looks.reduce(all).filter(|_| self.vertices.len() > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_bridge_small_gaps_only() {
        let got: Vec<_> = runs(&[3, 4, 6, 10, 11, 20], 1).collect();
        assert_eq!(got, [3..=6, 10..=11, 20..=20]);
        assert_eq!(runs(&[], 1).count(), 0);
        assert_eq!(runs(&[0, u32::MAX], 5).count(), 2);
    }
}
