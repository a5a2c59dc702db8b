//! Command line of the viewer.

use std::ffi::OsString;
use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;
use std::str::FromStr;

use clap::Parser;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use glam::DVec3;
use lodestream_bake::scene::UpAxis;
use lodestream_scene::description::Camera;
use lodestream_scene::section::SectionPlanes;
use lodestream_scene::view::View;
use lodestream_viewing::CameraController;

use lodestream_render::{
    AntiAliasing, DebugView, Ink, MAX_INK_LEVELS, MAX_INK_WIDTH, MAX_REFLECTION_STEPS, OcclusionMethod,
    OcclusionNormals, ReflectionMethod, ReliefMethod, ToneMapping, VerticalExaggeration,
};

use crate::outcome::EXIT_CODES;
use crate::part_args::{PartArg, PixelArg, SectionArg, TintArg};

/// Shows models and scenes: those of files, and those that a Lodestream server streams.
#[derive(Clone, Debug, Parser)]
#[command(name = "lodestream-viewer", version, about, after_help = EXIT_CODES)]
pub(crate) struct Args {
    /// What to show: models (OBJ, glTF, GLB, PLY, STL) and packs (.lsp), side by side, or a folder of them; a scene file
    /// (.toml), a published scene (.lss) or a folder with one; or a server's address: quic://HOST:PORT#PIN (as the
    /// server prints it), wss://HOST:PORT or ws://HOST:PORT; of a server with several scenes, with the scene's name behind
    /// it: ws://HOST:PORT/NAME. Without a fingerprint, the certificate must be signed by an authority that the system
    /// trusts. Without anything, an empty window opens, into which files can be dropped
    #[arg(value_name = "FILE | ADDRESS",
        required_if_eq_any([("headless", "true"), ("exit_when_settled", "true")]))]
    pub(crate) files: Vec<OsString>,
    /// Print help with all options
    #[arg(long)]
    pub(crate) help_all: bool,
    /// Show files anew when they change; the camera stays
    #[arg(long, conflicts_with = "headless")]
    pub(crate) watch: bool,
    /// Serve what is shown to other viewers, once it is prepared, and print its address; anyone who reaches the address
    /// may see it
    #[arg(long, value_name = "IP:PORT", num_args = 0..=1, require_equals = true,
        default_missing_value = "0.0.0.0:4433", conflicts_with = "headless")]
    pub(crate) share: Option<SocketAddr>,
    /// Axis of models that points up: x, y, z, -x, -y or -z [default: z for STL, y for others]
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// Folder of files' prepared packs [default: $XDG_CACHE_HOME/lodestream or ~/.cache/lodestream]
    #[arg(long, env = "LODESTREAM_CACHE", value_name = "DIR")]
    pub(crate) cache: Option<PathBuf>,
    /// Settings file, with the keys of the window [default: $XDG_CONFIG_HOME/lodestream/viewer.toml or
    /// ~/.config/lodestream/viewer.toml, if there is one]
    #[arg(long, env = "LODESTREAM_VIEWER_SETTINGS", value_name = "FILE", conflicts_with = "headless")]
    pub(crate) settings: Option<PathBuf>,
    /// Trust only the certificate authorities in this file (PEM), not the system's
    #[arg(long, value_name = "FILE")]
    pub(crate) ca: Option<PathBuf>,
    /// File with the access token for the server; read again when it changes. Default: the environment's
    /// LODESTREAM_TOKEN
    #[arg(long, value_name = "FILE")]
    pub(crate) token_file: Option<PathBuf>,
    /// Size of the window or picture in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720")]
    pub(crate) window: Size,
    /// Open no window: wait until the picture is settled and write it to --output
    #[arg(long, requires = "output")]
    pub(crate) headless: bool,
    /// File for the picture (PNG)
    #[arg(long, value_name = "FILE.png")]
    pub(crate) output: Option<PathBuf>,
    /// Print what a part is called, as a line of JSON: of an instance, a part's number, 0 outside batches. May be repeated
    #[arg(long, value_name = "INSTANCE:PART", requires = "headless")]
    pub(crate) part: Vec<PartArg>,
    /// Camera: `eye=X,Y,Z;target=X,Y,Z`, optionally with `;up=X,Y,Z` and `;fov=DEGREES`. Default: the scene's camera
    #[arg(long, value_name = "CAMERA", allow_hyphen_values = true)]
    pub(crate) camera: Option<CameraArg>,
    /// Parallel projection; what is at the camera's target keeps its size
    #[arg(long)]
    pub(crate) orthographic: bool,
    /// Section plane: cuts away from meshes what lies where X·x + Y·y + Z·z > D, in world units, and fills closed ones
    /// there. May be repeated, up to three planes
    #[arg(long, value_name = "X,Y,Z,D", allow_hyphen_values = true)]
    pub(crate) section: Vec<SectionArg>,
    /// Size of the pictures that a key of the window writes [default: the window's]
    #[arg(long, value_name = "WxH", conflicts_with = "headless")]
    pub(crate) picture_size: Option<Size>,
    /// Write pictures with a transparent background
    #[arg(long)]
    pub(crate) transparent: bool,
    /// Write this many pictures from around the camera's target, numbered from FILE-0001.png
    #[arg(long, value_name = "PICTURES", requires = "headless",
        value_parser = picture_count)]
    pub(crate) turntable: Option<NonZeroU32>,
    /// Write a picture from each camera of a file, one a line as --camera has them, numbered from FILE-0001.png
    #[arg(long, value_name = "FILE", requires = "headless", conflicts_with_all = ["turntable", "camera"])]
    pub(crate) camera_path: Option<PathBuf>,
    /// Screen error to refine to, in pixels
    #[arg(long, value_name = "PX", default_value = "1")]
    pub(crate) pixel_error: PixelError,
    /// Frames a second to aim for while the camera moves, 1 to 1000 [default: 60; of a software driver 30]
    #[arg(long, value_name = "N", conflicts_with = "headless")]
    pub(crate) frame_rate: Option<FrameRate>,
    /// Exit when the picture is settled, or incomplete with nothing more to arrive
    #[arg(long)]
    pub(crate) exit_when_settled: bool,
    /// Exit after this time (default with --headless: 300, once files are prepared)
    #[arg(long, value_name = "SECONDS")]
    pub(crate) timeout: Option<Seconds>,
    /// Write the run's statistics as JSON
    #[arg(long, value_name = "FILE.json")]
    pub(crate) stats: Option<PathBuf>,
    /// Save the frames shown in the first three seconds, the first complete frame and the last frame in this folder,
    /// with their times in frames.json
    #[arg(long, value_name = "DIR", conflicts_with = "headless")]
    pub(crate) frames: Option<PathBuf>,
    /// Start with the overlay hidden; H shows and hides it
    #[arg(long)]
    pub(crate) no_overlay: bool,
    /// Print the run's statistics as a table at the end
    #[arg(long)]
    pub(crate) figures: bool,
    /// What to draw: the materials, or an intermediate result of the renderer
    #[arg(long, value_name = "NAME", default_value = "material", value_parser = named(DebugView::ALL, DebugView::name))]
    pub(crate) view: DebugView,
    /// The same as --view level
    #[arg(long, conflicts_with = "view")]
    pub(crate) colour_by_level: bool,
    /// Tone mapping curve: filmic, or neutral, which keeps base colours
    #[arg(long, value_name = "NAME", default_value = "filmic", value_parser = named(ToneMapping::ALL, ToneMapping::name))]
    pub(crate) tone_mapping: ToneMapping,
    /// Exposure: factor on light before tone mapping, 0.001 to 1000
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = exposure)]
    pub(crate) exposure: f32,
    /// Draw the edges of triangles
    #[arg(long)]
    pub(crate) wireframe: bool,
    /// No ambient occlusion
    #[arg(long)]
    pub(crate) no_ao: bool,
    /// Method of ambient occlusion
    #[arg(long, value_name = "NAME", default_value = OcclusionMethod::default().name(), value_parser = named(OcclusionMethod::ALL, OcclusionMethod::name))]
    pub(crate) occlusion_method: OcclusionMethod,
    /// Method of ambient occlusion for a picture at rest, as the mean of 16 frames; none: the same as in motion.
    /// Default: gtao on a GPU, none with a software driver
    #[arg(long, value_name = "NAME", value_parser = named(StillMethod::all(), StillMethod::name))]
    pub(crate) occlusion_still: Option<StillMethod>,
    /// Source of normals for ambient occlusion: the neighbours nearest in depth, the drawn normals, or continued
    /// surfaces
    #[arg(long, value_name = "NAME", default_value = OcclusionNormals::default().name(), value_parser = named(OcclusionNormals::ALL, OcclusionNormals::name))]
    pub(crate) occlusion_normals: OcclusionNormals,
    /// Ambient occlusion at one pixel of each 2×2 in frames that are not averaged; not with hbao-plus
    #[arg(long, conflicts_with = "no_ao")]
    pub(crate) occlusion_half: bool,
    /// No sun shadows
    #[arg(long)]
    pub(crate) no_shadows: bool,
    /// Anti-aliasing. Default: temporal on a GPU, spatial with a software driver
    #[arg(long, value_name = "NAME", value_parser = named(AntiAliasing::ALL, AntiAliasing::name))]
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
    /// Screen-space reflections of smooth surfaces and water. Default: they reflect the sky only
    #[arg(long, value_name = "NAME", value_parser = named(ReflectionMethod::ALL, ReflectionMethod::name))]
    pub(crate) reflections: Option<ReflectionMethod>,
    /// Most steps of a reflection ray
    #[arg(long, value_name = "STEPS", default_value_t = 100, requires = "reflections",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_REFLECTION_STEPS)))]
    pub(crate) reflection_steps: u32,
    /// Bloom: share of light that spreads around bright pixels, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, default_missing_value = "0.04", num_args = 0..=1,
        value_parser = share)]
    pub(crate) bloom: f32,
    /// Vertical exaggeration: factor on terrain heights, 0 to 100; objects on the terrain move with it
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, value_parser = exaggeration)]
    pub(crate) ground_heights: f64,
    /// Seconds over which terrain heights change; at once with --headless
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = exaggeration_seconds)]
    pub(crate) ground_seconds: f64,
    /// Print the part that this pixel of the finished picture shows, from its upper left corner; may be repeated
    #[arg(long, value_name = "X,Y", requires = "headless")]
    pub(crate) pick: Vec<PixelArg>,
    /// Hide a part; may be repeated, as may --isolate and --tint
    #[arg(long, value_name = "INSTANCE:PART")]
    pub(crate) hide: Vec<PartArg>,
    /// Draw this part without others
    #[arg(long, value_name = "INSTANCE:PART")]
    pub(crate) isolate: Vec<PartArg>,
    /// Tint a part
    #[arg(long, value_name = "INSTANCE:PART=RRGGBB")]
    pub(crate) tint: Vec<TintArg>,
    /// Play this clip [default: the scene's first]
    #[arg(long, value_name = "NAME")]
    pub(crate) animation: Option<String>,
    /// Show clips at this time instead of playing them. With --headless clips are shown only if one or a time is given
    #[arg(long, value_name = "SECONDS", value_parser = clip_time)]
    pub(crate) animation_time: Option<f64>,
    /// No relief mapping
    #[arg(long)]
    pub(crate) no_relief: bool,
    /// Ray search of relief mapping on meshes, cheapest first
    #[arg(long, value_name = "NAME", value_parser = named(ReliefMethod::ALL, ReliefMethod::name), conflicts_with = "no_relief")]
    pub(crate) relief_method: Option<ReliefMethod>,
    /// Relief mapping of meshes casts shadows on itself
    #[arg(long, conflicts_with = "no_relief")]
    pub(crate) relief_shadows: bool,
    /// Relief mapping of meshes writes depth, so that objects intersect the relief where it is drawn
    #[arg(long, conflicts_with = "no_relief")]
    pub(crate) relief_in_depth: bool,
    /// Curved PN triangles for meshes, tessellated to an error of at most this many pixels
    #[arg(long, value_name = "PX", num_args = 0..=1, require_equals = true, default_missing_value = "0.25")]
    pub(crate) pn_triangles: Option<PixelError>,
    /// Ink drawing: strokes along contours and creases of meshes, this many pixels wide, and light in levels
    #[arg(long, value_name = "PX", num_args = 0..=1, require_equals = true, default_missing_value = "2",
        value_parser = ink_width)]
    pub(crate) ink: Option<f32>,
    /// Levels of light under ink; 1 leaves light unchanged
    #[arg(long, value_name = "N", default_value_t = Ink::default().levels, requires = "ink",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_INK_LEVELS)))]
    pub(crate) ink_levels: u32,
    /// Least angle between two faces whose edge is drawn as a crease; 180 draws none
    #[arg(long, value_name = "DEGREES", default_value_t = Ink::default().crease_degrees, requires = "ink",
        value_parser = crease_degrees)]
    pub(crate) ink_crease: f32,
    /// Spatter of the borders between levels of light, in levels, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = Ink::default().spatter, requires = "ink",
        value_parser = share)]
    pub(crate) ink_spatter: f32,
    /// Most faces in use over all assets
    #[arg(long, value_name = "FACES", default_value_t = 8_000_000)]
    pub(crate) max_faces: u64,
    /// Size of the cache for received data, in MiB
    #[arg(long, value_name = "MIB", default_value_t = 128)]
    pub(crate) cache_mib: u32,
    /// Threads that decode meshes. Default: all of the machine's cores but one
    #[arg(long, value_name = "N")]
    pub(crate) decode_threads: Option<NonZeroUsize>,
}

