//! A report's plots: bytes, screen error and image error over time, times against the rate, percentiles.
//!
//! Cases with the same scene and camera path share a plot. Quantities over time are shown for the first seed of a case,
//! on a logarithmic time axis: a first frame takes a fraction of a second, a settled picture may take minutes.

pub(crate) mod chart;

use std::collections::BTreeSet;
use std::path::Path;

use chart::{Axis, Chart, Line, MAX_LINES, Mark, Panel, Scale};

use super::percentiles::{self, Percentiles};
use super::units;
use lodestream_scenario::plan::{Case, Plan};
use lodestream_scenario::result::{RunResult, error_name};
use lodestream_scenario::technique::Technique;
use lodestream_scenario::timeline::Sample;

/// Most plots of a kind.
const MAX_PLOTS: usize = 12;
/// Smaller screen errors are drawn at this value, since a logarithmic axis has no zero.
const MIN_DRAWN_ERROR_PX: f64 = 1e-2;
/// Larger screen errors are drawn at this value: they only mean that a coarse surface is next to the eye.
pub(super) const MAX_DRAWN_ERROR_PX: f64 = 1e4;

/// A plot with its title and caption.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plot {
    /// The file within the report's folder.
    pub file: String,
    /// Title.
    pub title: String,
    /// Caption.
    pub caption: &'static str,
    /// SVG.
    pub svg: String,
}

/// Kinds of plots, in a report's order.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Bytes,
    ScreenError,
    ImageError,
    Rates,
    Percentiles,
}

impl Kind {
    const ALL: [Self; 5] = [Self::Bytes, Self::ScreenError, Self::ImageError, Self::Rates, Self::Percentiles];

    fn stem(self) -> &'static str {
        match self {
            Self::Bytes => "bytes-over-time",
            Self::ScreenError => "screen-error-over-time",
            Self::ImageError => "image-error-over-time",
            Self::Rates => "times-against-rate",
            Self::Percentiles => "percentiles",
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Bytes => "Bytes received over time",
            Self::ScreenError => "Screen error over time",
            Self::ImageError => "Image error over time",
            Self::Rates => "Time to first frame and to quality against rate",
            Self::Percentiles => "Percentiles over the seeds",
        }
    }

    fn caption(self) -> &'static str {
        match self {
            Self::Bytes => {
                "Transport payload that the client received since its connect call, handshake included."
            }
            Self::ScreenError => {
                "Upper bound on the screen error over all parts in view, and over those that the scene's own surfaces do \
                 not occlude, which baselines do not know. A line begins with the first frame. Bounds beyond 10,000 px, of coarse surfaces next to the eye, are \
                 drawn at 10,000 px, those below 0.01 px at 0.01 px."
            }
            Self::ImageError => {
                "Pictures against the settled one: PSNR (higher is better; equal pictures, for which it is infinite, have \
                 no dot), SSIM (1 is equal) and FLIP (0 is equal)."
            }
            Self::Rates => {
                "Medians over the seeds. TTFF: until every visible instance can be drawn; TTQ: until no visible part has a \
                 larger screen error; where seen: without parts that the scene's own surfaces occlude."
            }
            Self::Percentiles => {
                "For each case: the median, 90th and 99th percentile over the seeds. \
                 A missing dot was never reached."
            }
        }
    }
}

/// Draws all plots of a report; `results` are the plan's, in its order.
///
/// # Errors
/// Errors of the drawing library.
pub fn draw(plan: &Plan, results: &[RunResult]) -> std::io::Result<Vec<Plot>> {
    let cases = Cases::new(plan, results);
    let spread = percentiles::of_plan(plan, results);
    let mut plots = Vec::new();
    for kind in Kind::ALL {
        let charts: Vec<(String, Chart)> = match kind {
            Kind::Bytes => cases.charts(|case| !case.run.series.is_empty(), bytes_over_time),
            Kind::ScreenError => cases.charts(CaseRuns::has_errors, screen_error_over_time),
            Kind::ImageError => cases.charts(CaseRuns::has_pictures, image_error_over_time),
            Kind::Rates => cases.rate_charts(plan),
            Kind::Percentiles => percentile_charts(plan, &spread),
        };
        for (number, (of, chart)) in (1..).zip(&charts).take(MAX_PLOTS) {
            let suffix = if charts.len() > 1 { format!("-{number}") } else { String::new() };
            plots.push(Plot {
                file: format!("{}{suffix}.svg", kind.stem()),
                title: format!("{}: {of}", kind.title()),
                caption: kind.caption(),
                svg: chart.svg()?,
            });
        }
    }
    Ok(plots)
}

