//! The skeletons of a file that its animations move. A mesh that follows one is imported in its bind pose, about where its
//! first joint rests, with a skin for each vertex; other skinned meshes are imported as their joints rest.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use glam::{DAffine3, DMat4, DVec3};
use lodestream_geometry::mesh::skin::{MAX_JOINTS, Pose};
use lodestream_scene::animation::{AnimatedModel, AnimatedSkin, SkinJoint, SkinPose};

use super::accessor::Buffers;
use super::animated_nodes::{AnimatedNodes, Moving};
use super::animation_left_out::LeftOut;
use super::animation_targets::targets;
use super::container::Document;
use super::inverse_bind::inverse_bind_matrices;
use super::keyframes::Keyframes;
use super::nodes::{self, SceneContents, nodes_to_scene};
use super::skeleton::Skeleton;

/// Poses in which the error of skins is measured.
const MEASURED_POSES: usize = 4;
/// Most times of a clip that are looked at for them, and most maps of joints that are computed for that.
const MAX_TIMES: usize = 16;
const MAX_MAPS: usize = 1 << 18;

/// The skeletons of a file that move, by number of the skin. They are looked for once.
pub(super) fn of_document(document: &Document) -> &BTreeMap<usize, Arc<Skeleton>> {
    document.skeletons.get_or_init(|| found(document))
}

/// The skeletons that move, by number of the skin: of skins that nodes of the scene have, with joints that a vertex can
/// name in a byte and keyframes that can be read. Nothing of a file whose nodes are invalid.
fn found(document: &Document) -> BTreeMap<usize, Arc<Skeleton>> {
    let root = &document.root;
    if root.animations.is_empty() || root.skins.is_empty() {
        return BTreeMap::new();
    }
    let Ok(contents) = nodes::placed(document) else { return BTreeMap::new() };
    let targets = targets(&root.animations, &mut LeftOut::default());
    let mut moving = Moving::new(&contents, &targets);
    let mut nodes = AnimatedNodes::new(document, &contents, &targets);
    let mut buffers = Buffers::new(document);
    let (mut skins, mut references) = (Vec::new(), Vec::new());
    for skin in used(document, &contents) {
        let joints = root.skins.get(skin).map_or(&[][..], |skin| &skin.joints);
        let moves = joints.iter().any(|joint| moving.moves(joint.value()));
        if let Some((bound, reference)) = bound(&mut nodes, &mut buffers, skin).filter(|_| moves) {
            skins.push(bound);
            references.push((skin, reference));
        }
    }
    let AnimatedNodes { nodes, numbers, .. } = nodes;
    let mut model = AnimatedModel { nodes, skins, ..AnimatedModel::default() };
    Keyframes::new(document, &numbers, &mut LeftOut::default()).add_clips(&root.animations, &mut model);
    if model.clips.is_empty() || model.to_bytes().is_err() {
        return BTreeMap::new();
    }
    let all = sampled(&model);
    let skeleton = |(at, (skin, reference)): (usize, (usize, DMat4))| {
        let own: Vec<&SkinPose> = all.iter().filter_map(|poses| poses.get(at)).collect();
        (skin, Arc::new(Skeleton { reference, poses: apart(&own) }))
    };
    references.into_iter().enumerate().map(skeleton).collect()
}

/// The skins of the nodes that the scene places.
fn used(document: &Document, contents: &SceneContents) -> BTreeSet<usize> {
    let nodes = contents.meshes.iter().filter_map(|placed| document.root.nodes.get(placed.node? as usize));
    let skinned = nodes.filter(|node| node.is_skinned);
    skinned.filter_map(|node| Some(node.skin?.value())).collect()
}

/// The joints of a skin, which hang on nodes, and its reference: the map of its first joint at rest. `None` for one with
/// too many joints, or that cannot be undone.
pub(super) fn bound(
    nodes: &mut AnimatedNodes<'_>,
    buffers: &mut Buffers<'_>,
    skin: usize,
) -> Option<(AnimatedSkin, DMat4)> {
    let document = nodes.document;
    let joints = &document.root.skins.get(skin)?.joints;
    if joints.len() > MAX_JOINTS {
        return None;
    }
    let matrices = inverse_bind_matrices(document, buffers, skin).ok()?;
    let rests = nodes_to_scene(document);
    let at_rest = |at: usize| Some(*rests.get(joints.get(at)?.value())? * *matrices.get(at)?);
    let reference = at_rest(0)?;
    let back = reference.inverse();
    if reference.determinant() == 0.0 || !reference.is_finite() || !back.is_finite() {
        return None;
    }
    let joint = |(joint, matrix): (&gltf::json::Index<gltf::json::Node>, &DMat4)| {
        let above = nodes.above(joint.value());
        let to_node = above.below * DAffine3::from_mat4(*matrix * back);
        SkinJoint { node: above.number, to_node }
    };
    let joints: Vec<SkinJoint> = joints.iter().zip(&matrices).map(joint).collect();
    Some((AnimatedSkin { joints }, reference))
}

/// The poses of all skins at times of all clips.
fn sampled(model: &AnimatedModel) -> Vec<Vec<SkinPose>> {
    let joints: usize = model.skins.iter().map(|skin| skin.joints.len()).sum();
    let per_time = (model.nodes.len() + joints).saturating_mul(model.clips.len()).max(1);
    let times = (MAX_MAPS / per_time).clamp(1, MAX_TIMES);
    let at = |clip| {
        let duration_s = model.duration_s(clip);
        (0..times).map(move |step| model.poses_at(Some(clip), duration_s * step as f64 / times as f64))
    };
    model.clips.iter().take(MAX_MAPS / per_time.min(MAX_MAPS)).flat_map(at).collect()
}

/// Those poses that differ most from the rest and from one another (farthest-point sampling; Gonzalez, "Clustering to
/// minimize the maximum intercluster distance", 1985).
fn apart(all: &[&SkinPose]) -> Vec<Pose> {
    let Some(joints) = all.first().map(|pose| pose.joints().len()) else { return Vec::new() };
    let still = SkinPose::new(vec![DAffine3::IDENTITY; joints]);
    let mut distance: Vec<f64> = all.iter().map(|pose| apartness(&still, pose)).collect();
    let mut poses = Vec::new();
    for _ in 0..MEASURED_POSES {
        let farthest = distance.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(&a.0)));
        let Some((at, _)) = farthest.filter(|(_, distance)| **distance > 0.0 && distance.is_finite()) else {
            break;
        };
        poses.push(all[at].joints().iter().map(rows).collect());
        for (own, pose) in distance.iter_mut().zip(all) {
            *own = own.min(apartness(all[at], pose));
        }
    }
    poses
}

/// Sum of the squared distances between places that two poses give to some of each joint.
fn apartness(a: &SkinPose, b: &SkinPose) -> f64 {
    let places = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let of_joint = |(a, b): (&DAffine3, &DAffine3)| {
        places
            .map(|place| a.transform_point3(place).distance_squared(b.transform_point3(place)))
            .iter()
            .sum::<f64>()
    };
    a.joints().iter().zip(b.joints()).map(of_joint).sum()
}

fn rows(map: &DAffine3) -> [[f64; 4]; 3] {
    let linear = map.matrix3.transpose();
    let row = |row: DVec3, offset: f64| row.extend(offset).to_array();
    let offset = map.translation;
    [row(linear.x_axis, offset.x), row(linear.y_axis, offset.y), row(linear.z_axis, offset.z)]
}
