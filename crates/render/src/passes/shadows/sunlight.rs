//! Uniforms of the shadow lookup: `Shadows` of `sunlight.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3};

use super::Cascade;
use crate::frame::settings::{MAX_CASCADES, Shadows};

/// `Cascade` of the shader.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
struct CascadeRaw {
    map_from_world: [[f32; 4]; 4],
    texel: f32,
    padding: [f32; 3],
}

/// The uniform block.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct SunlightUniform {
    cascades: [CascadeRaw; MAX_CASCADES],
    count: u32,
    filter: u32,
    padding: [u32; 2],
}

impl SunlightUniform {
    /// Built from the cascades and their tops, nearest first, for a frame from `eye`.
    pub(crate) fn new(shadows: Shadows, maps: impl Iterator<Item = (Cascade, f64)>, eye: DVec3) -> Self {
        let mut all = [CascadeRaw::default(); MAX_CASCADES];
        let mut count = 0;
        for (raw, (cascade, top)) in all.iter_mut().zip(maps) {
            *raw = CascadeRaw {
                map_from_world: map_from_world(&cascade, top, eye).as_mat4().to_cols_array_2d(),
                texel: (cascade.side / f64::from(shadows.map_side)) as f32,
                padding: [0.0; 3],
            };
            count += 1;
        }
        Self { cascades: all, count, filter: shadows.filter, padding: [0; 2] }
    }
}

/// Matrix from positions relative to the eye to a map: 0 to 1 across it, rows from the top, and depth.
pub(crate) fn map_from_world(cascade: &Cascade, top: f64, eye: DVec3) -> DMat4 {
    let at = cascade.place_of(eye, DVec3::ZERO);
    let scale = DVec3::new(1.0 / cascade.side, -1.0 / cascade.side, 1.0 / (top + cascade.below));
    let offset = at * scale + DVec3::new(0.5, 0.5, cascade.below * scale.z);
    DMat4::from_translation(offset) * DMat4::from_scale(scale) * DMat4::from_mat3(cascade.axes.transpose())
}
