//! The report as a self-contained HTML page: no script, no external file, no network.

use std::collections::BTreeMap;
use std::path::Path;

use data_encoding::BASE64;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{self, FilterType};
use lodestream_scenario::picture::Picture;
use lodestream_scenario::plan::{Case, Plan};
use lodestream_scenario::result::{RunResult, error_name};
use lodestream_scenario::technique::Technique;
use maud::{Markup, PreEscaped, html};

use super::html as pages;
use super::percentiles::{self, MIN_SEEDS, Percentiles, Spread};
use super::plots::{MAX_DRAWN_ERROR_PX, Plot};
use super::units;

/// Most lines of a table; the CSV files have all.
const MAX_LINES: usize = 500;
/// Most bytes of JPEG in a page.
const MAX_PICTURE_BYTES: usize = 3 << 20;
/// Widest picture in a page.
const PICTURE_PX: u32 = 480;
const JPEG_QUALITY: u8 = 85;

/// Text of a cell without a figure.
const DASH: &str = "–";

/// Columns of the results that hold words.
const TEXT_COLUMNS: usize = 7;

/// A case and its runs.
struct CaseRuns<'a> {
    case: &'a Case,
    number: usize,
    runs: &'a [RunResult],
}

/// The page with the plots and pictures of a report; pictures are read from its folder. `adapter` drew them.
///
/// # Errors
/// A picture that cannot be read.
pub(super) fn page(
    folder: &Path,
    plan: &Plan,
    results: &[RunResult],
    plots: &[Plot],
    adapter: Option<&str>,
) -> std::io::Result<String> {
    let mut cases = Vec::new();
    let mut rest = results;
    for (number, case) in (1..).zip(&plan.cases) {
        let (runs, others) = rest.split_at(case.seeds.len().min(rest.len()));
        rest = others;
        if !runs.is_empty() {
            cases.push(CaseRuns { case, number, runs });
        }
    }
    let scenes: Vec<&str> = plan.scenes.iter().map(|scene| scene.name.as_str()).collect();
    let title = format!("Lodestream: {}", scenes.join(", "));
    let page = html! {
        (summary(plan, &cases, adapter))
        (results_table(plan, &cases))
        (percentile_table(&percentiles::of_plan(plan, results)))
        @if !plots.is_empty() {
            h2 { "Over time" } "\n"
        }
        @for plot in plots {
            figure class="plot" {
                h3 { (plot.title) } "\n"
                (PreEscaped(&plot.svg))
                figcaption { (plot.caption) " File: " (plot.file) }
            }
            "\n"
        }
        (pictures(folder, &cases)?)
        h2 { "The plan" } "\n"
        pre { (plan.text) } "\n"
        (terms())
    };
    Ok(pages::page(&title, &page))
}

/// Terms of the page and their definitions.
const TERMS: [(&str, &str); 9] = [
    (
        "TTFF",
        "Time from the client's connect call until it can draw every visible instance, at least as its base mesh.",
    ),
    ("TTQ(e)", "Time until no visible part has a screen error above e pixels."),
    (
        "Where seen",
        "The same without parts that the scene's own surfaces occlude, as the client knows them; baselines do not know them.",
    ),
    ("At rest", "TTQ counted from the time at which a moving camera came to rest."),
    ("Bytes", "Transport payload that the client received, handshake included; a kB is 1,000 bytes."),
    (
        "Stalls",
        "Pauses of half a second or more, after the first frame, in which blobs were requested and no byte arrived.",
    ),
    ("Wasted", "Share of the chunks' bytes that no selection of the run requested."),
    (
        "Never drawn",
        "Share of the chunks' bytes that were not applied: wasted, finer than the view needed, or needed only briefly.",
    ),
    (
        "PSNR, SSIM, FLIP",
        "Of a picture against the settled one: on 8-bit sRGB values; of luma, 11 × 11 Gaussian window (Wang et al. 2004); \
         at 67 pixels per degree (Andersson et al. 2020).",
    ),
];

