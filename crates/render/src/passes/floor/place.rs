//! Where a studio's ground is, and from where its shadows are drawn.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DMat4, DVec2, DVec3};

use crate::frame::placed::PlacedInstances;
use crate::frame::settings::Frame;
use crate::passes::shadows::{Cascade, map_from_world};
use crate::scene::environment::Sky;

/// Texels along a side of the map of undersides.
pub(crate) const UNDERSIDE_SIDE: u32 = 256;
/// Texels along a side of the key light's map.
pub(crate) const KEY_SIDE: u32 = 512;
/// Reach of the darkness around contacts, and a margin, in radii of the objects.
const AROUND: f64 = 1.65;
/// Largest cotangent of the key light's height for which the ground holds the whole shadow.
const MOST_COTANGENT: f64 = 1.5;

/// The ground of a frame's objects. Its axes: towards the key light's azimuth, across, and down.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FloorPlace {
    /// Views of the objects from below and from the key light. The former's axes are the ground's.
    pub(crate) cascades: [Cascade; 2],
    /// Middle and half the sides of the picture of the ground, about the middle of the objects.
    middle: DVec2,
    half: DVec2,
    /// Radius of the objects.
    radius: f64,
}

impl FloorPlace {
    /// The ground of the frame's objects; `None` if the surroundings have none, or no object has bounds.
    pub(crate) fn new(
        frame: &Frame<'_>,
        placed: &PlacedInstances,
        (to_key, up, side): (DVec3, DVec3, DVec3),
    ) -> Option<Self> {
        if !matches!(&frame.environment.sky, Sky::Studio(studio) if studio.ground) {
            return None;
        }
        let drawables = placed.drawables().filter(|drawable| drawable.look.is_some() && !drawable.unbounded);
        let cells: Vec<_> = drawables
            .flat_map(|drawable| drawable.cells)
            .filter(|cell| cell.centre.is_finite() && cell.radius.is_finite())
            .collect();
        let ends = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = cells.iter().fold(ends, |(low, high), cell| {
            (low.min(cell.centre - cell.radius), high.max(cell.centre + cell.radius))
        });
        let centre = 0.5 * (low + high);
        let reach = cells.iter().map(|cell| cell.centre.distance(centre) + cell.radius);
        let radius = reach.fold(0.0, f64::max);
        (radius > 0.0 && centre.is_finite()).then(|| Self::around((centre, radius), (to_key, up, side)))
    }

    /// The ground of objects in a sphere. Unit vectors: towards the key light, up, horizontally towards the light.
    pub(crate) fn around((centre, radius): (DVec3, f64), (to_key, up, side): (DVec3, DVec3, DVec3)) -> Self {
        let cascade = |axes: DMat3| {
            // Rounding must not leave a surface outside.
            let reach = 1.01 * radius;
            Cascade { axes, centre: axes.transpose() * centre, side: 2.0 * reach, above: reach, below: reach }
        };
        let (x, y) = to_key.any_orthonormal_pair();
        let height = to_key.dot(up);
        let cotangent = to_key.dot(side).max(0.0) / height.max(1e-3);
        let shadow = 1.0 + 2.0 * cotangent.min(MOST_COTANGENT);
        let (low, high) = (-shadow.max(AROUND), AROUND);
        Self {
            cascades: [
                cascade(DMat3::from_cols(side, (-up).cross(side), -up)),
                cascade(DMat3::from_cols(x, y, to_key)),
            ],
            middle: DVec2::new(0.5 * (low + high), 0.0) * radius,
            half: DVec2::new(0.5 * (high - low), AROUND) * radius,
            radius,
        }
    }

    /// The uniform block for a frame from `eye`, with the tops of both maps.
    pub(crate) fn uniform(&self, [underside_top, key_top]: [f64; 2], eye: DVec3) -> FloorUniform {
        let [underside, key] = &self.cascades;
        let at = underside.place_of(eye, DVec3::ZERO);
        let axis = |axis: DVec3, at: f64| axis.extend(at).as_vec4().to_array();
        // From the ground's axes about the middle of the objects.
        let turned = DMat4::from_mat3(underside.axes);
        let middle = underside.axes * underside.centre;
        let range =
            [1.0 / underside.side, underside_top + underside.below, underside.below, key_top + key.below];
        let picture = [self.middle.x, self.middle.y, self.half.x, self.half.y];
        let single = |all: [f64; 4]| all.map(|x| x as f32);
        FloorUniform {
            axes: [
                axis(underside.axes.x_axis, at.x),
                axis(underside.axes.y_axis, at.y),
                axis(underside.axes.z_axis, at.z),
            ],
            key_from_floor: (map_from_world(key, key_top, middle) * turned).as_mat4().to_cols_array_2d(),
            range: single(range),
            picture: single(picture),
            size: single([self.radius, 1.0 / key.side, 0.0, 0.0]),
        }
    }
}

/// `Floor` of `floor.wgsl`. Lengths are in world units.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(crate) struct FloorUniform {
    /// Axes of the ground; w: place of the eye along them, from the middle of the objects.
    pub(crate) axes: [[f32; 4]; 3],
    /// From places in these axes to the key light's map.
    pub(crate) key_from_floor: [[f32; 4]; 4],
    /// Of the map of undersides: inverse of its side, range of its depths, and what depth 0 lies above the middle; of
    /// the key light's map: range of its depths.
    pub(crate) range: [f32; 4],
    /// Middle and half the sides of the picture of the ground.
    pub(crate) picture: [f32; 4],
    /// Radius of the objects; inverse of the side of the key light's map.
    pub(crate) size: [f32; 4],
}
