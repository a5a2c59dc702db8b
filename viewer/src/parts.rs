//! Parts named on the command line: what they look like, and which one a pixel shows.

use std::str::FromStr;

use anyhow::Context;
use lodestream_client::core::{Hit, Ray};
use lodestream_client::streaming::Streaming;
use lodestream_render::{Gpu, PartState, SceneView, Tint};
use lodestream_scene::parts::ScenePart;
use lodestream_scene::pose::Pose;

use crate::args::Args;

/// Share of a tint's colour in the mixture.
const TINT_STRENGTH: f32 = 0.7;

/// A part, as `INSTANCE:PART`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PartArg(pub(crate) ScenePart);

impl FromStr for PartArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split_once(':');
        let part = numbers.and_then(|(instance, part)| {
            Some(ScenePart { instance: instance.trim().parse().ok()?, part: part.trim().parse().ok()? })
        });
        part.map(Self).ok_or_else(|| "write INSTANCE:PART, for example 0:12".into())
    }
}

/// A part and a colour, as `INSTANCE:PART=RRGGBB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TintArg {
    part: ScenePart,
    colour: [u8; 3],
}

impl FromStr for TintArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let read = || {
            let (part, colour) = text.split_once('=')?;
            let hex =
                Some(colour).filter(|hex| hex.len() == 6 && hex.bytes().all(|c| c.is_ascii_hexdigit()))?;
            let [_, r, g, b] = u32::from_str_radix(hex, 16).ok()?.to_be_bytes();
            Some(Self { part: part.parse::<PartArg>().ok()?.0, colour: [r, g, b] })
        };
        read().ok_or_else(|| "write INSTANCE:PART=RRGGBB, for example 0:12=ff8000".into())
    }
}

/// A pixel, as `X,Y` from the upper left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PixelArg(pub(crate) [u32; 2]);

impl FromStr for PixelArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pixel = text.split_once(',');
        let pixel = pixel.and_then(|(x, y)| Some(Self([x.trim().parse().ok()?, y.trim().parse().ok()?])));
        pixel.ok_or_else(|| "write X,Y in pixels from the upper left, for example 640,360".into())
    }
}

/// A tint of usual strength.
pub(crate) const fn tinted(colour: [u8; 3]) -> PartState {
    PartState { hidden: false, tint: Some(Tint { colour, strength: TINT_STRENGTH }) }
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

/// Describes what a pixel shows; waits for the streaming thread.
pub(crate) fn describe_at(
    PixelArg([x, y]): PixelArg,
    pose: &Pose,
    size: (u32, u32),
    streaming: &Streaming,
    scene: &SceneView,
) -> anyhow::Result<String> {
    let direction = pose.direction([f64::from(x) + 0.5, f64::from(y) + 0.5], size);
    let ray = Ray { origin: pose.eye, direction };
    let hidden = scene.hidden_parts();
    let hit = streaming.ask(move |core| core.pick(ray, |part| hidden.contains(part)))?.wait()?;
    Ok(match hit {
        None => format!("{x},{y}: nothing"),
        Some(Hit { part: ScenePart { instance, part }, place, distance }) => format!(
            "{x},{y}: {instance}:{part} at {:.4},{:.4},{:.4}, distance {distance:.4}",
            place.x, place.y, place.z
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_colours_and_pixels_are_parsed() {
        let part = ScenePart { instance: 3, part: 12 };
        assert_eq!("3:12".parse(), Ok(PartArg(part)));
        assert_eq!("3:12=ff8000".parse(), Ok(TintArg { part, colour: [255, 128, 0] }));
        assert_eq!("640,3".parse(), Ok(PixelArg([640, 3])));
        for bad in ["", "3", "3:", ":1", "a:b", "3:-1", "4294967296:0"] {
            assert!(bad.parse::<PartArg>().is_err(), "{bad}");
        }
        for bad in ["3:1", "3:1=", "3:1=12345", "3:1=+12345", "3=ff8000", "3:1=ff8000ff"] {
            assert!(bad.parse::<TintArg>().is_err(), "{bad}");
        }
        for bad in ["3", "3,", "-1,2", "1.5,2", "1,2,3"] {
            assert!(bad.parse::<PixelArg>().is_err(), "{bad}");
        }
    }
}
