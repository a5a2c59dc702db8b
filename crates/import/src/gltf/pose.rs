//! Poses: the shape that a mesh has in the scene of a file by its skin, or by its morph targets.
//!
//! A pose belongs to a node, but what is imported are meshes. So each mesh in a pose of its own becomes one before anything
//! else is done: the mesh itself for the first node that places it, copies that share its primitives for others.

use std::collections::BTreeMap;
use std::sync::Arc;

use gltf::json::mesh::Semantic;

use super::root::{Mesh, Node, Pose, Primitive, Root};

/// Most weights of morph targets that are read, which bounds the work for nodes that repeat a mesh's.
const MAX_WEIGHTS: usize = 1 << 10;
/// Longest name and extras that a mesh in a further pose repeats, in bytes.
const MAX_REPEATED_BYTES: usize = 256;

fn pose_of(node: &Node, mesh: &Mesh, skin: Option<usize>) -> Pose {
    let weights = node.weights.as_ref().or(mesh.weights.as_ref());
    let weights = weights.filter(|weights| weights.iter().any(|&weight| weight != 0.0));
    let bits = |weights: &[f32]| weights.iter().take(MAX_WEIGHTS).map(|weight| weight.to_bits()).collect();
    let bits = weights.map(|weights| bits(weights));
    Pose { skin, weights: bits.unwrap_or_default() }
}

/// Gives each mesh of a file the pose of the nodes that place it. Returns what is wrong with skins, for people.
pub(super) fn resolve(root: &mut Root) -> Option<String> {
    let mut posed: BTreeMap<(usize, Pose), usize> = BTreeMap::new();
    let mut taken = vec![false; root.meshes.len()];
    let skinned: Vec<bool> = root.meshes.iter().map(is_skinned).collect();
    let complete: Vec<bool> = root.skins.iter().map(|skin| is_complete(root, skin)).collect();
    let (mut unusable, mut first) = (0_usize, 0);
    for index in 0..root.nodes.len() {
        let node = &root.nodes[index];
        let number = node.mesh.map_or(usize::MAX, |mesh| mesh.value());
        let Some(mesh) = root.meshes.get(number).filter(|_| number < taken.len()) else { continue };
        let skin = node.skin.map(|skin| skin.value());
        let usable = skin.filter(|&skin| skinned[number] && complete.get(skin) == Some(&true));
        if skin != usable {
            (unusable, first) = (unusable + 1, if unusable == 0 { index } else { first });
        }
        let pose = pose_of(node, mesh, usable);
        let is_skinned = pose.skin.is_some();
        let own = match posed.get(&(number, pose.clone())) {
            Some(&own) => own,
            None if !std::mem::replace(&mut taken[number], true) => {
                root.meshes[number].pose = pose.clone();
                posed.insert((number, pose), number);
                number
            }
            None => {
                let further = further(mesh, pose.clone());
                root.meshes.push(further);
                posed.insert((number, pose), root.meshes.len() - 1);
                root.meshes.len() - 1
            }
        };
        let node = &mut root.nodes[index];
        node.mesh = u32::try_from(own).ok().map(gltf::json::Index::new);
        node.is_skinned = is_skinned;
    }
    // In a file without nodes, meshes are as they state.
    for (mesh, _) in root.meshes.iter_mut().zip(&taken).filter(|(_, taken)| !**taken) {
        mesh.pose = pose_of(&Node::default(), mesh, None);
    }
    (unusable > 0).then(|| {
        format!(
            "{unusable} nodes have skins with joints that do not exist, or meshes without joints and weights, and are drawn \
             without (the first is nodes[{first}])"
        )
    })
}

/// A mesh in one more pose.
fn further(mesh: &Mesh, pose: Pose) -> Mesh {
    let short = |length: usize| length <= MAX_REPEATED_BYTES;
    Mesh {
        name: mesh.name.clone().filter(|name| short(name.len())),
        extras: mesh.extras.clone().filter(|extras| short(extras.get().len())),
        primitives: Arc::clone(&mesh.primitives),
        weights: None,
        pose,
    }
}

fn is_skinned(mesh: &Mesh) -> bool {
    let has = |primitive: &Primitive| {
        [Semantic::Joints(0), Semantic::Weights(0)].iter().all(|of| primitive.attribute(of).is_some())
    };
    mesh.primitives.iter().all(has)
}

/// Whether a skin has joints, and all that it names exists.
fn is_complete(root: &Root, skin: &gltf::json::Skin) -> bool {
    let joints = skin.joints.len();
    let matrices = skin.inverse_bind_matrices.is_none_or(|accessor| {
        root.accessors.get(accessor.value()).is_some_and(|accessor| accessor.count >= joints as u64)
    });
    matrices && joints > 0 && skin.joints.iter().all(|joint| joint.value() < root.nodes.len())
}