/// Parses one of `values` by its name. The renderer's enums state their names themselves and do not depend on clap, so
/// that they cannot implement its `ValueEnum`.
fn named<T: Copy + Send + Sync + 'static>(
    values: impl IntoIterator<Item = T>,
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T> {
    let values: Vec<T> = values.into_iter().collect();
    let names = PossibleValuesParser::new(values.iter().map(|value| name(*value)).collect::<Vec<_>>());
    names.try_map(move |text| values.iter().copied().find(|value| name(*value) == text).ok_or("unknown name"))
}

/// Parses a number of pictures.
fn picture_count(text: &str) -> Result<NonZeroU32, String> {
    let count = text.parse().ok().filter(|count: &NonZeroU32| count.get() <= 100_000);
    count.ok_or_else(|| "write a number of pictures from 1 to 100000".into())
}

/// Parses the width of strokes.
fn ink_width(text: &str) -> Result<f32, String> {
    let width = text.parse().ok().filter(|px: &f32| (0.0..=MAX_INK_WIDTH).contains(px));
    width.ok_or_else(|| format!("write a number of pixels from 0 to {MAX_INK_WIDTH}"))
}

/// Parses a vertical exaggeration.
fn exaggeration(text: &str) -> Result<f64, String> {
    let factor = text.parse().map_err(|_| "write a number".to_owned())?;
    VerticalExaggeration::default().towards(factor, 0.0, 0.0).map(|_| factor).map_err(|why| why.to_string())
}

