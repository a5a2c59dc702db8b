//! Plots of a section's figures, for the page.
//!
//! Each row gives a point per pair of figures; rows with the same name form a line. A row whose x is not a number, such
//! as "measured" among bytes, is a horizontal line across the plot.

use anyhow::Context as _;

use super::Rows;
use super::section::{Plot, PlotAxis, Section};
use super::table;
use crate::plots::chart::{Axis, Chart, Line, MAX_LINES, Mark, Panel, Scale};
use crate::units;

/// Most distinct x values that are used as ticks in place of round values.
const MAX_MARKED: usize = 7;
/// Fewest round values along x; with fewer, ticks are at the figures.
const MIN_ROUND: usize = 3;

/// Plots side by side in one picture.
pub(super) const PER_PICTURE: usize = 2;

/// The section's plots as SVG, some in one picture.
///
/// # Errors
/// Figures and names of unknown columns, and more lines than colours.
pub(super) fn svgs(section: &Section, rows: &Rows) -> anyhow::Result<Vec<String>> {
    let pictures = section.plots.chunks(PER_PICTURE).enumerate();
    pictures
        .map(|(number, plots)| {
            let chart = chart(plots, rows).with_context(|| format!("picture {} of plots", number + 1))?;
            Ok(chart.svg()?)
        })
        .collect()
}

/// Panels with common line names.
fn chart(plots: &[Plot], rows: &Rows) -> anyhow::Result<Chart> {
    let mut chart = Chart { panels: Vec::new(), legend: Vec::new() };
    for plot in plots {
        let panel = panel(plot, rows, &mut chart.legend)?;
        chart.panels.push(panel);
    }
    // A single line needs no name.
    if chart.legend.iter().all(String::is_empty) {
        chart.legend.clear();
    }
    let lines = chart.legend.len();
    anyhow::ensure!(lines <= MAX_LINES, "{lines} lines are too many: at most {MAX_LINES} have a colour each");
    Ok(chart)
}

/// A line's number in the legend.
fn number_of(name: String, legend: &mut Vec<String>) -> usize {
    legend.iter().position(|known| *known == name).unwrap_or_else(|| {
        legend.push(name);
        legend.len() - 1
    })
}

