//! Relief mapping compared with geometry: a wall as a plane with a height map, and as a mesh.
//!
//! Both are prepared, streamed over the same link and drawn by the same renderer with the same colours and light;
//! pictures are compared with one ray-cast from the height map's surface. Bytes and times are of virtual time and
//! reproducible; frame times depend on the machine, their ratios little.

mod truth;
mod wall;

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use image::RgbaImage;
use lodestream_protocol::source::SceneSource;
use lodestream_render::{Gpu, ReliefMethod, Settings};
use lodestream_scenario::plan::{self, ClientSettings, Plan};
use lodestream_scenario::run::{Run, certificate};
use lodestream_scenario::scene;
use lodestream_scenario::stopwatch::{median, paired_ratio, rounded};
use lodestream_scene::description::Camera;
use serde::Serialize;

use super::painter::Studio;
use super::settled::{by_turns, settle_at};
use crate::image_error::flip_of;
use truth::{Traced, environment};
use wall::Wall;
pub use wall::WallMethod;

/// Angles between the view and the wall's normal, degrees.
pub const ANGLES: [f64; 4] = [0.0, 45.0, 75.0, 85.0];
/// Distances of the eye from the wall's middle, in metres; the wall is two wide and high.
pub const DISTANCES_M: [f64; 3] = [2.0, 6.0, 18.0];
/// Vertical field of view.
const FOV_Y: f32 = 0.9;
/// Target screen error at which everything is fetched.
const ALL_PX: f32 = 1e-3;

/// What to measure.
#[derive(Clone, Copy, Debug)]
pub struct Question {
    /// Texels along a side of the maps; a metre of the wall has as many.
    pub texels: usize,
    /// Width and height of the pictures.
    pub size_px: [u32; 2],
    /// Distances of the eye from the wall's middle, in metres.
    pub distances_m: &'static [f64],
    /// Angles between the view and the wall's normal, degrees.
    pub angles: &'static [f64],
    /// Timed frames of each method in each view.
    pub frames: u32,
}

/// A wall sent by one method, seen head-on from a distance. Times since the connect call, in virtual time.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Delivery {
    /// The height map.
    pub map: &'static str,
    /// The method.
    pub way: &'static str,
    /// Distance of the eye, metres.
    pub distance_m: f64,
    /// Faces drawn at the end.
    pub faces: u64,
    /// Time until it could be drawn.
    pub ttff_ms: f64,
    /// Bytes until then.
    pub first_frame_bytes: u64,
    /// Time until its shape was at most a pixel off; textures are not considered.
    pub ttq_1_ms: f64,
    /// Time until settled at 1 px, including textures.
    pub settled_ms: f64,
    /// Bytes until then.
    pub settled_bytes: u64,
    /// Bytes of the whole model.
    pub all_bytes: u64,
}

/// One view of a wall sent by one method, settled at 1 px.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewResult {
    /// Angle between view and normal.
    pub degrees: f64,
    /// Mean FLIP error against rays over the wall, without shadows in either.
    pub flip: f64,
    /// The same with shadows in both.
    pub shadowed_flip: f64,
    /// Median frame time, in milliseconds.
    pub median_ms: f64,
    /// Frame time relative to the plane with a height map: the median over consecutive frames.
    pub over_relief: f64,
}

/// All views from a distance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DistanceResults {
    /// The height map.
    pub map: &'static str,
    /// The method.
    pub way: &'static str,
    /// Distance of the eye, metres.
    pub distance_m: f64,
    /// One entry for each of [`ANGLES`].
    pub angles: Vec<ViewResult>,
}

/// Both tables.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReliefComparison {
    /// The graphics adapter, if anything was drawn.
    pub adapter: Option<String>,
    /// Cost of sending.
    pub sent: Vec<Delivery>,
    /// Picture errors and frame times.
    pub shown: Vec<DistanceResults>,
}

