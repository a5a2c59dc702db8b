//! Projection of an instance: its bounds on the screen, and the view in its local coordinates.

use glam::{DVec3, Vec3};
use lodestream_geometry::index::Sphere;
use lodestream_geometry::screen::screen_error_px;

use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::view::{Frustum, View};

/// A view with values that all instances share.
#[derive(Clone, Copy, Debug)]
pub struct Projection {
    eye: DVec3,
    frustum: Frustum,
    scale_px: f64,
}

/// The bounding sphere of an instance on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Whether it reaches into the frustum.
    pub visible: bool,
    /// Depth of its nearest point, in world units; may be negative.
    pub depth: f64,
    /// Radius on the screen in pixels, by distance, so that it is defined out of view too.
    pub coverage_px: f32,
    /// Pixels per world unit at the distance of its centre, or of its radius if that is larger.
    pub px_per_unit: f32,
    /// 1 in the middle of the picture, falling outwards.
    pub foveation: f32,
}

impl Projection {
    /// The projection of a view.
    #[must_use]
    pub fn new(view: &View) -> Self {
        Self { eye: DVec3::from(view.eye), frustum: view.frustum(), scale_px: view.scale_px() }
    }

    /// Pixels per unit of tangent.
    #[must_use]
    pub const fn scale_px(&self) -> f64 {
        self.scale_px
    }

    /// Screen error of a world-space length at a depth, in pixels.
    #[must_use]
    pub fn error_px(&self, error: f64, depth: f64) -> f64 {
        screen_error_px(error, depth, self.scale_px)
    }

    /// The bounding sphere of an instance on the screen.
    #[must_use]
    pub fn bounds(&self, asset: &AssetEntry, instance: &Instance) -> Bounds {
        let (center, radius) = self.sphere(asset, instance);
        self.of_sphere(center, radius)
    }

    fn of_sphere(&self, center: Vec3, radius: f32) -> Bounds {
        Bounds {
            visible: self.frustum.sees(center, radius),
            depth: f64::from(self.frustum.depth(center, radius)),
            coverage_px: self.radius_px(center, radius),
            px_per_unit: self.length_px(1.0, center, radius),
            foveation: foveation(&self.frustum, center, radius),
        }
    }

    /// Bounds of an asset that is placed in the world as it is, with a margin.
    #[must_use]
    pub fn bounds_within(&self, asset: &AssetEntry, margin: f32) -> Bounds {
        let (center, radius) = self.sphere(asset, &Instance::at(0, [0.0; 3]));
        self.of_sphere(center, radius + margin)
    }

    /// Radius of an instance on the screen, in pixels, as [`Bounds::coverage_px`].
    pub fn coverage_px(&self, asset: &AssetEntry, instance: &Instance) -> f32 {
        let (center, radius) = self.sphere(asset, instance);
        self.radius_px(center, radius)
    }

    fn radius_px(&self, center: Vec3, radius: f32) -> f32 {
        self.length_px(radius, center, radius)
    }

    /// A length in pixels at the distance of a sphere's centre, or of its radius if that is larger.
    #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
    pub(super) fn length_px(&self, length: f32, center: Vec3, radius: f32) -> f32 {
        let distance = f64::from(center.length()).max(f64::from(radius)).max(f64::from(f32::MIN_POSITIVE));
        (f64::from(length) * self.scale_px / distance).min(f64::from(f32::MAX)) as f32
    }

    /// Position of the eye.
    #[must_use]
    pub const fn eye(&self) -> [f64; 3] {
        self.eye.to_array()
    }

    pub(super) const fn frustum(&self) -> &Frustum {
        &self.frustum
    }

    /// An instance's bounding sphere, its centre relative to the eye.
    pub(super) fn sphere(&self, asset: &AssetEntry, instance: &Instance) -> (Vec3, f32) {
        let center = instance.to_world(asset.origin, asset.sphere.center) - self.eye;
        (center.as_vec3(), asset.sphere.radius * instance.placement.scale)
    }

    /// Whether a sphere reaches into the frustum; `center` is relative to the eye.
    pub(super) fn sees(&self, center: Vec3, radius: f32) -> bool {
        self.frustum.sees(center, radius)
    }

    /// Least depth in the frustum of a sphere's shadow that is swept along `sweep`; `None` if it is not in the frustum.
    /// `center` is relative to the eye.
    pub(super) fn shadow_depth(&self, center: Vec3, radius: f32, sweep: Vec3) -> Option<f64> {
        shadow_depth(&self.frustum, center, radius, sweep)
    }

    /// The view in the local axes and units of an instance, relative to the grid origin of its asset.
    #[must_use]
    pub fn local(&self, asset: &AssetEntry, instance: &Instance) -> LocalView {
        let rotation = instance.placement.orientation();
        let offset = self.eye - DVec3::from(instance.placement.translation);
        let eye = rotation.conjugate().as_dquat() * offset / f64::from(instance.placement.scale);
        LocalView {
            eye: (eye - DVec3::from(asset.origin)).as_vec3(),
            frustum: self.frustum.rotated_into(rotation),
            scale_px: self.scale_px,
        }
    }

