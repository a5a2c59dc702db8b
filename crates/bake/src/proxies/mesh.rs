//! The mesh of a node: base meshes of its members in their places, with colours in the vertices.

use glam::DVec3;
use lodestream_geometry::DecodeError;
use lodestream_geometry::base::Base;
use lodestream_geometry::mesh::{Corner, Face, NONE, QuantisedMesh, SourceMesh};
use lodestream_geometry::normals::wedge_normals;
use lodestream_scene::asset::{AssetDescription, Material};
use lodestream_scene::placement::Placement;
use lodestream_store::{PackFile, StoreError};

use super::color::corners;
use super::components::connected;

/// A base mesh as a member of a node, in its asset's units.
pub(super) struct Piece {
    positions: Vec<DVec3>,
    /// Of each vertex; empty if it has one part.
    parts: Vec<u32>,
    /// Of each wedge; zero for none.
    normals: Vec<DVec3>,
    faces: Vec<PieceFace>,
    /// Roughness and metalness of each material, and the largest diagonal of the components that have it.
    shading: Vec<([f64; 2], f64)>,
    /// Length up to which colours differ from what vertices show, in the asset's units.
    detail: f64,
}

struct PieceFace {
    vertices: [u32; 3],
    wedges: [u32; 3],
    colors: [[u8; 4]; 3],
    /// Roughness and metalness.
    shading: [f64; 2],
    /// Whether it is shaded by its own normal.
    flat: bool,
}

impl Piece {
    /// Reads a base mesh, its materials and their coarsest textures. Transparent faces are left out unless
    /// `transparent_too`.
    ///
    /// # Errors
    /// Blobs that are missing, unreadable or damaged.
    pub(super) fn read(pack: &PackFile, transparent_too: bool) -> Result<Self, StoreError> {
        Self::of(pack, pack.base()?, transparent_too)
    }

    /// As [`Self::read`], of a mesh of the pack that replaces its base mesh in `base`.
    ///
    /// # Errors
    /// As there.
    pub(super) fn of(pack: &PackFile, mut base: Base, transparent_too: bool) -> Result<Self, StoreError> {
        let description = AssetDescription::decode(&base.description)
            .map_err(|why| pack.damaged(DecodeError::new("description", why.to_string())))?;
        let mut colors = corners(pack, &base, &description)?;
        let lengths = component_lengths(&base);
        let (mut detail, mut textured) = (0.0_f64, 0.0_f64);
        for ((face, length), color) in base.faces.iter().zip(&lengths).zip(&colors) {
            let material = description.materials.get(usize::from(face.material));
            if color.is_none() || material.is_some_and(|material| material.emits() || material.unlit) {
                detail = detail.max(*length);
            }
            if material.is_some_and(|material| material.textures().next().is_some()) {
                textured = textured.max(*length);
            }
        }
        // A displacement counts half as an attribute's (lodestream_geometry::screen).
        let detail = detail.max(texture_length(&base, &description).min(textured) / 2.0);
        if transparent_too {
            for (color, face) in colors.iter_mut().zip(&base.faces) {
                let material = description.materials.get(usize::from(face.material));
                color.get_or_insert([material.map_or([u8::MAX; 4], opaque); 3]);
            }
        }
        let mesh = QuantisedMesh {
            grid: base.grid,
            uv_grid: base.uv_grid,
            second_uv_grid: base.second_uv_grid,
            positions: std::mem::take(&mut base.positions),
            wedges: std::mem::take(&mut base.wedges),
            faces: std::mem::take(&mut base.faces),
            parts: std::mem::take(&mut base.parts),
            skins: Vec::new(),
            poses: Vec::new(),
        };
        let shadings: Vec<[f64; 2]> =
            description.materials.iter().map(|m| shading(m, &description)).collect();
        let mut of_shading: Vec<([f64; 2], f64)> = shadings.iter().map(|&shading| (shading, 0.0)).collect();
        for (face, &length) in mesh.faces.iter().zip(&lengths) {
            if let Some((_, longest)) = of_shading.get_mut(usize::from(face.material)) {
                *longest = longest.max(length);
            }
        }
        let faces = mesh.faces.iter().zip(colors).filter_map(|(face, colors)| {
            Some(PieceFace {
                vertices: face.wedges.map(|wedge| mesh.wedges[wedge as usize].vertex),
                wedges: face.wedges,
                colors: colors?,
                shading: shadings.get(usize::from(face.material)).copied().unwrap_or([1.0, 0.0]),
                flat: description.materials.get(usize::from(face.material)).is_some_and(|m| m.flat),
            })
        });
        Ok(Self {
            shading: of_shading,
            positions: mesh.positions.iter().map(|&q| mesh.grid.position(q).into()).collect(),
            normals: wedge_normals(&mesh).into_iter().map(DVec3::from).collect(),
            parts: mesh.parts,
            faces: faces.collect(),
            detail,
        })
    }