fn terms() -> Markup {
    html! {
        h2 { "Terms" } "\n"
        dl {
            "\n"
            @for (word, meaning) in TERMS {
                dt { (word) } dd { (meaning) } "\n"
            }
        }
        "\n"
    }
}

/// A table of at most [`MAX_LINES`] lines: column names, of which the first `texts` hold words, and lines.
fn table(texts: usize, names: &[String], lines: &[Vec<String>]) -> Markup {
    html! {
        (pages::table(texts, names, lines.iter().take(MAX_LINES), pages::plain))
        @if lines.len() > MAX_LINES {
            p { (lines.len() - MAX_LINES) " more in the files beside this page." } "\n"
        }
    }
}

fn strings<const N: usize>(texts: [&str; N]) -> Vec<String> {
    texts.map(str::to_owned).to_vec()
}

fn summary(plan: &Plan, cases: &[CaseRuns<'_>], adapter: Option<&str>) -> Markup {
    let runs: usize = cases.iter().map(|shown| shown.runs.len()).sum();
    let [width, height] = plan.viewport_px;
    let target = plan.ttq_px.iter().copied().fold(f64::INFINITY, f64::min);
    let mut seeds: Vec<u64> = cases.iter().flat_map(|shown| shown.case.seeds.iter().copied()).collect();
    seeds.sort_unstable();
    seeds.dedup();
    let pictures = plan.pictures.as_ref().map(|settings| {
        let [width, height] = settings.size_px;
        let by = adapter.map(|adapter| format!(", drawn by {adapter}")).unwrap_or_default();
        format!(" Pictures of {width} × {height} pixels{by}.")
    });
    html! {
        p {
            (count(runs, "run")) " in " (count(cases.len(), "case"))
            ", over simulated links in virtual time, by lodestream-sim " (env!("CARGO_PKG_VERSION"))
            ". Seeds " (ranges(&seeds)) ". View of " (width) " × " (height)
            " pixels, refined to a screen error of " (target) " px."
            @if let Some(pictures) = pictures { (pictures) }
        }
        "\n"
    }
}

fn count(number: usize, what: &str) -> String {
    if number == 1 { format!("1 {what}") } else { format!("{number} {what}s") }
}

/// Ascending numbers as text, consecutive ones as a range.
fn ranges(numbers: &[u64]) -> String {
    let mut ranges: Vec<(u64, u64)> = Vec::new();
    for &number in numbers {
        match ranges.last_mut() {
            Some((_, last)) if *last + 1 == number => *last = number,
            _ => ranges.push((number, number)),
        }
    }
    let text = |(from, to): &(u64, u64)| if from == to { from.to_string() } else { format!("{from}–{to}") };
    ranges.iter().map(text).collect::<Vec<_>>().join(", ")
}

/// The screen errors of a plan's TTQ, in descending order.
fn qualities(plan: &Plan) -> Vec<f64> {
    let mut px = plan.ttq_px.clone();
    px.sort_by(|a, b| b.total_cmp(a));
    px
}

fn time(ms: Option<f64>) -> String {
    ms.map_or("never".to_owned(), units::milliseconds)
}

fn some_bytes(bytes: Option<f64>) -> String {
    bytes.map_or(DASH.to_owned(), units::bytes)
}

/// Median of a figure over all seeds (nearest rank).
fn median(shown: &CaseRuns<'_>, figure: impl Fn(&RunResult) -> Option<f64>) -> Option<f64> {
    Spread::of(shown.runs.iter().map(figure)).and_then(|spread| spread.p50)
}

/// Median times until each of a plan's errors; dashes for missing values.
fn times(
    plan: &Plan,
    shown: &CaseRuns<'_>,
    tells: bool,
    of: impl Fn(&RunResult) -> &BTreeMap<String, Option<f64>>,
) -> Vec<String> {
    let reached = |px: &String| time(median(shown, |run| of(run).get(px).copied().flatten()));
    let cell = |px: f64| if tells { reached(&error_name(px)) } else { DASH.to_owned() };
    qualities(plan).into_iter().map(cell).collect()
}

fn results_table(plan: &Plan, cases: &[CaseRuns<'_>]) -> Markup {
    let seeds = cases.iter().map(|shown| shown.runs.len()).max().unwrap_or(0);
    let mut names = strings([
        "Case",
        "Scene",
        "Technique",
        "Transport",
        "Link",
        "Camera",
        "Ended",
        "Seeds",
        "TTFF",
        "Bytes until then",
    ]);
    let quality_names = |what: &str| {
        let name = |px: &f64| format!("{what}TTQ({px}\u{a0}px)");
        qualities(plan).iter().map(name).collect::<Vec<_>>()
    };
    names.extend(quality_names(""));
    names.extend(quality_names("Where seen, "));
    let moved = cases.iter().flat_map(|shown| shown.runs).any(|run| run.rest_ms.is_some());
    if moved {
        names.extend(quality_names("At rest, "));
        names.extend(quality_names("At rest, where seen, "));
    }
    names.extend(strings(["Settled", "Bytes in all", "Stalls", "Stalled", "Wasted", "Never drawn"]));
    let line = |shown: &CaseRuns<'_>| {
        let first = &shown.runs[0];
        let limit = shown.case.limiter_bits_per_s.map(|rate| format!(", limited to {}", units::rate(rate)));
        let share = |part: fn(&RunResult) -> u64| {
            let share = |run: &RunResult| match run.usage.chunk_bytes {
                // Baselines have no chunks, hence no unused bytes.
                0 => (shown.case.technique == Technique::Lodestream).then_some(0.0),
                chunks => Some(100.0 * part(run) as f64 / chunks as f64),
            };
            median(shown, share).map_or(DASH.to_owned(), |percent| format!("{percent:.1} %"))
        };
        let mut line = vec![
            shown.number.to_string(),
            first.scene.clone(),
            first.technique.clone(),
            first.transport.to_string(),
            format!("{}{}", first.link, limit.unwrap_or_default()),
            first.camera.clone(),
            endings(shown.runs),
            shown.runs.len().to_string(),
            time(median(shown, |run| run.ttff_ms)),
            some_bytes(median(shown, |run| run.first_frame_bytes.map(|bytes| bytes as f64))),
        ];
        let ours = shown.case.technique.is_ours();
        // With a fixed camera, nothing is counted from its rest.
        let moves = shown.case.path.moves();
        line.extend(times(plan, shown, true, |run| &run.ttq_ms));
        line.extend(times(plan, shown, ours, |run| &run.unoccluded_ttq_ms));
        if moved {
            line.extend(times(plan, shown, moves, |run| &run.rest_ttq_ms));
            line.extend(times(plan, shown, moves && ours, |run| &run.rest_unoccluded_ttq_ms));
        }
        line.extend([
            time(median(shown, |run| run.settled_ms)),
            some_bytes(median(shown, |run| Some(run.total_bytes as f64))),
            median(shown, |run| Some(f64::from(run.stalls))).map(units::plain).unwrap_or_default(),
            time(median(shown, |run| Some(run.stalled_ms))),
            share(|run| run.usage.wasted_bytes),
            share(|run| run.usage.undrawn_bytes),
        ]);
        line
    };
    let mut lines: Vec<Vec<String>> = cases.iter().map(line).collect();
    let (texts, mut note) = same_once(&mut names, &mut lines, TEXT_COLUMNS, &[1, 4, 5, 6]);
    if seeds > 1 {
        note += "Figures are medians over the seeds of a case.";
    }
    html! {
        h2 { "Results" } "\n"
        p { (note) } "\n"
        (table(texts, &names, &lines))
    }
}

/// Removes columns with the same value in all lines. Returns how many of the first `texts` columns remain, and a
/// sentence that states the removed values.
fn same_once(
    names: &mut Vec<String>,
    lines: &mut [Vec<String>],
    mut texts: usize,
    columns: &[usize],
) -> (usize, String) {
    let mut same = Vec::new();
    // From the last column on, so that indices stay valid.
    for &column in columns.iter().rev() {
        if lines.len() > 1 && lines.iter().all(|line| line[column] == lines[0][column]) {
            same.push(format!("{}: {}", names.remove(column).to_lowercase(), lines[0][column]));
            texts -= usize::from(column < texts);
            for line in lines.iter_mut() {
                line.remove(column);
            }
        }
    }
    same.reverse();
    let note = if same.is_empty() { String::new() } else { format!("All cases: {}. ", same.join("; ")) };
    (texts, note)
}

/// Why runs ended: the most frequent reason, and the number of other endings.
fn endings(runs: &[RunResult]) -> String {
    let mut reasons: Vec<(&str, usize)> = Vec::new();
    for run in runs {
        match reasons.iter_mut().find(|(reason, _)| *reason == run.ended) {
            Some((_, count)) => *count += 1,
            None => reasons.push((&run.ended, 1)),
        }
    }
    reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    match reasons.as_slice() {
        [] => String::new(),
        [(reason, _)] => (*reason).to_owned(),
        [(reason, count), ..] => format!("{reason} ({count} of {})", runs.len()),
    }
}

fn percentile_table(cases: &[Percentiles]) -> Markup {
    if cases.is_empty() {
        return Markup::default();
    }
    let figures = [
        "ttff_ms",
        "ttq_16_ms",
        "ttq_4_ms",
        "ttq_1_ms",
        "unoccluded_ttq_16_ms",
        "unoccluded_ttq_4_ms",
        "unoccluded_ttq_1_ms",
        "settled_ms",
    ];
    let known: Vec<&str> = figures
        .into_iter()
        .filter(|name| cases.iter().any(|case| case.figures.contains_key(*name)))
        .collect();
    let mut names = strings(["Scene", "Transport", "Link", "Camera", "Seeds"]);
    let words = |name: &str| match name.strip_suffix("_ms").unwrap_or(name) {
        "ttff" => "TTFF".to_owned(),
        "settled" => "settled".to_owned(),
        quality => match quality.strip_prefix("unoccluded_ttq_") {
            Some(px) => format!("where seen, TTQ({px} px)"),
            None => format!("TTQ({} px)", quality.trim_start_matches("ttq_")),
        },
    };
    names.extend(known.iter().map(|name| format!("{} p50 / p90 / p99", words(name))));
    let line = |case: &Percentiles| {
        let mut line = vec![
            case.scene.clone(),
            case.transport.to_string(),
            case.link.clone(),
            case.camera.clone(),
            case.seeds.to_string(),
        ];
        line.extend(known.iter().map(|name| {
            if name.starts_with("unoccluded_")
                && ![Technique::Lodestream, Technique::Published]
                    .into_iter()
                    .any(|ours| case.technique == ours.name())
            {
                return DASH.to_owned();
            }
            let spread = case.figures.get(*name);
            let place = |pick: fn(&Spread) -> Option<f64>| time(spread.and_then(pick));
            format!("{} / {} / {}", place(|s| s.p50), place(|s| s.p90), place(|s| s.p99))
        }));
        line
    };
    let mut lines: Vec<Vec<String>> = cases.iter().map(line).collect();
    let (texts, note) = same_once(&mut names, &mut lines, 4, &[0, 3, 4]);
    html! {
        h2 { "Percentiles" } "\n"
        p {
            (note) "Values that half, nine tenths and 99 of 100 seeds do not exceed (nearest rank; given from " (MIN_SEEDS)
            " seeds on)."
        }
        "\n"
        (table(texts, &names, &lines))
    }
}

/// The pictures of each case's first seed, until the page is full.
fn pictures(folder: &Path, cases: &[CaseRuns<'_>]) -> std::io::Result<Markup> {
    let mut of_cases = Vec::new();
    let (mut bytes, mut left_out) = (0, 0);
    for shown in cases {
        let run = &shown.runs[0];
        let mut figures = Vec::new();
        for (i, picture) in run.pictures.iter().enumerate() {
            // Instants after the end share the last picture.
            if run.pictures[i + 1..].iter().any(|later| later.file == picture.file) {
                continue;
            }
            if bytes >= MAX_PICTURE_BYTES {
                left_out += 1;
                continue;
            }
            let jpeg = jpeg(&folder.join(&picture.file))?;
            bytes += jpeg.len();
            let source = format!("data:image/jpeg;base64,{}", BASE64.encode(&jpeg));
            figures.push((picture, source));
        }
        if !figures.is_empty() {
            let name = format!("Case {}: {}, {}, seed {}", shown.number, run.scene, shown.case, run.seed);
            of_cases.push((name, figures));
        }
    }
    if of_cases.is_empty() {
        return Ok(Markup::default());
    }
    Ok(html! {
        h2 { "Pictures" } "\n"
        p {
            "What the client could draw at an instant, vertices that are new at their places, compared with the settled "
            "picture from the same pose."
        }
        "\n"
        @for (name, figures) in &of_cases {
            h3 { (name) } "\n"
            div class="pictures" {
                "\n"
                @for (picture, source) in figures {
                    figure { img alt=(picture.instant) src=(source); figcaption { (caption(picture)) } } "\n"
                }
            }
            "\n"
        }
        @if left_out > 0 {
            p { (count(left_out, "picture")) " more in the folder beside this page." } "\n"
        }
    })
}

fn caption(picture: &Picture) -> Markup {
    let at = units::milliseconds(picture.at_ms);
    let pixels = |px: f64| if px > MAX_DRAWN_ERROR_PX { "> 10,000".to_owned() } else { units::plain(px) };
    let [error_px, seen_px] = [picture.error_px, picture.unoccluded_error_px].map(|px| px.map(pixels));
    let against = picture.error.map_or("no settled picture to compare with".to_owned(), |error| {
        let psnr = error.psnr_db.map_or("∞".to_owned(), |db| format!("{db:.1}"));
        format!("PSNR {psnr} dB, SSIM {:.4}, FLIP {:.4}", error.ssim, error.flip)
    });
    html! {
        b { (picture.instant) }
        @if at != picture.instant { " at " (at) }
        ", " (units::bytes(picture.bytes as f64))
        @if let Some(px) = error_px { ", screen error " (px) " px" }
        @if let Some(px) = seen_px { " (where seen " (px) ")" }
        br;
        (against)
    }
}

/// A picture of the report, scaled down for the page.
fn jpeg(file: &Path) -> std::io::Result<Vec<u8>> {
    let fail = |why: image::ImageError| std::io::Error::other(format!("{}: {why}", file.display()));
    let mut picture = image::open(file).map_err(fail)?.into_rgb8();
    let (width, height) = picture.dimensions();
    if width > PICTURE_PX {
        let height = (u64::from(height) * u64::from(PICTURE_PX) / u64::from(width)).max(1) as u32;
        picture = imageops::resize(&picture, PICTURE_PX, height, FilterType::Triangle);
    }
    let mut bytes = Vec::new();
    picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)).map_err(fail)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_tables_state_how_many_lines_they_omit() {
        let html = table(1, &strings(["n"]), &vec![strings(["x"]); MAX_LINES + 2]).into_string();
        assert_eq!(html.matches("<td").count(), MAX_LINES);
        assert!(html.contains("<p>2 more in the files"), "{html}");
    }

    #[test]
    fn equal_columns_are_stated_once() {
        let mut names = strings(["Scene", "Link", "Seeds", "TTFF"]);
        let mut lines = [strings(["a<b", "slow", "1", "5 s"]), strings(["a<b", "fast", "1", "5 s"])];
        let found = same_once(&mut names, &mut lines, 2, &[0, 1, 2]);
        assert_eq!(found, (1, "All cases: scene: a<b; seeds: 1. ".to_owned()));
        assert_eq!(names, ["Link", "TTFF"]);
        assert_eq!(lines, [strings(["slow", "5 s"]), strings(["fast", "5 s"])]);
    }

    #[test]
    fn consecutive_seeds_are_a_range() {
        assert_eq!(ranges(&[1, 2, 3, 7, 9, 10]), "1–3, 7, 9–10");
        assert_eq!(ranges(&[]), "");
    }
}
