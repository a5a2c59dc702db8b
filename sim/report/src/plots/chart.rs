//! A chart as SVG: panels in a row with common lines, and a legend below.
//!
//! The crate `plotters` draws. Values are mapped to the axes' scales beforehand, and ticks and legend are laid out
//! here, since the width of text is unknown without fonts.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::coord::types::RangedCoordf64;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Colours that the colour-blind can distinguish (Okabe and Ito, "Color universal design", 2008), without the yellow,
/// which is hard to see on white.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(60, 60, 60),
];

const WIDTH_PX: u32 = 1120;
const PANEL_HEIGHT_PX: u32 = 300;
const LEFT_PX: u32 = 78;
const LEGEND_ROW_PX: u32 = 20;
const DASH_PX: i32 = 7;
const GAP_PX: i32 = 4;
const TEXT_PX: u32 = 17;
const FONT: &str = "sans-serif";

/// Scale of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    Linear,
    Logarithmic,
}

/// An axis: label, scale and range.
#[derive(Clone, Debug)]
pub(crate) struct Axis {
    pub(crate) label: String,
    pub(crate) scale: Scale,
    pub(crate) range: (f64, f64),
    /// Formats a tick's value; `None` for an axis without ticks.
    pub(crate) format: Option<fn(f64) -> String>,
    /// Preferred ticks, ascending, used if they fit; empty for round values.
    pub(crate) marked: Vec<f64>,
}

impl Axis {
    /// An axis that covers some values (possibly none), with a margin at both ends.
    pub(crate) fn holding(
        label: &str,
        scale: Scale,
        values: impl IntoIterator<Item = f64>,
        format: fn(f64) -> String,
    ) -> Self {
        let usable = |value: &f64| value.is_finite() && (scale == Scale::Linear || *value > 0.0);
        let (least, most) = values
            .into_iter()
            .filter(usable)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), v| (least.min(v), most.max(v)));
        let range = match scale {
            _ if least > most => (1.0, 10.0),
            Scale::Logarithmic if least * 1.2 > most => (least / 2.0, most * 2.0),
            Scale::Logarithmic => (least / 1.15, most * 1.15),
            // Linear axes start at zero, so that heights are proportional.
            Scale::Linear => (0.0_f64.min(least), if most > 0.0 { most * 1.05 } else { 1.0 }),
        };
        Self { label: label.to_owned(), scale, range, format: Some(format), marked: Vec::new() }
    }

    /// Normalised position of a value, clamped to the axis.
    fn place(&self, value: f64) -> f64 {
        let value = value.clamp(self.range.0, self.range.1);
        match self.scale {
            Scale::Linear => value,
            Scale::Logarithmic => value.log10(),
        }
    }

    fn value(&self, place: f64) -> f64 {
        match self.scale {
            Scale::Linear => place,
            Scale::Logarithmic => 10_f64.powf(place),
        }
    }

    /// Values of ticks: one, two and five times powers of ten; if these are too many, one and three times, or powers
    /// alone.
    pub(crate) fn ticks(&self, most: usize) -> Vec<f64> {
        let (from, to) = self.range;
        if self.format.is_none() {
            return Vec::new();
        }
        if (1..=most).contains(&self.marked.len()) {
            return self.marked.clone();
        }
        match self.scale {
            Scale::Linear => {
                let step = [1.0, 2.0, 5.0]
                    .into_iter()
                    .flat_map(|factor| (-12..=15).map(move |power| factor * 10_f64.powi(power)))
                    .filter(|step| (to - from) / step <= most as f64)
                    .fold(f64::INFINITY, f64::min);
                let first = (from / step).ceil() as i64;
                (first..).map(|i| i as f64 * step).take_while(|tick| *tick <= to).collect()
            }
            Scale::Logarithmic => {
                let all = |factors: &'static [f64], every: i32| {
                    let tick = move |power: i32| factors.iter().map(move |f| f * 10_f64.powi(power));
                    let powers = (-15..=15).filter(move |power| power % every == 0);
                    let ticks = powers.flat_map(tick).filter(|tick| (from..=to).contains(tick));
                    ticks.collect::<Vec<f64>>()
                };
                let fine = [all(&[1.0, 2.0, 5.0], 1), all(&[1.0, 3.0], 1)];
                let coarser = (1..=6).map(|every| all(&[1.0], every));
                let fitting = fine.into_iter().chain(coarser).find(|ticks| ticks.len() <= most);
                fitting.unwrap_or_default()
            }
        }
    }

    fn coordinate(&self, most_ticks: usize) -> Places {
        let ticks = self.ticks(most_ticks).into_iter().map(|tick| self.place(tick)).collect();
        Places { range: (self.place(self.range.0)..self.place(self.range.1)).into(), ticks }
    }

    fn text(&self, place: f64) -> String {
        // A power of ten is slightly off after its logarithm.
        let value = self.value(place);
        let rounded = format!("{value:.9e}").parse().unwrap_or(value);
        self.format.map(|format| format(rounded)).unwrap_or_default()
    }
}

