//! Cost and benefit of a renderer setting: frame time and picture error for each of its values.
//!
//! The settled scene is the same for all values; the picture of the last value, the best, is the reference.

use std::fmt;
use std::sync::Arc;

use anyhow::Context as _;
use image::RgbaImage;
use lodestream_protocol::source::SceneSource;
use lodestream_render::{AmbientOcclusion, AntiAliasing, Counters, Gpu, ReliefMethod, Settings, Shadows};
use lodestream_scenario::picture::ImageError;
use lodestream_scenario::plan::{ClientSettings, Plan};
use lodestream_scenario::stopwatch::{Spread, median, paired_ratio, rounded};
use lodestream_scene::view::View;
use lodestream_viewing::{STEPS, Step};
use serde::Serialize;

use super::painter::Studio;
use super::settled::{by_turns, settle};
use crate::image_error::image_error;

/// A setting and its values, the best one last.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// Linear steps of relief mapping at grazing angles; 0 turns it off.
    ReliefSteps(Vec<u32>),
    /// Methods of relief mapping: 0 for none, then [`ReliefMethod::ALL`] by number.
    ReliefMethods(Vec<u32>),
    /// Samples of ambient occlusion; 0 turns it off.
    OcclusionSamples(Vec<u32>),
    /// Texels along a side of the shadow maps, which each frame redraws; 0 turns shadows off.
    ShadowSides(Vec<u32>),
    /// Bilinear shadow lookups along a side, with maps that stay unchanged; 0 turns shadows off.
    ShadowFilters(Vec<u32>),
    /// Anti-aliasing: [`AntiAliasing::ALL`] by number.
    SmoothEdges(Vec<u32>),
    /// Screen error of the terrain, in pixels.
    GroundPx(Vec<f32>),
    /// Steps of quality while the camera moves: [`STEPS`] by number, the last for larger numbers.
    QualitySteps(Vec<u32>),
}

/// Timed frames with one value.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DrawTime {
    /// The value; 0 if the feature is off.
    pub value: f32,
    /// Width and height of the frames, which are the plan's viewport.
    pub size_px: [u32; 2],
    /// The graphics adapter.
    pub adapter: String,
    /// Triangles submitted per frame, including every instance and unused slots.
    pub triangles: u64,
    /// Those of the terrain.
    pub ground_triangles: u64,
    /// Triangles drawn into shadow maps that changed; not included in the others.
    pub shadow_triangles: u64,
    /// Screen error of the terrain; `None` without terrain.
    pub ground_px: Option<f64>,
    /// Frames that were timed.
    pub frames: u32,
    /// Median time, in milliseconds.
    pub median_ms: f64,
    /// Least, mean and greatest time.
    #[serde(flatten)]
    pub spread: Spread,
    /// Time relative to the last value: the median over consecutive frames.
    pub over_best: f64,
    /// Error of the picture against that with the last value.
    #[serde(flatten)]
    pub error: ImageError,
}

impl Setting {
    fn values(&self) -> Vec<f32> {
        match self {
            Self::ReliefSteps(counts)
            | Self::ReliefMethods(counts)
            | Self::OcclusionSamples(counts)
            | Self::ShadowSides(counts)
            | Self::ShadowFilters(counts)
            | Self::SmoothEdges(counts)
            | Self::QualitySteps(counts) => counts.iter().map(|&count| count as f32).collect(),
            Self::GroundPx(px) => px.clone(),
        }
    }

    /// Renderer settings for a value.
    fn frame(&self, number: usize, view: View) -> (View, Settings) {
        let defaults = Settings::default();
        match self {
            Self::ReliefSteps(steps) => {
                let relief_steps = steps[number];
                (view, Settings { relief: relief_steps > 0, relief_steps, ..defaults })
            }
            Self::ReliefMethods(ways) => match ways[number].checked_sub(1) {
                None => (view, Settings { relief: false, ..defaults }),
                Some(way) => {
                    let known = ReliefMethod::ALL.get(way as usize).copied();
                    (view, Settings { relief_method: known.unwrap_or_default(), ..defaults })
                }
            },
            Self::OcclusionSamples(samples) => {
                let samples = samples[number];
                let some = AmbientOcclusion { samples, ..AmbientOcclusion::default() };
                (view, Settings { occlusion: (samples > 0).then_some(some), ..defaults })
            }
            Self::ShadowSides(sides) => {
                let some = Shadows { map_side: sides[number], ..Shadows::default() };
                (view, Settings { shadows: (sides[number] > 0).then_some(some), ..defaults })
            }
            Self::ShadowFilters(filters) => {
                let some = Shadows { filter: filters[number], ..Shadows::default() };
                (view, Settings { shadows: (filters[number] > 0).then_some(some), ..defaults })
            }
            Self::SmoothEdges(smooth) => {
                (view, Settings { anti_aliasing: smoothing(smooth[number]), ..defaults })
            }
            Self::GroundPx(px) => (View { target_px: px[number], ..view }, defaults),
            Self::QualitySteps(steps) => {
                let step = quality_step(steps[number]);
                // The scene was settled with the step's error of meshes.
                let target_px = view.target_px / step.meshes * step.ground;
                (View { target_px, ..view }, step.limit(&defaults))
            }
        }
    }

