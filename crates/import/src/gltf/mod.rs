//! glTF 2.0 and GLB to [`SourceMesh`](lodestream_geometry::mesh::SourceMesh) and materials.
//!
//! Meshes of triangles (lists, strips, fans; indexed or not; every component type, sparse accessors too; compressed or
//! not) with positions, normals, one set of texture coordinates and vertex colours; nodes flattened to
//! transformations in f64; metallic-roughness materials with all their maps; punctual lights. A warning names what is
//! ignored; an unsupported extension is an error if the file requires it and drawing without it would be wrong.
//!
//! The crate `gltf` parses the JSON. Its types are used without its validation, which panics on some
//! indices out of range (gltf-json 1.4, `primitive_validate_hook`): every index is looked up here with a
//! check, where it is used.

mod accessor;
mod animated_nodes;
mod animation;
mod animation_json;
mod animation_left_out;
mod animation_targets;
mod byte_values;
mod compressed;
mod container;
mod contents_bytes;
mod copies;
mod draco;
mod ignored;
mod instancing;
mod inverse_bind;
mod keyframes;
mod lights;
mod maps;
mod material;
mod mesh;
mod nodes;
mod part_names;
mod pose;
mod posed;
mod root;
mod similarity;
mod sizes;
mod skeleton;
mod skeletons;
mod specular;
#[cfg(test)]
mod tests;
mod uneven;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};

use crate::content::{Content as _, OpenFile};
use crate::error::ImportError;
use crate::model::Part;
use crate::shading::Unshaded;
pub use animation::FileAnimation;
pub(crate) use container::Document;
pub use contents_bytes::CONTENTS_VERSION;
pub use copies::CopyTolerance;
use lodestream_geometry::base::MAX_PARTS;
use lodestream_scene::placement::Placement;
use lodestream_scene::punctual_lights::PunctualLight;
use mesh::Builder;
pub use part_names::PartNames;
pub use sizes::{MeshSize, PartSize, join_uvs};

/// Relative tolerance within which axes count as equally long and orthogonal: the rounding of transformations that
/// were composed in f32.
const SIMILARITY: f64 = 1e-5;

/// One mesh of a file, placed by a similarity. Any other part of its transformation is in [`PlacedMesh::part`].
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedMesh {
    /// What is placed, as [`crate::import_part`] takes it: the mesh, or the one that it is a copy of.
    pub part: Part,
    /// The part's placement in the file's scene.
    pub placement: Placement,
    /// Index of the mesh itself.
    pub mesh: usize,
    /// Columns of the mesh's whole transformation, of which the part and the placement have rounded shares.
    pub to_scene: [[f64; 4]; 4],
    /// Number of the node that places it, by which [`Contents::part_names`] finds its name; `None` in a file without
    /// scenes.
    pub node: Option<u32>,
}

/// The meshes and lights of a file.
#[derive(Clone, Debug)]
pub struct Contents {
    /// Name of each mesh, by index; unique.
    pub names: Vec<String>,
    /// Size of each mesh, by index; `None` for meshes that must stay assets of their own.
    pub sizes: Vec<Option<MeshSize>>,
    /// What its placed meshes are called.
    pub part_names: Arc<PartNames>,
    /// Number of materials that its meshes may name, the default one included.
    pub materials: usize,
    /// Placements of meshes in the file's scene.
    pub placed: Vec<PlacedMesh>,
    /// Punctual lights of the file's scene.
    pub punctual_lights: Vec<PunctualLight>,
    /// How the placed meshes move, if any does.
    pub animation: Option<FileAnimation>,
    /// What could not be taken over whole, for people.
    pub warnings: Vec<String>,
}

impl Contents {
    /// Nodes and meshes of the parts of the whole file as one mesh ([`Part::Whole`]), by number; `None` if that has no
    /// parts: a file that places one mesh, or more than a mesh may have parts.
    #[must_use]
    pub fn merged_parts(&self) -> Option<impl Iterator<Item = (Option<u32>, usize)>> {
        has_parts(self.placed.len()).then(|| self.placed.iter().map(|placed| (placed.node, placed.mesh)))
    }
}

/// Whether the meshes that a file places are parts of their whole.
fn has_parts(placed: usize) -> bool {
    (2..=MAX_PARTS as usize).contains(&placed)
}

/// The placed meshes of which something is left to draw. A map onto a line or a point leaves nothing, one onto a plane
/// leaves flat meshes (glTF 2.0 specification, §3.5.3, lets only scales of zero on all axes hide a mesh).
fn drawn(mut placed: Vec<nodes::Placed>) -> Vec<nodes::Placed> {
    placed.retain(|placed| {
        let DMat3 { x_axis: x, y_axis: y, z_axis: z } = DMat3::from_mat4(placed.to_scene);
        [x.cross(y), y.cross(z), z.cross(x)].iter().any(|cofactors| *cofactors != DVec3::ZERO)
    });
    placed
}

