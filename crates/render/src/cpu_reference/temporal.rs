//! Temporal anti-aliasing: `temporal.wgsl` with `motion.wgsl`, and its tone mapping in `tonemap.wgsl`.

use glam::{DVec2, DVec3};
use lodestream_scene::pose::Pose;

use super::depth;

/// As in the shader.
const DEVIATIONS: f64 = 1.0;
const BEFORE: f64 = 1.1;
const HASTE: f64 = 0.4;
const LEAST_MOTION: f64 = 0.01;

/// A frame and its history; rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct Resolve<'a> {
    /// Width and height.
    pub size_px: [u32; 2],
    /// Radiance of the frame.
    pub radiance: &'a [[f64; 3]],
    /// Its depth as it is stored.
    pub depth: &'a [f64],
    /// Motion of moving objects to their previous position in pixels; `None` for still ones.
    pub motion: &'a [Option<[f64; 2]>],
    /// Weighed colours, and of how many frames they are a mean.
    pub history: &'a [[f64; 4]],
    /// Cameras of this frame and the previous one.
    pub cameras: [Pose; 2],
    /// The near plane.
    pub near: f64,
    /// Off the pixels' centres.
    pub jitter: [f64; 2],
    /// Factor on radiance.
    pub exposure: f64,
    /// Most frames that the history counts for.
    pub most: f64,
    /// Height of the eye over water and extinction of green light by it, where there is some.
    pub water: Option<[f64; 2]>,
}

/// Brightness weight of a colour; 0 for NaN.
#[must_use]
pub fn weighed(radiance: [f64; 3], exposure: f64) -> Option<[f64; 3]> {
    if radiance.iter().any(|c| (c * exposure).is_nan()) {
        return None;
    }
    let x = radiance.map(|c| (c * exposure).clamp(0.0, 65504.0));
    let most = x.into_iter().fold(0.0, f64::max);
    Some(x.map(|c| c / (1.0 + most)))
}

/// Removes the brightness weight and applies exposure.
#[must_use]
pub fn unweighed(colour: [f64; 3]) -> [f64; 3] {
    let colour = colour.map(|c| c.min(0.9999));
    let most = colour.into_iter().fold(0.0, f64::max);
    colour.map(|c| c / (1.0 - most))
}

fn luma_chroma([r, g, b]: [f64; 3]) -> DVec3 {
    DVec3::new(0.25 * r + 0.5 * g + 0.25 * b, 0.5 * (r - b), 0.5 * g - 0.25 * (r + b))
}

fn from_luma_chroma(c: DVec3) -> [f64; 3] {
    let t = c.x - c.z;
    [t + c.y, c.x + c.z, t - c.y]
}

