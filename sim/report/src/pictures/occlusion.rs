//! What methods of ambient occlusion cost and how far they are from rays, for numbers of samples and views.
//!
//! A viewer settles at each view. Rays against the triangles that it draws there give how open each pixel is
//! ([`lodestream_render::rays`]); the same radius and falloff hold for all. Methods are drawn as they are handed on to the
//! light, after their blur, at strength 1, and their passes timed by the device's clock.

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

/// Most rays a pixel.
pub const MAX_RAYS: u32 = 65_536;
/// A pixel is judged where its ray's depth and the drawn one are as near as this, as a share: else they see different
/// things, as where an edge passes through its middle.
const SAME_DEPTH: f64 = 1e-3;

/// What is drawn.
#[derive(Clone, Debug)]
pub struct Question {
    /// Cameras beside the scene's own.
    pub cameras: Vec<Camera>,
    /// Methods.
    pub methods: Vec<OcclusionMethod>,
    /// Samples a pixel, each with each method.
    pub samples: Vec<u32>,
    /// What normals are taken from, each with each method and number of samples.
    pub normals: Vec<OcclusionNormals>,
    /// Whether those that stand alone are drawn of one pixel of each 2×2 too, but for those in layers, which stay whole.
    pub half: bool,
    /// Samples a pixel and frame of means over [`STILL_FRAMES`] frames in which nothing changes, of each method; 0: none.
    pub still: u32,
    /// Reach of occlusion.
    pub radius: OcclusionRadius,
    /// Rays a pixel.
    pub rays: u32,
    /// Frames that are timed of each, at least one.
    pub frames: u32,
}

/// One method in one view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct OcclusionError {
    /// Number of the view; 0 is the scene's own.
    pub view: usize,
    /// Name of the method, or `none`.
    pub method: String,
    /// Samples a pixel, over all frames of a mean.
    pub samples: u32,
    /// What its normals are taken from.
    pub normals: String,
    /// Whether one pixel of each 2×2 is estimated.
    pub half: bool,
    /// Frames of the mean; 1 where each frame stands alone.
    pub mean_of: u32,
    /// Width and height of the pictures, which are the plan's viewport.
    pub size_px: [u32; 2],
    /// The graphics adapter.
    pub adapter: String,
    /// Triangles that rays are cast at.
    pub triangles: usize,
    /// Share of pixels with a surface that are judged.
    pub judged: f64,
    /// How open those are by rays, in the mean.
    pub openness: f64,
    /// How open they are drawn, less that by rays, in the mean: below 0 is too dark.
    pub bias: f64,
    /// Mean squared error of how open they are, 0 to 1.
    pub mse: f64,
    /// FLIP of the pictures of both, shown as grey values; those that are not judged are alike.
    pub flip: f64,
    /// Median time of the estimate, then with its blur, in milliseconds of the device.
    pub estimate_ms: f64,
    /// See there.
    pub pass_ms: f64,
    /// The latter over that of the first method and number of samples in the view: the median over frames drawn one after
    /// the other. Of a mean it is that of one of its frames.
    pub over_first: f64,
}

/// Settles a viewer at each view and draws all methods with all numbers of samples.
///
/// # Errors
/// A plan of more than one case, or of another technique; runs that do not settle; whatever ends a run early, and what
/// the graphics device refuses.
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

/// How a view is drawn.
#[derive(Clone, Copy, Debug)]
struct OcclusionVariant {
    method: OcclusionMethod,
    normals: OcclusionNormals,
    samples: u32,
    /// Of one pixel of each 2×2.
    half: bool,
    /// In a mean of frames, or in such as stand alone.
    still: bool,
}

impl OcclusionVariant {
    /// All that are asked for: those that stand alone first.
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

    /// Frames of its mean.
    fn mean_of(self) -> u32 {
        if self.still { STILL_FRAMES } else { 1 }
    }

    /// Of a picture.
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
    anyhow::ensure!(count > 0, "view {number}: rays see nothing of what is drawn");
    let truth: Vec<f64> = seen.iter().map(|seen| seen.map_or(1.0, |seen| seen.openness)).collect();
    keep(&format!("view-{number}-rays"), &grey(size_px, &truth))?;
    let mean = |of: &dyn Fn(usize) -> f64| {
        (0..truth.len()).filter(|i| judged[*i]).map(of).sum::<f64>() / count as f64
    };
    let openness = mean(&|i| truth[i]);

    let mut times = vec![[Vec::new(), Vec::new()]; all.len()];
    for _ in 0..question.frames.max(1) {
        for (way, times) in all.iter().zip(&mut times) {
            // The first frame of a mean stands alone.
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
        // The first frame after others stands alone; then come those of a mean.
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

/// A line for people.
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
    use std::path::Path;

    use super::super::open_device;
    use super::super::tests::may_draw;
    use super::*;
    use crate::tests::small_scene;
    use lodestream_scenario::plan;

    /// On the small scene, whatever the method: nearer to rays than no occlusion at all, and rays see what is drawn.
    #[test]
    fn every_method_is_nearer_to_rays_than_none() {
        if !may_draw() {
            return;
        }
        let text = "scene = \"demo-small\"\nviewport_px = [160, 90]\n[[sweep]]\ntransport = \"quic\"\n\
                    rate_bits_per_s = 16_000_000\nrtt_ms = 50\n";
        let plan = plan::parse(text, Path::new("test.toml")).unwrap();
        let gpu = open_device().expect("a graphics adapter (or LODESTREAM_SKIP_GPU=1)");
        let question = Question {
            cameras: Vec::new(),
            methods: OcclusionMethod::ALL.to_vec(),
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
        let methods = OcclusionMethod::ALL.len();
        assert_eq!((errors.len(), kept.len()), (2 * methods, 2 * methods + 1));
        let (alone, means) = errors.split_at(methods);
        for (alone, mean) in alone.iter().zip(means) {
            assert_eq!((alone.samples, mean.samples, mean.mean_of), (16, 256, 16));
            assert!(mean.mse < alone.mse, "{alone}; {mean}");
        }
        let truth: Vec<f64> = kept[0].1.pixels().map(|pixel| 1.0 - f64::from(pixel[0]) / 255.0).collect();
        // Of surfaces, as the others: the sky is white, and what is hidden in the mean says how much of the picture it is.
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
