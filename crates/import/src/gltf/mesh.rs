//! Merges primitives into one [`SourceMesh`], transformed by their nodes.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DMat3, DMat4};
use gltf::json::accessor::Type;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;
use lodestream_geometry::mesh::{Corner, NONE, SourceMesh};

use super::accessor::{Buffers, Elements};
use super::container::Document;
use super::draco::{Compressed, Streams};
use super::ignored::Ignored;
use super::maps::{Lookup, UvTransform};
use super::material::{Converted, convert};
use super::posed::{Posed, SETS};
use super::root::{Pose, Primitive};
use crate::error::ImportError;
use crate::shading::{FaceShading, ShadingRuns, Unshaded};
use crate::srgb::linear_to_srgb;

/// Most triangles of one asset, over all nodes that are merged into it.
const MAX_FACES: usize = 1 << 26;
/// Most materials of one asset, as the protocol describes them.
const MAX_MATERIALS: usize = lodestream_scene::asset::MAX_MATERIALS;

/// Meshes merged so far.
pub(super) struct Builder<'a> {
    document: &'a Document,
    buffers: Buffers<'a>,
    streams: Streams,
    mesh: SourceMesh,
    shading: ShadingRuns,
    materials: Vec<Converted>,
    /// By index in the file; `None` is the default material.
    material_of: BTreeMap<Option<usize>, u16>,
    ignored: Ignored,
    warnings: Vec<String>,
    /// Materials whose missing texture coordinates were reported.
    without_uvs: BTreeSet<u16>,
    /// Whether vertices may follow joints that move.
    follows_joints: bool,
}

/// The vertex attributes of one primitive.
struct Attributes {
    positions: Elements,
    normals: Option<Elements>,
    /// Texture coordinates by number of their TEXCOORD_n set: those that the material's maps use.
    uvs: Vec<(u32, Elements)>,
    colors: Option<Elements>,
    pose: Posed,
}

impl<'a> Builder<'a> {
    pub(super) fn new(document: &'a Document) -> Self {
        Self::with(document, Buffers::new(document))
    }

    /// For shapes only: images of materials are not read.
    pub(super) fn of_shapes(document: &'a Document) -> Self {
        Self::with(document, Buffers::without_images(document))
    }

    fn with(document: &'a Document, buffers: Buffers<'a>) -> Self {
        Self {
            document,
            buffers,
            streams: Streams::default(),
            mesh: SourceMesh::default(),
            shading: ShadingRuns::default(),
            materials: Vec::new(),
            material_of: BTreeMap::new(),
            ignored: Ignored::of_file(document),
            warnings: document.told().collect(),
            without_uvs: BTreeSet::new(),
            follows_joints: false,
        }
    }

    /// Adds a mesh of the file, transformed.
    ///
    /// # Errors
    /// Accessors that do not hold what they should, indices beyond their vertices, and too many faces.
    pub(super) fn add(&mut self, mesh: usize, transform: &DMat4) -> Result<(), ImportError> {
        let document = self.document;
        let Some(source) = document.root.meshes.get(mesh) else {
            return Err(document.error(format!("meshes[{mesh}] does not exist")));
        };
        for (number, primitive) in source.primitives.iter().enumerate() {
            self.primitive(
                (primitive, &source.pose),
                &format!("meshes[{mesh}].primitives[{number}]"),
                transform,
            )?;
        }
        Ok(())
    }

    /// Notes that all meshes of the file become one, in which none moves.
    pub(super) fn merge(&mut self) {
        self.ignored.note_animations(self.document);
    }

    /// Notes that what is added stays one mesh of the file, whose vertices follow joints that move.
    pub(super) fn follow_joints(&mut self) {
        self.follows_joints = true;
    }

    /// Numbers the faces added since the last call as a part.
    pub(super) fn end_part(&mut self, part: u32) {
        self.mesh.parts.resize(self.mesh.faces.len(), part);
    }

