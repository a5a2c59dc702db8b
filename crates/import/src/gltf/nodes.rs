//! Flattening of the node hierarchy: each mesh and light with its transformation to the scene, in f64.

use glam::{DMat4, DQuat, DVec3};

use super::accessor::Buffers;
use super::container::Document;
use super::instancing;
use super::lights::{self, PlacedLight};
use super::part_names::Nodes;
use super::root::{Node, Root};
use crate::error::ImportError;

/// A mesh of the file with its transformation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub(super) mesh: usize,
    pub(super) to_scene: DMat4,
    /// The node that places it; `None` in a file without scenes.
    pub(super) node: Option<u32>,
    /// Its transformation to the node.
    pub(super) to_node: DMat4,
}

/// Meshes and lights of a scene.
#[derive(Debug, Default)]
pub(super) struct SceneContents {
    pub(super) nodes: Nodes,
    /// Parents of the scene's nodes, by node of the file.
    pub(super) parents: Vec<Option<u32>>,
    pub(super) meshes: Vec<Placed>,
    pub(super) lights: Vec<PlacedLight>,
}

/// Flattens the default scene, or the first one if the file names none; nodes depth first. A file without scenes is a
/// library: each mesh once, untransformed, and no lights.
///
/// # Errors
/// Nodes that do not exist, have two parents or are their own ancestors; values that are not finite; invalid instances.
pub(super) fn placed(document: &Document) -> Result<SceneContents, ImportError> {
    let root = &document.root;
    let number = root.scene.map_or(0, |scene| scene.value());
    let Some(scene) = root.scenes.get(number) else {
        if root.scenes.is_empty() {
            let all = 0..root.meshes.len();
            let (to_scene, to_node) = (DMat4::IDENTITY, DMat4::IDENTITY);
            let meshes = all.map(|mesh| Placed { mesh, to_scene, node: None, to_node }).collect();
            return Ok(SceneContents { meshes, ..SceneContents::default() });
        }
        return Err(document.error(format!("scenes[{number}] does not exist")));
    };
    let count = root.nodes.len();
    let (nodes, parents) = (Nodes::new(count), vec![None; count]);
    let mut placed = SceneContents { nodes, parents, ..SceneContents::default() };
    let mut buffers = Buffers::new(document);
    let mut seen = vec![false; root.nodes.len()];
    let mut waiting: Vec<(usize, DMat4, Option<u32>)> =
        scene.nodes.iter().rev().map(|node| (node.value(), DMat4::IDENTITY, None)).collect();
    while let Some((index, parent, named)) = waiting.pop() {
        let error = |what: &str| document.error(format!("nodes[{index}] {what}"));
        let node = root.nodes.get(index).ok_or_else(|| error("does not exist"))?;
        if std::mem::replace(&mut seen[index], true) {
            return Err(error("has two parents, or is its own ancestor; the nodes must form trees"));
        }
        let to_scene = parent * local(node);
        if !to_scene.is_finite() {
            return Err(error("has a transformation that is not finite"));
        }
        let named = placed.nodes.add(index, node, named);
        let number = u32::try_from(index).ok();
        if let Some(mesh) = node.mesh.map(|mesh| mesh.value()) {
            // Joints place a mesh with a skin: "only the joint transforms are applied" (glTF 2.0 specification, §3.7.3.3).
            let to_scene = if node.is_skinned { DMat4::IDENTITY } else { to_scene };
            match instancing::of_node(document, &mut buffers, node, index)? {
                None => placed.meshes.push(Placed { mesh, to_scene, node: number, to_node: DMat4::IDENTITY }),
                Some(places) => {
                    let placed_here =
                        |to_node| Placed { mesh, to_scene: to_scene * to_node, node: number, to_node };
                    let places: Vec<Placed> = places.into_iter().map(placed_here).collect();
                    if !places.iter().all(|place| place.to_scene.is_finite()) {
                        return Err(error("has an instance that is not finite; export the file again"));
                    }
                    placed.meshes.extend(places);
                }
            }
        }
        if let Some(light) = lights::of_node(node).map_err(error)? {
            placed.lights.push(PlacedLight { node: index, light, to_scene });
        }
        for child in &node.children {
            if let Some(parent) = placed.parents.get_mut(child.value()) {
                *parent = number;
            }
        }
        let children = node.children.iter().rev();
        waiting.extend(children.map(|child| (child.value(), to_scene, named)));
    }
    Ok(placed)
}

/// The transformation of each node to the scene; the identity for nodes that are their own ancestors. They are computed
/// once.
pub(super) fn nodes_to_scene(document: &Document) -> &[DMat4] {
    document.to_scene.get_or_init(|| all_to_scene(&document.root))
}

fn all_to_scene(root: &Root) -> Vec<DMat4> {
    let mut is_child = vec![false; root.nodes.len()];
    for child in root.nodes.iter().flat_map(|node| &node.children) {
        if let Some(is_child) = is_child.get_mut(child.value()) {
            *is_child = true;
        }
    }
    let mut all = vec![DMat4::IDENTITY; root.nodes.len()];
    let mut seen = vec![false; root.nodes.len()];
    let roots = is_child.iter().enumerate().filter(|(_, is_child)| !**is_child);
    let mut waiting: Vec<(usize, DMat4)> = roots.map(|(index, _)| (index, DMat4::IDENTITY)).collect();
    while let Some((index, parent)) = waiting.pop() {
        let Some(node) = root.nodes.get(index) else { continue };
        if std::mem::replace(&mut seen[index], true) {
            continue;
        }
        all[index] = parent * local(node);
        waiting.extend(node.children.iter().map(|child| (child.value(), all[index])));
    }
    all
}

/// The transformation of a node to its parent.
pub(super) fn local(node: &Node) -> DMat4 {
    if let Some(matrix) = &node.matrix {
        return DMat4::from_cols_array(matrix);
    }
    let vector = |v: Option<[f64; 3]>, default: f64| v.map_or(DVec3::splat(default), DVec3::from_array);
    let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    // Normalised, since files round quaternions; a zero quaternion counts as the identity.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    DMat4::from_scale_rotation_translation(vector(node.scale, 1.0), rotation, vector(node.translation, 0.0))
}
