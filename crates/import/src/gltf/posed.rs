//! The vertices of meshes in their poses: moved by morph targets and by the joints of a skin.

use std::sync::{Arc, PoisonError};

use glam::{DMat3, DMat4, DVec3};
use gltf::json::accessor::Type;
use lodestream_geometry::mesh::skin::Skin;

use super::accessor::{Buffers, Elements};
use super::container::Document;
use super::inverse_bind::inverse_bind_matrices;
use super::nodes::nodes_to_scene;
use super::root::{Pose, Primitive};
use super::skeleton::Skeleton;
use super::skeletons;
use crate::error::ImportError;

/// Sets of joints and weights of a vertex, of four each.
pub(super) const SETS: usize = 2;
/// Most morph targets of a primitive that are applied, which bounds the work for targets that share their bytes.
const MAX_TARGETS: usize = 64;

/// The map from each joint's bound vertices to the scene: the joint's transformation times its inverse bind matrix.
///
/// # Errors
/// Matrices that cannot be read.
fn joint_matrices(
    document: &Document,
    buffers: &mut Buffers<'_>,
    number: usize,
) -> Result<Arc<[DMat4]>, ImportError> {
    let known = || document.joints.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(joints) = known().get(&number) {
        return Ok(Arc::clone(joints));
    }
    let Some(skin) = document.root.skins.get(number) else { return Ok(Arc::default()) };
    let bound = inverse_bind_matrices(document, buffers, number)?;
    let to_scene = nodes_to_scene(document);
    let matrix = |(joint, inverse): (&gltf::json::Index<gltf::json::Node>, DMat4)| {
        to_scene.get(joint.value()).copied().unwrap_or_default() * inverse
    };
    let joints: Arc<[DMat4]> = skin.joints.iter().zip(bound).map(matrix).collect();
    known().insert(number, Arc::clone(&joints));
    Ok(joints)
}

/// Moves the vertices of one primitive to their places in a pose.
#[derive(Default)]
pub(super) struct Posed {
    /// Shifts of positions and normals by morph targets; empty without.
    shifts: [Vec<DVec3>; 2],
    /// Joints and weights of each vertex, by set.
    influences: Vec<(Elements, Elements)>,
    joints: Arc<[DMat4]>,
    /// If joints move, the skeleton in whose bind pose the vertices stay.
    skeleton: Option<Arc<Skeleton>>,
}

impl Posed {
    /// Opens what a pose needs of a primitive of `vertices` vertices, whose joints and weights are opened already, by set;
    /// `moves`: its vertices may follow joints that move. Returns the number of morph targets that are not applied, too.
    ///
    /// # Errors
    /// Accessors that do not hold what they should.
    pub(super) fn open(
        document: &Document,
        buffers: &mut Buffers<'_>,
        (primitive, pose): (&Primitive, &Pose),
        (place, vertices, moves): (&str, usize, bool),
        influences: [[Option<Elements>; 2]; SETS],
    ) -> Result<(Self, usize), ImportError> {
        let mut posed = Self::default();
        let mut left_out = if pose.weights.is_empty() { primitive.targets.len() } else { 0 };
        if let Some(skin) = pose.skin {
            posed.joints = joint_matrices(document, buffers, skin)?;
            posed.skeleton = skeletons::of_document(document).get(&skin).filter(|_| moves).cloned();
            posed.influences =
                influences.into_iter().filter_map(|[joints, weights]| joints.zip(weights)).collect();
            let all = posed.influences.iter().flat_map(|(joints, weights)| [joints, weights]);
            if all.map(Elements::len).any(|length| length < vertices) {
                let what = "JOINTS and WEIGHTS have fewer elements than POSITION";
                return Err(document.error(format!("{place}.attributes: {what}; export the file again")));
            }
        }
        let weights = pose.weights.iter().map(|&bits| f64::from(f32::from_bits(bits)));
        let active = primitive.targets.iter().zip(weights).enumerate();
        let active = active.filter(|(_, (_, weight))| *weight != 0.0 && weight.is_finite());
        for (applied, (number, (target, weight))) in active.enumerate() {
            if applied >= MAX_TARGETS {
                left_out += 1;
                continue;
            }
            for (shifts, (accessor, name)) in
                posed.shifts.iter_mut().zip(target.iter().zip(["POSITION", "NORMAL"]))
            {
                let Some(accessor) = accessor else { continue };
                let place = format!("{place}.targets[{number}].{name}");
                let target = buffers.open_with(accessor.value(), &place, &[Type::Vec3], vertices)?;
                if target.len() < vertices {
                    return Err(
                        document.error(format!("{place} has fewer elements than the mesh; export it again"))
                    );
                }
                shifts.resize(vertices, DVec3::ZERO);
                for (at, shift) in shifts.iter_mut().enumerate() {
                    *shift += weight * DVec3::from_array(target.get(at));
                }
            }
        }
        Ok((posed, left_out))
    }

