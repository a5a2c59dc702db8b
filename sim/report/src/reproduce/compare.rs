//! Figures beside those committed.

use std::fmt;

use serde::Serialize;

use super::{Rows, Section};

/// A figure that is not as committed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// The row, by its number and label.
    pub row: String,
    /// The column.
    pub column: String,
    /// As committed.
    pub expected: String,
    /// As found.
    pub found: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}: {} instead of {}", self.row, self.column, self.found, self.expected)
    }
}

/// What differs by more than it may: columns with a ratio as ratios to the column's geometric mean, by
/// that factor; all others at all.
#[must_use]
pub fn compare(section: &Section, expected: &Rows, found: &Rows) -> Vec<Difference> {
    let whole = |what: &str, expected: String, found: String| Difference {
        row: what.to_owned(),
        column: "all".to_owned(),
        expected,
        found,
    };
    if expected.columns != found.columns {
        return vec![whole("columns", expected.columns.join(", "), found.columns.join(", "))];
    }
    if expected.rows.len() != found.rows.len() {
        let count = |rows: &Rows| format!("{} rows", rows.rows.len());
        return vec![whole("rows", count(expected), count(found))];
    }
    let mut differences = Vec::new();
    for (c, column) in expected.columns.iter().enumerate() {
        let factor = section.ratios.get(column);
        let means = [expected, found].map(|rows| geometric_mean(rows, c));
        for (number, (was, is)) in (1..).zip(expected.rows.iter().zip(&found.rows)) {
            let same = was[c] == is[c]
                || factor.is_some_and(|factor| {
                    let ratio = |text: &str, mean: f64| text.parse::<f64>().map(|x| x / mean);
                    match (ratio(&was[c], means[0]), ratio(&is[c], means[1])) {
                        (Ok(was), Ok(is)) => (is / was).max(was / is) <= *factor,
                        _ => false,
                    }
                });
            if !same {
                differences.push(Difference {
                    row: format!("row {number} {}", was[0]).trim_end().to_owned(),
                    column: column.clone(),
                    expected: was[c].clone(),
                    found: is[c].clone(),
                });
            }
        }
    }
    differences
}

/// Of the figures of a column that are above 0; 1 where there are none.
fn geometric_mean(rows: &Rows, column: usize) -> f64 {
    let figures = rows.rows.iter().filter_map(|row| row[column].parse::<f64>().ok());
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for figure in figures.filter(|&f| f > 0.0) {
        sum += figure.ln();
        count += 1.0;
    }
    (sum / count.max(1.0)).exp()
}

#[cfg(test)]
mod tests {
    use super::super::section::parse;
    use super::*;

    fn section() -> Section {
        let text = "[[section]]\nname = \"s\"\ntitle = \"t\"\nseconds = 1\ncolumns = [\"bytes\", \"speed\"]\n\
                    ratios = { speed = 1.2 }\n[[section.command]]\nrun = \"x\"\n";
        parse(text).unwrap().remove(0)
    }

    fn rows(figures: [[&str; 2]; 2]) -> Rows {
        let row =
            |(label, [bytes, speed]): (&str, [&str; 2])| [label, bytes, speed].map(str::to_owned).to_vec();
        Rows {
            columns: ["label", "bytes", "speed"].map(str::to_owned).to_vec(),
            rows: ["a", "b"].into_iter().zip(figures).map(row).collect(),
        }
    }

    #[test]
    fn bytes_must_be_equal_and_speeds_in_proportion() {
        let expected = rows([["10", "100"], ["20", "200"]]);
        let differ = |found| compare(&section(), &expected, &found);
        assert!(differ(expected.clone()).is_empty());
        // A machine that is three times as fast.
        assert!(differ(rows([["10", "300"], ["20", "600"]])).is_empty());
        let found = differ(rows([["10", "300"], ["21", "1200"]]));
        let columns: Vec<&str> = found.iter().map(|d| d.column.as_str()).collect();
        assert_eq!(columns, ["bytes", "speed", "speed"]);
        assert_eq!(found[0].to_string(), "row 2 b, bytes: 21 instead of 20");
        assert_eq!(differ(rows([["", "100"], ["20", "200"]])).len(), 1);
    }

    #[test]
    fn other_rows_or_columns_are_one_difference() {
        let expected = rows([["10", "100"], ["20", "200"]]);
        let mut fewer = expected.clone();
        fewer.rows.pop();
        assert_eq!(compare(&section(), &expected, &fewer)[0].found, "1 rows");
        let mut renamed = expected.clone();
        renamed.columns[1] = "size".to_owned();
        assert_eq!(compare(&section(), &expected, &renamed)[0].row, "columns");
    }
}
