//! Parts, colours, pixels and section planes as arguments.

use std::str::FromStr;

use glam::DVec3;
use lodestream_scene::parts::ScenePart;
use lodestream_scene::section::SectionPlane;

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
    pub(crate) part: ScenePart,
    pub(crate) colour: [u8; 3],
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

/// A section plane, as `X,Y,Z,D`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SectionArg(pub(crate) SectionPlane);

impl FromStr for SectionArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        let plane = match numbers.as_deref() {
            Some(&[x, y, z, distance]) => SectionPlane::new(DVec3::new(x, y, z), distance),
            _ => None,
        };
        plane
            .map(Self)
            .ok_or_else(|| "write X,Y,Z,D with a normal that is not 0, for example 0,1,0,1.5".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn section_planes_are_parsed() {
        let plane = SectionPlane::new(DVec3::new(0.0, -1.0, 0.0), 0.75).unwrap();
        assert_eq!("0,-2, 0,1.5".parse(), Ok(SectionArg(plane)));
        for bad in ["", "1,2,3", "0,0,0,1", "1,2,3,4,5", "a,0,0,1", "nan,1,0,0", "1,0,0,inf"] {
            assert!(bad.parse::<SectionArg>().is_err(), "{bad}");
        }
    }

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