/// Sends all walls by all methods, and draws them if there is a device. Packs are stored in a cache folder; `keep`
/// receives each picture with a name.
///
/// # Errors
/// Walls that cannot be written, prepared or sent, and errors of the graphics device.
pub fn relief_worth(
    question: &Question,
    gpu: Option<Gpu>,
    cache: &Path,
    mut keep: impl FnMut(&str, &RgbaImage) -> anyhow::Result<()>,
) -> anyhow::Result<ReliefComparison> {
    let adapter = gpu.as_ref().map(Gpu::describe);
    let studio = gpu.map(Studio::new);
    let mut worth = ReliefComparison { adapter, sent: Vec::new(), shown: Vec::new() };
    for wall in Wall::all(question.texels) {
        let folder = tempfile::tempdir().context("no folder for the wall")?;
        let open = |way: WallMethod, distance_m: f64| {
            let file = wall.write(way, folder.path(), &camera(distance_m, 0.0))?;
            let text = format!(
                "scene = {:?}\nviewport_px = {:?}\nttq_px = [1]\n[[sweep]]\ntransport = \"quic\"\nrate_bits_per_s = 2_000_000\n\
                 rtt_ms = 50\n",
                file.file_name().unwrap_or_default(),
                question.size_px
            );
            let plan = plan::parse(&text, &file)?;
            let one = plan.scenes.first().context("the plan has no scene")?;
            let scene = scene::open(&one.choice, plan.codec, cache, true)?;
            anyhow::Ok((way, plan, scene))
        };
        let traced = Traced::new(&wall);
        for &distance_m in question.distances_m {
            let ways = WallMethod::ALL
                .iter()
                .map(|way| open(*way, distance_m))
                .collect::<anyhow::Result<Vec<_>>>()?;
            // Variants that differ only in drawing are sent once.
            for (way, plan, scene) in
                ways.iter().filter(|(way, ..)| *way == WallMethod::Relief || !way.has_heights())
            {
                worth.sent.push(sent(&wall, *way, plan, scene, distance_m)?);
            }
            let Some(studio) = &studio else { continue };
            let mut shown: Vec<DistanceResults> = WallMethod::ALL
                .map(|way| DistanceResults {
                    map: wall.name,
                    way: way.name(),
                    distance_m,
                    angles: Vec::new(),
                })
                .into();
            for &degrees in question.angles {
                let view = camera(distance_m, degrees).view(question.size_px, 1.0);
                let name = |of: &str| format!("{}-{distance_m}m-{degrees}-{of}", wall.name);
                let truth = traced.picture(&view);
                keep(&name("rays"), &truth.shape)?;
                keep(&name("rays-shadowed"), &truth.shadowed)?;
                let mut painters = ways
                    .iter()
                    .map(|(_, plan, scene)| settle_at(plan, scene, studio, view))
                    .collect::<anyhow::Result<Vec<_>>>()?;
                let seconds = by_turns(painters.len(), question.frames, |number| {
                    painters[number].frame_in(&view, settings(ways[number].0), environment()).map(|_| ())
                })?;
                let relief = &seconds[1];
                for (number, painter) in painters.iter_mut().enumerate() {
                    let file = shown[number].way.replace([' ', ','], "-");
                    let shadowed = painter.picture()?;
                    let lit = Settings { shadows: None, relief_shadows: false, ..settings(ways[number].0) };
                    painter.frame_in(&view, lit, environment())?;
                    let picture = painter.picture()?;
                    keep(&name(&file), &picture)?;
                    keep(&name(&format!("{file}-shadowed")), &shadowed)?;
                    let flip = |picture, rays| rounded(flip_of(picture, rays, &truth.covered), 5);
                    shown[number].angles.push(ViewResult {
                        degrees,
                        flip: flip(&picture, &truth.shape),
                        shadowed_flip: flip(&shadowed, &truth.shadowed),
                        median_ms: rounded(median(seconds[number].clone()) * 1e3, 3),
                        over_relief: rounded(paired_ratio(&seconds[number], relief), 3),
                    });
                }
            }
            worth.shown.append(&mut shown);
        }
    }
    Ok(worth)
}

/// Renderer settings of a method: sun with shadows, sky without occlusion.
fn settings(way: WallMethod) -> Settings {
    let relief_shadows = way == WallMethod::ReliefShadows;
    let relief_method = match way {
        WallMethod::Cones => ReliefMethod::RelaxedCones,
        WallMethod::Quadtree => ReliefMethod::Quadtree,
        _ => ReliefMethod::default(),
    };
    Settings {
        relief_method,
        occlusion: None,
        dither: false,
        relief: way.has_heights(),
        relief_shadows,
        ..Settings::default()
    }
}

/// A camera at an angle to the wall's normal, to its left.
fn camera(distance_m: f64, degrees: f64) -> Camera {
    let (sin, cos) = degrees.to_radians().sin_cos();
    Camera {
        eye: [-sin * distance_m, 0.0, cos * distance_m],
        target: [0.0; 3],
        up: [0.0, 1.0, 0.0],
        fov_y: FOV_Y,
    }
}

fn sent(
    wall: &Wall,
    way: WallMethod,
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    distance_m: f64,
) -> anyhow::Result<Delivery> {
    let certificate = certificate()?;
    let streamed = |target_px: f32| {
        let case = plan.cases.first().context("the plan has no case")?;
        let plan = Plan { client: ClientSettings::to(target_px), ..plan.clone() };
        Run { plan: &plan, case, scene, certificate: &certificate, seed: 1 }.result(None)
    };
    let (result, all) = (streamed(1.0)?, streamed(ALL_PX)?);
    let never = || format!("{} as {}: {}", wall.name, way.name(), result.ended);
    Ok(Delivery {
        map: wall.name,
        way: way.name(),
        distance_m,
        faces: result.applied_faces.unwrap_or(0),
        ttff_ms: result.ttff_ms.with_context(never)?,
        first_frame_bytes: result.first_frame_bytes.with_context(never)?,
        ttq_1_ms: result.ttq_ms.get("1").copied().flatten().with_context(never)?,
        settled_ms: result.settled_ms.with_context(never)?,
        settled_bytes: result.total_bytes,
        all_bytes: all.total_bytes,
    })
}

