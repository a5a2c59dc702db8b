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

/// Adds fields of a struct to a line, under their own names.
macro_rules! add {
    ($line:ident, $of:expr; $($field:ident),+) => {
        $($line.add(stringify!($field), &$of.$field);)+
    };
}

/// The same for optional fields.
macro_rules! add_some {
    ($line:ident, $of:expr; $($field:ident),+) => {
        $($line.add_some(stringify!($field), $of.$field);)+
    };
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
        add!(line, run; scene, transport, link, camera, seed);
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
        add!(line, run; scene, technique, transport, resumed, link, camera, rate_bits_per_s, rtt_ms, loss, queue_bytes);
        line.add_some("limiter_bits_per_s", run.limiter_bits_per_s);
        line.add("seed", run.seed);
        add_some!(line, run; ttff_ms, first_frame_bytes);
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
        add_some!(line, run; assets, instances, applied_faces, needed_bytes, shadow_bytes);
        add!(line, run; stalls, stalled_ms);
        add!(line, run.usage; blobs, chunk_bytes, wasted_bytes, finer_bytes, undrawn_bytes, repeated_bytes);
        add!(line, run.usage; unfinished_bytes, cache_hits, cache_misses);
        add!(line, run; packets_lost, packets_dropped, packets_lost_up, packets_dropped_up, ended);
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
            add!(line, picture; instant, at_ms, bytes);
            add_some!(line, picture; error_px, unoccluded_error_px);
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
        add_some!(line, run; ttff_ms, first_frame_bytes);
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
        add!(line, seconds; until_s, flip_s, dissimilarity_s);
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
        add!(line, case; scene, technique, transport, resumed, link, camera);
        line.add_some("limiter_bits_per_s", case.limiter_bits_per_s);
        add!(line, case; seeds, settled);
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
        add!(line, level; scene, transport, link, rate_bits_per_s, seed, error_px, technique);
        add_some!(line, level; bytes, ms);
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