/// Parses the duration of a change of the vertical exaggeration.
fn exaggeration_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().map_err(|_| "write a number".to_owned())?;
    VerticalExaggeration::default().towards(1.0, seconds, 0.0).map(|_| seconds).map_err(|why| why.to_string())
}

/// Parses a time of a clip.
fn clip_time(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| (0.0..=1e9).contains(seconds));
    seconds.ok_or_else(|| "write a number of seconds from 0".to_owned())
}

/// Parses the least angle of creases.
fn crease_degrees(text: &str) -> Result<f32, String> {
    let degrees = text.parse().ok().filter(|degrees: &f32| (0.0..=180.0).contains(degrees));
    degrees.ok_or_else(|| "write a number of degrees from 0 to 180".into())
}

/// Parses a share.
fn share(text: &str) -> Result<f32, String> {
    let share: f32 = text.parse().map_err(|_| "write a number".to_owned())?;
    if (0.0..=1.0).contains(&share) { Ok(share) } else { Err("write a number from 0 to 1".to_owned()) }
}

/// Occlusion method for a picture at rest; `None` is the method of moving pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct StillMethod(pub(crate) Option<OcclusionMethod>);

impl StillMethod {
    fn name(self) -> &'static str {
        self.0.map_or("none", OcclusionMethod::name)
    }

    fn all() -> impl Iterator<Item = Self> {
        OcclusionMethod::ALL.map(Some).into_iter().chain([None]).map(Self)
    }
}

