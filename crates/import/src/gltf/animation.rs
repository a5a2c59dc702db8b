//! Animations: the nodes above placed meshes and joints that move, what hangs on them, and their clips.
//!
//! Morph targets and lights do not move: a warning says so, once for a file. So it is with channels that cannot be read;
//! the others play.

use glam::{DAffine3, DMat3, DMat4};
use lodestream_scene::animation::{AnimatedModel, AnimatedPart, MAX_ENTRIES};

use super::accessor::Buffers;
use super::animated_nodes::{Above, AnimatedNodes, Moving};
use super::animation_left_out::LeftOut;
use super::animation_targets::targets;
use super::container::Document;
use super::keyframes::Keyframes;
use super::nodes::SceneContents;
use super::skeletons;
use super::uneven::scales_unevenly;

/// The animation of a file's placed meshes.
#[derive(Clone, Debug, PartialEq)]
pub struct FileAnimation {
    /// Nodes, parts and clips; it has no places.
    pub model: AnimatedModel,
    /// Of each part of the model, then of each skin, the index of the placed mesh.
    pub placed: Vec<usize>,
}

/// A mesh that may move.
pub(super) struct Candidate {
    /// Number of the node that places it.
    pub(super) node: usize,
    /// From the mesh to its node.
    pub(super) to_node: DMat4,
    /// From the asset to the mesh, and from the file's scene to the asset; `None` if the asset is flat.
    pub(super) maps: Option<[DAffine3; 2]>,
}

/// The animation of the meshes that a file places, of which skinned ones are no candidates but name the skin that they
/// follow, if it moves; and a warning about what does not play. No animation if nothing moves.
pub(super) fn of_file(
    document: &Document,
    contents: &SceneContents,
    candidates: &[Option<Candidate>],
    followers: &[Option<usize>],
) -> (Option<FileAnimation>, Option<String>) {
    let animations = &document.root.animations;
    if animations.is_empty() {
        return (None, None);
    }
    let mut left_out = LeftOut::default();
    let targets = targets(animations, &mut left_out);
    let mut nodes = AnimatedNodes::new(document, contents, &targets);
    let (mut parts, mut placed) = (Vec::new(), Vec::new());
    for (index, candidate) in candidates.iter().enumerate() {
        let Some(candidate) = candidate else { continue };
        let Above { number: Some(node), below } = nodes.above(candidate.node) else { continue };
        match candidate.maps {
            Some([to_mesh, from_model]) if parts.len() < MAX_ENTRIES => {
                let to_node = below * DAffine3::from_mat4(candidate.to_node) * to_mesh;
                parts.push(AnimatedPart { node, to_node, from_model });
                placed.push(index);
            }
            _ => left_out.still += 1,
        }
    }
    let mut skins = Vec::new();
    let mut buffers = Buffers::new(document);
    for (index, skin) in followers.iter().enumerate() {
        // The same skin once more for each mesh, with its joints.
        let Some(skin) = skin.filter(|_| parts.len() + skins.len() < MAX_ENTRIES) else { continue };
        let Some((skin, _)) = skeletons::bound(&mut nodes, &mut buffers, skin) else { continue };
        skins.push(skin);
        placed.push(index);
    }
    let mut model = AnimatedModel { nodes: nodes.nodes, parts, skins, ..AnimatedModel::default() };
    Keyframes::new(document, &nodes.numbers, &mut left_out).add_clips(animations, &mut model);
    left_out.uneven = scales_unevenly(&model);
    let mut moving = Moving::new(contents, &targets);
    left_out.skinned = skinned_nodes(document, &mut moving).saturating_sub(model.skins.len());
    left_out.lit = contents.lights.iter().filter(|light| moving.moves(light.node)).count();
    let warning = left_out.warning(&document.path);
    if model.clips.is_empty() || model.parts.is_empty() && model.skins.is_empty() {
        return (None, warning);
    }
    match model.to_bytes() {
        Ok(_) => (Some(FileAnimation { model, placed }), warning),
        Err(why) => {
            let path = document.path.display();
            (None, Some(format!("{path}: its animations are not played: {why}; shorten them")))
        }
    }
}

/// Number of nodes with a skin of which a joint moves.
fn skinned_nodes(document: &Document, moving: &mut Moving<'_>) -> usize {
    let skins = &document.root.skins;
    let moves: Vec<bool> =
        skins.iter().map(|skin| skin.joints.iter().any(|joint| moving.moves(joint.value()))).collect();
    let nodes = document.root.nodes.iter().filter(|node| node.is_skinned);
    nodes.filter(|node| node.skin.is_some_and(|skin| moves.get(skin.value()) == Some(&true))).count()
}

/// The map from an asset to its mesh, from that from the mesh to the asset; `None` if it has no inverse.
pub(super) fn inverse(linear: &DMat3) -> Option<DAffine3> {
    let inverse = linear.inverse();
    let exists = linear.determinant() != 0.0 && inverse.is_finite();
    exists.then(|| DAffine3::from_mat3(inverse))
}
