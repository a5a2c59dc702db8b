//! Punctual lights of a frame, front to back, as shaders read them: `lights.wgsl`.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use lodestream_scene::punctual_lights::PunctualLight;

use super::{LIGHT_TILES, LightCulling, MAX_LIGHTS};
use crate::frame::camera::may_see;
use crate::frame::settings::Frame;

/// Most bytes of masks; beyond, tiles get larger.
const MAX_MASK_BYTES: u64 = 64 << 20;
/// Number of depth bins.
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

/// The lights of a frame.
pub(crate) struct PunctualLightList {
    pub(crate) punctual_lights: Vec<PunctualLightRaw>,
    /// First and, shifted by 16, last light that reaches into a depth bin; first > last for none.
    pub(crate) bins: Vec<u32>,
    pub(crate) uniform: PunctualLightsUniform,
    /// Number of tiles across and down.
    pub(crate) tiles: [u32; 2],
}

impl PunctualLightList {
    /// Collects the lights that may reach visible surfaces. `through`: some surfaces are transparent.
    pub(crate) fn new(frame: &Frame<'_>, culling: LightCulling, size: (u32, u32), through: bool) -> Self {
        let camera = &frame.camera;
        let ahead = camera.rotation * DVec3::NEG_Z;
        let mut seen: Vec<(f64, f64, PunctualLightRaw)> = frame
            .lights
            .iter()
            .filter_map(|light| {
                let raw = punctual_light(light, camera.eye)?;
                let at = DVec3::from(light.position) - camera.eye;
                let (depth, range) = (at.dot(ahead), f64::from(light.range));
                let reached = may_see(camera, at, range, size) && depth + range > 0.0;
                reached.then_some((depth - range, depth + range, raw))
            })
            .collect();
        let LightCulling { tile_px, clusters, most } = culling;
        if seen.len() > most as usize {
            // A stable sort, so that the choice among equal lights does not change.
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

/// A light as shaders read it; `None` if it lights nothing.
pub(crate) fn punctual_light(light: &PunctualLight, eye: DVec3) -> Option<PunctualLightRaw> {
    let (scale, offset, direction) = match light.spot {
        None => (0.0, 1.0, DVec3::Y),
        Some(spot) => {
            let [inner, outer] =
                [spot.inner, spot.outer].map(|angle| f64::from(angle).clamp(0.0, 0.5 * std::f64::consts::PI));
            let scale = 1.0 / (inner.cos() - outer.cos()).max(1e-3);
            (scale, -outer.cos() * scale, Vec3::from(spot.direction).as_dvec3().try_normalize()?)
        }
    };
    let raw = PunctualLightRaw {
        position: (DVec3::from(light.position) - eye).as_vec3().to_array(),
        range: light.range,
        colour: light.intensity.map(|intensity| intensity / std::f32::consts::PI),
        spot_scale: scale as f32,
        direction: direction.as_vec3().to_array(),
        spot_offset: offset as f32,
    };
    let finite = raw.position.iter().chain(&raw.colour).chain([&raw.range]).all(|x| x.is_finite());
    (finite && raw.range > 0.0 && light.brightest() > 0.0).then_some(raw)
}

/// Importance of a light to the picture, up to a factor: its irradiance times the disc that it covers on the screen.
/// The irradiance is inversely proportional to the square of its range, the disc to that square over the squared
/// distance; inside its range it covers the whole screen.
fn brightness(punctual_light: &PunctualLightRaw) -> f32 {
    let [r, g, b] = punctual_light.colour;
    let distance = glam::Vec3::from(punctual_light.position).length().max(punctual_light.range);
    // BT.709 luminance.
    (0.2126 * r + 0.7152 * g + 0.0722 * b) / (distance * distance)
}

/// Whether a light lights anything.
#[cfg(test)]
pub(crate) fn lights(light: &PunctualLight, eye: DVec3) -> bool {
    punctual_light(light, eye).is_some()
}

/// Depth bins of equal ratios over lights sorted by depth: the lights of each, the depth at which the first begins,
/// and the number of bins per doubling.
fn bins(punctual_lights: &[(f64, f64, PunctualLightRaw)]) -> (Vec<u32>, f32, f32) {
    let furthest = punctual_lights.iter().map(|(_, far, _)| *far).fold(0.0, f64::max);
    // Lights that reach behind the eye begin at depth 0; bins begin at a ten-thousandth of the farthest depth at the
    // latest.
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
        // A spare bin on both sides absorbs f32 rounding.
        let first = (bin(*near) as usize).saturating_sub(1);
        let last = (bin(*far) as usize + 1).min(BINS - 1);
        for (low, high) in &mut reach[first..=last] {
            (*low, *high) = ((*low).min(index), (*high).max(index));
        }
    }
    let pack = |(low, high)| if low > high { 1 } else { low | high << 16 };
    (reach.into_iter().map(pack).collect(), nearest as f32, per_octave)
}
