//! `lodestream-sim draw-trade`: arguments; prints a line per value.

use clap::Args;
use lodestream_render::{MAP_SIDES, MAX_FILTER, MAX_RELIEF_STEPS, MAX_SAMPLES, ReliefMethod};
use lodestream_report::pictures::draw_trade::{Setting, draw_trade};
use lodestream_report::pictures::frame_time::MAX_FRAMES;
use lodestream_viewing::STEPS;

use crate::arguments::{DrawnCase, target_px};

/// Most values of a run: each terrain error keeps a scene on the graphics device.
const MAX_VALUES: usize = 16;

/// The plan must have one case, which runs with its first seed.
#[derive(Debug, Args)]
pub(crate) struct DrawTrade {
    #[command(flatten)]
    case: DrawnCase,
    #[command(flatten)]
    setting: SettingArguments,
    /// Timed frames with each value, after two untimed ones.
    #[arg(long, default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_FRAMES)))]
    frames: u32,
}

/// The setting; the last value is the best, with which others are compared.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct SettingArguments {
    /// Linear steps of relief mapping at grazing angles, separated by commas; 0 turns it off.
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=i64::from(MAX_RELIEF_STEPS)))]
    relief_steps: Option<Vec<u32>>,
    /// Methods of relief mapping, separated by commas: 0 none, 1 parallax, 2 steep parallax, 3 parallax occlusion, 4
    /// relief, 5 relaxed cones, 6 quadtree.
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=ReliefMethod::ALL.len() as i64))]
    relief_methods: Option<Vec<u32>>,
    /// Samples of ambient occlusion per pixel, separated by commas; 0 turns it off.
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=i64::from(MAX_SAMPLES)))]
    occlusion_samples: Option<Vec<u32>>,
    /// Texels along a side of the shadow maps, separated by commas; 0 turns shadows off.
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=i64::from(MAP_SIDES[1])))]
    shadow_sides: Option<Vec<u32>>,
    /// Bilinear shadow lookups along a side, separated by commas; 0 turns shadows off.
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=i64::from(MAX_FILTER)))]
    shadow_filters: Option<Vec<u32>>,
    /// Anti-aliasing, 0 or 1, separated by commas.
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..=1))]
    smooth_edges: Option<Vec<u32>>,
    /// Screen errors of the terrain in pixels, separated by commas.
    #[arg(long, value_delimiter = ',', value_parser = target_px)]
    ground_px: Option<Vec<f32>>,
    /// Steps of quality while the camera moves, separated by commas; 0 is full quality.
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u32).range(0..STEPS.len() as i64))]
    quality_steps: Option<Vec<u32>>,
}

impl SettingArguments {
    fn setting(&self) -> anyhow::Result<Setting> {
        let (setting, count) = match self {
            Self { relief_steps: Some(steps), .. } => (Setting::ReliefSteps(steps.clone()), steps.len()),
            Self { relief_methods: Some(ways), .. } => (Setting::ReliefMethods(ways.clone()), ways.len()),
            Self { occlusion_samples: Some(samples), .. } => {
                (Setting::OcclusionSamples(samples.clone()), samples.len())
            }
            Self { shadow_sides: Some(sides), .. } => (Setting::ShadowSides(sides.clone()), sides.len()),
            Self { shadow_filters: Some(filters), .. } => {
                (Setting::ShadowFilters(filters.clone()), filters.len())
            }
            Self { smooth_edges: Some(smooth), .. } => (Setting::SmoothEdges(smooth.clone()), smooth.len()),
            Self { ground_px: Some(px), .. } => (Setting::GroundPx(px.clone()), px.len()),
            Self { quality_steps: Some(steps), .. } => (Setting::QualitySteps(steps.clone()), steps.len()),
            _ => anyhow::bail!(
                "name --relief-steps, --relief-methods, --occlusion-samples, --shadow-sides, --shadow-filters, --smooth-edges, --ground-px or --quality-steps"
            ),
        };
        anyhow::ensure!(count <= MAX_VALUES, "{count} values are given; {MAX_VALUES} are the most");
        Ok(setting)
    }
}

impl DrawTrade {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let setting = self.setting.setting()?;
        self.case.run(|plan, scene, gpu| draw_trade(plan, scene, gpu, &setting, self.frames))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::parsed;

    fn setting(arguments: &[&str]) -> Result<Setting, String> {
        parsed::<DrawTrade>("plan.toml", arguments)?.setting.setting().map_err(|why| why.to_string())
    }

    #[test]
    fn one_setting_is_selected() {
        assert_eq!(setting(&["--relief-steps", "0,48,192"]), Ok(Setting::ReliefSteps(vec![0, 48, 192])));
        assert_eq!(setting(&["--occlusion-samples", "0,64"]), Ok(Setting::OcclusionSamples(vec![0, 64])));
        assert_eq!(setting(&["--ground-px", "8,0.5"]), Ok(Setting::GroundPx(vec![8.0, 0.5])));
    }

    #[test]
    fn other_numbers_of_settings_and_values_out_of_range_are_refused() {
        let cases: [&[&str]; 9] = [
            &[],
            &["--relief-steps", "1", "--ground-px", "1"],
            &["--relief-steps", "1025"],
            &["--relief-methods", "7"],
            &["--relief-steps", ""],
            &["--occlusion-samples", "65"],
            &["--ground-px", "0"],
            &["--quality-steps", "11"],
            &["--ground-px", "1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1"],
        ];
        for case in cases {
            assert!(setting(case).is_err(), "{case:?}");
        }
    }
}
