//! Command line of the viewer.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Parser;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use lodestream_scene::description::Camera;
use lodestream_scene::view::View;

use lodestream_client::net::Address;
use lodestream_render::{
    AntiAliasing, DebugView, Ink, MAX_INK_LEVELS, MAX_INK_WIDTH, MAX_REFLECTION_STEPS, OcclusionMethod,
    OcclusionNormals, ReflectionMethod, ReliefMethod, ToneMapping, VerticalExaggeration,
};

use crate::outcome::EXIT_CODES;

/// Streams a scene from a Lodestream server and draws it.
#[derive(Clone, Debug, Parser)]
#[command(name = "lodestream-viewer", version, about, after_help = EXIT_CODES)]
pub(crate) struct Args {
    /// The server: quic://HOST:PORT#sha256=FINGERPRINT (as the server prints it), wss://HOST:PORT or ws://HOST:PORT; of a
    /// server with several scenes, with the scene's name behind it: ws://HOST:PORT/NAME.
    /// Without a fingerprint, certificates are believed that the system's authorities vouch for
    pub(crate) address: Address,
    /// Believe certificates of the authorities in this file (PEM), and not the system's
    #[arg(long, value_name = "FILE")]
    pub(crate) ca: Option<PathBuf>,
    /// File with the token that the server asks for; read again when it changes. Without, the environment's
    /// LODESTREAM_TOKEN
    #[arg(long, value_name = "FILE")]
    pub(crate) token_file: Option<PathBuf>,
    /// Size of the window or picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    pub(crate) window: Size,
    /// Draw no window: wait until the picture is settled and write it to --output
    #[arg(long, requires = "output")]
    pub(crate) headless: bool,
    /// Where the picture goes (PNG)
    #[arg(long, value_name = "FILE.png")]
    pub(crate) output: Option<PathBuf>,
    /// Where to look from: `eye=X,Y,Z;target=X,Y,Z`, then `;up=X,Y,Z` and `;fov=DEGREES` if wanted; the
    /// scene's own camera without
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true)]
    pub(crate) camera: Option<CameraArg>,
    /// Screen error to refine to, in pixels
    #[arg(long, value_name = "PX", default_value = "1")]
    pub(crate) pixel_error: PixelError,
    /// End when the picture is settled, or when it is incomplete and nothing more will come
    #[arg(long)]
    pub(crate) exit_when_settled: bool,
    /// End after this time (headless: 300 without)
    #[arg(long, value_name = "SECONDS")]
    pub(crate) timeout: Option<Seconds>,
    /// Write the run's figures as JSON
    #[arg(long, value_name = "FILE.json")]
    pub(crate) stats: Option<PathBuf>,
    /// Keep pictures of the frames that the window shows in the first three seconds, of the first whole one and of the
    /// last, in this folder, with their times in frames.json
    #[arg(long, value_name = "DIR", conflicts_with = "headless")]
    pub(crate) frames: Option<PathBuf>,
    /// Begin without the overlay; H shows and hides it
    #[arg(long)]
    pub(crate) no_overlay: bool,
    /// Print the run's figures as a table at the end
    #[arg(long)]
    pub(crate) figures: bool,
    /// What colours the surfaces: their materials, or what passes hand on
    #[arg(long, value_name = "NAME", default_value = "material", value_parser = shades())]
    pub(crate) view: DebugView,
    /// The same as --view level
    #[arg(long, conflicts_with = "view")]
    pub(crate) colour_by_level: bool,
    /// How bright light is shown: as films have it, or with base colours as they are
    #[arg(long, value_name = "NAME", default_value = "filmic", value_parser = tones())]
    pub(crate) tone_mapping: ToneMapping,
    /// Factor on light before that, 0.001 to 1000
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = exposure)]
    pub(crate) exposure: f32,
    /// Draw the edges of triangles
    #[arg(long)]
    pub(crate) wireframe: bool,
    /// No ambient occlusion
    #[arg(long)]
    pub(crate) no_ao: bool,
    /// By which method ambient occlusion is estimated
    #[arg(long, value_name = "NAME", default_value = OcclusionMethod::default().name(), value_parser = occlusion_methods())]
    pub(crate) occlusion_method: OcclusionMethod,
    /// By which method it is estimated while nothing changes, as the mean of 16 frames, or none for as always; without, gtao on
    /// a graphics processor and none where processors draw
    #[arg(long, value_name = "NAME", value_parser = still_methods())]
    pub(crate) occlusion_still: Option<Still>,
    /// By what the pixels are chosen that it takes normals from: nearest in depth, the drawn normals, or surfaces that go on
    #[arg(long, value_name = "NAME", default_value = OcclusionNormals::default().name(), value_parser = occlusion_normals())]
    pub(crate) occlusion_normals: OcclusionNormals,
    /// Estimate ambient occlusion at one pixel of each 2×2 where frames stand alone; not by hbao-plus
    #[arg(long, conflicts_with = "no_ao")]
    pub(crate) occlusion_half: bool,
    /// No shadows of the sun
    #[arg(long)]
    pub(crate) no_shadows: bool,
    /// How edges are smoothed; without, temporal on a graphics processor and spatial where processors draw
    #[arg(long, value_name = "NAME", value_parser = smoothings())]
    pub(crate) anti_aliasing: Option<AntiAliasing>,
    /// The same as --anti-aliasing none
    #[arg(long, conflicts_with = "anti_aliasing")]
    pub(crate) no_aa: bool,
    /// No punctual lights
    #[arg(long)]
    pub(crate) no_punctual_lights: bool,
    /// No water
    #[arg(long)]
    pub(crate) no_water: bool,
    /// How smooth surfaces and water look for what they mirror of the picture; without, they mirror the sky alone
    #[arg(long, value_name = "NAME", value_parser = reflections())]
    pub(crate) reflections: Option<ReflectionMethod>,
    /// Steps of a reflection's ray at most
    #[arg(long, value_name = "STEPS", default_value_t = 100, requires = "reflections",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_REFLECTION_STEPS)))]
    pub(crate) reflection_steps: u32,
    /// Share of light that spreads around what is bright, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, default_missing_value = "0.04", num_args = 0..=1,
        value_parser = share)]
    pub(crate) bloom: f32,
    /// Heights of the ground are multiplied by this, 0 to 100, and what stands on it goes up and down with it
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = heights)]
    pub(crate) ground_heights: f64,
    /// Seconds in which heights of the ground go where they are to; without a window they are there at once
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = heights_time)]
    pub(crate) ground_seconds: f64,
    /// No relief mapping
    #[arg(long)]
    pub(crate) no_relief: bool,
    /// How relief mapping of meshes looks for the hit, the cheapest first
    #[arg(long, value_name = "NAME", value_parser = reliefs(), conflicts_with = "no_relief")]
    pub(crate) relief_method: Option<ReliefMethod>,
    /// Relief mapping of meshes leaves dark what its own heights hide from the sun
    #[arg(long, conflicts_with = "no_relief")]
    pub(crate) relief_shadows: bool,
    /// Depth is that of what relief of meshes shows: what stands in it meets it where it should
    #[arg(long, conflicts_with = "no_relief")]
    pub(crate) relief_in_depth: bool,
    /// Triangles of meshes as curved patches, cut until no edge is further off its curve than this many pixels
    #[arg(long, value_name = "PX", num_args = 0..=1, require_equals = true, default_missing_value = "0.25")]
    pub(crate) pn_triangles: Option<PixelError>,
    /// Strokes of ink along contours and creases of meshes, so many pixels wide, over light in levels
    #[arg(long, value_name = "PX", num_args = 0..=1, require_equals = true, default_missing_value = "2",
        value_parser = ink_width)]
    pub(crate) ink: Option<f32>,
    /// Levels of light under ink; with 1 light is as it is
    #[arg(long, value_name = "N", default_value_t = Ink::default().levels, requires = "ink",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_INK_LEVELS)))]
    pub(crate) ink_levels: u32,
    /// Angle between two faces from which on their edge has a stroke wherever it is seen; with 180 none has
    #[arg(long, value_name = "DEGREES", default_value_t = Ink::default().crease_degrees, requires = "ink",
        value_parser = crease)]
    pub(crate) ink_crease: f32,
    /// By how much of a level borders between levels of light are spattered, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = Ink::default().spatter, requires = "ink",
        value_parser = share)]
    pub(crate) ink_spatter: f32,
    /// Most faces in use, over all assets
    #[arg(long, value_name = "FACES", default_value_t = 8_000_000)]
    pub(crate) max_faces: u64,
    /// Bytes of received data kept for reuse, in MiB
    #[arg(long, value_name = "MIB", default_value_t = 128)]
    pub(crate) cache_mib: u32,
    /// Threads that decode meshes; without, all but one of the machine's cores, and at least one
    #[arg(long, value_name = "N")]
    pub(crate) decode_threads: Option<NonZeroUsize>,
}

