//! How a figure grows with another: the exponent of the power law through some rows.

use super::Rows;
use super::section::FitLine;
use super::table;

/// Of a table of exponents.
pub(super) const HEADINGS: [&str; 6] = ["what", "from", "to", "exponent", "off by at most", "last exponent"];

/// A line: the figure, its first and last point, the exponent by least squares in logarithms, the largest factor between
/// a point and the law, and the exponent between the last two points: what grows from a floor bends upwards.
///
/// # Errors
/// What names no column.
pub(super) fn line(fit: &FitLine, rows: &Rows) -> anyhow::Result<Vec<String>> {
    let mut points = Vec::new();
    for row in table::only(&fit.only, rows)? {
        let pair = (table::of_row(&fit.x, rows, row)?, table::of_row(&fit.y, rows, row)?);
        if let (Some(x), Some(y)) = pair
            && x > 0.0
            && y > 0.0
        {
            points.push((x, y));
        }
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let dash = || "–".to_owned();
    let point = |point: Option<&(f64, f64)>| {
        point.map_or_else(dash, |(x, y)| format!("{} at {}", short(*y), short(*x)))
    };
    let (exponent, off) = match power(&points) {
        Some((exponent, off)) => (format!("{exponent:.2}"), format!("{off:.2} ×")),
        None => (dash(), dash()),
    };
    let last = power(&points[points.len().saturating_sub(2)..]);
    let last = last.map_or_else(dash, |(exponent, _)| format!("{exponent:.2}"));
    Ok(vec![fit.what.clone(), point(points.first()), point(points.last()), exponent, off, last])
}

/// Three digits.
fn short(x: f64) -> String {
    let digits = 2 - x.abs().log10().floor() as i32;
    if digits >= 0 {
        let text = format!("{x:.*}", digits as usize);
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        let unit = 10_f64.powi(-digits);
        format!("{:.0}", (x / unit).round() * unit)
    }
}

/// Exponent of `y = a · x^b` by least squares in logarithms, and the largest factor between a point and it; `None` where
/// there are not two places.
fn power(points: &[(f64, f64)]) -> Option<(f64, f64)> {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let (mean_x, mean_y) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / count, b + y / count));
    let spread: f64 = logs.iter().map(|(x, _)| (x - mean_x) * (x - mean_x)).sum();
    if spread <= 1e-12 {
        return None;
    }
    let slope = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>() / spread;
    let off = logs.iter().map(|(x, y)| (y - mean_y - slope * (x - mean_x)).abs()).fold(0.0, f64::max);
    Some((slope, off.exp()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_found() {
        let points: Vec<(f64, f64)> = (1..6).map(|i| (f64::from(i), 3.0 * f64::from(i).powf(1.5))).collect();
        let (exponent, off) = power(&points).unwrap();
        assert!((exponent - 1.5).abs() < 1e-9 && (off - 1.0).abs() < 1e-9);
        assert_eq!((power(&[(2.0, 3.0)]), power(&[(2.0, 3.0), (2.0, 4.0)]), power(&[])), (None, None, None));
        // A point that is twice too high.
        assert!(power(&[(1.0, 1.0), (10.0, 20.0), (100.0, 100.0)]).unwrap().1 > 1.5);
    }

    #[test]
    fn a_line_says_from_where_to_where_and_leaves_out_what_has_no_figure() {
        let rows = "label,n,kind,bytes\n,100,a,40000\n,1,a,400\n,10,a,\n,7,b,3\n";
        let rows = Rows::from_csv(rows).unwrap();
        let only = [("kind".to_owned(), "a".to_owned())].into();
        let fit = FitLine { what: "w".to_owned(), x: "n".to_owned(), y: "bytes/1000".to_owned(), only };
        assert_eq!(line(&fit, &rows).unwrap(), ["w", "0.4 at 1", "40 at 100", "1.00", "1.00 ×", "1.00"]);
        assert!(line(&FitLine { y: "size".to_owned(), ..fit }, &rows).is_err());
    }

    #[test]
    fn numbers_are_short() {
        let all = [0.012_345, 1.0, 12.34, 151_266.0, 999.6].map(short);
        assert_eq!(all, ["0.0123", "1", "12.3", "151000", "1000"]);
    }
}
