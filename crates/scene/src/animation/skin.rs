//! Assets whose vertices follow the joints of a skeleton (linear blend skinning; glTF 2.0, §3.7.3.3).

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use super::similarity::nearest;
use super::{AnimatedModel, Clip};
use crate::parts::{PART_SCALES, PartTransform};

/// Most joints of a skin: a vertex names one in a byte.
pub const MAX_SKIN_JOINTS: usize = 256;
/// Largest number in the map of a joint that counts as the identity, minus the identity's.
const STILL: f64 = 1e-9;

/// The skeleton of an asset. Vertices name its joints by number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnimatedSkin {
    /// At most [`MAX_SKIN_JOINTS`].
    pub joints: Vec<SkinJoint>,
}

/// A joint. It takes what follows it by node · `to_node`, within the instance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkinJoint {
    /// Number of the node; `None` for a joint that stands still.
    pub node: Option<u32>,
    /// From the asset to the node, or to where the joint stands still.
    pub to_node: DAffine3,
}

/// Where the joints of a skin take an asset, by joint, within its instance and in units of the asset.
#[derive(Clone, Debug, PartialEq)]
pub struct SkinPose {
    joints: Arc<[DAffine3]>,
}

impl SkinPose {
    /// A pose by its joints' maps.
    #[must_use]
    pub fn new(joints: impl IntoIterator<Item = DAffine3>) -> Self {
        Self { joints: joints.into_iter().collect() }
    }

    /// The joints' maps.
    #[must_use]
    pub fn joints(&self) -> &[DAffine3] {
        &self.joints
    }

    /// Whether it leaves all as it is.
    #[must_use]
    pub fn is_still(&self) -> bool {
        self.joints.iter().all(|map| map.abs_diff_eq(DAffine3::IDENTITY, STILL))
    }

    /// The place of a vertex: the mean of where its joints take it, by weight. A joint that does not exist leaves it.
    #[must_use]
    pub fn apply(&self, influences: impl Iterator<Item = (u8, u8)>, place: DVec3) -> DVec3 {
        let (mut sum, mut whole) = (DVec3::ZERO, 0.0);
        for (joint, weight) in influences {
            let moved = self.joints.get(usize::from(joint)).map_or(place, |map| map.transform_point3(place));
            sum += moved * f64::from(weight);
            whole += f64::from(weight);
        }
        if whole > 0.0 { sum / whole } else { place }
    }

    /// A similarity for each joint, each once: turned as the joint, and scaled by the most that it stretches. Whatever
    /// follows joints that are no shears lies between the places where these have it.
    #[must_use]
    pub fn similarities(&self) -> Vec<PartTransform> {
        let all: Vec<PartTransform> = self.joints.iter().map(covering).collect();
        PartTransform::distinct(all.iter())
    }
}

fn covering(map: &DAffine3) -> PartTransform {
    let near = nearest(map);
    let scale = stretch(&map.matrix3).clamp(*PART_SCALES.start(), *PART_SCALES.end());
    PartTransform::new(near.translation(), near.rotation(), scale).unwrap_or(near)
}

/// A bound of the most that a linear map stretches, exact for one with orthogonal axes: the root of the largest row sum of
/// MᵀM, which no eigenvalue exceeds (Gershgorin).
fn stretch(linear: &DMat3) -> f64 {
    let squares = (linear.transpose() * *linear).to_cols_array_2d();
    let most = squares.iter().map(|row| row.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max);
    if most.is_finite() { most.sqrt() } else { *PART_SCALES.end() }
}

impl AnimatedModel {
    /// The pose of each skin at a time of a clip, in seconds; as its nodes rest without a clip.
    #[must_use]
    pub fn poses_at(&self, clip: Option<&Clip>, time_s: f64) -> Vec<SkinPose> {
        if self.skins.is_empty() {
            return Vec::new();
        }
        self.poses_of(&self.nodes_at(clip, time_s))
    }

    /// The pose of each skin, of the nodes' transformations to the model.
    pub(super) fn poses_of(&self, nodes: &[DAffine3]) -> Vec<SkinPose> {
        let map = |joint: &SkinJoint| {
            let node = joint.node.and_then(|node| nodes.get(node as usize));
            node.map_or(joint.to_node, |node| *node * joint.to_node)
        };
        self.skins.iter().map(|skin| SkinPose::new(skin.joints.iter().map(map))).collect()
    }
}
