//! Cost and error of ambient occlusion methods against ray casting, by number of samples and view.
//!
//! A viewer settles at each view. Rays against the triangles drawn there give each pixel's visibility
//! ([`lodestream_render::rays`]), with the same radius and falloff for all methods. Methods are drawn as the lighting
//! pass receives them, after their blur, at strength 1; their passes are timed by the device's clock.

use std::fmt;
use std::sync::Arc;

use anyhow::Context as _;
use image::{Rgba, RgbaImage};
use lodestream_protocol::source::SceneSource;
use lodestream_render::rays::RayHit;
use lodestream_render::{
    AmbientOcclusion, AntiAliasing, DebugView, Gpu, OcclusionMethod, OcclusionNormals, OcclusionRadius,
    PassId, STILL_FRAMES, Settings,
};
use lodestream_scenario::plan::Plan;
use lodestream_scenario::stopwatch::{median, rounded};
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;
use serde::Serialize;

use super::painter::{Painter, Studio};
use super::settled::settle_views;
use crate::image_error::flip;

/// Most rays per pixel.
pub const MAX_RAYS: u32 = 65_536;
/// Largest relative difference between a pixel's depth by ray and as drawn; beyond it the two hit different surfaces,
/// for example at an edge, and the pixel is not compared.
const SAME_DEPTH: f64 = 1e-3;

/// What to measure.
#[derive(Clone, Debug)]
pub struct Question {
    /// Cameras besides the scene's own.
    pub cameras: Vec<Camera>,
    /// Methods.
    pub methods: Vec<OcclusionMethod>,
    /// Samples per pixel, combined with each method.
    pub samples: Vec<u32>,
    /// Sources of normals, combined with each method and number of samples.
    pub normals: Vec<OcclusionNormals>,
    /// Whether single frames are also drawn at half resolution, except for layered methods.
    pub half: bool,
    /// Samples per pixel and frame for means over [`STILL_FRAMES`] still frames, for each method; 0: none.
    pub still: u32,
    /// Radius of occlusion.
    pub radius: OcclusionRadius,
    /// Rays per pixel.
    pub rays: u32,
    /// Timed frames of each, at least one.
    pub frames: u32,
}

/// Results of one method in one view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OcclusionError {
    /// Number of the view; 0 is the scene's own.
    pub view: usize,
    /// Name of the method, or `none`.
    pub method: String,
    /// Samples per pixel, over all frames of a mean.
    pub samples: u32,
    /// Source of its normals.
    pub normals: String,
    /// Whether it is estimated at half resolution.
    pub half: bool,
    /// Frames of the mean; 1 for a single frame.
    pub mean_of: u32,
    /// Width and height of the pictures, which are the plan's viewport.
    pub size_px: [u32; 2],
    /// The graphics adapter.
    pub adapter: String,
    /// Triangles that rays are cast against.
    pub triangles: usize,
    /// Share of pixels with a surface that are compared.
    pub judged: f64,
    /// Mean visibility of these pixels by rays.
    pub openness: f64,
    /// Mean difference of the drawn visibility from that by rays; below 0 is too dark.
    pub bias: f64,
    /// Root mean squared error of the visibility, 0 to 1.
    pub mse: f64,
    /// FLIP error of the visibilities as grey values; pixels that are not compared are equal in both.
    pub flip: f64,
    /// Median device time of the estimate, in milliseconds.
    pub estimate_ms: f64,
    /// The same including its blur.
    pub pass_ms: f64,
    /// The latter relative to that of the first method and number of samples in the view: the median over consecutive
    /// frames. For a mean it is that of one of its frames.
    pub over_first: f64,
}

