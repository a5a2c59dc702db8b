//! Settled scenes, drawn as often as one likes.
//!
//! A run settles in virtual time. Then the shipped renderer draws its settled view, in real time, on whatever adapter there
//! is. What is compared is drawn by turns: what else the machine does meanwhile falls on all, so that ratios hold where
//! times do not. A frame is what a viewer does for one: choosing the ground's tiles, recording, drawing, and waiting
//! until it is done. Nothing is read back.

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

/// Most frames of each.
pub const MAX_FRAMES: u32 = 10_000;
/// Frames of each that are drawn before: they make the ground's tiles and fill caches.
const WARM_UP: u32 = 2;

/// A run that has settled, and what draws it.
#[derive(Debug)]
pub(super) struct Settled<'a> {
    pub(super) run: RunResult,
    pub(super) painter: Painter<'a>,
    pub(super) view: View,
}

/// Settles the plan's case with each client, by its first seed.
///
/// # Errors
/// A plan of more than one case, or of another technique; runs that do not settle; whatever ends a run early, and what
/// the graphics device refuses.
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

/// What draws the plan's case at its own view, and at those of more cameras, each with its view.
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

/// What draws a viewer that has settled with its camera at a view, by the plan's case.
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

/// Seconds of so many frames of each, at least one: the first of all, then the second of all. `frame` draws one of those
/// numbered below `count`.
///
/// # Errors
/// What `frame` does not draw.
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