/// Reads a [`DebugView`] by its name.
fn shades() -> impl TypedValueParser<Value = DebugView> {
    PossibleValuesParser::new(DebugView::ALL.map(DebugView::name)).try_map(|name| {
        // One of those offered.
        DebugView::ALL.into_iter().find(|shade| shade.name() == name).ok_or("no such view")
    })
}

/// Reads the width of strokes.
fn ink_width(text: &str) -> Result<f32, String> {
    let width = text.parse().ok().filter(|px: &f32| (0.0..=MAX_INK_WIDTH).contains(px));
    width.ok_or_else(|| format!("write a number of pixels from 0 to {MAX_INK_WIDTH}"))
}

/// Reads what heights of the ground are multiplied by.
fn heights(text: &str) -> Result<f64, String> {
    let factor = text.parse().map_err(|_| "not a number".to_owned())?;
    VerticalExaggeration::default().towards(factor, 0.0, 0.0).map(|_| factor).map_err(|why| why.to_string())
}

/// Reads how long they take.
fn heights_time(text: &str) -> Result<f64, String> {
    let seconds = text.parse().map_err(|_| "not a number".to_owned())?;
    VerticalExaggeration::default().towards(1.0, seconds, 0.0).map(|_| seconds).map_err(|why| why.to_string())
}

