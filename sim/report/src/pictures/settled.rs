//! Settled scenes, drawn repeatedly for timing.
//!
//! A run settles in virtual time. Then the shipped renderer draws its settled view in real time on the available
//! adapter. Variants are drawn in turn, so that other load on the machine affects all alike: ratios hold where times do
//! not. A frame includes what a viewer's frame does: selecting terrain tiles, recording, drawing, and waiting for the
//! device, without readback.

use std::sync::Arc;

use anyhow::Context as _;
use lodestream_protocol::source::SceneSource;
use lodestream_scenario::plan::{Case, ClientSettings, PictureSettings, Plan};
use lodestream_scenario::result::RunResult;
use lodestream_scenario::run::{Run, certificate};
use lodestream_scenario::stopwatch::timed;
use lodestream_scenario::technique::Technique;
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;

use super::painter::{Painter, Studio};

/// Most frames of each variant.
pub const MAX_FRAMES: u32 = 10_000;
/// Untimed frames of each variant: they generate terrain tiles and fill caches.
const WARM_UP: u32 = 2;

/// A settled run with its renderer.
#[derive(Debug)]
pub(super) struct Settled<'a> {
    pub(super) run: RunResult,
    pub(super) painter: Painter<'a>,
    pub(super) view: View,
}

/// Settles the plan's case with each client, with its first seed.
///
/// # Errors
/// A plan with several cases or another technique; runs that do not settle or end early; errors of the graphics device.
pub(super) fn settle<'a>(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    studio: &'a Studio,
    clients: impl IntoIterator<Item = ClientSettings>,
) -> anyhow::Result<Vec<Settled<'a>>> {
    let case = only_case(plan)?;
    let seed = case.seeds.first().copied().unwrap_or(1);
    let certificate = certificate()?;
    let settings = PictureSettings { at_s: Vec::new(), size_px: plan.viewport_px, first: None };
    let settle = |client: ClientSettings| {
        let plan = Plan { client, ..plan.clone() };
        let mut painter = Painter::new(studio, &settings)?;
        let run = Run { plan: &plan, case, scene, certificate: &certificate, seed };
        let run = run.result(Some(&mut painter))?;
        painter.check()?;
        let view = painter.settled_view();
        let view =
            view.with_context(|| format!("{} px: no settled picture: {}", client.target_px, run.ended))?;
        Ok(Settled { run, painter, view })
    };
    clients.into_iter().map(settle).collect()
}

/// Settles the plan's case at its own view and at those of more cameras; each renderer comes with its view.
///
/// # Errors
/// As [`settle`].
pub(super) fn settle_views<'a>(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    studio: &'a Studio,
    cameras: &[Camera],
) -> anyhow::Result<Vec<(Painter<'a>, View)>> {
    let own = settle(plan, scene, studio, [plan.client])?;
    let own = own.into_iter().map(|settled| Ok((settled.painter, settled.view)));
    let others = cameras.iter().map(|camera| {
        let view = camera.view(plan.viewport_px, plan.client.target_px);
        Ok((settle_at(plan, scene, studio, view)?, view))
    });
    own.chain(others).collect()
}

/// Settles the plan's case with a fixed camera at a view.
///
/// # Errors
/// As [`settle`].
pub(super) fn settle_at<'a>(
    plan: &Plan,
    scene: &Arc<dyn SceneSource>,
    studio: &'a Studio,
    view: View,
) -> anyhow::Result<Painter<'a>> {
    let case = only_case(plan)?;
    let seed = case.seeds.first().copied().unwrap_or(1);
    let certificate = certificate()?;
    let settings = PictureSettings { at_s: Vec::new(), size_px: plan.viewport_px, first: None };
    let mut painter = Painter::new(studio, &settings)?;
    Run { plan, case, scene, certificate: &certificate, seed }.settle_at(view, &mut painter)?;
    painter.check()?;
    painter.settled_view().with_context(|| format!("from {:?}: no settled picture", view.eye))?;
    Ok(painter)
}

fn only_case(plan: &Plan) -> anyhow::Result<&Case> {
    let [case] = &plan.cases[..] else {
        anyhow::bail!("the plan has {} cases: choose one, as with --set sweep.seeds=1", plan.cases.len());
    };
    anyhow::ensure!(case.technique == Technique::Lodestream, "frames of {} are not drawn", case.technique);
    Ok(case)
}

/// Seconds of `frames` frames (at least one) of each variant: the first of all, then the second of all. `frame` draws
/// the variant with a number below `count`.
///
/// # Errors
/// Errors of `frame`.
pub(super) fn by_turns<E>(
    count: usize,
    frames: u32,
    mut frame: impl FnMut(usize) -> Result<(), E>,
) -> Result<Vec<Vec<f64>>, E> {
    let mut seconds = vec![Vec::new(); count];
    for turn in 0..WARM_UP + frames.max(1) {
        for (number, seconds) in seconds.iter_mut().enumerate() {
            let (drawn, taken) = timed(|| frame(number));
            drawn?;
            if turn >= WARM_UP {
                seconds.push(taken);
            }
        }
    }
    Ok(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_drawn_by_turns_and_the_first_two_of_each_do_not_count() {
        let mut order = Vec::new();
        let frame = |number| {
            order.push(number);
            Ok::<(), ()>(())
        };
        let seconds = by_turns(3, 2, frame).unwrap();
        assert_eq!(order, [0, 1, 2].repeat(4));
        assert!(seconds.len() == 3 && seconds.iter().all(|of_one| of_one.len() == 2));
        assert_eq!(by_turns(1, 0, |_| Ok::<(), ()>(())).unwrap()[0].len(), 1);
        assert!(by_turns(2, 1, |number| if number == 1 { Err("refused") } else { Ok(()) }).is_err());
    }
}