/// Settles a viewer at each view and draws all methods with all numbers of samples.
///
/// # Errors
/// A plan with several cases or another technique; runs that do not settle or end early; errors of the graphics device.
pub fn occlusion_errors(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    question: &Question,
    mut keep: impl FnMut(&str, &RgbaImage) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<OcclusionError>> {
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let mut views = settle_views(plan, scene, &studio, &question.cameras)?;
    let mut errors = Vec::new();
    for (number, (painter, view)) in views.iter_mut().enumerate() {
        errors.extend(of_view(painter, view, (number, plan.viewport_px, &adapter), question, &mut keep)?);
    }
    Ok(errors)
}

/// A method with its settings.
#[derive(Clone, Copy, Debug)]
struct OcclusionVariant {
    method: OcclusionMethod,
    normals: OcclusionNormals,
    samples: u32,
    /// At half resolution.
    half: bool,
    /// A mean over frames, or a single frame.
    still: bool,
}

impl OcclusionVariant {
    /// All requested variants, single frames first.
    fn all(question: &Question) -> Vec<Self> {
        let counts = |half, still| question.samples.iter().map(move |samples| (*samples, half, still));
        let halves = counts(true, false).filter(|_| question.half);
        let means = Some((question.still, false, true)).filter(|(samples, ..)| *samples > 0);
        let mut all = Vec::new();
        for (samples, half, still) in counts(false, false).chain(halves).chain(means) {
            for &normals in &question.normals {
                let ways =
                    question.methods.iter().map(|&method| Self { method, normals, samples, half, still });
                all.extend(ways.filter(|way| !(half && way.method == OcclusionMethod::HbaoPlus)));
            }
        }
        all
    }

    fn settings(self, radius: OcclusionRadius) -> Settings {
        let Self { method, normals, samples, half, still } = self;
        let still = still.then_some(method);
        let occlusion = AmbientOcclusion { method, radius, strength: 1.0, samples, normals, half, still };
        Settings {
            debug_view: DebugView::Occlusion,
            occlusion: Some(occlusion),
            shadows: None,
            anti_aliasing: AntiAliasing::None,
            ..Settings::default()
        }
    }

    /// Frames of its mean; 1 for a single frame.
    fn mean_of(self) -> u32 {
        if self.still { STILL_FRAMES } else { 1 }
    }

    /// Name of its picture.
    fn name(self) -> String {
        let normals = match self.normals {
            normals if normals == OcclusionNormals::default() => String::new(),
            normals => format!("-{}", normals.name()),
        };
        let half = if self.half { "-half" } else { "" };
        format!("{}-{}{normals}{half}", self.method.name(), self.samples * self.mean_of())
    }
}

fn of_view(
    painter: &mut Painter<'_>,
    view: &View,
    (number, size_px, adapter): (usize, [u32; 2], &str),
    question: &Question,
    keep: &mut impl FnMut(&str, &RgbaImage) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<OcclusionError>> {
    let all = OcclusionVariant::all(question);
    let first = all.first().context("there is no method, or no number of samples")?;
    painter.frame(view, first.settings(question.radius))?;
    let (near, depth) = (Settings::default().near, painter.depth()?);
    let rays = painter.rays(view)?;
    let seen = rays.picture(size_px, question.radius, question.rays);
    let judged: Vec<bool> = depth
        .iter()
        .zip(&seen)
        .map(|(stored, seen)| {
            let alike = |seen: &RayHit| (f64::from(*stored) * seen.depth / near - 1.0).abs() < SAME_DEPTH;
            *stored > 0.0 && seen.as_ref().is_some_and(alike)
        })
        .collect();
    let surfaces = depth.iter().filter(|stored| **stored > 0.0).count().max(1);
    let count = judged.iter().filter(|judged| **judged).count();
    anyhow::ensure!(count > 0, "view {number}: no ray hits a drawn surface; choose another view");
    let truth: Vec<f64> = seen.iter().map(|seen| seen.map_or(1.0, |seen| seen.openness)).collect();
    keep(&format!("view-{number}-rays"), &grey(size_px, &truth))?;
    let mean = |of: &dyn Fn(usize) -> f64| {
        (0..truth.len()).filter(|i| judged[*i]).map(of).sum::<f64>() / count as f64
    };
    let openness = mean(&|i| truth[i]);

    let mut times = vec![[Vec::new(), Vec::new()]; all.len()];
    for _ in 0..question.frames.max(1) {
        for (way, times) in all.iter().zip(&mut times) {
            // The first frame of a mean is a single frame.
            let settings = way.settings(question.radius);
            let [estimate, blur] =
                painter.pass_ms(view, settings, [PassId::Occlusion, PassId::OcclusionBlur])?;
            times[0].push(estimate);
            times[1].push(estimate + blur);
        }
    }
    let reference = times[0][1].clone();
    let mut errors = Vec::new();
    for (way, [estimates, passes]) in all.into_iter().zip(times) {
        // The first frame after others is a single frame; those of the mean follow.
        for _ in 0..if way.still { 1 + STILL_FRAMES } else { 1 } {
            painter.frame(view, way.settings(question.radius))?;
        }
        let picture = painter.picture()?;
        keep(&format!("view-{number}-{}", way.name()), &picture)?;
        let drawn: Vec<f64> = picture
            .pixels()
            .zip(&judged)
            .zip(&truth)
            .map(|((pixel, judged), truth)| if *judged { f64::from(pixel[0]) / 255.0 } else { *truth })
            .collect();
        errors.push(OcclusionError {
            view: number,
            method: way.method.name().to_owned(),
            samples: way.samples * way.mean_of(),
            normals: way.normals.name().to_owned(),
            half: way.half,
            mean_of: way.mean_of(),
            size_px,
            adapter: adapter.to_owned(),
            triangles: rays.triangles(),
            judged: rounded(count as f64 / surfaces as f64, 4),
            openness: rounded(openness, 5),
            bias: rounded(mean(&|i| drawn[i] - truth[i]), 5),
            mse: rounded(mean(&|i| (drawn[i] - truth[i]).powi(2)), 7),
            flip: rounded(flip(&grey(size_px, &drawn), &grey(size_px, &truth)), 6),
            estimate_ms: rounded(median(estimates), 3),
            over_first: rounded(lodestream_scenario::stopwatch::paired_ratio(&passes, &reference), 3),
            pass_ms: rounded(median(passes), 3),
        });
    }
    Ok(errors)
}

/// Shares as grey values.
fn grey([width, height]: [u32; 2], shares: &[f64]) -> RgbaImage {
    let value = |share: f64| (share.clamp(0.0, 1.0) * 255.0).round() as u8;
    RgbaImage::from_fn(width, height, |x, y| {
        let value = value(shares[(y * width + x) as usize]);
        Rgba([value, value, value, 255])
    })
}

/// One line of text.
impl fmt::Display for OcclusionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "view {}, {:>12} {:>3}, {}{}: MSE {:.6}, bias {:+.4}, FLIP {:.4}, {:.2} ms ({:.2} without blur), {:.2} times the \
             first; open {:.3}, {:.1} % judged, {} triangles",
            self.view,
            self.method,
            self.samples,
            self.normals,
            if self.half { ", half" } else { "" },
            self.mse,
            self.bias,
            self.flip,
            self.pass_ms,
            self.estimate_ms,
            self.over_first,
            self.openness,
            100.0 * self.judged,
            self.triangles,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    /// In the small scene, a method of each family (point sampling, layers, horizons, bitmask) is nearer to rays than
    /// no occlusion, and rays hit what is drawn. The renderer's tests (`occlusion_rays`) compare every method with
    /// rays.
    #[test]
    fn methods_are_nearer_to_rays_than_no_occlusion() {
        use OcclusionMethod::{Bitmask, Gtao, HbaoPlus, Ssao};
        const METHODS: [OcclusionMethod; 4] = [Ssao, HbaoPlus, Gtao, Bitmask];
        let Some((plan, gpu)) = plan_and_device("[160, 90]") else { return };
        let question = Question {
            cameras: Vec::new(),
            methods: METHODS.to_vec(),
            samples: vec![16],
            normals: vec![OcclusionNormals::default()],
            half: false,
            still: 16,
            radius: OcclusionRadius::Depth(0.06),
            rays: 64,
            frames: 1,
        };
        let mut kept = Vec::new();
        let errors = occlusion_errors(&plan, &small_scene(), gpu, &question, |name, picture| {
            kept.push((name.to_owned(), picture.clone()));
            Ok(())
        })
        .unwrap();
        let methods = METHODS.len();
        assert_eq!((errors.len(), kept.len()), (2 * methods, 2 * methods + 1));
        let (alone, means) = errors.split_at(methods);
        for (alone, mean) in alone.iter().zip(means) {
            assert_eq!((alone.samples, mean.samples, mean.mean_of), (16, 256, 16));
            assert!(mean.mse < alone.mse, "{alone}; {mean}");
        }
        let truth: Vec<f64> = kept[0].1.pixels().map(|pixel| 1.0 - f64::from(pixel[0]) / 255.0).collect();
        // Over surfaces only: the sky is white, and the mean occlusion tells the share of surfaces in the picture.
        let surfaces = truth.iter().sum::<f64>() / (1.0 - errors[0].openness);
        let none = truth.iter().map(|hidden| hidden * hidden).sum::<f64>() / surfaces;
        for error in &errors {
            println!("{error}");
            assert!(error.judged > 0.95 && error.openness < 0.99, "{error}");
            assert!(error.mse < none, "{error}; none: {none}");
        }
        let rows = crate::reproduce::Rows::from_json(&serde_json::to_string(&errors).unwrap()).unwrap();
        for name in
            ["view", "method", "samples", "mse", "bias", "flip", "estimate_ms", "pass_ms", "over_first"]
        {
            assert!(rows.columns.iter().any(|column| column == name), "{name}: {:?}", rows.columns);
        }
    }
}