    /// One mesh of the file, untransformed and by itself. Its material numbers mean nothing.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub(super) fn take(&mut self, mesh: usize) -> Result<SourceMesh, ImportError> {
        // Room for all materials of the mesh, which may have as many as an asset.
        if self.materials.len() >= MAX_MATERIALS / 2 {
            self.materials.clear();
            self.material_of.clear();
        }
        let added = self.add(mesh, &DMat4::IDENTITY);
        self.warnings.clear();
        self.shading = ShadingRuns::default();
        let taken = std::mem::take(&mut self.mesh);
        added.map(|()| taken)
    }

    fn primitive(
        &mut self,
        (primitive, pose): (&Primitive, &Pose),
        place: &str,
        transform: &DMat4,
    ) -> Result<(), ImportError> {
        let document = self.document;
        let mode = match primitive.mode() {
            Some(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
            Some(_) => {
                self.ignored.note("points and lines");
                return Ok(());
            }
            None => return Err(document.error(format!("{place}.mode is unknown"))),
        };
        let material = self.material(primitive.material.map(|m| m.value()))?;
        let compressed = self.streams.open(document, &mut self.buffers, primitive, place)?;
        // Draco streams contain a list of triangles, whatever the primitive's mode.
        let mode = if compressed.is_some() { Mode::Triangles } else { mode };
        let attributes = self.attributes((primitive, pose), compressed.as_ref(), place, material)?;
        let Some(attributes) = attributes else { return Ok(()) };
        self.warn_of_missing_uvs(material, &attributes, place);
        let indices = self.indices(primitive, compressed.as_ref(), place, attributes.positions.len())?;
        let faces = match mode {
            Mode::Triangles => indices.len() / 3,
            _ => indices.len().saturating_sub(2),
        };
        if faces > MAX_FACES.saturating_sub(self.mesh.faces.len()) {
            return Err(document.error(format!(
                "{place} brings the triangles of one asset above {MAX_FACES}; split the model"
            )));
        }
        let mut used = indices.clone();
        used.sort_unstable();
        used.dedup();
        let corners = self.vertices(&attributes, &used, place, material, transform)?;
        if let Some(skeleton) = attributes.pose.skeleton() {
            self.mesh.poses.clone_from(&skeleton.poses);
        }
        // Every index is among those used.
        let corner = |i: u32| corners[used.binary_search(&i).unwrap_or(0)];
        let flip = (DMat3::from_mat4(*transform).determinant() < 0.0) != attributes.pose.mirrors();
        self.mesh.faces.reserve(faces);
        for [a, b, c] in triangles(&indices, mode) {
            // A mirror reverses the winding; swapping two corners restores it.
            let [a, b, c] = if flip { [a, c, b] } else { [a, b, c] };
            self.mesh.faces.push([corner(a), corner(b), corner(c)]);
            self.mesh.materials.push(material);
        }
        // "When normals are not specified, client implementations MUST calculate flat normals" (glTF 2.0, §3.7.2.1).
        let shading = if attributes.normals.is_some() { FaceShading::Given } else { FaceShading::Flat };
        self.shading.push(self.mesh.faces.len(), shading);
        Ok(())
    }

    /// Warns, once for each material, that a primitive lacks texture coordinates of the material's maps.
    fn warn_of_missing_uvs(&mut self, material: u16, attributes: &Attributes, place: &str) {
        let converted = &self.materials[usize::from(material)];
        let missing = |lookup: &Lookup| !attributes.uvs.iter().any(|(set, _)| *set == lookup.uv_set);
        let Some(lookup) = converted.lookups.into_iter().flatten().find(missing) else { return };
        if self.without_uvs.insert(material) {
            self.warnings.push(format!(
                "{}: {place} has no TEXCOORD_{}, which the maps of its material {:?} are laid by: each shows one of its \
                 texels all over; export the mesh with texture coordinates",
                self.document.path.display(),
                lookup.uv_set,
                converted.imported.material.name
            ));
        }
    }

    fn material(&mut self, index: Option<usize>) -> Result<u16, ImportError> {
        if let Some(&known) = self.material_of.get(&index) {
            return Ok(known);
        }
        if self.materials.len() >= MAX_MATERIALS {
            return Err(ImportError::TooManyMaterials {
                path: self.document.path.clone(),
                count: self.materials.len() + 1,
                limit: MAX_MATERIALS,
            });
        }
        let converted = convert(self.document, index, &mut self.buffers, &mut self.warnings)?;
        self.materials.push(converted);
        let number = (self.materials.len() - 1) as u16;
        self.material_of.insert(index, number);
        Ok(number)
    }

    /// Opens the supported attributes and counts the others as ignored; `None` for a primitive without positions, which
    /// glTF allows and which draws nothing.
    fn attributes(
        &mut self,
        (primitive, pose): (&Primitive, &Pose),
        compressed: Option<&Compressed>,
        place: &str,
        material: u16,
    ) -> Result<Option<Attributes>, ImportError> {
        let document = self.document;
        let [first, second] = self.materials[usize::from(material)].lookups;
        let sets_of_uvs = [Some(first.unwrap_or_default().uv_set), second.map(|lookup| lookup.uv_set)];
        let mut positions = None;
        let (mut normals, mut uvs, mut colors) = (None, Vec::new(), None);
        let mut influences: [[Option<Elements>; 2]; SETS] = Default::default();
        let sets = if pose.skin.is_some() { SETS } else { 0 };
        for (semantic, accessor) in &primitive.attributes {
            let Checked::Valid(semantic) = semantic else {
                self.ignored.note("attributes of the application's own");
                continue;
            };
            let name = semantic.to_string();
            let place = format!("{place}.attributes.{name}");
            let mut open = |allowed: &[Type]| {
                let decoded =
                    compressed.map(|c| c.attribute(document, &name, accessor.value(), &place, allowed));
                match decoded.transpose()?.flatten() {
                    Some(elements) => Ok(elements),
                    None => self.buffers.open(accessor.value(), &place, allowed),
                }
            };
            match semantic {
                Semantic::Positions => positions = Some(open(&[Type::Vec3])?),
                Semantic::Normals => normals = Some(open(&[Type::Vec3])?),
                Semantic::TexCoords(set) if sets_of_uvs.contains(&Some(*set)) => {
                    uvs.push((*set, open(&[Type::Vec2])?));
                }
                Semantic::Colors(0) => colors = Some(open(&[Type::Vec3, Type::Vec4])?),
                Semantic::Joints(set) | Semantic::Weights(set) if (*set as usize) < sets => {
                    let kind = usize::from(matches!(semantic, Semantic::Weights(_)));
                    influences[*set as usize][kind] = Some(open(&[Type::Vec4])?);
                }
                Semantic::Joints(_) | Semantic::Weights(_) => {}
                _ => self.ignored.note(&format!("attribute {name}")),
            }
        }
        let Some(positions) = positions else {
            self.ignored.note("primitives without POSITION");
            return Ok(None);
        };
        let others = [("NORMAL", normals.as_ref()), ("COLOR_0", colors.as_ref())];
        let uv_sets = uvs.iter().map(|(_, elements)| ("TEXCOORD", Some(elements)));
        for (name, elements) in others.into_iter().chain(uv_sets) {
            if elements.is_some_and(|e| e.len() < positions.len()) {
                return Err(self
                    .document
                    .error(format!("{place}.attributes.{name} has fewer elements than POSITION")));
            }
        }
        let of = (primitive, pose);
        let (pose, left_out) = Posed::open(
            document,
            &mut self.buffers,
            of,
            (place, positions.len(), self.follows_joints),
            influences,
        )?;
        if left_out > 0 {
            self.ignored.note("morph targets");
        }
        Ok(Some(Attributes { positions, normals, uvs, colors, pose }))
    }

    /// The primitive's indices, all below `vertices`.
    fn indices(
        &mut self,
        primitive: &Primitive,
        compressed: Option<&Compressed>,
        place: &str,
        vertices: usize,
    ) -> Result<Vec<u32>, ImportError> {
        let document = self.document;
        let place = format!("{place}.indices");
        let indices: Vec<u32> = match (compressed, primitive.indices) {
            (Some(compressed), _) => compressed.corners(),
            (None, None) => return Ok((0..vertices as u32).collect()),
            (None, Some(accessor)) => {
                let elements = self.buffers.open(accessor.value(), &place, &[Type::Scalar])?;
                if !elements.is_unsigned() {
                    return Err(document.error(format!("{place}: are not unsigned integers")));
                }
                (0..elements.len()).map(|i| elements.get::<1>(i)[0] as u32).collect()
            }
        };
        match indices.iter().find(|&&index| index as usize >= vertices) {
            Some(index) => {
                Err(document.error(format!("{place}: index {index} is beyond the {vertices} vertices")))
            }
            None => Ok(indices),
        }
    }

    /// Appends the vertices `used`, and returns a corner for each.
    ///
    /// # Errors
    /// Positions and texture coordinates that are not finite.
    fn vertices(
        &mut self,
        attributes: &Attributes,
        used: &[u32],
        place: &str,
        material: u16,
        transform: &DMat4,
    ) -> Result<Vec<Corner>, ImportError> {
        let document = self.document;
        let error = |name: &str, index: usize| {
            document
                .error(format!("{place}.attributes.{name}: element {index} is not finite; export it again"))
        };
        let linear = DMat3::from_mat4(*transform);
        // Normals transform by the cofactor matrix: the inverse transpose up to a factor, defined for singular maps
        // too. The sign of the determinant keeps them pointing outwards.
        let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
        let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
        let outwards = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
        let [first, second] = self.materials[usize::from(material)].lookups;
        let laid = |lookup: Lookup| {
            let elements = attributes.uvs.iter().find(|(set, _)| *set == lookup.uv_set);
            elements.map(|(_, elements)| (elements, lookup.transform))
        };
        let (first, second) = (laid(first.unwrap_or_default()), second.and_then(laid));
        let mesh = &mut self.mesh;
        let mut corners = Vec::with_capacity(used.len());
        for &index in used {
            let index = index as usize;
            let mut corner = Corner::at(mesh.positions.len() as u32);
            let position =
                transform.transform_point3(attributes.pose.position(index, attributes.positions.get(index)));
            if !position.is_finite() {
                return Err(error("POSITION", index));
            }
            mesh.positions.push(position.to_array());
            mesh.skins.extend(attributes.pose.skin(index));
            if let Some(normals) = &attributes.normals {
                let normal = cofactors * attributes.pose.normal(index, normals.get(index)) * outwards;
                // A zero normal counts as missing.
                if let Some(normal) = normal.try_normalize() {
                    corner.normal = mesh.normals.len() as u32;
                    mesh.normals.push(normal.as_vec3().to_array());
                }
            }
            let uv = |(elements, transform): (&Elements, UvTransform)| {
                let uv = transform.apply(elements.get(index));
                if uv.iter().all(|x| x.is_finite()) { Ok(uv) } else { Err(error("TEXCOORD", index)) }
            };
            if let Some(first) = first {
                corner.uv = mesh.uvs.len() as u32;
                mesh.uvs.push(uv(first)?);
            }
            if let Some(second) = second {
                corner.second_uv = mesh.second_uvs.len() as u32;
                mesh.second_uvs.push(uv(second)?);
            }
            if let Some(colors) = &attributes.colors {
                corner.color = mesh.colors.len() as u32;
                let [r, g, b, a] = colors.get(index);
                let alpha =
                    if colors.components() == 4 { (a.clamp(0.0, 1.0) * 255.0).round() } else { 255.0 };
                mesh.colors.push([linear_to_srgb(r), linear_to_srgb(g), linear_to_srgb(b), alpha as u8]);
            }
            corners.push(corner);
        }
        Ok(corners)
    }

    /// The merged mesh.
    ///
    /// # Errors
    /// A model without a triangle.
    pub(super) fn finish(mut self) -> Result<Unshaded, ImportError> {
        self.warnings.extend(self.ignored.warning(self.document));
        if self.mesh.faces.is_empty() {
            let found = format!(
                "{} meshes, {} nodes",
                self.document.root.meshes.len(),
                self.document.root.nodes.len()
            );
            return Err(ImportError::NoFaces { path: self.document.path.clone(), found });
        }
        debug_assert!(self.mesh.faces.iter().flatten().all(|c| c.position != NONE));
        let materials = self.materials.into_iter().map(|converted| converted.imported).collect();
        Ok(Unshaded { mesh: self.mesh, materials, shading: self.shading, warnings: self.warnings })
    }
}

/// Corners of each triangle (glTF 2.0 specification, §3.7.2.1): lists, strips, fans.
fn triangles(indices: &[u32], mode: Mode) -> impl Iterator<Item = [u32; 3]> + '_ {
    let count = if mode == Mode::Triangles { indices.len() / 3 } else { indices.len().saturating_sub(2) };
    (0..count).map(move |i| match mode {
        Mode::TriangleStrip => [indices[i], indices[i + 1 + i % 2], indices[i + 2 - i % 2]],
        Mode::TriangleFan => [indices[i + 1], indices[i + 2], indices[0]],
        _ => [indices[3 * i], indices[3 * i + 1], indices[3 * i + 2]],
    })
}
