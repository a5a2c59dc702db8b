//! Numbers of instances of a mesh that can be drawn within bands of frame rates, flat and curved, with three methods
//! of occlusion: an experiment of the older system.
//!
//! Instances are distributed evenly over a frustum in front of the eye, always the first ones of one sequence. Their
//! number doubles until a frame takes longer than the slowest band allows; between two numbers time is interpolated
//! linearly. The fastest frame of a number counts, which excludes other load on the machine.

use std::fmt;
use std::sync::Arc;

use glam::{DQuat, DVec3};
use lodestream_protocol::source::SceneSource;
use lodestream_render::{
    AmbientOcclusion, AntiAliasing, Drawable, Frame, Gpu, Headless, OcclusionMethod, Placement, PnTriangles,
    Settings,
};
use lodestream_scenario::plan::Plan;
use lodestream_scenario::stopwatch::rounded;
use lodestream_scene::pose::Pose;
use serde::Serialize;

use super::painter::Studio;
use super::settled::{by_turns, settle};

/// Frame rates at which the bands end.
pub const BANDS: [f64; 3] = [54.0, 45.0, 30.0];
/// Most instances.
pub const MOST: usize = 1 << 15;
/// Distances of the nearest and furthest instance, in radii of the mesh, and the vertical field of view.
const NEAR: f64 = 6.0;
const FAR: f64 = 24.0;
const FOV_Y: f64 = 0.8;

/// Results of one variant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Crowd {
    /// The system that was measured.
    pub system: &'static str,
    /// Method of drawing triangles.
    pub triangles: &'static str,
    /// The method of occlusion.
    pub occlusion: &'static str,
    /// Width and height of the frames, which are the plan's viewport; unknown for the older system.
    pub size_px: Option<[u32; 2]>,
    /// The graphics adapter.
    pub adapter: String,
    /// Frame time of one instance, in milliseconds; unknown for the older system.
    pub one_ms: Option<f64>,
    /// Instances drawn at each of [`BANDS`].
    pub instances: [f64; 3],
    /// The same relative to flat triangles.
    pub over_flat: [f64; 3],
}

/// The older system's table, of its WebGL program: "monkeys" drawn at 54 to 60, 45 to 50 and 30 to 34 frames per second,
/// by device, occlusion and triangles. It tessellates on the CPU, at a level of 0 to 3 that the table does not give.
const OLDER: [(&str, &str, &str, [f64; 3]); 12] = [
    ("older system, GTX 970", "ssao", "flat", [1374.0, 1669.0, 2376.0]),
    ("older system, GTX 970", "ssao", "curved", [320.0, 392.0, 592.0]),
    ("older system, GTX 970", "hbao", "flat", [159.0, 206.0, 338.0]),
    ("older system, GTX 970", "hbao", "curved", [93.0, 125.0, 231.0]),
    ("older system, GTX 970", "hbao-plus", "flat", [243.0, 305.0, 456.0]),
    ("older system, GTX 970", "hbao-plus", "curved", [225.0, 291.0, 438.0]),
    ("older system, GTX 960M", "ssao", "flat", [163.0, 792.0, 1325.0]),
    ("older system, GTX 960M", "ssao", "curved", [116.0, 153.0, 242.0]),
    ("older system, GTX 960M", "hbao", "flat", [61.0, 123.0, 203.0]),
    ("older system, GTX 960M", "hbao", "curved", [26.0, 78.0, 137.0]),
    ("older system, GTX 960M", "hbao-plus", "flat", [218.0, 330.0, 525.0]),
    ("older system, GTX 960M", "hbao-plus", "curved", [80.0, 170.0, 291.0]),
];

fn older() -> Vec<Crowd> {
    let row = |(system, occlusion, triangles, instances)| Crowd {
        system,
        triangles,
        occlusion,
        size_px: None,
        adapter: String::new(),
        one_ms: None,
        instances,
        over_flat: [1.0; 3],
    };
    OLDER.into_iter().map(row).collect()
}

