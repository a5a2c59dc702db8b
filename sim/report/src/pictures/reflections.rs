//! Hit rate and cost of screen-space reflection searches against ray casting.
//!
//! A viewer settles at each view. Each pixel is treated as a mirror: a ray along the mirrored direction against the
//! drawn triangles tells what it would show, and whether the picture shows that place too. The searches are those of
//! the shader's CPU reference, on the device's depths.

use std::fmt;
use std::sync::Arc;

use anyhow::Context as _;
use glam::DVec3;
use lodestream_protocol::source::SceneSource;
use lodestream_render::cpu_reference::depth::{project, view_ray};
use lodestream_render::cpu_reference::reflections::{End, Mirror, Pyramid, Tracing};
use lodestream_render::cpu_reference::surface::DepthPicture;
use lodestream_render::rays::Rays;
use lodestream_render::{
    AntiAliasing, Gpu, PassId, REFLECTION_LEVELS, ReflectionMethod, Reflections, Settings,
};
use lodestream_scenario::plan::Plan;
use lodestream_scenario::stopwatch::{median, rounded};
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;
use serde::Serialize;

use super::painter::{Painter, Studio};
use super::settled::settle_views;

/// Largest relative difference between a pixel's depth by ray and as drawn for which the pixel is compared, and between
/// the depth of a mirror image and the picture's there for which it counts as visible.
const SAME_DEPTH: f64 = 1e-3;
const SHOWN_DEPTH: f64 = 5e-3;
/// Tolerance of a hit, in pixels.
const NEAR_PX: i64 = 2;
/// Offset of a ray's start, relative to the depth.
const BEGIN: f64 = 1e-5;

/// What to measure.
#[derive(Clone, Debug)]
pub struct Question {
    /// Cameras besides the scene's own.
    pub cameras: Vec<Camera>,
    /// Searches.
    pub searches: Vec<Reflections>,
    /// Thicknesses of surfaces, relative to their depth, combined with each search.
    pub thicknesses: Vec<f64>,
    /// Timed frames of each search, at least one.
    pub frames: u32,
}

/// Results of one search in one view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ReflectionError {
    /// Number of the view; 0 is the scene's own.
    pub view: usize,
    /// Name of the search.
    pub method: String,
    /// Most steps of a ray.
    pub steps: u32,
    /// Thickness of surfaces, relative to their depth.
    pub thickness: f64,
    /// Width and height of the pictures, which are the plan's viewport.
    pub size_px: [u32; 2],
    /// The graphics adapter.
    pub adapter: String,
    /// Number of compared pixels.
    pub pixels: usize,
    /// Share of them whose mirror image is visible in the picture.
    pub shown: f64,
    /// Of those: found within two pixels.
    pub found: f64,
    /// Of those: found at another place.
    pub elsewhere: f64,
    /// Of those: ended by the step limit.
    pub mid_air: f64,
    /// Of those: missed.
    pub missed: f64,
    /// Share of the other pixels (mirrored sky or invisible places) for which something is found.
    pub false_hits: f64,
    /// Mean depth lookups per ray.
    pub lookups: f64,
    /// Median device time of the passes in the original scene, which has few smooth surfaces, in milliseconds.
    pub pass_ms: f64,
}

/// Settles a viewer at each view and traces all rays with all searches.
///
/// # Errors
/// A plan with several cases or another technique; runs that do not settle or end early; errors of the graphics device.
pub fn reflection_errors(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    question: &Question,
) -> anyhow::Result<Vec<ReflectionError>> {
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let mut views = settle_views(plan, scene, &studio, &question.cameras)?;
    let mut errors = Vec::new();
    for (number, (painter, view)) in views.iter_mut().enumerate() {
        errors.extend(of_view(painter, view, (number, plan.viewport_px, &adapter), question)?);
    }
    Ok(errors)
}

/// A pixel as a mirror.
struct Mirrored {
    place: [f64; 3],
    normal: [f64; 3],
    direction: [f64; 3],
    /// Where the picture shows the mirror image, if it does.
    shown_at: Option<[i64; 2]>,
}