/// Whether a file of a report's folder is one of these plots.
pub(super) fn is_plot(name: &str) -> bool {
    Kind::ALL.iter().any(|kind| {
        let rest = name.strip_prefix(kind.stem()).and_then(|rest| rest.strip_suffix(".svg"));
        rest.is_some_and(|rest| {
            rest.is_empty() || rest.strip_prefix('-').is_some_and(|n| n.parse::<usize>().is_ok())
        })
    })
}

/// Removes the plots of an earlier report.
pub(super) fn remove_earlier(folder: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_str().is_some_and(is_plot) {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// A case with its runs.
#[derive(Clone, Copy, Debug)]
struct CaseRuns<'a> {
    case: &'a Case,
    /// The run of the first seed.
    run: &'a RunResult,
    runs: &'a [RunResult],
}

impl CaseRuns<'_> {
    fn name(&self) -> String {
        let limit = self.case.limiter_bits_per_s.map(|rate| format!(", limited to {}", units::rate(rate)));
        format!(
            "{}{}, {}{}",
            self.technique(),
            self.case.transport,
            self.case.link.name,
            limit.unwrap_or_default()
        )
    }

    /// The technique with a comma, unless it is this project's.
    fn technique(&self) -> String {
        match self.case.technique {
            Technique::Lodestream => String::new(),
            _ => format!("{}, ", self.run.technique),
        }
    }

    fn has_errors(&self) -> bool {
        self.run.series.iter().any(|sample| sample.error_px.is_some_and(|px| px > 0.0))
    }

    fn has_pictures(&self) -> bool {
        self.run.pictures.iter().any(|picture| picture.error.is_some())
    }

    /// Median of a figure over all seeds (nearest rank); `None` if half of them never reached it.
    fn median(&self, figure: impl Fn(&RunResult) -> Option<f64>) -> Option<f64> {
        percentiles::Spread::of(self.runs.iter().map(figure)).and_then(|spread| spread.p50)
    }
}

/// All cases, by scene and camera path.
struct Cases<'a> {
    groups: Vec<(String, Vec<CaseRuns<'a>>)>,
}