/// Fills in the ratios to flat triangles of the same system with the same occlusion.
fn compare(rows: &mut [Crowd]) {
    let flat: Vec<Crowd> = rows.iter().filter(|row| row.triangles == "flat").cloned().collect();
    for row in rows {
        let of = |other: &&Crowd| other.system == row.system && other.occlusion == row.occlusion;
        let Some(flat) = flat.iter().find(of) else { continue };
        let over = row.instances.iter().zip(flat.instances);
        let over = over.map(|(count, flat)| if flat > 0.0 { rounded(count / flat, 3) } else { 0.0 });
        row.over_flat = std::array::from_fn(|_| 0.0);
        over.enumerate().for_each(|(band, share)| row.over_flat[band] = share);
    }
}

/// Methods of drawing triangles.
fn ways() -> [(&'static str, Option<PnTriangles>); 4] {
    let usual = PnTriangles::default();
    [
        ("flat", None),
        ("curved, 1 px", Some(PnTriangles { error_px: 1.0, ..usual })),
        ("curved", Some(usual)),
        // The highest subdivision up to that bound.
        ("curved, 4 pieces an edge", Some(PnTriangles { error_px: 0.0, most: 4 })),
    ]
}

/// Settles the plan's case and draws increasing numbers of its first mesh, up to `most`, `frames` frames of each.
///
/// # Errors
/// Plans with several cases, scenes without a mesh, runs that do not settle, and errors of the graphics device.
pub fn crowd(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    (frames, most): (u32, usize),
    mut keep: impl FnMut(&str, &image::RgbaImage) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<Crowd>> {
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let mut settled = settle(plan, scene, &studio, [plan.client])?;
    let mut rows = Vec::new();
    let Some(one) = settled.first_mut() else { return Ok(rows) };
    let methods = [OcclusionMethod::Ssao, OcclusionMethod::Hbao, OcclusionMethod::HbaoPlus];
    let all: Vec<_> =
        methods.iter().flat_map(|method| ways().map(|(name, way)| (*method, name, way))).collect();
    // By variant: numbers of instances and frame times.
    let mut taken: Vec<Vec<(usize, f64)>> = vec![Vec::new(); all.len()];
    let mut count = 1;
    let slowest = BANDS.map(|band| 1.0 / band).into_iter().fold(0.0, f64::max);
    let base = Settings { shadows: None, anti_aliasing: AntiAliasing::None, ..Settings::default() };
    while count <= most {
        let left: Vec<usize> = (0..all.len())
            .filter(|&i| taken[i].last().is_none_or(|(_, seconds)| *seconds < slowest))
            .collect();
        if left.is_empty() {
            break;
        }
        let seconds = one.painter.with_mesh(&one.view, base, |headless, frame, mesh| {
            let (centre, radius) = mesh.bounds().unwrap_or((DVec3::ZERO, 1.0));
            let instances = places(count, mesh.origin() + centre, radius);
            let drawables = [Drawable { asset: mesh, instances: &instances }];
            let camera = Pose::look_at(DVec3::ZERO, DVec3::NEG_Z, DVec3::Y, FOV_Y);
            let draw = |headless: &mut Headless, i: usize| {
                let (method, _, pn_triangles) = all[i];
                let occlusion = Some(AmbientOcclusion { method, ..AmbientOcclusion::default() });
                let settings = Settings { occlusion, pn_triangles, ..frame.settings };
                headless.frame(&Frame { camera, settings, drawables: &drawables, ..frame })
            };
            let seconds = by_turns(left.len(), frames, |i| draw(headless, left[i]).map(drop))?;
            if count == 4 {
                for &i in &left {
                    draw(headless, i)?;
                    keep(
                        &format!("crowd-{}-{}", all[i].0.name(), all[i].1.replace([' ', ','], "-")),
                        &headless.picture()?,
                    )?;
                }
            }
            Ok(seconds)
        })?;
        for (&i, seconds) in left.iter().zip(seconds) {
            taken[i].push((count, seconds.into_iter().fold(f64::INFINITY, f64::min)));
        }
        count *= 2;
    }
    for ((method, triangles, _), taken) in all.iter().zip(&taken) {
        rows.push(Crowd {
            system: "ours",
            triangles,
            occlusion: method.name(),
            size_px: Some(plan.viewport_px),
            adapter: adapter.clone(),
            one_ms: taken.first().map(|(_, seconds)| rounded(seconds * 1e3, 3)),
            instances: BANDS.map(|band| rounded(at_seconds(taken, 1.0 / band), 0)),
            over_flat: [1.0; 3],
        });
    }
    rows.extend(older());
    compare(&mut rows);
    Ok(rows)
}

/// The interpolated number whose frame takes `seconds`: 0 if one takes longer, the largest tried if it takes less.
fn at_seconds(taken: &[(usize, f64)], seconds: f64) -> f64 {
    let mut before = (0.0, 0.0);
    for (number, &(count, took)) in taken.iter().enumerate() {
        let now = (count as f64, took);
        if took >= seconds {
            let share = (seconds - before.1) / (now.1 - before.1);
            return if number == 0 { 0.0 } else { before.0 + share * (now.0 - before.0) };
        }
        before = now;
    }
    before.0
}

/// The first `count` placements before an eye at the origin that looks along −z, for a mesh with a centre and radius,
/// each with a rotation of its own.
fn places(count: usize, centre: DVec3, radius: f64) -> Vec<Placement> {
    // Low-discrepancy sequence in three dimensions: every prefix is evenly distributed (Roberts 2018).
    let even = |i: usize, step: f64| (0.5 + i as f64 * step).fract();
    let half = (0.5 * FOV_Y).tan();
    (0..count)
        .map(|i| {
            let [u, v, w] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3]
                .map(|s| even(i, s));
            let distance = radius * (NEAR + (FAR - NEAR) * w);
            let across = DVec3::new((u - 0.5) * 3.2 * half, (v - 0.5) * 1.8 * half, -1.0) * distance;
            let rotation = DQuat::from_rotation_y(even(i, 0.618_033_988_749_894_9) * std::f64::consts::TAU);
            Placement::new(across - rotation * centre, rotation, 1.0)
        })
        .collect()
}

/// One line of text.
impl fmt::Display for Crowd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { system, triangles, occlusion, one_ms, instances, over_flat, .. } = self;
        write!(f, "{system}, {triangles}, {occlusion}:")?;
        if let Some(one_ms) = one_ms {
            write!(f, " one {one_ms:.1} ms;")?;
        }
        let bands = BANDS.iter().zip(instances).zip(over_flat);
        bands.into_iter().try_for_each(|((band, count), over)| {
            write!(f, " {count:.0} at {band} frames/s ({over:.2} of flat),")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    #[test]
    fn every_variant_draws_increasing_numbers() {
        let Some((plan, gpu)) = plan_and_device("[64, 36]") else { return };
        let rows = crowd(&plan, &small_scene(), gpu, (1, 4), |_, _| Ok(())).unwrap();
        let ours: Vec<&Crowd> = rows.iter().filter(|row| row.system == "ours").collect();
        assert_eq!((ours.len(), rows.len()), (12, 24));
        assert!(ours.iter().all(|row| row.one_ms.is_some_and(|ms| ms > 0.0)));
        assert!(ours.iter().all(|row| row.instances.is_sorted()), "{ours:?}");
    }

    #[test]
    fn numbers_are_interpolated_by_their_times() {
        let taken = [(1, 0.010), (2, 0.012), (4, 0.020), (8, 0.040)];
        assert_eq!(at_seconds(&taken, 0.020), 4.0);
        assert_eq!(at_seconds(&taken, 0.030), 6.0);
        assert_eq!(at_seconds(&taken, 0.005), 0.0, "one takes longer");
        assert_eq!(at_seconds(&taken, 1.0), 8.0, "the most that was tried");
    }

    #[test]
    fn the_older_systems_ratios_are_to_its_flat_triangles() {
        let mut rows = older();
        compare(&mut rows);
        assert_eq!(rows[1].over_flat, [0.233, 0.235, 0.249]);
        assert_eq!((rows[2].over_flat, rows[4].over_flat), ([1.0; 3], [1.0; 3]));
        assert_eq!(rows[5].over_flat, [0.926, 0.954, 0.961]);
    }

    #[test]
    fn placements_are_in_view_and_prefixes_are_stable() {
        let (some, more) = (places(10, DVec3::ONE, 2.0), places(100, DVec3::ONE, 2.0));
        assert_eq!(some[..], more[..10]);
        for instance in more {
            let middle = instance.to_world(DVec3::ONE);
            assert!((2.0 * NEAR..2.0 * FAR).contains(&-middle.z), "{middle}");
        }
    }
}