    /// White triangles that share no vertex.
    #[cfg(test)]
    pub(super) fn of_triangles(triangles: &[[DVec3; 3]]) -> Self {
        let face = |first: u32| PieceFace {
            vertices: [0, 1, 2].map(|k| 3 * first + k),
            wedges: [0, 1, 2].map(|k| 3 * first + k),
            colors: [[u8::MAX; 4]; 3],
            shading: [1.0, 0.0],
            flat: false,
        };
        Self {
            positions: triangles.as_flattened().to_vec(),
            parts: Vec::new(),
            normals: vec![DVec3::Z; 3 * triangles.len()],
            faces: (0..triangles.len() as u32).map(face).collect(),
            shading: Vec::new(),
            detail: 0.0,
        }
    }

    /// Its faces in the world.
    pub(super) fn triangles(&self, placement: &Placement) -> impl Iterator<Item = [DVec3; 3]> {
        let corner = |vertex: u32| placement.to_world(self.positions[vertex as usize]);
        self.faces.iter().map(move |face| face.vertices.map(corner))
    }

    /// For each face the number of its connected component, and how many there are.
    pub(super) fn components(&self) -> (Vec<u32>, usize) {
        connected(self.positions.len(), self.faces.iter().map(|face| face.vertices))
    }

    /// Some of its faces.
    pub(super) fn some(mut self, is_wanted: impl Iterator<Item = bool>) -> Self {
        let faces = std::mem::take(&mut self.faces);
        self.faces =
            faces.into_iter().zip(is_wanted).filter_map(|(face, wanted)| wanted.then_some(face)).collect();
        self
    }

    /// Without its division into parts.
    pub(super) fn into_one_part(self) -> Self {
        Self { parts: Vec::new(), ..self }
    }
}

/// Colour of a material without textures, sRGB.
fn opaque(material: &Material) -> [u8; 4] {
    let [r, g, b, _] = material.base_color;
    let [r, g, b] = [r, g, b].map(|x| lodestream_import::srgb::linear_to_srgb(f64::from(x)));
    [r, g, b, u8::MAX]
}

/// Roughness and metalness of a material, with the mean of its texture.
fn shading(material: &Material, description: &AssetDescription) -> [f64; 2] {
    let texture = material.surface_texture.and_then(|of| description.textures.get(usize::from(of)));
    let [_, green, blue] = texture.and_then(|texture| texture.mean).unwrap_or([u8::MAX; 3]);
    let share = |byte: u8| f64::from(byte) / 255.0;
    [f64::from(material.roughness) * share(green), f64::from(material.metallic) * share(blue)]
}

/// Mean length of a unit of texture coordinates on the surface, in the asset's units; 0 without textures. A texture has no
/// detail that is coarser.
fn texture_length(base: &Base, description: &AssetDescription) -> f64 {
    let (mut surface, mut texture) = (0.0, 0.0);
    for face in &base.faces {
        let material = description.materials.get(usize::from(face.material));
        if material.is_none_or(|material| material.textures().next().is_none()) {
            continue;
        }
        let wedges = face.wedges.map(|wedge| base.wedges[wedge as usize]);
        let at = wedges.map(|w| DVec3::from(base.grid.position(base.positions[w.vertex as usize])));
        let uv = wedges.map(|w| glam::DVec2::from(base.uv_grid.uv(w.attributes.uv)));
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            surface += at[from].distance(at[to]);
            texture += uv[from].distance(uv[to]);
        }
    }
    // One texel on a whole surface is a colour.
    if texture == 0.0 { 0.0 } else { surface / texture }
}

