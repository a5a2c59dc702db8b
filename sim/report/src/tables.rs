//! A report's CSV tables: a line per run, case, picture or level.

use std::collections::BTreeSet;
use std::fmt::Display;

use lodestream_client::core::QUALITIES_PX;
use lodestream_scenario::picture::Picture;
use lodestream_scenario::result::{RunResult, error_name};

use super::csv_text::csv_text;
use super::levels::Level;
use super::percentiles::Percentiles;

/// A line that grows field by field, with the fields' names.
#[derive(Default)]
struct Line {
    names: Vec<String>,
    fields: Vec<String>,
}

impl Line {
    fn add(&mut self, name: impl Into<String>, value: impl Display) {
        self.names.push(name.into());
        self.fields.push(value.to_string());
    }

    /// A line that begins with a run and its number in the plan.
    fn of_run(number: usize, run: &RunResult) -> Self {
        let mut line = Self::default();
        line.add("run", number);
        line.add("scene", &run.scene);
        line.add("transport", run.transport);
        line.add("link", &run.link);
        line.add("camera", &run.camera);
        line.add("seed", run.seed);
        line
    }

    /// Adds a field that is empty without a value.
    fn add_some(&mut self, name: impl Into<String>, value: Option<impl Display>) {
        self.add(name, value.map(|value| value.to_string()).unwrap_or_default());
    }
}

/// The names of the first line, then all lines. All have the same names.
fn table(lines: impl Iterator<Item = Line>) -> String {
    let lines: Vec<Line> = lines.collect();
    let names = lines.first().map(|line| &line.names);
    csv_text(names.into_iter().chain(lines.iter().map(|line| &line.fields)))
}

/// A line per run, with the names of `results.json`, without the series.
#[must_use]
pub(super) fn of_runs(results: &[RunResult]) -> String {
    table(results.iter().map(|run| {
        let mut line = Line::default();
        line.add("scene", &run.scene);
        line.add("technique", &run.technique);
        line.add("transport", run.transport);
        line.add("resumed", run.resumed);
        line.add("link", &run.link);
        line.add("camera", &run.camera);
        line.add("rate_bits_per_s", run.rate_bits_per_s);
        line.add("rtt_ms", run.rtt_ms);
        line.add("loss", run.loss);
        line.add("queue_bytes", run.queue_bytes);
        line.add_some("limiter_bits_per_s", run.limiter_bits_per_s);
        line.add("seed", run.seed);
        line.add_some("ttff_ms", run.ttff_ms);
        line.add_some("first_frame_bytes", run.first_frame_bytes);
        line.add_some("ttff_bound_ms", run.ttff_bound_ms());
        for px in QUALITIES_PX.map(error_name) {
            line.add_some(format!("ttq_{px}_ms"), run.ttq_ms.get(&px).copied().flatten());
            line.add_some(format!("ttq_{px}_bytes"), run.ttq_bytes.get(&px).copied().flatten());
        }
        for px in QUALITIES_PX.map(error_name) {
            line.add_some(
                format!("unoccluded_ttq_{px}_ms"),
                run.unoccluded_ttq_ms.get(&px).copied().flatten(),
            );
            line.add_some(
                format!("unoccluded_ttq_{px}_bytes"),
                run.unoccluded_ttq_bytes.get(&px).copied().flatten(),
            );
        }
        line.add_some("settled_ms", run.settled_ms);
        line.add("total_bytes", run.total_bytes);
        line.add_some("rest_ms", run.rest_ms);
        for px in QUALITIES_PX.map(error_name) {
            line.add_some(format!("rest_ttq_{px}_ms"), run.rest_ttq_ms.get(&px).copied().flatten());
        }
        for px in QUALITIES_PX.map(error_name) {
            let reached = run.rest_unoccluded_ttq_ms.get(&px).copied().flatten();
            line.add_some(format!("rest_unoccluded_ttq_{px}_ms"), reached);
        }
        line.add_some("assets", run.assets);
        line.add_some("instances", run.instances);
        line.add_some("applied_faces", run.applied_faces);
        line.add_some("needed_bytes", run.needed_bytes);
        line.add_some("shadow_bytes", run.shadow_bytes);
        line.add("stalls", run.stalls);
        line.add("stalled_ms", run.stalled_ms);
        line.add("blobs", run.usage.blobs);
        line.add("chunk_bytes", run.usage.chunk_bytes);
        line.add("wasted_bytes", run.usage.wasted_bytes);
        line.add("finer_bytes", run.usage.finer_bytes);
        line.add("undrawn_bytes", run.usage.undrawn_bytes);
        line.add("repeated_bytes", run.usage.repeated_bytes);
        line.add("unfinished_bytes", run.usage.unfinished_bytes);
        line.add("cache_hits", run.usage.cache_hits);
        line.add("cache_misses", run.usage.cache_misses);
        line.add("packets_lost", run.packets_lost);
        line.add("packets_dropped", run.packets_dropped);
        line.add("packets_lost_up", run.packets_lost_up);
        line.add("packets_dropped_up", run.packets_dropped_up);
        line.add("ended", &run.ended);
        line.add_some("ended_ms", run.ended_ms);
        line.add("trace", &run.trace);
        line
    }))
}

