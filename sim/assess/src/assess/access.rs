//! Cost of random access: the ancestors that a spot or a view requires.

use lodestream_geometry::index::{ChunkInfo, Sphere, TruncationPoint};
use lodestream_geometry::random::Random;
use lodestream_geometry::screen::{scale_px, screen_error_px, visible_error};
use lodestream_scene::View;
use serde::Serialize;

use super::model::Model;

/// Number of spots and views that are averaged.
const TRIALS: usize = 40;
/// Radius of a spot relative to the diagonal.
const SPOT_RADIUS: f32 = 0.05;
/// Distance of the eye from the centre relative to the diagonal: the object fills the screen.
const EYE_DISTANCE: f64 = 1.0;
const VIEWPORT_PX: [u32; 2] = [1280, 720];
const FOV_Y: f32 = 60.0 * std::f32::consts::PI / 180.0;
const TARGET_PX: f64 = 1.0;

/// Refining one spot fully: means over random spots on the surface.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Spot {
    /// Bytes of the chunks that touch a ball of 5 % of the diagonal, with all their ancestors.
    pub bytes: f64,
    /// The same relative to the bytes of those chunks that are of the finest level.
    pub ratio: f64,
}

/// The share of an asset that a view filled by it needs: means over random directions.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct ViewShare {
    /// Share of all splits.
    pub splits: f64,
    /// Share of all payload bytes.
    pub bytes: f64,
    /// Share of payload bytes if chunks could not be truncated.
    pub whole_bytes: f64,
}

pub(super) fn spot(model: &Model, seed: u64) -> Spot {
    let infos = &model.prepared.infos;
    let finest = infos.iter().map(|i| i.level).max().unwrap_or(0);
    let mut random = Random::new(seed);
    let radius = model.prepared.base.diagonal * SPOT_RADIUS;
    let (mut spot, mut counted) = (Spot::default(), 0.0);
    for _ in 0..TRIALS {
        let q = model.mesh.positions[random.below(model.mesh.positions.len())];
        let at = q.map(|x| (f64::from(x) * model.mesh.grid.step) as f32);
        let set = with_ancestors(infos, |i| touches(&i.sphere, at, radius));
        let own: u32 = (0..infos.len())
            .filter(|&i| infos[i].level == finest && touches(&infos[i].sphere, at, radius))
            .map(|i| infos[i].payload_bytes)
            .sum();
        let all: u32 = chosen(infos, &set).map(|i| i.payload_bytes).sum();
        if own > 0 {
            spot.bytes += f64::from(all);
            spot.ratio += f64::from(all) / f64::from(own);
            counted += 1.0;
        }
    }
    let counted = f64::max(counted, 1.0);
    Spot { bytes: spot.bytes / counted, ratio: spot.ratio / counted }
}

pub(super) fn view_share(model: &Model, seed: u64) -> ViewShare {
    let infos = &model.prepared.infos;
    let base = &model.prepared.base;
    let diagonal = f64::from(base.diagonal);
    let center = base.sphere.center.map(f64::from);
    let mut random = Random::new(seed);
    let mut share = ViewShare::default();
    for _ in 0..TRIALS {
        let direction = direction(&mut random);
        let eye = [0, 1, 2].map(|k| center[k] + direction[k] * diagonal * EYE_DISTANCE);
        let up = if direction[2].abs() < 0.9 { [0.0, 0.0, 1.0] } else { [0.0, 1.0, 0.0] };
        let frustum = View::look_at(eye, center, up, FOV_Y, VIEWPORT_PX).frustum();
        let scale = scale_px(f64::from(VIEWPORT_PX[1]), f64::from(FOV_Y));
        let error_px = |sphere: &Sphere, error: f32| {
            let from_eye = glam::Vec3::from([0, 1, 2].map(|k| (f64::from(sphere.center[k]) - eye[k]) as f32));
            let depth = f64::from(frustum.depth(from_eye, sphere.radius));
            let seen = frustum.sees(from_eye, sphere.radius);
            if seen { screen_error_px(f64::from(error), depth, scale) } else { 0.0 }
        };
        let set = with_ancestors(infos, |i| error_px(&i.sphere, visible_error(i, 1.0)) > TARGET_PX);
        let mut inner = vec![false; infos.len()];
        for (info, _) in infos.iter().zip(&set).filter(|(_, taken)| **taken) {
            info.parents.iter().for_each(|&parent| inner[parent as usize] = true);
        }
        let (mut splits, mut bytes, mut whole_bytes) = (0.0, 0.0, 0.0);
        for (id, info) in infos.iter().enumerate().filter(|(id, _)| set[*id]) {
            // A chunk without dependents is needed up to the first truncation point that suffices. Attribute errors are
            // known for the whole chunk only.
            let attributes = visible_error(&ChunkInfo { error: 0.0, ..info.clone() }, 1.0);
            let enough = |s: &TruncationPoint| error_px(&info.sphere, s.error.max(attributes)) <= TARGET_PX;
            let truncation = info.truncation_points.iter().find(|s| !inner[id] && enough(s));
            splits += f64::from(truncation.map_or(info.vertices, |s| s.vertices));
            bytes += f64::from(truncation.map_or(info.payload_bytes, |s| s.payload_bytes));
            whole_bytes += f64::from(info.payload_bytes);
        }
        let total =
            |count: fn(&ChunkInfo) -> u32| infos.iter().map(|i| f64::from(count(i))).sum::<f64>().max(1.0);
        share.splits += splits / total(|i| i.vertices) / TRIALS as f64;
        share.bytes += bytes / total(|i| i.payload_bytes) / TRIALS as f64;
        share.whole_bytes += whole_bytes / total(|i| i.payload_bytes) / TRIALS as f64;
    }
    share
}

/// Uniformly distributed on the sphere (Marsaglia, 1972), without trigonometry.
fn direction(random: &mut Random) -> [f64; 3] {
    loop {
        let (a, b) = (random.unit() * 2.0 - 1.0, random.unit() * 2.0 - 1.0);
        let square = a * a + b * b;
        if square < 1.0 {
            let root = 2.0 * (1.0 - square).sqrt();
            return [a * root, b * root, 1.0 - 2.0 * square];
        }
    }
}

fn touches(sphere: &Sphere, at: [f32; 3], radius: f32) -> bool {
    glam::Vec3::from(sphere.center).distance(glam::Vec3::from(at)) < sphere.radius + radius
}

/// The wanted chunks with all their ancestors.
fn with_ancestors(infos: &[ChunkInfo], wanted: impl Fn(&ChunkInfo) -> bool) -> Vec<bool> {
    let mut set: Vec<bool> = infos.iter().map(wanted).collect();
    for id in (0..infos.len()).rev() {
        if set[id] {
            for &parent in &infos[id].parents {
                set[parent as usize] = true;
            }
        }
    }
    set
}

fn chosen<'a>(infos: &'a [ChunkInfo], set: &'a [bool]) -> impl Iterator<Item = &'a ChunkInfo> {
    infos.iter().zip(set).filter(|(_, taken)| **taken).map(|(info, _)| info)
}