/// For each face, the diagonal of its connected component: what vanishes, or looks otherwise, as a whole.
fn component_lengths(base: &Base) -> Vec<f64> {
    let faces = base.faces.iter().map(|f: &Face| f.wedges.map(|wedge| base.wedges[wedge as usize].vertex));
    let (of_face, count) = connected(base.positions.len(), faces.clone());
    let mut bounds = vec![(DVec3::INFINITY, DVec3::NEG_INFINITY); count];
    for (vertices, &component) in faces.zip(&of_face) {
        let (low, high) = &mut bounds[component as usize];
        for vertex in vertices {
            let point = DVec3::from(base.grid.position(base.positions[vertex as usize]));
            (*low, *high) = (low.min(point), high.max(point));
        }
    }
    of_face
        .iter()
        .map(|&component| bounds[component as usize])
        .map(|(low, high)| low.distance(high))
        .collect()
}

/// A node's mesh while members are added.
#[derive(Default)]
pub(super) struct Union {
    mesh: SourceMesh,
    /// Roughness, metalness, flatness and their weight, summed by area.
    shading: [f64; 4],
    /// Roughness and metalness of the members' materials, and the largest length in the world that has them.
    materials: Vec<([f64; 2], f64)>,
    /// Largest [`Piece::detail`] in the world.
    detail: f64,
}

/// A node's mesh.
pub(super) struct NodeMesh {
    pub(super) mesh: SourceMesh,
    pub(super) material: Material,
    /// Length up to which colours and shading differ from the members', in world units: for errors, a displacement.
    pub(super) appearance_error: f64,
}

impl Union {
    /// Adds a member. Its part `p` becomes part `first_part + p`.
    pub(super) fn add(&mut self, piece: &Piece, placement: &Placement, first_part: u32) {
        let rotation = placement.orientation().as_dquat();
        let mesh = &mut self.mesh;
        let (position, normal) = (mesh.positions.len() as u32, mesh.normals.len() as u32);
        mesh.positions.extend(piece.positions.iter().map(|&point| placement.to_world(point).to_array()));
        mesh.normals.extend(piece.normals.iter().map(|&n| (rotation * n).as_vec3().to_array()));
        for face in &piece.faces {
            let color = mesh.colors.len() as u32;
            mesh.colors.extend(face.colors);
            mesh.faces.push(std::array::from_fn(|i| Corner {
                normal: normal + face.wedges[i],
                color: color + i as u32,
                ..Corner::at(position + face.vertices[i])
            }));
            let part = piece.parts.get(face.vertices[0] as usize).copied().unwrap_or(0);
            mesh.parts.push(first_part + part);
            let [a, b, c] = face.vertices.map(|vertex| piece.positions[vertex as usize]);
            let area = (b - a).cross(c - a).length() * f64::from(placement.scale).powi(2);
            let [roughness, metallic] = face.shading;
            [area * roughness, area * metallic, if face.flat { area } else { 0.0 }, area]
                .into_iter()
                .zip(&mut self.shading)
                .for_each(|(x, sum)| *sum += x);
        }
        mesh.materials.resize(mesh.faces.len(), 0);
        self.detail = self.detail.max(piece.detail * f64::from(placement.scale));
        self.materials.extend(
            piece.shading.iter().map(|&(shading, length)| (shading, length * f64::from(placement.scale))),
        );
    }

    /// Faces of what was added.
    pub(super) const fn face_count(&self) -> usize {
        self.mesh.faces.len()
    }

    /// The mesh, with one opaque material of mean roughness and metalness, flat if most of it is. Few flat faces get no
    /// normals of their own, which would take more bytes than their positions.
    pub(super) fn finish(mut self) -> NodeMesh {
        let [roughness, metallic, flat, area] = self.shading;
        let flat = 2.0 * flat > area;
        if flat {
            self.mesh.normals.clear();
            self.mesh.faces.iter_mut().flatten().for_each(|corner| corner.normal = NONE);
        }
        let mean = if area > 0.0 { [roughness / area, metallic / area] } else { [1.0, 0.0] };
        let material = Material {
            base_color: [1.0; 4],
            roughness: mean[0] as f32,
            metallic: mean[1] as f32,
            flat,
            ..Material::default()
        };
        let differs = |(of, length): &([f64; 2], f64)| {
            let difference = (of[0] - mean[0]).abs().max((of[1] - mean[1]).abs());
            difference * length / 2.0
        };
        let appearance_error = self.materials.iter().map(differs).fold(self.detail, f64::max);
        NodeMesh { mesh: self.mesh, material, appearance_error }
    }
}