fn of_view(
    painter: &mut Painter<'_>,
    view: &View,
    (number, size_px, adapter): (usize, [u32; 2], &str),
    question: &Question,
) -> anyhow::Result<Vec<ReflectionError>> {
    let bare =
        Settings { occlusion: None, shadows: None, anti_aliasing: AntiAliasing::None, ..Settings::default() };
    painter.frame(view, bare)?;
    let (stored, rays) = (painter.depth()?, painter.rays(view)?);
    let tan = view.pose().tan_half_fov(size_px[0], size_px[1]);
    let picture = DepthPicture { stored: &stored, size_px, tan_half_fov: tan.into(), near: bare.near };
    let pixels = mirrors(&picture, &rays, view);
    anyhow::ensure!(!pixels.is_empty(), "view {number}: no ray hits a drawn surface; choose another view");
    let pyramid = Pyramid::new(&picture, REFLECTION_LEVELS);
    let mirror = Mirror { picture, pyramid: &pyramid };
    let mut errors = Vec::new();
    for search in &question.searches {
        let mut times = Vec::new();
        for _ in 0..question.frames.max(1) {
            let settings = Settings { reflections: Some(*search), ..bare };
            let both = painter.pass_ms(view, settings, [PassId::DepthPyramid, PassId::Reflections])?;
            times.push(both.iter().sum());
        }
        let pass_ms = rounded(median(times), 3);
        for &thickness in &question.thicknesses {
            let by_cells = search.method == ReflectionMethod::HiZ;
            let tracing = Tracing { by_cells, steps: search.steps, thickness };
            let count = Count::of(&mirror, &tracing, &pixels);
            let share = |part: usize, all: usize| rounded(part as f64 / all.max(1) as f64, 4);
            let other = pixels.len() - count.shown;
            errors.push(ReflectionError {
                view: number,
                method: search.method.name().to_owned(),
                steps: search.steps,
                thickness,
                size_px,
                adapter: adapter.to_owned(),
                pixels: pixels.len(),
                shown: share(count.shown, pixels.len()),
                found: share(count.found, count.shown),
                elsewhere: share(count.elsewhere, count.shown),
                mid_air: share(count.mid_air, count.shown),
                missed: share(count.missed, count.shown),
                false_hits: share(count.false_hits, other),
                lookups: rounded(count.lookups as f64 / pixels.len() as f64, 2),
                pass_ms,
            });
        }
    }
    Ok(errors)
}

/// All pixels whose triangle a ray hits as it was drawn.
fn mirrors(picture: &DepthPicture<'_>, rays: &Rays, view: &View) -> Vec<Mirrored> {
    let [width, height] = picture.size_px;
    let turn = view.pose().rotation;
    let mut all = Vec::new();
    for pixel in (0..height).flat_map(|y| (0..width).map(move |x| [x, y].map(i64::from))) {
        let depth = picture.depth_at(pixel);
        let ray = turn * DVec3::from(view_ray(pixel, picture.size_px, picture.tan_half_fov));
        let Some(seen) = rays.first_hit(DVec3::ZERO, ray, 0.0) else { continue };
        if (depth / seen - 1.0).abs() >= SAME_DEPTH {
            continue;
        }
        let place = picture.position_at(pixel);
        let normal = DVec3::from(picture.normal_at(pixel, place));
        let to_eye = -DVec3::from(place).normalize();
        let direction = 2.0 * to_eye.dot(normal) * normal - to_eye;
        let (from, towards) = (turn * DVec3::from(place), turn * direction);
        let hit = rays.first_hit(from, towards, BEGIN * depth);
        let shown_at = hit.and_then(|length| {
            let met = DVec3::from(place) + direction * length;
            if met.z >= 0.0 {
                return None;
            }
            let (ndc, _) = project(met.into(), picture.tan_half_fov, picture.near);
            let [x, y] = [(ndc[0] * 0.5 + 0.5) * f64::from(width), (0.5 - ndc[1] * 0.5) * f64::from(height)];
            let at = [x, y].map(|c| c.floor() as i64);
            let inside = (0..i64::from(width)).contains(&at[0]) && (0..i64::from(height)).contains(&at[1]);
            // The nearest of the neighbourhood: on a slope, depths differ by more between pixels.
            let near = |dx, dy| (picture.depth_at([at[0] + dx, at[1] + dy]) / -met.z - 1.0).abs();
            let as_far = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| near(dx, dy))).fold(1.0, f64::min);
            (inside && as_far < SHOWN_DEPTH).then_some(at)
        });
        all.push(Mirrored { place, normal: normal.into(), direction: direction.into(), shown_at });
    }
    all
}