fn panel(plot: &Plot, rows: &Rows, legend: &mut Vec<String>) -> anyhow::Result<Panel> {
    let mut lines: Vec<Line> = Vec::new();
    // Rows without a number for x: names and heights.
    let mut level: Vec<(String, f64)> = Vec::new();
    for row in table::only(&plot.only, rows)? {
        let name = table::text_of_row(&plot.line, rows, row)?;
        for (x, y) in plot.x.figures.iter().zip(&plot.y.figures) {
            // A logarithmic axis has no zero.
            let shown = |value: &f64, axis: &PlotAxis| !axis.log || *value > 0.0;
            let Some(y) = table::of_row(y, rows, row)?.filter(|y| shown(y, &plot.y)) else { continue };
            match table::of_row(x, rows, row) {
                Ok(Some(x)) if shown(&x, &plot.x) => {
                    let number = number_of(name.clone(), legend);
                    match lines.iter_mut().find(|line| line.number == number) {
                        Some(line) => line.points.push((x, y)),
                        None => lines.push(Line { number, points: vec![(x, y)] }),
                    }
                }
                Ok(_) => {}
                Err(why) => {
                    // A column with words in it.
                    let column = rows.column(x).ok_or(why)?;
                    level.push((format!("{name}, {}", row[column]).trim_start_matches(", ").to_owned(), y));
                }
            }
        }
    }
    for line in &mut lines {
        line.points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let points = || lines.iter().flat_map(|line| &line.points);
    let mut marked: Vec<f64> = points().map(|point| point.0).collect();
    marked.sort_by(f64::total_cmp);
    marked.dedup();
    let x = axis(&plot.x, marked.iter().copied());
    let at_figures = marked.len() <= MAX_MARKED || x.ticks(MAX_MARKED).len() < MIN_ROUND;
    let x = if at_figures { Axis { marked: apart(marked, &x), ..x } } else { x };
    let y = axis(&plot.y, points().map(|point| point.1).chain(level.iter().map(|(_, y)| *y)));
    let (from, to) = x.range;
    for (name, y) in level {
        lines.push(Line { number: number_of(name, legend), points: vec![(from, y), (to, y)] });
    }
    Ok(Panel { title: plot.title.clone(), x, y, mark: Mark::Dots, lines })
}

/// Ascending values of an axis, without those too near to their predecessor to be labelled.
fn apart(values: Vec<f64>, axis: &Axis) -> Vec<f64> {
    let place = |value: f64| if axis.scale == Scale::Logarithmic { value.log10() } else { value };
    let least = (place(axis.range.1) - place(axis.range.0)) / (2 * MAX_MARKED) as f64;
    let mut kept: Vec<f64> = Vec::new();
    for value in values {
        if kept.last().is_none_or(|last| place(value) - place(*last) >= least) {
            kept.push(value);
        }
    }
    kept
}

fn axis(axis: &PlotAxis, values: impl Iterator<Item = f64>) -> Axis {
    Axis::holding(&axis.label, scale(axis), values, short)
}

fn scale(axis: &PlotAxis) -> Scale {
    if axis.log { Scale::Logarithmic } else { Scale::Linear }
}

/// A number with three digits, thousands and millions abbreviated.
fn short(value: f64) -> String {
    match value.abs() {
        x if x >= 1e6 => format!("{} M", units::plain(value / 1e6)),
        x if x >= 1e4 => format!("{} k", units::plain(value / 1e3)),
        _ => units::plain(value),
    }
}

#[cfg(test)]
mod tests {
    use super::super::section::parse;
    use super::*;

    const ROWS: &str = "label,who,ms,bytes\n10,a,9,100\n10,b,5,0\n1,a,7,200\nmeasured,a,8,300\n1,b,,400\n";

    fn section(plot: &str) -> Section {
        let text = format!(
            "[[section]]\nname = \"s\"\ntitle = \"t\"\nseconds = 1\ncolumns = [\"who\", \"ms\", \"bytes\"]\n\
             [[section.command]]\nrun = \"x\"\n[[section.plot]]\n{plot}\n"
        );
        parse(&text).unwrap().remove(0)
    }

    fn drawn(plot: &str) -> anyhow::Result<Chart> {
        chart(&section(plot).plots, &Rows::from_csv(ROWS).unwrap())
    }

    #[test]
    fn rows_with_one_name_are_a_line_and_words_a_horizontal_line() {
        let text = "line = \"{who}\"\nx = { label = \"setting\", figures = [\"label\"], log = true }\n\
                    y = { label = \"s\", figures = [\"ms/1000\"] }";
        let chart = drawn(text).unwrap();
        assert_eq!(chart.legend, ["a", "b", "a, measured"]);
        let [panel] = &chart.panels[..] else { panic!("{chart:?}") };
        let line = |number: usize| panel.lines.iter().find(|line| line.number == number).unwrap();
        assert_eq!(line(0).points, [(1.0, 0.007), (10.0, 0.009)]);
        assert_eq!(line(1).points, [(10.0, 0.005)]);
        assert_eq!(line(2).points, [(panel.x.range.0, 0.008), (panel.x.range.1, 0.008)]);
        assert_eq!(panel.x.marked, [1.0, 10.0]);
        let rows = Rows::from_csv(ROWS).unwrap();
        let svg = &svgs(&section(text), &rows).unwrap()[0];
        assert!(svg.contains(">\na, measured\n<") && svg.contains("setting"), "{svg}");
    }

    #[test]
    fn a_row_may_give_several_points_and_logarithms_skip_zero() {
        let text = "x = { label = \"b\", figures = [\"bytes\", \"bytes*2\"], log = true }\n\
                    y = { label = \"\", figures = [\"1\", \"ms\"] }\nonly = { who = \"b\" }";
        let chart = drawn(text).unwrap();
        // The first row has zero bytes, and the second no time.
        assert_eq!(chart.panels[0].lines[0].points, [(400.0, 1.0)]);
        assert!(chart.legend.is_empty());
    }

    #[test]
    fn unknown_columns_are_refused() {
        for (x, y, line) in [("size", "ms", ""), ("label", "size", ""), ("label", "ms", "{size}")] {
            let text = format!(
                "line = \"{line}\"\nx = {{ label = \"\", figures = [\"{x}\"] }}\n\
                 y = {{ label = \"\", figures = [\"{y}\"] }}"
            );
            let error = format!("{:#}", drawn(&text).unwrap_err());
            assert!(error.contains("no column size"), "{error}");
        }
    }

    #[test]
    fn settings_too_near_each_other_share_a_tick() {
        let settings = [0.8, 0.9, 0.95, 0.97, 0.98, 0.99, 1.0, 1.02, 1.05];
        let setting = PlotAxis { label: String::new(), figures: Vec::new(), log: true };
        let kept = apart(settings.to_vec(), &axis(&setting, settings.into_iter()));
        assert!(kept.len() <= MAX_MARKED && kept.len() > MIN_ROUND && kept[..2] == [0.8, 0.9], "{kept:?}");
        let few = [1.0, 10.0, 100.0];
        assert_eq!(apart(few.to_vec(), &axis(&setting, few.into_iter())), few);
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!([0.5, 1000.0, 26_116.0, 1_332_175.0].map(short), ["0.5", "1000", "26.1 k", "1.33 M"]);
    }
}