    /// Clients of the scenes on the graphics device, one per value for the terrain's error, so that tiles do not evict each
    /// other, and for that of meshes.
    fn clients(&self, client: ClientSettings) -> Vec<ClientSettings> {
        match self {
            Self::GroundPx(px) => vec![client; px.len()],
            Self::QualitySteps(steps) => {
                let coarser = |&step: &u32| client.target_px * quality_step(step).meshes;
                steps.iter().map(|step| ClientSettings { target_px: coarser(step), ..client }).collect()
            }
            _ => vec![client],
        }
    }
}

fn quality_step(number: u32) -> Step {
    STEPS[(number as usize).min(STEPS.len() - 1)]
}

/// The entry of [`AntiAliasing::ALL`]; the last for larger numbers.
fn smoothing(number: u32) -> AntiAliasing {
    AntiAliasing::ALL.get(number as usize).copied().unwrap_or(AntiAliasing::Temporal)
}

/// The results of a frame with one value.
#[derive(Clone, Debug, Default)]
struct Drawn {
    counters: Counters,
    ground_px: Option<f64>,
    picture: RgbaImage,
}

/// Settles the plan's case and times `frames` frames (at least one) with each value.
///
/// # Errors
/// A setting without values; a plan with several cases or another technique; runs that do not settle or end early;
/// errors of the graphics device.
pub fn draw_trade(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    setting: &Setting,
    frames: u32,
) -> anyhow::Result<Vec<DrawTime>> {
    let values = setting.values();
    let best = values.len().checked_sub(1).context("there are no values to draw with")?;
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let mut settled = settle(plan, scene, &studio, setting.clients(plan.client))?;
    let scenes = settled.len();
    let seconds = by_turns(values.len(), frames, |number| {
        let one = &mut settled[number % scenes];
        let (view, settings) = setting.frame(number, one.view);
        one.painter.frame(&view, settings).map(|_| ())
    })?;
    // Once more, since scenes are shared, for the readback.
    let draw = |number: usize| {
        let one = &mut settled[number % scenes];
        let (view, settings) = setting.frame(number, one.view);
        let counters = one.painter.frame(&view, settings)?;
        anyhow::Ok(Drawn { counters, ground_px: one.painter.ground_px(), picture: one.painter.picture()? })
    };
    let drawn = (0..values.len()).map(draw).collect::<anyhow::Result<Vec<_>>>()?;
    let draw_time = |number: usize| {
        let Drawn { counters, ground_px, picture } = &drawn[number];
        let seconds_best = &seconds[best];
        Ok(DrawTime {
            value: values[number],
            size_px: plan.viewport_px,
            adapter: adapter.clone(),
            triangles: counters.triangles,
            ground_triangles: counters.terrain_triangles,
            shadow_triangles: counters.shadow_triangles,
            ground_px: ground_px.map(|px| rounded(px, 3)),
            frames: frames.max(1),
            median_ms: rounded(median(seconds[number].clone()) * 1e3, 4),
            spread: Spread::of(&seconds[number]),
            over_best: rounded(paired_ratio(&seconds[number], seconds_best), 3),
            error: image_error(picture, &drawn[best].picture)?,
        })
    };
    (0..values.len()).map(draw_time).collect()
}