    /// Pixels per unit of the asset at a world depth, which is at least a fiftieth of the asset's radius.
    #[must_use]
    pub fn px_per_unit(&self, asset: &AssetEntry, instance: &Instance, depth: f64) -> f64 {
        let scale = f64::from(instance.placement.scale);
        let nearest = f64::from(asset.sphere.radius) * scale * 0.02;
        self.scale_px * scale / depth.max(nearest).max(f64::MIN_POSITIVE)
    }
}

/// Least depth of a region's nearest point, in radii: the eye may be within its sphere, and the surface further away.
const LEAST_DEPTH: f32 = 0.1;

/// A region of a surface on the screen, in the units of its asset.
#[derive(Clone, Copy, Debug)]
pub(super) struct RegionView {
    /// Pixels per unit at the nearest point.
    pub(super) px_per_unit: f32,
    /// Pixels per unit at the centre.
    pub(super) middle_px_per_unit: f32,
    /// 1 in the middle of the picture, falling outwards.
    pub(super) foveation: f32,
}

/// A view in an instance's own axes. The scale cancels in the screen error.
#[derive(Clone, Copy, Debug)]
pub struct LocalView {
    eye: Vec3,
    frustum: Frustum,
    scale_px: f64,
}

impl LocalView {
    /// Screen error in pixels of an error within a sphere, and the sphere's foveation; `None` out of view.
    #[inline]
    #[must_use]
    pub fn error_px(&self, sphere: &Sphere, error: f32) -> Option<(f64, f32)> {
        let center = Vec3::from(sphere.center) - self.eye;
        if !self.frustum.sees(center, sphere.radius) {
            return None;
        }
        let depth = self.frustum.depth(center, sphere.radius);
        let px = screen_error_px(f64::from(error), f64::from(depth), self.scale_px);
        Some((px, foveation(&self.frustum, center, sphere.radius)))
    }

    /// Where a region of the surface is on the screen; `None` out of view.
    pub(super) fn region(&self, sphere: &Sphere) -> Option<RegionView> {
        let center = Vec3::from(sphere.center) - self.eye;
        if !self.frustum.sees(center, sphere.radius) {
            return None;
        }
        let nearest = self.frustum.depth(center, sphere.radius).max(LEAST_DEPTH * sphere.radius);
        #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
        let px_per_unit = (self.scale_px / f64::from(nearest.max(f32::MIN_POSITIVE))) as f32;
        Some(RegionView {
            px_per_unit,
            middle_px_per_unit: self.px_per_unit(sphere),
            foveation: foveation(&self.frustum, center, sphere.radius),
        })
    }

    /// Pixels per unit at the distance of a sphere's centre, or of its radius if that is larger.
    #[inline]
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "to the nearest f32")]
    pub(super) fn px_per_unit(&self, sphere: &Sphere) -> f32 {
        let distance = (Vec3::from(sphere.center) - self.eye).length();
        (self.scale_px / f64::from(distance.max(sphere.radius).max(f32::MIN_POSITIVE))) as f32
    }

    /// Displacement in pixels of the shadow of a sphere out of view by an error within it, and pixels per unit there.
    /// The shadow is swept along `sweep`, in the instance's local axes and units. `None` if the sphere is in view or
    /// its shadow is not.
    pub(super) fn shadow_px(&self, sphere: &Sphere, error: f32, sweep: Vec3) -> Option<[f64; 2]> {
        let center = Vec3::from(sphere.center) - self.eye;
        if self.frustum.sees(center, sphere.radius) {
            return None;
        }
        let depth = shadow_depth(&self.frustum, center, sphere.radius, sweep)?;
        Some([screen_error_px(f64::from(error), depth, self.scale_px), self.scale_px / depth])
    }
}

/// Implements [`Projection::shadow_depth`]. The depth is at least the radius: an estimate, not a bound.
fn shadow_depth(frustum: &Frustum, center: Vec3, radius: f32, sweep: Vec3) -> Option<f64> {
    let ends = frustum.sees_on_path(center, radius, sweep)?;
    let depth = ends.map(|share| frustum.depth(center + sweep * share, 0.0));
    Some(f64::from(depth[0].min(depth[1]).max(radius).max(f32::MIN_POSITIVE)))
}

/// 1 where the sphere covers the middle of the picture, falling with the tangent of the angle to its
/// nearest point.
#[inline]
fn foveation(frustum: &Frustum, center: Vec3, radius: f32) -> f32 {
    let along = frustum.forward.dot(center);
    let across = ((center - frustum.forward * along).length() - radius).max(0.0);
    let tangent = across / along.max(radius).max(f32::MIN_POSITIVE);
    1.0 / (1.0 + tangent * tangent)
}