/// Reads an angle of creases.
fn crease(text: &str) -> Result<f32, String> {
    let degrees = text.parse().ok().filter(|degrees: &f32| (0.0..=180.0).contains(degrees));
    degrees.ok_or_else(|| "write a number of degrees from 0 to 180".into())
}

/// Reads an [`AntiAliasing`] by its name.
fn smoothings() -> impl TypedValueParser<Value = AntiAliasing> {
    PossibleValuesParser::new(AntiAliasing::ALL.map(AntiAliasing::name)).try_map(|name| {
        // One of those offered.
        AntiAliasing::ALL.into_iter().find(|way| way.name() == name).ok_or("no such anti-aliasing")
    })
}

/// Reads a [`ReliefMethod`] by its name.
fn reliefs() -> impl TypedValueParser<Value = ReliefMethod> {
    PossibleValuesParser::new(ReliefMethod::ALL.map(ReliefMethod::name)).try_map(|name| {
        // One of those offered.
        ReliefMethod::ALL.into_iter().find(|way| way.name() == name).ok_or("no such way")
    })
}

/// Reads a [`ReflectionMethod`] by its name.
fn reflections() -> impl TypedValueParser<Value = ReflectionMethod> {
    PossibleValuesParser::new(ReflectionMethod::ALL.map(ReflectionMethod::name)).try_map(|name| {
        // One of those offered.
        ReflectionMethod::ALL.into_iter().find(|way| way.name() == name).ok_or("no such search")
    })
}

/// Reads a part of a whole.
fn share(text: &str) -> Result<f32, String> {
    let share: f32 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.0..=1.0).contains(&share) { Ok(share) } else { Err("not from 0 to 1".to_owned()) }
}