    fn shifted(&self, kind: usize, index: usize, vector: [f64; 3]) -> DVec3 {
        DVec3::from_array(vector) + self.shifts[kind].get(index).copied().unwrap_or_default()
    }

    /// The place of a vertex (glTF 2.0 specification, §3.7.3.3).
    pub(super) fn position(&self, index: usize, position: [f64; 3]) -> DVec3 {
        let position = self.shifted(0, index, position);
        self.matrix(index).map_or(position, |matrix| matrix.transform_point3(position))
    }

    /// The direction of a vertex's normal, of any length.
    pub(super) fn normal(&self, index: usize, normal: [f64; 3]) -> DVec3 {
        let normal = self.shifted(1, index, normal);
        let Some(matrix) = self.matrix(index) else { return normal };
        let DMat3 { x_axis: x, y_axis: y, z_axis: z } = DMat3::from_mat4(matrix);
        let outwards = if x.dot(y.cross(z)) < 0.0 { -1.0 } else { 1.0 };
        DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * normal * outwards
    }

    /// The skeleton that moves the vertices, if one does.
    pub(super) fn skeleton(&self) -> Option<&Arc<Skeleton>> {
        self.skeleton.as_ref()
    }

    /// The joints that move a vertex, if any move.
    pub(super) fn skin(&self, index: usize) -> Option<Skin> {
        self.skeleton.as_ref()?;
        let all = self
            .influences
            .iter()
            .flat_map(|(joints, weights)| joints.get::<4>(index).into_iter().zip(weights.get::<4>(index)));
        let existing = all.filter(|(joint, _)| (*joint as usize) < self.joints.len());
        Some(Skin::new(existing.map(|(joint, weight)| (joint as u8, weight))))
    }

    /// Whether the pose turns the mesh inside out, as joints below a mirrored node do.
    pub(super) fn mirrors(&self) -> bool {
        self.joints.first().is_some_and(|joint| joint.determinant() < 0.0)
    }

    /// The weighted sum of a vertex's joints, or the map of the bind pose if they move; `None` without a skin. Weights count
    /// in proportion, as files round them.
    fn matrix(&self, index: usize) -> Option<DMat4> {
        if let Some(skeleton) = &self.skeleton {
            return Some(skeleton.reference);
        }
        let first = self.joints.first()?;
        let (mut sum, mut whole) = (DMat4::ZERO, 0.0);
        for (joints, weights) in &self.influences {
            for (joint, weight) in joints.get::<4>(index).into_iter().zip(weights.get::<4>(index)) {
                // Beyond the joints there is nothing to follow.
                let Some(joint) = self.joints.get(joint as usize).filter(|_| weight > 0.0) else { continue };
                sum += *joint * weight;
                whole += weight;
            }
        }
        Some(if whole > 0.0 { sum * (1.0 / whole) } else { *first })
    }
}