/// Ticks of an axis, for `plotters`.
struct Places {
    range: RangedCoordf64,
    ticks: Vec<f64>,
}

impl Ranged for Places {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, place: &f64, limit: (i32, i32)) -> i32 {
        self.range.map(place, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.range.range()
    }
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// Each value holds until the next one.
    Steps,
    /// A dot at each value, connected by lines.
    Dots,
}

/// A line; its index in the legend determines its colour.
#[derive(Clone, Debug)]
pub(crate) struct Line {
    pub(crate) number: usize,
    pub(crate) points: Vec<(f64, f64)>,
}

/// One coordinate system.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) mark: Mark,
    pub(crate) lines: Vec<Line>,
}

/// Panels side by side.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    pub(crate) panels: Vec<Panel>,
    /// Names of the lines.
    pub(crate) legend: Vec<String>,
}

/// Most lines of a chart: each colour solid and dashed.
pub(crate) const MAX_LINES: usize = 2 * COLOURS.len();

type Failed = DrawingAreaErrorKind<std::io::Error>;
type Area<'a> = DrawingArea<SVGBackend<'a>, plotters::coord::Shift>;

impl Chart {
    /// The chart's SVG; deterministic.
    ///
    /// # Errors
    /// Errors of the drawing library.
    pub(crate) fn svg(&self) -> std::io::Result<String> {
        let mut svg = String::new();
        self.draw(&mut svg).map_err(|why| std::io::Error::other(why.to_string()))?;
        Ok(svg)
    }

    fn draw(&self, svg: &mut String) -> Result<(), Failed> {
        // Two columns of legend if all names are short enough.
        let longest = self.legend.iter().map(|name| name.chars().count()).max().unwrap_or(0);
        let columns: u32 = if longest <= 56 && self.legend.len() > 1 { 2 } else { 1 };
        let rows = (self.legend.len() as u32).div_ceil(columns).max(1);
        let root = SVGBackend::with_string(svg, (WIDTH_PX, PANEL_HEIGHT_PX + rows * LEGEND_ROW_PX + 10))
            .into_drawing_area();
        root.fill(&WHITE)?;
        let (above, below) = root.split_vertically(PANEL_HEIGHT_PX);
        for (panel, area) in self.panels.iter().zip(above.split_evenly((1, self.panels.len().max(1)))) {
            panel.draw(&area, self.panels.len())?;
        }
        for (number, name) in (0_u32..).zip(&self.legend) {
            let x = (LEFT_PX + number / rows * (WIDTH_PX - LEFT_PX) / columns) as i32;
            let y = (6 + number % rows * LEGEND_ROW_PX) as i32 + 7;
            let (key, style) = ([(x, y), (x + 30, y)], colour(number as usize).stroke_width(2));
            match is_dashed(number as usize) {
                true => below.draw(&DashedPathElement::new(key, DASH_PX, GAP_PX, style))?,
                false => below.draw(&PathElement::new(key, style))?,
            }
            let middle = Pos::new(HPos::Left, VPos::Center);
            let style = TextStyle::from((FONT, TEXT_PX)).color(&BLACK).pos(middle);
            below.draw(&Text::new(name.clone(), (x + 38, y), style))?;
        }
        root.present()
    }
}

impl Panel {
    fn draw(&self, area: &Area<'_>, panels: usize) -> Result<(), Failed> {
        // As many numbers as fit side by side.
        let x_ticks = (14 / panels).max(4).min(16 / panels);
        let left_px = if self.y.format.is_some() { LEFT_PX } else { 30 };
        let mut chart = ChartBuilder::on(area)
            .margin_right(26)
            .margin_top(4)
            .caption(&self.title, (FONT, TEXT_PX + 1))
            .x_label_area_size(46)
            .y_label_area_size(left_px)
            .build_cartesian_2d(self.x.coordinate(x_ticks), self.y.coordinate(9))?;
        chart
            .configure_mesh()
            .x_label_formatter(&|place| self.x.text(*place))
            .y_label_formatter(&|place| self.y.text(*place))
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .label_style((FONT, TEXT_PX))
            .axis_desc_style((FONT, TEXT_PX))
            .bold_line_style(RGBColor(222, 222, 222))
            .light_line_style(TRANSPARENT)
            .draw()?;
        for Line { number, points } in &self.lines {
            let place = |&(x, y): &(f64, f64)| (self.x.place(x), self.y.place(y));
            let dots: Vec<(f64, f64)> = points.iter().map(place).collect();
            let path = match self.mark {
                Mark::Dots => dots.clone(),
                Mark::Steps => steps(&dots),
            };
            let style = colour(*number).stroke_width(2);
            if is_dashed(*number) {
                let path = DashedPathElement::new(path, DASH_PX, GAP_PX, style);
                chart.draw_series(std::iter::once(path))?;
            } else {
                chart.draw_series(std::iter::once(PathElement::new(path, style)))?;
            }
            // A line of one point is drawn as a dot.
            if self.mark == Mark::Dots || dots.len() == 1 {
                let dot = |at| Circle::new(at, 3, colour(*number).filled());
                chart.draw_series(dots.into_iter().map(dot))?;
            }
        }
        Ok(())
    }
}