impl Resolve<'_> {
    fn index(&self, [x, y]: [i64; 2]) -> usize {
        let [width, height] = self.size_px.map(i64::from);
        (y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize
    }

    /// Share of what a pixel shows that lies at its depth.
    fn share_at_depth(&self, pixel: [i64; 2]) -> f64 {
        let Some([height, extinction]) = self.water else { return 1.0 };
        let camera = self.cameras[0];
        let (tx, ty) = camera.tan_half_fov(self.size_px[0], self.size_px[1]);
        let now = DVec2::new(pixel[0] as f64, pixel[1] as f64) + 0.5 + DVec2::from(self.jitter);
        let uv = now / DVec2::from(self.size_px.map(f64::from));
        let ray = camera.rotation * DVec3::new((uv.x * 2.0 - 1.0) * tx, (1.0 - uv.y * 2.0) * ty, -1.0);
        let stored = self.depth[self.index(pixel)];
        let depth = if stored > 0.0 { self.near / stored } else { f64::INFINITY };
        let (cosine, along) = (-ray.y / ray.length(), height / -ray.y);
        let below = (depth - along) * ray.length();
        if cosine <= 0.0 || along < self.near || below <= 0.0 {
            return 1.0;
        }
        let mirrored = 0.0204 + 0.9796 * (1.0 - cosine).powi(5);
        (1.0 - mirrored) * (-extinction * below * (1.0 + cosine)).exp()
    }

    /// Motion of a pixel due to the camera, to its previous position.
    #[must_use]
    pub fn motion_of_camera(&self, pixel: [i64; 2]) -> DVec2 {
        let [camera, before] = self.cameras;
        let (tx, ty) = camera.tan_half_fov(self.size_px[0], self.size_px[1]);
        let size = DVec2::from(self.size_px.map(f64::from));
        let now = DVec2::new(pixel[0] as f64, pixel[1] as f64) + 0.5 + DVec2::from(self.jitter);
        let uv = now / size;
        let ray = DVec3::new((uv.x * 2.0 - 1.0) * tx, (1.0 - uv.y * 2.0) * ty, -1.0);
        let stored = self.depth[self.index(pixel)];
        let ray = camera.rotation * ray;
        let world = if stored > 0.0 { ray * (self.near / stored) + camera.eye - before.eye } else { ray };
        let (tx, ty) = before.tan_half_fov(self.size_px[0], self.size_px[1]);
        let there = before.rotation.conjugate() * world;
        if -there.z <= 0.0 {
            return DVec2::splat(-1e9) - now;
        }
        let (ndc, _) = depth::project(there.to_array(), [tx, ty], self.near);
        (DVec2::new(ndc[0], -ndc[1]) * 0.5 + 0.5) * size - now
    }

    /// The history at a position, by a bicubic filter without corner texels.
    fn history_at(&self, place: DVec2) -> [f64; 4] {
        let centre = (place - 0.5).floor() + 0.5;
        let f = place - centre;
        let weights = |f: f64| {
            [
                f * (-0.5 + f * (1.0 - 0.5 * f)),
                1.0 + f * f * (-2.5 + 1.5 * f),
                f * (0.5 + f * (2.0 - 1.5 * f)),
                f * f * (-0.5 + 0.5 * f),
            ]
        };
        let (across, down) = (weights(f.x), weights(f.y));
        let (mut sum, mut weight) = ([0.0; 4], 0.0);
        for (j, wy) in down.into_iter().enumerate() {
            for (i, wx) in across.into_iter().enumerate() {
                let corner = (i == 0 || i == 3) && (j == 0 || j == 3);
                if corner {
                    continue;
                }
                let at = [centre.x as i64 - 1 + i as i64, centre.y as i64 - 1 + j as i64];
                let texel = self.history[self.index(at)];
                for (sum, texel) in sum.iter_mut().zip(texel) {
                    *sum += texel * wx * wy;
                }
                weight += wx * wy;
            }
        }
        let mean = sum.map(|sum| sum / weight);
        if mean.iter().all(|x| x.is_finite()) { mean.map(|x| x.max(0.0)) } else { [0.0; 4] }
    }

    /// The resolved pixel while things move.
    #[must_use]
    pub fn pixel(&self, pixel: [i64; 2]) -> [f64; 4] {
        let seen = |at: [i64; 2]| weighed(self.radiance[self.index(at)], self.exposure);
        let with = |[r, g, b]: [f64; 3], count| [r, g, b, count];
        // What is no number counts for no frame.
        let (own, counts) = seen(pixel).map_or(([0.0; 3], 0.0), |own| (own, 1.0));
        if self.most <= 0.0 {
            return with(own, counts);
        }
        let around: Vec<[i64; 2]> = (0..9).map(|i| [pixel[0] + i % 3 - 1, pixel[1] + i / 3 - 1]).collect();
        let clamped = |[x, y]: [i64; 2]| {
            let [width, height] = self.size_px.map(i64::from);
            [x.clamp(0, width - 1), y.clamp(0, height - 1)]
        };
        let around: Vec<_> = around.into_iter().map(clamped).collect();
        let depth = |at: &[i64; 2]| self.depth[self.index(*at)];
        let before = around.iter().filter(|at| depth(at) > depth(&pixel) * BEFORE);
        // The first of those that are alike, as the shader takes it.
        let nearest =
            before.copied().reduce(|a, b| if depth(&b) < depth(&a) { b } else { a }).unwrap_or(pixel);
        let motion = self.motion[self.index(nearest)].map(DVec2::from);
        let motion = motion.unwrap_or_else(|| self.motion_of_camera(nearest));
        let motion = DVec2::from(motion.to_array().map(|m| if m.abs() < LEAST_MOTION { 0.0 } else { m }));
        let place = DVec2::new(pixel[0] as f64, pixel[1] as f64) + 0.5 + motion;
        let size = DVec2::from(self.size_px.map(f64::from));
        if place.min_element() < 0.0 || place.x > size.x || place.y > size.y {
            return with(own, counts);
        }
        let [r, g, b, frames] = self.history_at(place);
        let colours: Vec<DVec3> = around.iter().filter_map(|at| Some(luma_chroma(seen(*at)?))).collect();
        let counted = colours.len().max(1) as f64;
        let mean = colours.iter().sum::<DVec3>() / counted;
        let variance = colours.iter().map(|c| *c * *c).sum::<DVec3>() / counted - mean * mean;
        let reach = DEVIATIONS * variance.max(DVec3::ZERO).map(f64::sqrt) + 1e-4;
        let off = luma_chroma([r, g, b]) - mean;
        let beyond = (off.abs() / reach).max_element().max(1.0);
        let before = from_luma_chroma(mean + off / beyond);
        let share = self.share_at_depth(nearest);
        let count = frames.min(self.most * share / (1.0 + HASTE * motion.length()));
        let share = counts / (count + 1.0);
        let mixed = std::array::from_fn(|c| (before[c] + (own[c] - before[c]) * share).max(0.0));
        with(mixed, count + counts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_and_axes_of_colour_invert() {
        for colour in [[0.0, 0.0, 0.0], [0.2, 3.0, 0.7], [40.0, 1.0, 900.0]] {
            let back = unweighed(weighed(colour, 1.0).unwrap());
            assert!((0..3).all(|c| (back[c] - colour[c]).abs() <= 1e-9 * (1.0 + colour[c])), "{back:?}");
            let back = from_luma_chroma(luma_chroma(colour));
            assert!((0..3).all(|c| (back[c] - colour[c]).abs() <= 1e-9 * (1.0 + colour[c])), "{back:?}");
        }
    }
}
