//! Placements of assets as the GPU reads them: in f32, relative to the eye.

use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec3};
use lodestream_scene::placement::Placement;

/// An instance as the vertex shader reads it.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct InstanceRaw {
    /// Asset origin relative to the eye, world units.
    pub(crate) offset: [f32; 3],
    /// Uniform scale.
    pub(crate) scale: f32,
    /// Quaternion, x y z w.
    pub(crate) rotation: [f32; 4],
    /// Where the states of its parts begin in the asset's table; 0: none.
    pub(crate) states: u32,
    /// PN triangles read instances as vectors of four.
    pub(crate) padding: [u32; 3],
}

impl InstanceRaw {
    /// The placement of vertices that are relative to `origin` (asset units), relative to `eye`. The subtraction of
    /// large numbers happens here, in f64.
    pub(crate) fn new(placement: &Placement, origin: DVec3, eye: DVec3) -> Self {
        let offset = (placement.to_world(origin) - eye).as_vec3().to_array();
        let rotation = placement.orientation().to_array();
        Self { offset, scale: placement.scale, rotation, states: 0, padding: [0; 3] }
    }

    /// The same placement with part states.
    pub(crate) fn with_states(self, states: u32) -> Self {
        Self { states, ..self }
    }

    /// Position relative to the eye, in world units, of a point relative to the asset's origin.
    pub(crate) fn place(&self, point: DVec3) -> DVec3 {
        let rotation = DQuat::from_array(self.rotation.map(f64::from));
        DVec3::from(self.offset.map(f64::from)) + rotation * (point * f64::from(self.scale))
    }

    #[cfg(test)]
    /// A sphere about a point relative to the asset's origin, relative to the eye, in world units.
    pub(crate) fn sphere(&self, (centre, radius): (DVec3, f64)) -> (DVec3, f64) {
        (self.place(centre), radius * f64::from(self.scale))
    }
}

/// Layout of [`InstanceRaw`] at shader locations 7, 8 and 11.
pub(crate) const INSTANCE_ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![7 => Float32x4, 8 => Float32x4, 11 => Uint32];

/// Layout of the previous frame's [`InstanceRaw`] at locations 9, 10 and 12.
pub(crate) const BEFORE_ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![9 => Float32x4, 10 => Float32x4, 12 => Uint32];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu_reference::transform;

    #[test]
    fn far_from_zero_details_survive() {
        // A millimetre of detail on an asset 10,000 km from the world's zero point.
        let rotation = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
        let placement = Placement::new(DVec3::new(1e7, -2e7, 5e6), rotation, 2.0);
        let origin = DVec3::new(3.0, -1.0, 2.0);
        let eye = placement.to_world(origin) + DVec3::new(0.5, 0.25, -1.0);
        let raw = InstanceRaw::new(&placement, origin, eye);
        let p = DVec3::new(0.001, -0.002, 0.0005);
        let got = transform::place(
            p.to_array(),
            raw.offset.map(f64::from),
            f64::from(raw.scale),
            raw.rotation.map(f64::from),
        );
        let want = rotation * (p * 2.0) + DVec3::new(-0.5, -0.25, 1.0);
        assert!((DVec3::from(got) - want).length() < 1e-6, "{got:?} {want}");
    }

    #[test]
    fn quaternion_cpu_reference_rotates_as_glam_does() {
        let q = DQuat::from_axis_angle(DVec3::new(-1.0, 0.5, 2.0).normalize(), 2.1);
        let v = DVec3::new(0.3, -4.0, 1.5);
        let got = DVec3::from(transform::rotate(v.to_array(), q.to_array()));
        assert!((got - q * v).length() < 1e-12);
    }
}