fn open(path: &Path) -> Result<Document, ImportError> {
    let content = OpenFile::new(path)?;
    if content.length() == 0 {
        return Err(ImportError::Empty { path: path.to_owned() });
    }
    Document::parse(path, Arc::new(content))
}

/// Imports a file, or one mesh of it.
pub(super) fn import(path: &Path, part: &Part) -> Result<Unshaded, ImportError> {
    open(path)?.import(part)
}

impl Document {
    /// Imports the file, or one mesh of it.
    pub(crate) fn import(&self, part: &Part) -> Result<Unshaded, ImportError> {
        let mut builder = Builder::new(self);
        match part {
            Part::Whole => {
                let meshes = drawn(nodes::placed(self)?.meshes);
                let parted = has_parts(meshes.len());
                builder.merge();
                for (part, placed) in (0..).zip(meshes) {
                    builder.add(placed.mesh, &placed.to_scene)?;
                    if parted {
                        builder.end_part(part);
                    }
                }
            }
            Part::Mesh { mesh, linear } => {
                builder.follow_joints();
                builder.add(*mesh, &DMat4::from_mat3(DMat3::from_cols_array_2d(linear)))?;
            }
            Part::Batch(members) => {
                for (part, member) in (0..).zip(&**members) {
                    builder.add(member.mesh, &DMat4::from_cols_array_2d(&member.to_scene))?;
                    builder.end_part(part);
                }
            }
        }
        builder.finish()
    }

    /// What the file states of a part; `None` for all of it.
    pub(crate) fn stated_size(&self, part: &Part) -> Option<PartSize> {
        match part {
            Part::Whole => None,
            Part::Mesh { mesh, .. } => Some(sizes::of_part(self, [*mesh].into_iter())),
            Part::Batch(members) => Some(sizes::of_part(self, members.iter().map(|member| member.mesh))),
        }
    }

    /// As [`contents`].
    pub(crate) fn contents(&self, copies: Option<CopyTolerance>) -> Result<Contents, ImportError> {
        let mut placed = nodes::placed(self)?;
        let visible = drawn(std::mem::take(&mut placed.meshes));
        let used = visible.iter().map(|placed| placed.mesh).collect();
        let copies = copies.map(|tolerance| copies::of_meshes(self, &used, tolerance)).unwrap_or_default();
        let (mut candidates, mut followers) = (Vec::with_capacity(visible.len()), Vec::new());
        let placed_mesh = |nodes::Placed { mesh, to_scene, node, to_node }| {
            let (original, copied) =
                copies.get(&mesh).map_or((mesh, DMat4::IDENTITY), |(of, map)| (*of, *map));
            let (part, placement) = similar(original, &(to_scene * copied));
            candidates.push(self.movable(node, to_node, (&copied, &part, &placement)));
            followers.push(self.follower(node, &part, &placement));
            PlacedMesh { part, placement, mesh, to_scene: to_scene.to_cols_array_2d(), node }
        };
        let meshes = visible.into_iter().map(placed_mesh).collect();
        let (animation, still) = animation::of_file(self, &placed, &candidates, &followers);
        let punctual_lights = lights::punctual_lights(self, &placed.lights)?;
        let names = names(self);
        let (part_names, warning) = PartNames::new(self, placed.nodes, &names);
        Ok(Contents {
            names,
            part_names: Arc::new(part_names),
            sizes: sizes::of_meshes(self),
            materials: self.root.materials.len() + 1,
            placed: meshes,
            punctual_lights,
            animation,
            warnings: warning.into_iter().chain(still).collect(),
        })
    }

    /// How a placed mesh would move with its node; `None` for one that follows a skin or is in no node.
    fn movable(
        &self,
        node: Option<u32>,
        to_node: DMat4,
        (copied, part, placement): (&DMat4, &Part, &Placement),
    ) -> Option<animation::Candidate> {
        let node = node? as usize;
        let Part::Mesh { linear, .. } = part else { return None };
        if self.root.nodes.get(node)?.is_skinned {
            return None;
        }
        let to_mesh = animation::inverse(&DMat3::from_cols_array_2d(linear));
        let maps = to_mesh.map(|to_mesh| {
            let (scale, translation) = (f64::from(placement.scale), DVec3::from(placement.translation));
            let placed = DAffine3::from_scale_rotation_translation(
                DVec3::splat(scale),
                placement.orientation_f64(),
                translation,
            );
            [DAffine3::from_mat4(*copied) * to_mesh, placed.inverse()]
        });
        Some(animation::Candidate { node, to_node, maps })
    }

