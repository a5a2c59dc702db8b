//! Parts named on the command line: what they look like, and which one a pixel shows.

use anyhow::Context;
use glam::DVec3;
use lodestream_client::core::{Hit, Ray};
use lodestream_client::streaming::Streaming;
use lodestream_render::{Gpu, PartState, SceneView, Tint};
use lodestream_scene::pose::Pose;

use crate::args::Args;
use crate::part_args::PixelArg;

/// Share of a tint's colour in the mixture.
const TINT_STRENGTH: f32 = 0.7;

/// A tint of usual strength.
pub(crate) const fn tinted(colour: [u8; 3]) -> PartState {
    PartState { hidden: false, tint: Some(Tint { colour, strength: TINT_STRENGTH }), transform: None }
}

/// Hides, tints and isolates what the command line says.
pub(crate) fn apply(args: &Args, gpu: &Gpu, scene: &mut SceneView) -> anyhow::Result<()> {
    let tints = args.tint.iter().map(|tint| (tint.part, tinted(tint.colour)));
    let hidden = args.hide.iter().map(|part| (part.0, PartState::HIDDEN));
    let states: Vec<_> = tints.chain(hidden).collect();
    if !states.is_empty() {
        scene.set_parts(gpu, &states).context("--hide or --tint")?;
    }
    if !args.isolate.is_empty() {
        let parts: Vec<_> = args.isolate.iter().map(|part| part.0).collect();
        scene.isolate_parts(gpu, Some(&parts)).context("--isolate")?;
    }
    Ok(())
}

/// The instances that the command line hides, tints or isolates something of.
pub(crate) fn instances(args: &Args) -> Vec<u32> {
    let tinted = args.tint.iter().map(|tint| tint.part);
    let others = args.hide.iter().chain(&args.isolate).map(|part| part.0);
    tinted.chain(others).map(|part| part.instance).collect()
}

/// Describes what a pixel shows; waits for the streaming thread.
pub(crate) fn describe_at(
    PixelArg([x, y]): PixelArg,
    (pose, size): (&Pose, (u32, u32)),
    args: &Args,
    streaming: &Streaming,
    scene: &SceneView,
) -> anyhow::Result<String> {
    let direction = pose.direction([f64::from(x) + 0.5, f64::from(y) + 0.5], size);
    let ray = Ray { origin: pose.eye, direction };
    let (hidden, planes) = (scene.hidden_parts(), args.sections().unwrap_or_default());
    let hit = streaming.ask(move |core| core.pick_cut(ray, &planes, |part| hidden.contains(part)))?.wait()?;
    let Some(Hit { instance, part, place, distance }) = hit else { return Ok(format!("{x},{y}: nothing")) };
    // Behind a proxy the part is not known.
    let part = part.map_or_else(|| "?".into(), |part| part.to_string());
    let DVec3 { x: at_x, y: at_y, z: at_z } = place;
    Ok(format!("{x},{y}: {instance}:{part} at {at_x:.4},{at_y:.4},{at_z:.4}, distance {distance:.4}"))
}
