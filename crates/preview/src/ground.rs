//! The terrain around the start camera: heights on square rings whose sides grow, so that cells have about one size on
//! the screen. Height overrides of patches are blobs of their own and are left out.

use glam::DVec3;
use lodestream_scene::description::Camera;
use lodestream_scene::terrain::TerrainEntry;
use lodestream_terrain::{Scratch, Terrain};
use serde_json::{Value, json};

use crate::streams::Streams;

/// Points along a side of a ring; a ring has four times as many.
const SIDE: u32 = 24;
/// Rings.
const RINGS: u32 = 44;
/// Half a side of the first ring, in distances of the camera to its target.
const INNER: f64 = 0.02;
/// Factor from ring to ring.
const RATIO: f64 = 1.25;
/// Half a side, in distances of the camera to its target, up to which a height is the least of its cell: between points
/// the ground must not cover what stands on it.
const LOWERED: f64 = 3.0;
/// Steps of a height between the lowest and the highest.
const STEPS: f64 = 65_535.0;

/// Writes the heights, rings from the inmost; `None` if the terrain's parameters are invalid.
pub(crate) fn write(entry: &TerrainEntry, camera: &Camera, streams: &mut Streams) -> Option<Value> {
    let terrain = Terrain::with_stamps(entry.parameters, entry.stamps.clone()).ok()?;
    let (eye, target) = (DVec3::from(camera.eye), DVec3::from(camera.target));
    let reach = (target - eye).length().max(f64::from(entry.unit));
    let (unit, height_unit) = (f64::from(entry.unit), f64::from(entry.height_unit));
    let mut scratch = Scratch::new();
    let mut heights = Vec::with_capacity((RINGS * 4 * SIDE) as usize);
    let mut half = INNER * reach;
    for _ in 0..RINGS {
        for point in 0..4 * SIDE {
            let [x, z] = on_square(point).map(|part| part * half);
            let (x, z, cell) = ((eye.x + x) / unit, (eye.z + z) / unit, half / unit / 8.0);
            let mut height = terrain.height_between(x, z, &mut scratch);
            if half < LOWERED * reach {
                for [dx, dz] in [
                    [-1.0, -1.0],
                    [1.0, -1.0],
                    [-1.0, 1.0],
                    [1.0, 1.0],
                    [1.0, 0.0],
                    [-1.0, 0.0],
                    [0.0, -1.0],
                    [0.0, 1.0],
                ] {
                    height = height.min(terrain.height_between(x + dx * cell, z + dz * cell, &mut scratch));
                }
            }
            heights.push(height * height_unit);
        }
        half *= RATIO;
    }
    let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let high = heights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let step = ((high - low) / STEPS).max(f64::MIN_POSITIVE);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded and clamped")]
    let number = |height: f64| ((height - low) / step).round().clamp(0.0, STEPS) as u16;
    streams.differences(heights.into_iter().map(number));
    Some(json!({
        "center": [eye.x, eye.z],
        "inner": INNER * reach,
        "ratio": RATIO,
        "rings": RINGS,
        "side": SIDE,
        "low": low,
        "step": step,
        "zones": entry.zones,
        "water": entry.water.map(|water| water.level),
    }))
}

/// A point on the square of half side 1, counted from the corner (1, −1) along its four sides. Squares need no sine,
/// whose last digits differ between machines.
fn on_square(point: u32) -> [f64; 2] {
    let along = 2.0 * f64::from(point % SIDE) / f64::from(SIDE) - 1.0;
    match point / SIDE {
        0 => [1.0, along],
        1 => [-along, 1.0],
        2 => [-1.0, -along],
        _ => [along, -1.0],
    }
}