/// A line's colour.
fn colour(number: usize) -> RGBColor {
    COLOURS[number % COLOURS.len()]
}

fn is_dashed(number: usize) -> bool {
    number / COLOURS.len() % 2 == 1
}

/// The corners of a step line, on which each value holds until the next.
fn steps(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let corners = points.windows(2).flat_map(|pair| [pair[0], (pair[1].0, pair[0].1)]);
    corners.chain(points.last().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(scale: Scale, from: f64, to: f64) -> Axis {
        Axis {
            label: "x".into(),
            scale,
            range: (from, to),
            format: Some(|v| v.to_string()),
            marked: Vec::new(),
        }
    }

    #[test]
    fn ticks_are_round_and_not_too_many() {
        assert_eq!(axis(Scale::Linear, 0.0, 10.5).ticks(6), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(axis(Scale::Logarithmic, 0.9, 12.0).ticks(6), [1.0, 2.0, 5.0, 10.0]);
        assert_eq!(axis(Scale::Logarithmic, 90.0, 2e4).ticks(6), [100.0, 300.0, 1e3, 3e3, 1e4]);
        assert_eq!(axis(Scale::Logarithmic, 90.0, 2e4).ticks(4), [100.0, 1e3, 1e4]);
        for (from, to) in [(1e-9, 1e9), (3e3, 3.1e3), (0.5, 7e5)] {
            assert!(axis(Scale::Logarithmic, from, to).ticks(6).len() <= 6);
            assert!(axis(Scale::Linear, from, to).ticks(6).len() <= 7);
        }
        let texts: Vec<String> = axis(Scale::Logarithmic, 0.009, 1100.0)
            .ticks(9)
            .iter()
            .map(|tick| axis(Scale::Logarithmic, 0.009, 1100.0).text(tick.log10()))
            .collect();
        assert_eq!(texts, ["0.01", "0.1", "1", "10", "100", "1000"]);
    }

    #[test]
    fn an_axis_covers_its_values_and_accepts_none() {
        let held = Axis::holding("x", Scale::Logarithmic, [0.0, 3.0, f64::INFINITY, 40.0], |v| v.to_string());
        assert!(held.range.0 < 3.0 && held.range.0 > 2.0 && held.range.1 > 40.0 && held.range.1 < 50.0);
        for scale in [Scale::Linear, Scale::Logarithmic] {
            let empty = Axis::holding("x", scale, [], |v| v.to_string());
            assert!(empty.range.0 < empty.range.1);
            let one = Axis::holding("x", scale, [5.0], |v| v.to_string());
            assert!(one.range.0 < 5.0 && one.range.1 > 5.0, "{one:?}");
            assert!(one.place(1e9).is_finite() && one.place(-1.0).is_finite());
        }
    }

    #[test]
    fn a_step_holds_until_the_next_value() {
        assert_eq!(steps(&[(1.0, 5.0), (2.0, 3.0)]), [(1.0, 5.0), (2.0, 5.0), (2.0, 3.0)]);
        assert_eq!(steps(&[]), []);
    }

    #[test]
    fn names_are_escaped_in_the_svg() {
        let panel = Panel {
            title: "a < b".into(),
            x: axis(Scale::Linear, 0.0, 1.0),
            y: axis(Scale::Logarithmic, 1.0, 10.0),
            mark: Mark::Dots,
            lines: vec![Line { number: 0, points: vec![(0.5, 5.0), (0.7, 1e9)] }],
        };
        let chart = Chart { panels: vec![panel.clone(), panel], legend: vec!["<script>&".into()] };
        let svg = chart.svg().unwrap();
        assert!(svg.contains("&lt;script&gt;&amp;") && svg.contains("a &lt; b") && !svg.contains("<script"));
        assert_eq!(svg.matches("<circle").count(), 4);
        assert_eq!(svg, chart.svg().unwrap());
    }
}