/// Counts of how searches ended.
#[derive(Default)]
struct Count {
    shown: usize,
    found: usize,
    elsewhere: usize,
    mid_air: usize,
    missed: usize,
    false_hits: usize,
    lookups: u64,
}

impl Count {
    fn of(mirror: &Mirror<'_>, tracing: &Tracing, pixels: &[Mirrored]) -> Self {
        let mut count = Self::default();
        for pixel in pixels {
            let traced = mirror.trace(tracing, pixel.place, pixel.normal, pixel.direction);
            count.lookups += u64::from(traced.lookups);
            let Some(want) = pixel.shown_at else {
                count.false_hits += usize::from(matches!(traced.end, End::Met(_)));
                continue;
            };
            count.shown += 1;
            match traced.end {
                End::Met(at) if (0..2).all(|i| (at[i] - want[i]).abs() <= NEAR_PX) => count.found += 1,
                End::Met(_) => count.elsewhere += 1,
                End::MidAir => count.mid_air += 1,
                End::Left | End::Below => count.missed += 1,
            }
        }
        count
    }
}

/// One line of text.
impl fmt::Display for ReflectionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |share: f64| 100.0 * share;
        write!(
            f,
            "view {}, {:>6} {:>4}, {} thick: of {:.1} % that the picture shows {:.1} % found, {:.1} elsewhere, {:.1} in \
             mid-air, {:.1} missed; of the others {:.1} % false; {:.1} lookups; {:.2} ms",
            self.view,
            self.method,
            self.steps,
            self.thickness,
            percent(self.shown),
            percent(self.found),
            percent(self.elsewhere),
            percent(self.mid_air),
            percent(self.missed),
            percent(self.false_hits),
            self.lookups,
            self.pass_ms,
        )
    }
}

/// Parses a search such as `linear:150`.
///
/// # Errors
/// An unknown name or an invalid number of steps.
pub fn search(text: &str) -> anyhow::Result<Reflections> {
    let (name, steps) = text.split_once(':').context("write a search and its steps, as hi-z:100")?;
    let method = ReflectionMethod::ALL.into_iter().find(|method| method.name() == name);
    let method = method.context("there are linear and hi-z")?;
    let steps =
        steps.parse().ok().filter(|steps| (1..=lodestream_render::MAX_REFLECTION_STEPS).contains(steps));
    Ok(Reflections { method, steps: steps.context("steps are a number from 1 to 4096")? })
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    #[test]
    fn searches_have_names_and_steps() {
        assert_eq!(
            search("linear:150").unwrap(),
            Reflections { method: ReflectionMethod::Linear, steps: 150 }
        );
        for wrong in ["", "linear", "hi-z:0", "hi-z:4097", "hi-z:-1", "cones:3"] {
            assert!(search(wrong).is_err(), "{wrong}");
        }
    }

    /// In the small scene, more steps find more, and a depth pyramid finds as much with fewer lookups.
    #[test]
    fn searches_find_most_of_what_mirrors_would_show() {
        let Some((plan, gpu)) = plan_and_device("[160, 90]") else { return };
        let searches = ["linear:10", "linear:1000", "hi-z:10", "hi-z:400"].map(|name| search(name).unwrap());
        let question =
            Question { cameras: Vec::new(), searches: searches.to_vec(), thicknesses: vec![0.02], frames: 1 };
        let errors = reflection_errors(&plan, &small_scene(), gpu, &question).unwrap();
        errors.iter().for_each(|error| println!("{error}"));
        let [few, many, few_cells, cells] = &errors[..] else { panic!("{errors:?}") };
        for error in &errors {
            let all = error.found + error.elsewhere + error.mid_air + error.missed;
            assert!((all - 1.0).abs() < 1e-3 && error.pixels > 3000 && error.shown > 0.01, "{error}");
        }
        assert!(many.found > 0.6 && many.found > few.found && few.mid_air > many.mid_air);
        assert!(cells.found > few_cells.found && cells.found > 0.95 * many.found);
        assert!(cells.lookups < many.lookups && many.mid_air == 0.0);
        let rows = crate::reproduce::Rows::from_json(&serde_json::to_string(&errors).unwrap()).unwrap();
        for name in ["view", "method", "steps", "thickness", "found", "mid_air", "false_hits", "lookups"] {
            assert!(rows.columns.iter().any(|column| column == name), "{name}: {:?}", rows.columns);
        }
    }
}
