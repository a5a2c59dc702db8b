//! Frame time of ink: without, with all of it, and with its parts, for settled views.

use std::fmt;
use std::sync::Arc;

use image::RgbaImage;
use lodestream_protocol::source::SceneSource;
use lodestream_render::{Gpu, Ink, Settings};
use lodestream_scenario::plan::Plan;
use lodestream_scenario::stopwatch::{median, paired_ratio, rounded};
use lodestream_scene::description::Camera;
use serde::Serialize;

use super::painter::Studio;
use super::settled::{by_turns, settle_views};

/// The variants, drawn in turn: after a frame without ink, edges are searched anew; after others they are known.
const WAYS: [&str; 5] = ["none", "first frame", "strokes and levels", "strokes", "levels"];

/// One variant at one view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InkCost {
    /// Number of the view; 0 is the scene's own.
    pub view: usize,
    /// The variant.
    pub way: &'static str,
    /// Width and height of the frames.
    pub size_px: [u32; 2],
    /// The graphics adapter.
    pub adapter: String,
    /// Triangles of meshes that the frame draws.
    pub triangles: u64,
    /// Median frame time, in milliseconds.
    pub frame_ms: f64,
    /// Frame time relative to that without ink: the median over consecutive frames.
    pub over_none: f64,
}

fn settings(way: &str) -> Settings {
    let usual = Ink::default();
    let ink = match way {
        "none" => None,
        "strokes" => Some(Ink { levels: 1, ..usual }),
        "levels" => Some(Ink { width_px: 0.0, ..usual }),
        _ => Some(usual),
    };
    Settings { ink, ..Settings::default() }
}

/// Settles the plan's case at the scene's own view and at those of more cameras, and times `frames` frames of each
/// variant. `keep` receives pictures with their names.
///
/// # Errors
/// A plan with several cases or another technique; runs that do not settle or end early; errors of the graphics device
/// and of `keep`.
pub fn ink_cost(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    cameras: &[Camera],
    frames: u32,
    mut keep: impl FnMut(&str, &RgbaImage) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<InkCost>> {
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let mut rows = Vec::new();
    for (number, (painter, view)) in settle_views(plan, scene, &studio, cameras)?.iter_mut().enumerate() {
        let mut triangles = [0; WAYS.len()];
        for (way, name) in WAYS.into_iter().enumerate() {
            let counters = painter.frame(view, settings(name))?;
            triangles[way] = counters.triangles - counters.terrain_triangles;
            keep(&format!("{number}-{}", name.replace(' ', "-")), &painter.picture()?)?;
        }
        let seconds = by_turns(WAYS.len(), frames, |way| painter.frame(view, settings(WAYS[way])).map(drop))?;
        for (way, name) in WAYS.into_iter().enumerate() {
            rows.push(InkCost {
                view: number,
                way: name,
                size_px: plan.viewport_px,
                adapter: adapter.clone(),
                triangles: triangles[way],
                frame_ms: rounded(median(seconds[way].clone()) * 1e3, 3),
                over_none: rounded(paired_ratio(&seconds[way], &seconds[0]), 3),
            });
        }
    }
    Ok(rows)
}

/// One line of text.
impl fmt::Display for InkCost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { view, way, triangles, frame_ms, over_none, .. } = self;
        write!(
            f,
            "view {view}, {way}: {frame_ms:.1} ms a frame of {triangles} triangles, {over_none:.2} of one without"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    #[test]
    fn each_variant_gives_another_picture() {
        let Some((plan, gpu)) = plan_and_device("[160, 90]") else { return };
        let mut pictures = Vec::new();
        let keep = |_: &str, picture: &RgbaImage| {
            pictures.push(picture.clone());
            Ok(())
        };
        let rows = ink_cost(&plan, &small_scene(), gpu, &[], 1, keep).unwrap();
        assert!(rows.iter().map(|row| row.way).eq(WAYS) && rows.iter().all(|row| row.frame_ms > 0.0));
        assert!(rows.iter().all(|row| row.triangles == rows[0].triangles && row.triangles > 0));
        let [none, first, both, strokes, levels] = &pictures[..] else {
            panic!("{} pictures", pictures.len())
        };
        assert!(first == both && none != both && none != strokes && none != levels && strokes != levels);
    }
}
