//! A mesh in the poses in which the error of its skins is measured.

use crate::mesh::skin::{Pose, Skin, WHOLE, mapped};
use crate::mesh::vec3::{Vec3, add, length, scale, sub};
use crate::simplify::live::Live;

/// Skins and poses of the input.
pub(crate) struct PosedMesh {
    skins: Vec<Skin>,
    /// In the coordinates of [`Live::positions`].
    poses: Vec<Pose>,
}

impl PosedMesh {
    /// `None` if the mesh has no skins or no poses.
    pub(crate) fn new(live: &Live<'_>) -> Option<Self> {
        let mesh = live.mesh();
        if mesh.skins.is_empty() || mesh.poses.is_empty() {
            return None;
        }
        // Positions are relative to the grid's middle.
        let middle = live.middle();
        let around_middle =
            |map: &[[f64; 4]; 3]| map.map(|[a, b, c, d]| [a, b, c, d + (a + b + c) * middle - middle]);
        let poses = mesh.poses.iter().map(|pose| pose.iter().map(around_middle).collect()).collect();
        Some(Self { skins: mesh.skins.clone(), poses })
    }

    /// The largest distance, over all poses, between a vertex of the input and a place of a face, given by the face's
    /// corners and their shares.
    pub(crate) fn displacement(
        &self,
        (vertex, point): (u32, Vec3),
        corners: [(u32, Vec3); 3],
        shares: [f64; 3],
    ) -> f64 {
        self.poses.iter().fold(0.0, |most, pose| {
            let own = self.moved(pose, vertex, point);
            let coarse = corners
                .into_iter()
                .zip(shares)
                .fold([0.0; 3], |sum, ((v, at), share)| add(sum, scale(self.moved(pose, v, at), share)));
            f64::max(most, length(sub(own, coarse)))
        })
    }

    /// Where its joints take a vertex.
    fn moved(&self, pose: &Pose, vertex: u32, at: Vec3) -> Vec3 {
        let skin = self.skins.get(vertex as usize).copied().unwrap_or_default();
        skin.influences().fold([0.0; 3], |sum, (joint, weight)| {
            let moved = pose.get(usize::from(joint)).map_or(at, |map| mapped(map, at));
            add(sum, scale(moved, f64::from(weight) / f64::from(WHOLE)))
        })
    }
}
