//! `lodestream-sim reflection-errors`: arguments; prints a line per search and view.

use clap::Args;
use lodestream_render::Reflections;
use lodestream_report::pictures::frame_time::MAX_FRAMES;
use lodestream_report::pictures::reflections::{Question, reflection_errors, search};
use lodestream_scene::description::Camera;

use super::occlusion_errors::camera;
use crate::arguments::DrawnCase;

/// The plan must have one case, which runs with its first seed.
#[derive(Debug, Args)]
pub(crate) struct ReflectionErrors {
    #[command(flatten)]
    case: DrawnCase,
    /// A camera besides the scene's own, as X,Y,Z,X,Y,Z: position and target; may be given more than once.
    #[arg(long, value_name = "CAMERA", value_parser = camera, allow_hyphen_values = true)]
    view: Vec<Camera>,
    /// Searches with their step limits, separated by commas.
    #[arg(
        long,
        value_delimiter = ',',
        value_parser = named_search,
        default_value = "linear:150,linear:1000,hi-z:50,hi-z:100,hi-z:200,hi-z:400"
    )]
    searches: Vec<Reflections>,
    /// Thicknesses of surfaces relative to their depth, separated by commas.
    #[arg(long, value_delimiter = ',', default_values_t = [0.02], value_parser = thickness)]
    thicknesses: Vec<f64>,
    /// Timed frames of each.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
}

fn named_search(text: &str) -> Result<Reflections, String> {
    search(text).map_err(|why| format!("{why:#}"))
}

fn thickness(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..=1000.0).contains(share));
    share.ok_or_else(|| "write a share from 0 to 1000".to_owned())
}

impl ReflectionErrors {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let question = Question {
            cameras: self.view.clone(),
            searches: self.searches.clone(),
            thicknesses: self.thicknesses.clone(),
            frames: self.frames,
        };
        self.case.run(|plan, scene, gpu| reflection_errors(plan, scene, gpu, &question))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::parsed;

    #[test]
    fn searches_and_thicknesses_are_read() {
        let all = parsed::<ReflectionErrors>("plan.toml", &[]).unwrap();
        // As the shader has it.
        assert_eq!(
            (all.searches.len(), all.thicknesses[0] as f32),
            (6, lodestream_render::REFLECTION_THICKNESS)
        );
        let some =
            parsed::<ReflectionErrors>("plan.toml", &["--searches", "hi-z:7", "--thicknesses", "0,0.5"])
                .unwrap();
        assert_eq!((some.searches[0].steps, some.thicknesses.as_slice()), (7, &[0.0, 0.5][..]));
        for wrong in [["--searches", "hi-z"], ["--thicknesses", "nan"], ["--frames", "0"]] {
            assert!(parsed::<ReflectionErrors>("plan.toml", &wrong).is_err(), "{wrong:?}");
        }
    }
}