impl fmt::Display for ReliefComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "drawn on {}", self.adapter.as_deref().unwrap_or("nothing"))?;
        for s in &self.sent {
            write!(
                f,
                "\n{:7} {:26} {:>4} m: {:>7} faces; first frame {:.0} ms, {} bytes; shape within 1 px {:.0} ms; settled {:.0} ms, \
                 {} bytes; {} in all",
                s.map,
                s.way,
                s.distance_m,
                s.faces,
                s.ttff_ms,
                s.first_frame_bytes,
                s.ttq_1_ms,
                s.settled_ms,
                s.settled_bytes,
                s.all_bytes
            )?;
        }
        for from in &self.shown {
            write!(f, "\n{:7} {:26} {:>4} m:", from.map, from.way, from.distance_m)?;
            for ViewResult { degrees, flip, shadowed_flip, median_ms, over_relief } in &from.angles {
                write!(
                    f,
                    "  {degrees}° FLIP {flip:.4}, {shadowed_flip:.4} with shadows, {median_ms:.1} ms, {over_relief:.2}"
                )?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::device;
    use super::*;

    #[test]
    fn relief_is_nearer_to_rays_than_a_plane_and_at_grazing_angles_a_mesh_is_nearest() {
        let Some(gpu) = device() else { return };
        let cache = tempfile::tempdir().unwrap();
        let question = Question {
            texels: 24,
            size_px: [160, 90],
            distances_m: &DISTANCES_M[..1],
            angles: &[0.0, 85.0],
            frames: 1,
        };
        let mut pictures = 0;
        let worth = relief_worth(&question, Some(gpu), cache.path(), |_, _| {
            pictures += 1;
            Ok(())
        })
        .unwrap();
        assert_eq!((worth.sent.len(), worth.shown.len(), pictures), (2 * 4, 2 * 7, 2 * 2 * 16));
        for of_distance in worth.sent.chunks(4) {
            let [plane, relief, mesh, tile] = of_distance else { panic!("four ways") };
            assert!(plane.settled_bytes < relief.settled_bytes, "{relief:?}");
            assert!(relief.all_bytes < tile.all_bytes && tile.all_bytes < mesh.all_bytes, "{mesh:?}");
            assert!(of_distance.iter().all(|sent| sent.ttff_ms <= sent.ttq_1_ms), "{of_distance:?}");
        }
        for near in worth.shown.chunks(7) {
            let [plane, relief, shadows, cones, quadtree, mesh, _] = near else { panic!("seven ways") };
            for way in [cones, quadtree] {
                assert!(way.angles[0].flip < 0.7 * plane.angles[0].flip, "{way:?} {plane:?}");
            }
            assert!(
                shadows.angles[0].shadowed_flip < relief.angles[0].shadowed_flip,
                "{shadows:?} {relief:?}"
            );
            assert_eq!(shadows.angles[0].flip, relief.angles[0].flip);
            assert!(relief.angles[0].flip < 0.7 * plane.angles[0].flip, "{relief:?} {plane:?}");
            // Both have the error of the texture's code, which is large for so few texels.
            assert!(mesh.angles[1].flip < 0.8 * relief.angles[1].flip, "{mesh:?} {relief:?}");
            assert!(relief.angles.iter().all(|shown| shown.over_relief == 1.0));
        }
    }

    /// Names that `docs/report/sections.toml` refers to.
    #[test]
    fn figures_have_the_names_that_sections_use() {
        let shown =
            ViewResult { degrees: 0.0, flip: 0.1, shadowed_flip: 0.2, median_ms: 3.0, over_relief: 1.0 };
        let angles = vec![shown; ANGLES.len()];
        let from = DistanceResults { map: "brick", way: "mesh", distance_m: 2.0, angles };
        let sent = Delivery {
            map: "brick",
            way: "mesh",
            distance_m: 2.0,
            faces: 2,
            ttff_ms: 1.0,
            first_frame_bytes: 2,
            ttq_1_ms: 3.0,
            settled_ms: 4.0,
            settled_bytes: 5,
            all_bytes: 6,
        };
        for (json, names) in [
            (
                serde_json::to_string(&[from]).unwrap(),
                &[
                    "map",
                    "way",
                    "distance_m",
                    "angles.3.flip",
                    "angles.3.shadowed_flip",
                    "angles.0.over_relief",
                ][..],
            ),
            (
                serde_json::to_string(&[sent]).unwrap(),
                &[
                    "faces",
                    "ttff_ms",
                    "first_frame_bytes",
                    "ttq_1_ms",
                    "settled_ms",
                    "settled_bytes",
                    "all_bytes",
                ],
            ),
        ] {
            let rows = crate::reproduce::Rows::from_json(&json).unwrap();
            for name in names {
                assert!(rows.columns.iter().any(|column| column == name), "{name}: {:?}", rows.columns);
            }
        }
    }
}