/// Reads [`OcclusionNormals`] by their name.
fn occlusion_normals() -> impl TypedValueParser<Value = OcclusionNormals> {
    PossibleValuesParser::new(OcclusionNormals::ALL.map(OcclusionNormals::name)).try_map(|name| {
        // One of those offered.
        OcclusionNormals::ALL.into_iter().find(|way| way.name() == name).ok_or("no such normals")
    })
}

/// Reads an [`OcclusionMethod`] by its name.
fn occlusion_methods() -> impl TypedValueParser<Value = OcclusionMethod> {
    PossibleValuesParser::new(OcclusionMethod::ALL.map(OcclusionMethod::name)).try_map(|name| {
        // One of those offered.
        OcclusionMethod::ALL.into_iter().find(|way| way.name() == name).ok_or("no such method")
    })
}

/// By which method ambient occlusion is estimated while nothing changes, if by another than always.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Still(pub(crate) Option<OcclusionMethod>);

/// Reads a [`Still`]: the name of a method, or none.
fn still_methods() -> impl TypedValueParser<Value = Still> {
    let names = OcclusionMethod::ALL.into_iter().map(OcclusionMethod::name).chain(["none"]);
    PossibleValuesParser::new(names)
        .map(|name| Still(OcclusionMethod::ALL.into_iter().find(|way| way.name() == name)))
}

/// Reads a [`ToneMapping`] by its name.
fn tones() -> impl TypedValueParser<Value = ToneMapping> {
    PossibleValuesParser::new(ToneMapping::ALL.map(ToneMapping::name)).try_map(|name| {
        // One of those offered.
        ToneMapping::ALL.into_iter().find(|tone| tone.name() == name).ok_or("no such curve")
    })
}

/// Reads a factor on light.
fn exposure(text: &str) -> Result<f32, String> {
    let factor: f32 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.001..=1000.0).contains(&factor) { Ok(factor) } else { Err("not from 0.001 to 1000".to_owned()) }
}

/// A size in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Size(pub(crate) [u32; 2]);

impl FromStr for Size {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = |side: &str| side.parse().ok().filter(|n| (1..=16_384).contains(n));
        text.split_once(['x', 'X'])
            .and_then(|(w, h)| Some(Self([parse(w)?, parse(h)?])))
            .ok_or_else(|| "write WIDTHxHEIGHT in pixels, each from 1 to 16384, for example 1280x720".into())
    }
}

/// A screen error in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PixelError(pub(crate) f32);

impl FromStr for PixelError {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let px = text.parse().ok().filter(|px: &f32| (1e-6..=1e6).contains(px));
        px.map(Self).ok_or_else(|| "write a number of pixels above 0, for example 1 or 0.5".into())
    }
}

/// A time in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Seconds(pub(crate) std::time::Duration);

impl FromStr for Seconds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let seconds = text.parse().ok().filter(|s: &f64| *s > 0.0);
        seconds
            .and_then(|s| std::time::Duration::try_from_secs_f64(s).ok())
            .map(Self)
            .ok_or_else(|| "write a number of seconds above 0".into())
    }
}

/// A camera on the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CameraArg(pub(crate) Camera);

impl FromStr for CameraArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let usage = "write eye=X,Y,Z;target=X,Y,Z[;up=X,Y,Z][;fov=DEGREES]";
        let (mut eye, mut target, mut up, mut fov) = (None, None, DVec3::Y, 50.0_f64);
        for part in text.split(';').map(str::trim).filter(|p| !p.is_empty()) {
            let (name, value) =
                part.split_once('=').ok_or_else(|| format!("{part:?} is no NAME=VALUE; {usage}"))?;
            match name.trim() {
                "eye" => eye = Some(vector(name, value)?),
                "target" => target = Some(vector(name, value)?),
                "up" => up = vector(name, value)?,
                "fov" => {
                    fov = value
                        .trim()
                        .parse()
                        .ok()
                        .filter(|f| (0.1..=175.0).contains(f))
                        .ok_or_else(|| format!("fov={value} is no angle from 0.1 to 175 degrees"))?;
                }
                other => return Err(format!("{other:?} is unknown; {usage}")),
            }
        }
        let (Some(eye), Some(target)) = (eye, target) else {
            return Err(format!("eye and target are needed; {usage}"));
        };
        if eye == target {
            return Err("eye and target are the same point".into());
        }
        // An angle in a small range.
        let fov_y = fov.to_radians() as f32;
        Ok(Self(Camera { eye: eye.into(), target: target.into(), up: up.as_vec3().into(), fov_y }))
    }
}