impl<'a> Cases<'a> {
    fn new(plan: &'a Plan, results: &'a [RunResult]) -> Self {
        let mut groups: Vec<(String, Vec<CaseRuns<'a>>)> = Vec::new();
        let mut rest = results;
        for case in &plan.cases {
            let (runs, others) = rest.split_at(case.seeds.len().min(rest.len()));
            rest = others;
            let Some(run) = runs.first() else { continue };
            let name = subject(&run.scene, &run.camera);
            let shown = CaseRuns { case, run, runs };
            match groups.iter_mut().find(|(known, _)| *known == name) {
                Some((_, cases)) => cases.push(shown),
                None => groups.push((name, vec![shown])),
            }
        }
        Self { groups }
    }

    /// Charts of the cases that have data.
    fn charts(
        &self,
        shows: impl Fn(&CaseRuns<'a>) -> bool,
        chart: impl Fn(&[CaseRuns<'a>]) -> Chart,
    ) -> Vec<(String, Chart)> {
        let mut charts = Vec::new();
        for (name, cases) in &self.groups {
            let cases: Vec<CaseRuns<'a>> = cases.iter().copied().filter(&shows).collect();
            charts.extend(cases.chunks(MAX_LINES).map(|cases| (name.clone(), chart(cases))));
        }
        charts
    }

    /// Charts of times against the rate, for cases that differ only in it.
    fn rate_charts(&self, plan: &Plan) -> Vec<(String, Chart)> {
        let mut charts = Vec::new();
        for (name, cases) in &self.groups {
            let mut kinds: Vec<(String, Vec<CaseRuns<'a>>)> = Vec::new();
            for shown in cases {
                let Some(kind) = beside_the_rate(shown) else { continue };
                match kinds.iter_mut().find(|(known, _)| *known == kind) {
                    Some((_, cases)) => cases.push(*shown),
                    None => kinds.push((kind, vec![*shown])),
                }
            }
            kinds.retain(|(_, cases)| cases.len() > 1);
            for (_, cases) in &mut kinds {
                cases.sort_by_key(|shown| shown.run.rate_bits_per_s);
            }
            charts.extend(kinds.chunks(MAX_LINES).map(|kinds| (name.clone(), against_rate(plan, kinds))));
        }
        charts
    }
}

fn subject(scene: &str, camera: &str) -> String {
    format!("{scene}, camera {camera}")
}

/// Description of a case without its rate; `None` for links without a rate in their name.
fn beside_the_rate(shown: &CaseRuns<'_>) -> Option<String> {
    let mbit = format!("{} Mbit/s, ", shown.run.rate_bits_per_s as f64 / 1e6);
    let rest = shown.case.link.name.strip_prefix(&mbit)?;
    let share = shown.case.limiter_bits_per_s.map(|rate| {
        let percent = 100.0 * rate as f64 / shown.run.rate_bits_per_s as f64;
        format!(", limited to {} % of the rate", percent.round())
    });
    Some(format!("{}{}, {rest}{}", shown.technique(), shown.case.transport, share.unwrap_or_default()))
}

fn names(cases: &[CaseRuns<'_>]) -> Vec<String> {
    cases.iter().map(CaseRuns::name).collect()
}

/// The points that a panel shows of a case.
type Points<'a> = &'a dyn Fn(&CaseRuns<'_>) -> Vec<(f64, f64)>;

/// A chart with panels over the time of runs.
fn over_time(cases: &[CaseRuns<'_>], mark: Mark, panels: &[(&str, Axis, Points<'_>)]) -> Chart {
    let drawn = |points: Points<'_>| -> Vec<Line> {
        let line = |(number, shown): (usize, &CaseRuns<'_>)| Line { number, points: points(shown) };
        cases.iter().enumerate().map(line).collect()
    };
    let lines: Vec<Vec<Line>> = panels.iter().map(|(_, _, points)| drawn(points)).collect();
    let times = lines.iter().flatten().flat_map(|line| &line.points).map(|(ms, _)| *ms);
    let time = Axis::holding("time since the connect call", Scale::Logarithmic, times, units::milliseconds);
    let panel = |((title, y, _), lines): (&(&str, Axis, Points<'_>), Vec<Line>)| Panel {
        title: (*title).to_owned(),
        x: time.clone(),
        y: y.clone(),
        mark,
        lines,
    };
    Chart { panels: panels.iter().zip(lines).map(panel).collect(), legend: names(cases) }
}

fn ms(at_ns: u64) -> f64 {
    at_ns as f64 / 1e6
}

fn bytes_over_time(cases: &[CaseRuns<'_>]) -> Chart {
    let points = |shown: &CaseRuns<'_>| -> Vec<(f64, f64)> {
        let samples = shown.run.series.iter().filter(|sample| sample.at_ns > 0);
        samples.map(|sample| (ms(sample.at_ns), sample.bytes as f64)).collect()
    };
    let most = cases.iter().map(|shown| shown.run.total_bytes as f64);
    let y = Axis::holding("bytes received", Scale::Linear, most, units::bytes);
    over_time(cases, Mark::Steps, &[("", y, &points)])
}

fn screen_error_over_time(cases: &[CaseRuns<'_>]) -> Chart {
    type Pick = fn(&Sample) -> Option<f64>;
    let points = |shown: &CaseRuns<'_>, pick: Pick| -> Vec<(f64, f64)> {
        let errors = shown.run.series.iter().filter_map(|sample| Some((sample.at_ns, pick(sample)?)));
        errors
            .filter(|(at_ns, _)| *at_ns > 0)
            .map(|(at, px)| (ms(at), px.clamp(MIN_DRAWN_ERROR_PX, MAX_DRAWN_ERROR_PX)))
            .collect()
    };
    let [all, seen]: [Pick; 2] = [|sample| sample.error_px, |sample| sample.unoccluded_error_px];
    // Errors of visible parts are at most those of parts in view: one axis fits both.
    let least_and_most =
        [all, seen].into_iter().flat_map(|pick| cases.iter().flat_map(move |shown| points(shown, pick)));
    let y = Axis::holding(
        "screen error, pixels",
        Scale::Logarithmic,
        least_and_most.map(|(_, px)| px),
        units::plain,
    );
    let of_all: Points<'_> = &|shown| points(shown, all);
    let of_seen: Points<'_> = &|shown| points(shown, seen);
    let mut panels = vec![("all in view", y.clone(), of_all)];
    if cases.iter().any(|shown| shown.run.series.iter().any(|sample| sample.unoccluded_error_px.is_some())) {
        panels.push(("where seen", y, of_seen));
    }
    over_time(cases, Mark::Steps, &panels)
}

fn image_error_over_time(cases: &[CaseRuns<'_>]) -> Chart {
    type Pick = fn(&lodestream_scenario::picture::ImageError) -> Option<f64>;
    let points = |shown: &CaseRuns<'_>, pick: Pick| -> Vec<(f64, f64)> {
        let pictures = shown.run.pictures.iter();
        let mut points: Vec<(f64, f64)> = pictures
            .filter(|picture| picture.at_ms > 0.0)
            .filter_map(|picture| Some((picture.at_ms, pick(picture.error.as_ref()?)?)))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let [psnr, ssim, flip]: [Pick; 3] = [|e| e.psnr_db, |e| Some(e.ssim), |e| Some(e.flip)];
    let all = |pick: Pick| {
        cases.iter().flat_map(move |shown| points(shown, pick)).map(|(_, value)| value).collect::<Vec<_>>()
    };
    let y = |label: &str, pick: Pick, more: Option<f64>| {
        Axis::holding(label, Scale::Linear, all(pick).into_iter().chain(more), units::plain)
    };
    let panels: [(&str, Axis, Points<'_>); 3] = [
        ("PSNR", y("dB", psnr, None), &|shown| points(shown, psnr)),
        ("SSIM", y("", ssim, Some(1.0)), &|shown| points(shown, ssim)),
        ("FLIP", y("", flip, None), &|shown| points(shown, flip)),
    ];
    over_time(cases, Mark::Dots, &panels)
}

/// The milestones of a run: labels and figures. Of the visible parts only the smallest error is shown: more panels
/// would be too narrow to read.
fn times(plan: &Plan) -> Vec<(String, String)> {
    let mut coarse_first = plan.ttq_px.clone();
    coarse_first.sort_by(|a, b| b.total_cmp(a));
    let quality = |px: f64| (format!("TTQ({px} px)"), format!("ttq_{}_ms", error_name(px)));
    let first = std::iter::once(("TTFF".to_owned(), "ttff_ms".to_owned()));
    let finest = coarse_first.last().copied().map(|px| {
        let (name, place) = quality(px);
        (format!("{name}, where seen"), format!("unoccluded_{place}"))
    });
    first.chain(coarse_first.into_iter().map(quality)).chain(finest).collect()
}

fn against_rate(plan: &Plan, kinds: &[(String, Vec<CaseRuns<'_>>)]) -> Chart {
    let figures = times(plan);
    let lines = |field: &str| -> Vec<Line> {
        let figure = |run: &RunResult| percentiles::figures(run).get(field).copied().flatten();
        let point = |shown: &CaseRuns<'_>| Some((shown.run.rate_bits_per_s as f64, shown.median(figure)?));
        let line = |(number, (_, cases)): (usize, &(String, Vec<CaseRuns<'_>>))| Line {
            number,
            points: cases.iter().filter_map(point).collect(),
        };
        kinds.iter().enumerate().map(line).collect()
    };
    let panels: Vec<(String, Vec<Line>)> =
        figures.into_iter().map(|(name, field)| (name, lines(&field))).collect();
    let points = || panels.iter().flat_map(|(_, lines)| lines).flat_map(|line| &line.points);
    let rates = kinds.iter().flat_map(|(_, cases)| cases).map(|shown| shown.run.rate_bits_per_s);
    let marked: Vec<f64> = rates.collect::<BTreeSet<u64>>().into_iter().map(|rate| rate as f64).collect();
    let x = Axis::holding("rate, Mbit/s", Scale::Logarithmic, marked.clone(), units::megabits);
    let x = Axis { marked, ..x };
    let y = Axis::holding("time", Scale::Logarithmic, points().map(|(_, ms)| *ms), units::milliseconds);
    let panel = |(number, (title, lines)): (usize, (String, Vec<Line>))| {
        // Panels share their axis; one label is enough.
        let label = if number == 0 { y.label.clone() } else { String::new() };
        Panel { title, x: x.clone(), y: Axis { label, ..y.clone() }, mark: Mark::Dots, lines }
    };
    let legend = kinds.iter().map(|(kind, _)| kind.clone()).collect();
    Chart { panels: panels.clone().into_iter().enumerate().map(panel).collect(), legend }
}

fn percentile_charts(plan: &Plan, cases: &[Percentiles]) -> Vec<(String, Chart)> {
    let mut groups: Vec<(String, Vec<&Percentiles>)> = Vec::new();
    for case in cases {
        let name = subject(&case.scene, &case.camera);
        match groups.iter_mut().find(|(known, _)| *known == name) {
            Some((_, cases)) => cases.push(case),
            None => groups.push((name, vec![case])),
        }
    }
    let mut charts = Vec::new();
    for (name, cases) in &groups {
        charts.extend(cases.chunks(MAX_LINES).map(|cases| (name.clone(), spread_chart(plan, cases))));
    }
    charts
}

/// One row per case, from the top.
fn spread_chart(plan: &Plan, cases: &[&Percentiles]) -> Chart {
    let rows = (-(cases.len() as f64), 1.0);
    let y = Axis {
        label: "a row per case".into(),
        scale: Scale::Linear,
        range: rows,
        format: None,
        marked: Vec::new(),
    };
    let panel = |(title, field): (String, String)| {
        let points = |row: usize, case: &Percentiles| -> Vec<(f64, f64)> {
            let spread = case.figures.get(&field);
            let places = spread.map_or([None; 3], |spread| [spread.p50, spread.p90, spread.p99]);
            places.into_iter().flatten().map(|ms| (ms, -(row as f64))).collect()
        };
        let line = |(number, case): (usize, &&Percentiles)| Line { number, points: points(number, case) };
        let lines: Vec<Line> = cases.iter().enumerate().map(line).collect();
        let all = lines.iter().flat_map(|line| &line.points).map(|(ms, _)| *ms);
        let x = Axis::holding("time", Scale::Logarithmic, all, units::milliseconds);
        Panel { title, x, y: y.clone(), mark: Mark::Dots, lines }
    };
    let name = |case: &&Percentiles| {
        let limit = case.limiter_bits_per_s.map(|rate| format!(", limited to {}", units::rate(rate)));
        format!("{}, {}{}", case.transport, case.link, limit.unwrap_or_default())
    };
    Chart { panels: times(plan).into_iter().map(panel).collect(), legend: cases.iter().map(name).collect() }
}