/// Parses an exposure.
fn exposure(text: &str) -> Result<f32, String> {
    let factor: f32 = text.parse().map_err(|_| "write a number".to_owned())?;
    if (0.001..=1000.0).contains(&factor) {
        Ok(factor)
    } else {
        Err("write a number from 0.001 to 1000".to_owned())
    }
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

/// Frames a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FrameRate(pub(crate) f64);

impl FromStr for FrameRate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let rate = text.parse().ok().filter(|rate: &f64| (1.0..=1000.0).contains(rate));
        rate.map(Self).ok_or_else(|| "write a number of frames a second from 1 to 1000".into())
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

/// Camera given on the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CameraArg(pub(crate) Camera);

impl FromStr for CameraArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let usage = "write eye=X,Y,Z;target=X,Y,Z[;up=X,Y,Z][;fov=DEGREES]";
        let (mut eye, mut target, mut up, mut fov) = (None, None, DVec3::Y, 50.0_f64);
        for part in text.split(';').map(str::trim).filter(|p| !p.is_empty()) {
            let (name, value) =
                part.split_once('=').ok_or_else(|| format!("{part:?} is not NAME=VALUE; {usage}"))?;
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
                        .ok_or_else(|| format!("fov={value} is not an angle from 0.1 to 175 degrees"))?;
                }
                other => return Err(format!("unknown part {other:?}; {usage}")),
            }
        }
        let (Some(eye), Some(target)) = (eye, target) else {
            return Err(format!("eye and target are required; {usage}"));
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
        _ => Err(format!("{name}={text} is not a point: write {name}=X,Y,Z")),
    }
}

