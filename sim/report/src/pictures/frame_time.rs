//! Frame time of the settled scene by target screen error.

use std::fmt;
use std::sync::Arc;

use lodestream_protocol::source::SceneSource;
use lodestream_render::{Counters, Gpu, Settings};
use lodestream_scenario::plan::{ClientSettings, Plan};
use lodestream_scenario::stopwatch::{Spread, median, paired_ratio, rounded};
use serde::Serialize;

use super::painter::Studio;
pub use super::settled::MAX_FRAMES;
use super::settled::{Settled, by_turns, settle};

/// The target that others are compared with.
const REFERENCE_PX: f32 = 1.0;

/// Timed frames of a settled view.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameTime {
    /// Target screen error.
    pub target_px: f32,
    /// Width and height of the frames, which are the plan's viewport.
    pub size_px: [u32; 2],
    /// The graphics adapter.
    pub adapter: String,
    /// Bytes received until settled.
    pub total_bytes: u64,
    /// Triangles of meshes submitted per frame, including every instance and unused slots.
    pub mesh_triangles: u64,
    /// Triangles of the terrain.
    pub ground_triangles: u64,
    /// Tiles of the terrain.
    pub ground_tiles: u32,
    /// Screen error of the terrain: above the target if that would need more tiles than can be drawn. `None` without
    /// terrain.
    pub ground_px: Option<f64>,
    /// Draw calls.
    pub draws: u32,
    /// Frames that were timed.
    pub frames: u32,
    /// Median time, in milliseconds.
    pub median_ms: f64,
    /// Least, mean and greatest time.
    #[serde(flatten)]
    pub spread: Spread,
    /// Frame time relative to that at 1 px: the median over consecutive frames. `None` if 1 px is not among the
    /// targets.
    pub over_one_px: Option<f64>,
}

/// Settles the plan's case at each target and times `frames` frames (at least one) of each.
///
/// # Errors
/// A plan with several cases or another technique; runs that do not settle or end early; errors of the graphics device.
pub fn frame_times(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    gpu: Gpu,
    targets_px: &[f32],
    frames: u32,
) -> anyhow::Result<Vec<FrameTime>> {
    let adapter = gpu.describe();
    let studio = Studio::new(gpu);
    let clients = targets_px.iter().map(|&target_px| ClientSettings { target_px, ..plan.client });
    let mut settled = settle(plan, scene, &studio, clients)?;
    let mut counters = vec![Counters::default(); settled.len()];
    let seconds = by_turns(settled.len(), frames, |number| {
        let one = &mut settled[number];
        counters[number] = one.painter.frame(&one.view, Settings::default())?;
        anyhow::Ok(())
    })?;
    let reference = targets_px.iter().position(|&px| px == REFERENCE_PX).map(|number| &seconds[number]);
    let frame_time = |number: usize, one: &Settled<'_>, counters: &Counters| FrameTime {
        target_px: targets_px[number],
        size_px: plan.viewport_px,
        adapter: adapter.clone(),
        total_bytes: one.run.total_bytes,
        mesh_triangles: counters.triangles - counters.terrain_triangles,
        ground_triangles: counters.terrain_triangles,
        ground_tiles: counters.terrain_tiles,
        ground_px: one.painter.ground_px().map(|px| rounded(px, 3)),
        draws: counters.draws,
        frames: frames.max(1),
        over_one_px: reference.map(|reference| rounded(paired_ratio(&seconds[number], reference), 3)),
        spread: Spread::of(&seconds[number]),
        median_ms: rounded(median(seconds[number].clone()) * 1e3, 4),
    };
    let each = settled.iter().zip(&counters).enumerate();
    Ok(each.map(|(number, (one, counters))| frame_time(number, one, counters)).collect())
}

/// One line of text.
impl fmt::Display for FrameTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [width, height] = self.size_px;
        write!(
            f,
            "{} px: {} bytes, {} triangles of meshes, {} of ground ({} tiles, for {} px), {width} x {height} on {}: median of {} frames {:.1} ms \
             ({:.1} to {:.1})",
            self.target_px,
            self.total_bytes,
            self.mesh_triangles,
            self.ground_triangles,
            self.ground_tiles,
            self.ground_px.map_or("–".to_owned(), |px| px.to_string()),
            self.adapter,
            self.frames,
            self.median_ms,
            self.spread.min_ms,
            self.spread.max_ms
        )?;
        self.over_one_px.map_or(Ok(()), |ratio| write!(f, ", {ratio:.2} times that at 1 px"))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::tests::{device, may_draw};
    use super::*;
    use lodestream_scenario::plan;
    use lodestream_scenario::testing::small_scene;

    fn of_plan(head: &str, rates: &str, targets_px: &[f32]) -> anyhow::Result<Vec<FrameTime>> {
        let text = format!(
            "scene = \"demo-small\"\nviewport_px = [320, 180]\n{head}\n[[sweep]]\ntransport = \"quic\"\n\
             rate_bits_per_s = {rates}\nrtt_ms = 50\n"
        );
        let plan = plan::parse(&text, Path::new("test.toml")).unwrap();
        let gpu = device().expect("tests ask whether they may draw");
        frame_times(&plan, &small_scene(), gpu, targets_px, 3)
    }

    #[test]
    fn a_smaller_error_takes_more_bytes_and_triangles() {
        if !may_draw() {
            return;
        }
        let times = of_plan("", "16_000_000", &[8.0, 1.0, 0.25]).unwrap();
        let [coarse, reference, fine] = &times[..] else { panic!("{times:?}") };
        for [less, more] in [[coarse, reference], [reference, fine]] {
            assert!(
                less.mesh_triangles < more.mesh_triangles && less.total_bytes < more.total_bytes,
                "{times:?}"
            );
        }
        assert_eq!(reference.over_one_px, Some(1.0));
        for time in &times {
            let Spread { min_ms, max_ms, .. } = time.spread;
            assert!(0.0 < min_ms && min_ms <= time.median_ms && time.median_ms <= max_ms, "{time:?}");
            assert_eq!((time.size_px, time.frames), ([320, 180], 3));
            assert!(time.over_one_px.is_some() && time.draws > 0, "{time:?}");
            assert!(time.ground_triangles > 0 && time.ground_tiles > 0, "{time:?}");
            assert!(time.ground_px.is_some_and(|px| px >= f64::from(time.target_px)), "{time:?}");
        }
    }

    #[test]
    fn runs_that_do_not_settle_and_plans_of_several_cases_are_refused() {
        if !may_draw() {
            return;
        }
        let error = of_plan("", "[1_000_000, 2_000_000]", &[1.0]).unwrap_err().to_string();
        assert!(error.contains("2 cases"), "{error}");
        let error = of_plan("time_limit_s = 0.3", "100_000", &[1.0]).unwrap_err().to_string();
        assert!(error.contains("1 px: no settled picture"), "{error}");
    }
}