    /// The skin that a placed mesh follows, if its joints move.
    fn follower(&self, node: Option<u32>, part: &Part, placement: &Placement) -> Option<usize> {
        let node = self.root.nodes.get(node? as usize).filter(|node| node.is_skinned)?;
        let Part::Mesh { linear, .. } = part else { return None };
        // Instances of a skinned mesh stand still: what their joints would move is not said.
        let plain = *linear == DMat3::IDENTITY.to_cols_array_2d() && *placement == Placement::default();
        let skin = node.skin.filter(|_| plain)?.value();
        skeletons::of_document(self).contains_key(&skin).then_some(skin)
    }

    /// The files that are read beside it: buffers and images.
    pub(crate) fn dependencies(&self) -> Vec<PathBuf> {
        let buffers = self.root.buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
        let images = self.root.images.iter().filter_map(|image| image.uri.as_deref());
        let mut files = Vec::new();
        let mut known = BTreeSet::new();
        for uri in buffers.chain(images).filter(|uri| !uri.starts_with("data:")) {
            for file in self.files(uri) {
                if known.insert(file.clone()) {
                    files.push(file);
                }
            }
        }
        files
    }
}

/// Lists the meshes and lights of a file with their placements. With a tolerance, finds meshes that are copies of others,
/// which reads those that state the same numbers of corners; without one, reads no mesh.
///
/// # Errors
/// As [`crate::import`], except for errors within meshes.
pub fn contents(path: &Path, copies: Option<CopyTolerance>) -> Result<Contents, ImportError> {
    open(path)?.contents(copies)
}

/// The mesh of a name, untransformed.
///
/// # Errors
/// A file that is not glTF, or has no such mesh; the message lists its meshes.
pub fn part_named(path: &Path, name: &str) -> Result<Part, ImportError> {
    if !crate::file::is_gltf(path) {
        return Err(ImportError::gltf(path, "only glTF files have meshes with names; leave the mesh out"));
    }
    let document = open(path)?;
    let names = names(&document);
    let Some(mesh) = names.iter().position(|n| n == name) else {
        let some: Vec<&str> = names.iter().take(8).map(String::as_str).collect();
        let some = some.join(", ");
        return Err(document.error(format!("has no mesh named {name:?}; it has {}: {some}", names.len())));
    };
    Ok(Part::Mesh { mesh, linear: DMat3::IDENTITY.to_cols_array_2d() })
}

/// Names of the meshes, made unique by numbers; `mesh-N` for meshes without a name.
fn names(document: &Document) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for (index, mesh) in document.root.meshes.iter().enumerate() {
        let own = mesh.name.as_deref().filter(|name| !name.is_empty());
        let name = own.map_or_else(|| format!("mesh-{index}"), str::to_owned);
        let taken = counts.get(&*name).copied().unwrap_or_default();
        names.push(if taken == 0 { name } else { format!("{name}-{}", taken + 1) });
        if let Some(own) = own {
            counts.insert(own, taken + 1);
        }
    }
    names
}

/// Splits a transformation: a similarity becomes the placement of an instance, a mirror image the placement of one that is
/// mirrored in x; any other (uneven scale, shear) becomes a linear map of the mesh and a translation.
fn similar(mesh: usize, to_scene: &DMat4) -> (Part, Placement) {
    let linear = DMat3::from_mat4(*to_scene);
    let translation = to_scene.w_axis.truncate();
    let mirror = DMat3::from_diagonal(DVec3::new(linear.determinant().signum(), 1.0, 1.0));
    let rotated = linear * mirror;
    let scale = rotated.determinant().cbrt();
    let axes = [rotated.x_axis, rotated.y_axis, rotated.z_axis];
    let even = axes.iter().all(|axis| (axis.length() - scale).abs() <= SIMILARITY * scale);
    let square = [(0, 1), (1, 2), (2, 0)]
        .iter()
        .all(|&(i, j)| axes[i].dot(axes[j]).abs() <= SIMILARITY * scale * scale);
    let rounded = scale as f32;
    if rounded > 0.0 && rounded.is_finite() && even && square {
        let rotation = DQuat::from_mat3(&(rotated * scale.recip()));
        let part = Part::Mesh { mesh, linear: mirror.to_cols_array_2d() };
        (part, Placement::new(translation, rotation.normalize(), rounded))
    } else {
        let part = Part::Mesh { mesh, linear: linear.to_cols_array_2d() };
        (part, Placement::at(translation.to_array()))
    }
}

/// The files that are read beside a glTF file of the given content.
pub(super) fn dependencies(path: &Path, bytes: &[u8]) -> Vec<PathBuf> {
    Document::parse(path, Arc::new(Bytes::copy_from_slice(bytes)))
        .map(|document| document.dependencies())
        .unwrap_or_default()
}