/// One line of text.
impl fmt::Display for DrawTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size_px;
        let ImageError { psnr_db, ssim, flip } = self.error;
        write!(
            f,
            "{}: {} triangles, {} of ground, {} into shadow maps, {width} x {height} on {}: median of {} frames {:.1} ms ({:.1} to {:.1}), \
             {:.2} times that of the last; PSNR {} dB, SSIM {ssim}, FLIP {flip}",
            self.value,
            self.triangles,
            self.ground_triangles,
            self.shadow_triangles,
            self.adapter,
            self.frames,
            self.median_ms,
            self.spread.min_ms,
            self.spread.max_ms,
            self.over_best,
            psnr_db.map_or("–".to_owned(), |db| db.to_string()),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    /// The default value draws what [`Settings::default`] draws.
    #[test]
    fn a_value_changes_only_its_setting() {
        let defaults = Settings::default();
        let view = View {
            eye: [0.0; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
            fov_y: 1.0,
            viewport_px: [320, 180],
            target_px: 1.0,
        };
        let steps = Setting::ReliefSteps(vec![0, defaults.relief_steps]);
        assert_eq!(steps.frame(1, view), (view, defaults));
        assert!(!steps.frame(0, view).1.relief);
        let samples = Setting::OcclusionSamples(vec![0, AmbientOcclusion::default().samples]);
        assert_eq!(samples.frame(1, view), (view, defaults));
        assert_eq!(samples.frame(0, view).1, Settings { occlusion: None, ..defaults });
        let sides = Setting::ShadowSides(vec![0, Shadows::default().map_side]);
        assert_eq!(sides.frame(1, view), (view, defaults));
        assert_eq!(sides.frame(0, view).1, Settings { shadows: None, ..defaults });
        let filters = Setting::ShadowFilters(vec![0, Shadows::default().filter]);
        assert_eq!(filters.frame(1, view), (view, defaults));
        assert_eq!(filters.frame(0, view).1, Settings { shadows: None, ..defaults });
        let edges = Setting::SmoothEdges(vec![0, 1]);
        assert_eq!(edges.frame(1, view), (view, defaults));
        assert_eq!(edges.frame(0, view).1, Settings { anti_aliasing: AntiAliasing::None, ..defaults });
        let ground = Setting::GroundPx(vec![4.0, 1.0]);
        assert_eq!(ground.frame(0, view), (View { target_px: 4.0, ..view }, defaults));
        let client = ClientSettings::to(1.0);
        let scenes = |setting: &Setting| setting.clients(client).len();
        assert_eq!((ground.values(), scenes(&ground), scenes(&steps)), (vec![4.0, 1.0], 2, 1));
        let of_steps = Setting::QualitySteps(vec![9, 0]);
        assert_eq!(of_steps.frame(1, view), (view, defaults));
        assert_eq!(of_steps.frame(0, View { target_px: 4.0, ..view }).0.target_px, 16.0);
        let px: Vec<f32> = of_steps.clients(client).iter().map(|client| client.target_px).collect();
        assert_eq!(px, [4.0 * client.target_px, client.target_px]);
    }

    /// Names that `docs/report/sections.toml` refers to.
    #[test]
    fn figures_have_the_names_that_sections_use() {
        let time = DrawTime {
            value: 16.0,
            size_px: [2, 1],
            adapter: "none".to_owned(),
            triangles: 5,
            ground_triangles: 3,
            shadow_triangles: 2,
            ground_px: None,
            frames: 1,
            median_ms: 2.0,
            spread: Spread { min_ms: 1.0, mean_ms: 2.0, max_ms: 3.0 },
            over_best: 1.0,
            error: ImageError { psnr_db: None, ssim: 1.0, flip: 0.0 },
        };
        let rows = crate::reproduce::Rows::from_json(&serde_json::to_string(&[time]).unwrap()).unwrap();
        for name in [
            "value",
            "triangles",
            "ground_triangles",
            "shadow_triangles",
            "ground_px",
            "median_ms",
            "min_ms",
            "max_ms",
            "over_best",
            "psnr_db",
            "ssim",
            "flip",
        ] {
            assert!(rows.columns.iter().any(|column| column == name), "{name}: {:?}", rows.columns);
        }
    }

    #[test]
    fn picture_errors_fall_towards_the_best_value() {
        let Some((plan, gpu)) = plan_and_device("[320, 180]") else { return };
        let of_setting = |setting: &Setting| draw_trade(&plan, &small_scene(), gpu.clone(), setting, 1);
        assert!(of_setting(&Setting::GroundPx(Vec::new())).is_err());
        for setting in [
            Setting::ReliefSteps(vec![0, 24, 192]),
            Setting::ShadowSides(vec![0, 256, 2048]),
            Setting::GroundPx(vec![32.0, 4.0, 1.0]),
            Setting::QualitySteps(vec![9, 3, 0]),
        ] {
            let times = of_setting(&setting).unwrap();
            let [worst, better, best] = &times[..] else { panic!("{times:?}") };
            assert_eq!(
                (best.error, best.over_best),
                (ImageError { psnr_db: None, ssim: 1.0, flip: 0.0 }, 1.0)
            );
            assert!(worst.error.flip > better.error.flip && better.error.flip > 0.0, "{times:?}");
            assert!(worst.error.psnr_db < better.error.psnr_db, "{times:?}");
            let is_terrain = matches!(setting, Setting::GroundPx(_) | Setting::QualitySteps(_));
            assert_eq!(worst.ground_triangles < best.ground_triangles, is_terrain, "{times:?}");
        }
    }
}
