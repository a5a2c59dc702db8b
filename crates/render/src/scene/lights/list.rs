//! The punctual lights of a frame, from near to far, as the shaders read them: `lights.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::{LIGHT_TILES, Light, LightCulling, MAX_LIGHTS};
use crate::frame::camera::may_see;
use crate::frame::settings::Frame;

/// Most bytes of masks: beyond them tiles get larger.
const MAX_MASK_BYTES: u64 = 64 << 20;
/// Ranges of depth that name the punctual lights that reach into them.
const BINS: usize = 256;

/// `PunctualLight` of the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct PunctualLightRaw {
    pub(crate) position: [f32; 3],
    pub(crate) range: f32,
    pub(crate) colour: [f32; 3],
    pub(crate) spot_scale: f32,
    pub(crate) direction: [f32; 3],
    pub(crate) spot_offset: f32,
}

/// `PunctualLights` of the shaders.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct PunctualLightsUniform {
    pub(crate) count: u32,
    pub(crate) words: u32,
    pub(crate) tile_px: u32,
    pub(crate) tiles_across: u32,
    pub(crate) nearest: f32,
    pub(crate) bins_per_octave: f32,
    pub(crate) clusters: u32,
    pub(crate) bins: u32,
    pub(crate) through: u32,
    pub(crate) padding: [u32; 3],
}

/// See the module.
pub(crate) struct PunctualLightList {
    pub(crate) punctual_lights: Vec<PunctualLightRaw>,
    /// First and, shifted by 16, last punctual light that reaches into a range of depths; first above last where none does.
    pub(crate) bins: Vec<u32>,
    pub(crate) uniform: PunctualLightsUniform,
    /// Of the picture, across and down.
    pub(crate) tiles: [u32; 2],
}

impl PunctualLightList {
    /// Of the punctual lights that may reach what a frame of this size shows. `through`: something there is seen through.
    pub(crate) fn new(frame: &Frame<'_>, culling: LightCulling, size: (u32, u32), through: bool) -> Self {
        let camera = &frame.camera;
        let ahead = camera.rotation * DVec3::NEG_Z;
        let mut seen: Vec<(f64, f64, PunctualLightRaw)> = frame
            .lights
            .iter()
            .filter_map(|light| {
                let raw = punctual_light(light, camera.eye)?;
                let at = light.position - camera.eye;
                let depth = at.dot(ahead);
                let reached = may_see(camera, at, light.range, size) && depth + light.range > 0.0;
                reached.then_some((depth - light.range, depth + light.range, raw))
            })
            .collect();
        let LightCulling { tile_px, clusters, most } = culling;
        if seen.len() > most as usize {
            // Stable, so that of punctual lights that are alike always the same ones are left.
            seen.sort_by(|(.., a), (.., b)| brightness(b).total_cmp(&brightness(a)));
            seen.truncate(most as usize);
        }
        seen.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
        seen.truncate(MAX_LIGHTS);
        let [least, most] = LIGHT_TILES;
        let mut tile_px = tile_px.clamp(least, most);
        let words = (seen.len() as u32).div_ceil(32);
        let tiles = |px: u32| [size.0.div_ceil(px), size.1.div_ceil(px)];
        let bytes = |[across, down]: [u32; 2]| 4 * u64::from(across) * u64::from(down) * u64::from(words);
        while bytes(tiles(tile_px)) > MAX_MASK_BYTES {
            tile_px *= 2;
        }
        let tiles = tiles(tile_px);
        let (bins, nearest, bins_per_octave) = bins(&seen);
        let uniform = PunctualLightsUniform {
            count: seen.len() as u32,
            words,
            tile_px,
            tiles_across: tiles[0],
            nearest,
            bins_per_octave,
            clusters: u32::from(clusters),
            bins: bins.len() as u32,
            through: u32::from(through),
            padding: [0; 3],
        };
        Self { punctual_lights: seen.into_iter().map(|(.., raw)| raw).collect(), bins, uniform, tiles }
    }
}

/// A light as the shaders read it; `None` of one that lights nothing.
pub(crate) fn punctual_light(light: &Light, eye: DVec3) -> Option<PunctualLightRaw> {
    let (scale, offset, direction) = match light.spot {
        None => (0.0, 1.0, DVec3::Y),
        Some(spot) => {
            let [inner, outer] =
                [spot.inner, spot.outer].map(|angle| angle.clamp(0.0, 0.5 * std::f64::consts::PI));
            let scale = 1.0 / (inner.cos() - outer.cos()).max(1e-3);
            (scale, -outer.cos() * scale, spot.direction.try_normalize()?)
        }
    };
    let raw = PunctualLightRaw {
        position: (light.position - eye).as_vec3().to_array(),
        range: light.range as f32,
        colour: (light.intensity / std::f32::consts::PI).to_array(),
        spot_scale: scale as f32,
        direction: direction.as_vec3().to_array(),
        spot_offset: offset as f32,
    };
    let finite = raw.position.iter().chain(&raw.colour).chain([&raw.range]).all(|x| x.is_finite());
    (finite && raw.range > 0.0 && light.intensity.max_element() > 0.0).then_some(raw)
}

/// What a punctual light adds to the whole of a picture, but for a factor: a punctual light's irradiance falls with the square of its range,
/// and the disc that it reaches on the screen grows with that over the square of its distance. From within its range all
/// of the screen is reached.
fn brightness(punctual_light: &PunctualLightRaw) -> f32 {
    let [r, g, b] = punctual_light.colour;
    let distance = glam::Vec3::from(punctual_light.position).length().max(punctual_light.range);
    // BT.709 luminance.
    (0.2126 * r + 0.7152 * g + 0.0722 * b) / (distance * distance)
}

/// Whether a light lights anything, seen from an eye.
#[cfg(test)]
pub(crate) fn lights(light: &Light, eye: DVec3) -> bool {
    punctual_light(light, eye).is_some()
}

/// Ranges of depth in equal ratios, over punctual lights from near to far: what each names, the depth at which the first begins,
/// and how many there are to a doubling.
fn bins(punctual_lights: &[(f64, f64, PunctualLightRaw)]) -> (Vec<u32>, f32, f32) {
    let furthest = punctual_lights.iter().map(|(_, far, _)| *far).fold(0.0, f64::max);
    // Nearer than any punctual light begins but those that reach behind the eye: a ten-thousandth of all is near enough.
    let ahead = punctual_lights.iter().map(|(near, ..)| *near).filter(|near| *near > 0.0);
    let nearest = ahead.fold(furthest, f64::min).max(furthest * 1e-4).max(f64::from(f32::MIN_POSITIVE));
    let octaves = (furthest / nearest).log2().max(1e-3);
    let per_octave = (BINS as f64 / octaves) as f32;
    let bin = |depth: f64| {
        let place = (depth / nearest).max(1.0).log2() * f64::from(per_octave);
        place.clamp(0.0, (BINS - 1) as f64)
    };
    let mut reach = vec![(u32::MAX, 0); BINS];
    for (index, (near, far, _)) in (0u32..).zip(punctual_lights) {
        // A bin to spare on both sides, for what 32 bits make of it.
        let first = (bin(*near) as usize).saturating_sub(1);
        let last = (bin(*far) as usize + 1).min(BINS - 1);
        for (low, high) in &mut reach[first..=last] {
            (*low, *high) = ((*low).min(index), (*high).max(index));
        }
    }
    let pack = |(low, high)| if low > high { 1 } else { low | high << 16 };
    (reach.into_iter().map(pack).collect(), nearest as f32, per_octave)
}