/// A line per picture of a run; `run` counts from 1 in the plan's order.
#[must_use]
pub(super) fn of_pictures(results: &[RunResult]) -> String {
    let pictures = (1_usize..).zip(results).flat_map(|(number, run)| {
        run.pictures.iter().map(move |picture| {
            let mut line = Line::of_run(number, run);
            line.add("instant", &picture.instant);
            line.add("at_ms", picture.at_ms);
            line.add("bytes", picture.bytes);
            line.add_some("error_px", picture.error_px);
            line.add_some("unoccluded_error_px", picture.unoccluded_error_px);
            // Empty for equal pictures, whose PSNR is infinite.
            line.add_some("psnr_db", picture.error.and_then(|error| error.psnr_db));
            line.add_some("ssim", picture.error.map(|error| error.ssim));
            line.add_some("flip", picture.error.map(|error| error.flip));
            line.add("file", &picture.file);
            line
        })
    });
    table(pictures)
}

/// Instants whose error is listed with the integral, in seconds.
const FIRST_INSTANTS_S: [f64; 3] = [0.5, 1.0, 2.0];

/// FLIP errors for which the time is listed from which on no picture has a larger one, from coarse to fine. At 0.005 a
/// picture is hardly distinguishable from the settled one.
const FLIP_STEPS: [f64; 6] = [0.1, 0.05, 0.02, 0.01, 0.005, 0.002];

/// The first picture from which on none has a larger FLIP error.
fn close_for_good(pictures: &[Picture], flip: f64) -> Option<&Picture> {
    let is_close = |picture: &&Picture| picture.error.is_some_and(|error| error.flip <= flip);
    pictures.iter().rev().take_while(is_close).last()
}

/// A line per run with pictures of its first seconds.
#[must_use]
pub(super) fn of_first_seconds(results: &[RunResult]) -> String {
    let lines = (1_usize..).zip(results).filter_map(|(number, run)| {
        let seconds = run.first_seconds?;
        let flip = |instant: &str| {
            let picture = run.pictures.iter().find(|picture| picture.instant == instant)?;
            picture.error.map(|error| error.flip)
        };
        let mut line = Line::of_run(number, run);
        line.add("rate_bits_per_s", run.rate_bits_per_s);
        line.add_some("ttff_ms", run.ttff_ms);
        line.add_some("first_frame_bytes", run.first_frame_bytes);
        line.add("blank_flip", seconds.blank_flip);
        line.add_some("first_flip", flip("first frame"));
        for at_s in FIRST_INSTANTS_S {
            line.add_some(format!("flip_at_{}_ms", at_s * 1e3), flip(&format!("{at_s} s")));
        }
        for step in FLIP_STEPS {
            let near = close_for_good(&run.pictures, step);
            line.add_some(format!("flip_{step}_ms"), near.map(|picture| picture.at_ms));
            line.add_some(format!("flip_{step}_bytes"), near.map(|picture| picture.bytes));
        }
        line.add("until_s", seconds.until_s);
        line.add("flip_s", seconds.flip_s);
        line.add("dissimilarity_s", seconds.dissimilarity_s);
        line.add_some("psnr_db", seconds.psnr_db);
        Some(line)
    });
    table(lines)
}

/// A line per case.
#[must_use]
pub(super) fn of_percentiles(cases: &[Percentiles]) -> String {
    // Cases with a moving camera have more figures than others.
    let names: BTreeSet<&String> = cases.iter().flat_map(|case| case.figures.keys()).collect();
    table(cases.iter().map(|case| {
        let mut line = Line::default();
        line.add("scene", &case.scene);
        line.add("technique", &case.technique);
        line.add("transport", case.transport);
        line.add("resumed", case.resumed);
        line.add("link", &case.link);
        line.add("camera", &case.camera);
        line.add_some("limiter_bits_per_s", case.limiter_bits_per_s);
        line.add("seeds", case.seeds);
        line.add("settled", case.settled);
        for &name in &names {
            let spread = case.figures.get(name);
            line.add_some(format!("{name}_p50"), spread.and_then(|s| s.p50));
            line.add_some(format!("{name}_p90"), spread.and_then(|s| s.p90));
            line.add_some(format!("{name}_p99"), spread.and_then(|s| s.p99));
        }
        line
    }))
}

/// A line per level of a chain and technique.
#[must_use]
pub(super) fn of_levels(levels: &[Level]) -> String {
    table(levels.iter().map(|level| {
        let mut line = Line::default();
        line.add("scene", &level.scene);
        line.add("transport", level.transport);
        line.add("link", &level.link);
        line.add("rate_bits_per_s", level.rate_bits_per_s);
        line.add("seed", level.seed);
        line.add("error_px", level.error_px);
        line.add("technique", &level.technique);
        line.add_some("bytes", level.bytes);
        line.add_some("ms", level.ms);
        line
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_scenario::picture::ImageError;

    /// A moving camera may worsen pictures again; only pictures after the last worse one count.
    #[test]
    fn the_time_of_a_flip_step_is_after_the_last_worse_picture() {
        let picture = |at_ms, flip| Picture {
            instant: String::new(),
            at_ms,
            bytes: at_ms as u64,
            error_px: None,
            unoccluded_error_px: None,
            error: Some(ImageError { psnr_db: None, ssim: 1.0, flip }),
            file: String::new(),
        };
        let pictures = [(1.0, 0.08), (2.0, 0.004), (3.0, 0.03), (4.0, 0.004), (5.0, 0.003)];
        let pictures = pictures.map(|(at_ms, flip)| picture(at_ms, flip));
        let from = |flip| close_for_good(&pictures, flip).map(|picture| picture.bytes);
        assert_eq!(FLIP_STEPS.map(from), [Some(1), Some(2), Some(4), Some(4), Some(4), None]);
    }
}
