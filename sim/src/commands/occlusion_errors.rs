//! `lodestream-sim occlusion-errors`: arguments; prints a line per method, number of samples and view.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use lodestream_render::{MAX_SAMPLES, OcclusionMethod, OcclusionNormals, OcclusionRadius};
use lodestream_report::pictures::frame_time::MAX_FRAMES;
use lodestream_report::pictures::occlusion::{MAX_RAYS, Question, occlusion_errors};
use lodestream_scene::description::Camera;

use crate::arguments::DrawnCase;

/// Vertical field of view of cameras besides the scene's own.
const FOV_Y: f32 = 0.9;

/// The plan must have one case, which runs with its first seed.
#[derive(Debug, Args)]
pub(crate) struct OcclusionErrors {
    #[command(flatten)]
    case: DrawnCase,
    /// A camera besides the scene's own, as X,Y,Z,X,Y,Z: position and target; may be given more than once.
    #[arg(long, value_name = "CAMERA", value_parser = camera, allow_hyphen_values = true)]
    view: Vec<Camera>,
    /// Methods, separated by commas.
    #[arg(long, value_delimiter = ',', value_parser = methods(), default_values_t = OcclusionMethod::ALL.map(Named))]
    methods: Vec<Named<OcclusionMethod>>,
    /// Sources of normals, separated by commas; combined with each method.
    #[arg(long, value_delimiter = ',', value_parser = normals(), default_values_t = [Named(OcclusionNormals::default())])]
    normals: Vec<Named<OcclusionNormals>>,
    /// Also draw single frames at half resolution, except `hbao-plus`, whose layers are always full.
    #[arg(long)]
    half: bool,
    /// Samples per pixel, separated by commas; combined with each method.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "8,16,32",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_SAMPLES))
    )]
    samples: Vec<u32>,
    /// Samples per pixel and frame of means over 16 still frames, for each method; 0 for none.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(0..=i64::from(MAX_SAMPLES)))]
    still: u32,
    /// Radius of occlusion as a fraction of the view depth.
    #[arg(long, default_value_t = 0.06)]
    radius: f32,
    /// Rays per pixel.
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_RAYS)))]
    rays: u32,
    /// Timed frames of each.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
    /// Write the pictures into this folder.
    #[arg(long, value_name = "FOLDER")]
    pictures: Option<PathBuf>,
}

/// A value selected by its name.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Named<T>(T);

impl std::fmt::Display for Named<OcclusionMethod> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.0.name())
    }
}

impl std::fmt::Display for Named<OcclusionNormals> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.0.name())
    }
}

fn methods() -> impl TypedValueParser<Value = Named<OcclusionMethod>> {
    PossibleValuesParser::new(OcclusionMethod::ALL.map(OcclusionMethod::name)).try_map(|name| {
        // The name is one of those offered.
        OcclusionMethod::ALL.into_iter().find(|way| way.name() == name).map(Named).ok_or("no such method")
    })
}

fn normals() -> impl TypedValueParser<Value = Named<OcclusionNormals>> {
    PossibleValuesParser::new(OcclusionNormals::ALL.map(OcclusionNormals::name)).try_map(|name| {
        OcclusionNormals::ALL.into_iter().find(|way| way.name() == name).map(Named).ok_or("no such normals")
    })
}

pub(super) fn camera(text: &str) -> Result<Camera, String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|n| n.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    match numbers.as_deref() {
        Some(&[ex, ey, ez, tx, ty, tz]) if [ex, ey, ez] != [tx, ty, tz] => {
            Ok(Camera { eye: [ex, ey, ez], target: [tx, ty, tz], up: [0.0, 1.0, 0.0], fov_y: FOV_Y })
        }
        _ => Err("write six numbers, the eye's place and another that it looks at".to_owned()),
    }
}

impl OcclusionErrors {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let question = Question {
            cameras: self.view.clone(),
            methods: self.methods.iter().map(|named| named.0).collect(),
            samples: self.samples.clone(),
            normals: self.normals.iter().map(|named| named.0).collect(),
            half: self.half,
            still: self.still,
            radius: OcclusionRadius::Depth(self.radius),
            rays: self.rays,
            frames: self.frames,
        };
        self.case.run(|plan, scene, gpu| {
            occlusion_errors(plan, scene, gpu, &question, |name, picture| {
                let Some(folder) = &self.pictures else { return Ok(()) };
                let file = folder.join(format!("{name}.png"));
                let fail = || format!("{}: cannot be written", file.display());
                std::fs::create_dir_all(folder).with_context(fail)?;
                picture.save(&file).with_context(fail)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::parsed;

    #[test]
    fn methods_samples_and_views_are_read() {
        let all = parsed::<OcclusionErrors>("plan.toml", &[]).unwrap();
        assert_eq!(all.methods, OcclusionMethod::ALL.map(Named));
        assert_eq!((all.samples.as_slice(), all.rays, all.view.len()), (&[8, 16, 32][..], 512, 0));
        assert_eq!(all.normals, [Named(OcclusionNormals::default())]);
        let some = parsed::<OcclusionErrors>(
            "plan.toml",
            &["--methods", "gtao,bitmask", "--normals", "drawn,extended", "--view", "-1,2,3,0,0,0.5"],
        )
        .unwrap();
        assert_eq!(some.normals, [OcclusionNormals::Drawn, OcclusionNormals::Extended].map(Named));
        assert_eq!(some.methods, [OcclusionMethod::Gtao, OcclusionMethod::Bitmask].map(Named));
        assert_eq!((some.view[0].eye, some.view[0].target), ([-1.0, 2.0, 3.0], [0.0, 0.0, 0.5]));
        for wrong in [
            ["--methods", "guess"],
            ["--normals", "smooth"],
            ["--samples", "65"],
            ["--view", "1,2,3"],
            ["--view", "0,0,0,0,0,0"],
        ] {
            assert!(parsed::<OcclusionErrors>("plan.toml", &wrong).is_err(), "{wrong:?}");
        }
    }
}
