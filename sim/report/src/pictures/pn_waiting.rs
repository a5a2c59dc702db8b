//! Curved triangles while a scene arrives: errors of intermediate pictures against the settled one, flat and curved.
//!
//! Each case runs twice in virtual time, drawn flat and curved; drawing does not affect the run, so both have the same
//! data at each instant. The reference of both is the settled picture with flat triangles.

use std::fmt;
use std::sync::Arc;

use anyhow::Context as _;
use lodestream_protocol::source::SceneSource;
use lodestream_render::{Gpu, PnTriangles};
use lodestream_scenario::plan::{Case, Plan};
use lodestream_scenario::run::{Run, certificate};
use lodestream_scenario::stopwatch::rounded;
use lodestream_scenario::timeline::milliseconds;
use serde::Serialize;

use super::painter::{Painter, Studio};
use super::shot::{Instant, Shot};
use crate::image_error::image_error;

/// One instant of one case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Waiting {
    /// The case's scene.
    pub scene: String,
    /// Transport and link.
    pub case: String,
    /// The instant.
    pub instant: String,
    /// Milliseconds since the connect call.
    pub at_ms: f64,
    /// Bytes received by then.
    pub bytes: u64,
    /// Largest screen error, pixels.
    pub error_px: Option<f64>,
    /// FLIP error against the settled picture, flat.
    pub flip: f64,
    /// The same with curved triangles.
    pub flip_curved: f64,
    /// Structural similarity to the settled picture, flat.
    pub ssim: f64,
    /// The same with curved triangles.
    pub ssim_curved: f64,
}

/// Runs each case of a plan with `[pictures]` with its first seed, flat and curved. `keep` receives pictures with
/// names.
///
/// # Errors
/// Plans without pictures, runs that do not settle or end early, and errors of the graphics device.
pub fn waiting(
    plan: &Plan,
    scenes: &[Arc<dyn SceneSource>],
    gpu: Gpu,
    patches: PnTriangles,
    mut keep: impl FnMut(&str, &image::RgbaImage) -> anyhow::Result<()>,
) -> anyhow::Result<Vec<Waiting>> {
    let studio = Studio::new(gpu);
    let certificate = certificate()?;
    let settings = plan.pictures.as_ref().context("the plan has no [pictures]")?;
    let mut rows = Vec::new();
    for case in &plan.cases {
        let scene = scenes.get(case.scene).context("a case without a scene")?;
        let seed = case.seeds.first().copied().unwrap_or(1);
        let shots = |patches| -> anyhow::Result<Vec<Shot>> {
            let mut painter = Painter::new(&studio, settings)?.curved(patches);
            Run { plan, case, scene, certificate: &certificate, seed }.result(Some(&mut painter))?;
            Ok(painter.finish()?)
        };
        let (flat, curved) = (shots(None)?, shots(Some(patches))?);
        let name = name_of(plan, case);
        let settled = flat.last().filter(|shot| shot.instant == Instant::Settled);
        let settled = Arc::clone(&settled.with_context(|| format!("{name} does not settle"))?.picture);
        for (flat, curved) in flat.iter().zip(&curved) {
            anyhow::ensure!(flat.bytes == curved.bytes, "{name}: runs differ at {}", flat.instant);
            let off = |shot: &Shot| image_error(&shot.picture, &settled);
            let (flat_off, curved_off) = (off(flat)?, off(curved)?);
            for (way, shot) in [("flat", flat), ("curved", curved)] {
                keep(&format!("{name}-{}-{way}", shot.instant).replace([' ', ':'], "-"), &shot.picture)?;
            }
            rows.push(Waiting {
                scene: name.clone(),
                case: case.to_string(),
                instant: flat.instant.to_string(),
                at_ms: milliseconds(flat.at_ns),
                bytes: flat.bytes,
                error_px: flat.error_px.map(|px| rounded(px, 4)),
                flip: flat_off.flip,
                flip_curved: curved_off.flip,
                ssim: flat_off.ssim,
                ssim_curved: curved_off.ssim,
            });
        }
    }
    Ok(rows)
}

fn name_of(plan: &Plan, case: &Case) -> String {
    plan.scenes.get(case.scene).map_or_else(String::new, |scene| scene.name.clone())
}

/// One line of text.
impl fmt::Display for Waiting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, instant, at_ms, bytes, flip, flip_curved, ssim, ssim_curved, .. } = self;
        write!(
            f,
            "{scene}, {instant} ({at_ms:.0} ms, {bytes} bytes): FLIP {flip:.4} flat, {flip_curved:.4} curved; SSIM \
             {ssim:.4}, {ssim_curved:.4}"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::plan_and_device;
    use super::*;
    use lodestream_scenario::testing::small_scene;

    #[test]
    fn flat_and_curved_are_compared_with_the_settled_picture() {
        let Some((plan, gpu)) = plan_and_device("[160, 90]\n[pictures]\nat_s = [0.2]\nsize_px = [96, 54]")
        else {
            return;
        };
        let mut names = Vec::new();
        let keep = |name: &str, _: &image::RgbaImage| {
            names.push(name.to_owned());
            Ok(())
        };
        let rows = waiting(&plan, &[small_scene()], gpu, PnTriangles::default(), keep).unwrap();
        let instants: Vec<&str> = rows.iter().map(|row| row.instant.as_str()).collect();
        assert_eq!(instants, ["first frame", "0.2 s", "settled"]);
        assert_eq!(names.len(), 6);
        assert!(rows[0].flip > 0.0 && rows[0].flip_curved > 0.0);
        assert_eq!(rows[2].flip, 0.0, "the settled picture is its own reference");
    }
}