fn vector(name: &str, text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z] if text.matches(',').count() == 2 && [x, y, z].iter().all(|v| v.is_finite()) => {
            Ok(DVec3::new(x, y, z))
        }
        _ => Err(format!("{name}={text} is no point: write {name}=X,Y,Z")),
    }
}

impl Args {
    /// The view of a camera for the picture asked for.
    #[must_use]
    pub(crate) fn view_of(&self, camera: &Camera) -> View {
        camera.view(self.window.0, self.pixel_error.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn cameras_are_read() {
        let CameraArg(camera) = "eye=1,2,-3.5; target=0,0,0 ;fov=90".parse().unwrap();
        assert_eq!(camera.eye, [1.0, 2.0, -3.5]);
        assert!((camera.fov_y - std::f32::consts::FRAC_PI_2).abs() < 1e-6);
        for bad in [
            "",
            "eye=1,2,3",
            "eye=1,2;target=0,0,0",
            "eye=1,2,3,4;target=0,0,0",
            "eye=a,b,c;target=0,0,0",
            "eye=1,2,nan;target=0,0,0",
            "eye=1,2,3;target=1,2,3",
            "eye=1,2,3;target=0,0,0;fov=0",
            "eye=1,2,3;target=0,0,0;roll=1",
            "eye",
        ] {
            assert!(bad.parse::<CameraArg>().is_err(), "{bad}");
        }
    }

    #[test]
    fn every_view_has_a_name_that_is_read() {
        for shade in DebugView::ALL {
            let args = Args::try_parse_from(["viewer", "ws://h:1", "--view", shade.name()]).unwrap();
            assert_eq!(args.view, shade);
            assert_eq!(crate::run::settings(&args, true).debug_view, shade);
        }
        let args = Args::try_parse_from(["viewer", "ws://h:1", "--colour-by-level"]).unwrap();
        assert_eq!(crate::run::settings(&args, true).debug_view, DebugView::Level);
        for bad in [&["--view", "velocity"][..], &["--view", "normal", "--colour-by-level"]] {
            assert!(Args::try_parse_from(["viewer", "ws://h:1"].iter().chain(bad)).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn sizes_errors_and_times_are_bounded() {
        assert_eq!("640x360".parse(), Ok(Size([640, 360])));
        for bad in ["640", "0x10", "10x0", "axb", "99999x1", "-1x5"] {
            assert!(bad.parse::<Size>().is_err(), "{bad}");
        }
        for (wrong, said) in [
            (["--ground-heights", "nan"], "must be 0 to 100, not NaN"),
            (["--ground-heights", "-2"], "must be 0 to 100, not -2"),
            (["--ground-seconds", "inf"], "for 0 seconds or longer, not for inf"),
        ] {
            let wrong = wrong.join("=");
            let error = Args::try_parse_from(["viewer", "ws://h:1", &wrong]).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
        assert!("0".parse::<PixelError>().is_err() && "nan".parse::<PixelError>().is_err());
        assert!("0".parse::<Seconds>().is_err() && "1e300".parse::<Seconds>().is_err());
        assert!(Args::try_parse_from(["viewer", "ws://h:1", "--headless"]).is_err());
        assert!(Args::try_parse_from(["viewer", "quic://h:1#sha256="]).is_err());
        let args = Args::try_parse_from([
            "viewer",
            "ws://h:1",
            "--headless",
            "--output",
            "x.png",
            "--camera",
            "eye=-1,0,0;target=0,0,0",
        ]);
        assert!(args.is_ok(), "{args:?}");
    }
}