impl Args {
    /// The view of a camera at the window's size and the pixel error.
    #[must_use]
    pub(crate) fn view_of(&self, camera: &Camera) -> View {
        self.projected(*camera).view(self.window.0, self.pixel_error.0)
    }

    /// A camera with the projection that is asked for.
    pub(crate) fn projected(&self, camera: Camera) -> Camera {
        if self.orthographic { camera.orthographic() } else { camera }
    }

    /// The section planes; [`crate::run::check`] refuses too many.
    pub(crate) fn sections(&self) -> Option<SectionPlanes> {
        SectionPlanes::new(&self.section.iter().map(|section| section.0).collect::<Vec<_>>())
    }

    /// A controller that starts at a camera, with the projection that is asked for.
    pub(crate) fn controller(&self, camera: Camera) -> CameraController {
        let mut controller = CameraController::new(camera);
        controller.orthographic = self.orthographic;
        controller
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
    fn cameras_are_parsed() {
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
    fn every_debug_view_is_parsed_by_its_name() {
        for view in DebugView::ALL {
            let args = Args::try_parse_from(["viewer", "ws://h:1", "--view", view.name()]).unwrap();
            assert_eq!(args.view, view);
            assert_eq!(crate::run::settings(&args, true).debug_view, view);
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
        for (wrong, message) in [
            (["--ground-heights", "nan"], "must be 0 to 100, not NaN"),
            (["--ground-heights", "-2"], "must be 0 to 100, not -2"),
            (["--ground-seconds", "inf"], "must be 0 seconds or longer, not inf"),
        ] {
            let wrong = wrong.join("=");
            let error = Args::try_parse_from(["viewer", "ws://h:1", &wrong]).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        }
        assert!("0".parse::<FrameRate>().is_err() && "nan".parse::<FrameRate>().is_err());
        assert!("0".parse::<PixelError>().is_err() && "nan".parse::<PixelError>().is_err());
        assert!("0".parse::<Seconds>().is_err() && "1e300".parse::<Seconds>().is_err());
        assert!(Args::try_parse_from(["viewer", "ws://h:1", "--headless"]).is_err());
        assert!(Args::try_parse_from(["viewer"]).is_ok());
        for alone in [&["--headless", "--output", "x.png"][..], &["--exit-when-settled"]] {
            assert!(Args::try_parse_from([&["viewer"], alone].concat()).is_err(), "{alone:?}");
        }
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
