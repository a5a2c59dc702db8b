//! The animation that the command line names.

use anyhow::bail;
use lodestream_scene::animation::{Animations, Moment};
use lodestream_viewing::Playback;

use crate::args::Args;

/// Most clips that a message names.
const NAMED: usize = 8;

/// The playback with which a window begins: it plays, unless a time is given or the picture is to become final.
pub(crate) fn playback(args: &Args) -> Playback {
    let plays = args.animation_time.is_none() && !args.exit_when_settled;
    Playback::new(args.animation.clone(), args.animation_time.unwrap_or(0.0), plays)
}

/// What a picture without a window shows: the clip that is named, the first if only a time is; `None` if neither is.
pub(crate) fn moment(args: &Args) -> Option<Moment> {
    let clip = args.animation.clone().unwrap_or_default();
    let any = args.animation.is_some() || args.animation_time.is_some();
    any.then(|| Moment { clip, time_s: args.animation_time.unwrap_or(0.0) })
}

/// Checks that a scene has the clip of the command line.
///
/// # Errors
/// Names its clips.
pub(crate) fn check(args: &Args, animations: &Animations) -> anyhow::Result<()> {
    let Some(name) = &args.animation else { return Ok(()) };
    let clips = animations.clips();
    if clips.iter().any(|clip| clip.name == *name) {
        return Ok(());
    }
    if clips.is_empty() {
        bail!("--animation {name:?}: the scene has no animation; leave it out");
    }
    let names: Vec<&str> = clips.iter().take(NAMED).map(|clip| &*clip.name).collect();
    bail!(
        "--animation {name:?}: the scene has no such animation; it has {}: {}",
        clips.len(),
        names.join(", ")
    );
}
