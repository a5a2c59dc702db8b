//! Comparison of figures with the committed ones.

use std::fmt;

use lodestream_scenario::baseline::lacks_something_here;
use serde::Serialize;

use super::rows::Rows;
use super::section::Section;

/// A figure that differs from the committed one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// The row, by its number and label.
    pub row: String,
    /// The column.
    pub column: String,
    /// The committed figure.
    pub expected: String,
    /// The new figure.
    pub found: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}, {}: {} instead of {}", self.row, self.column, self.found, self.expected)
    }
}

/// Committed rows that cannot be reproduced on this machine.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct RowsLeftOut {
    /// Number of rows.
    pub rows: usize,
    /// Their technique.
    pub of: String,
    /// Reason.
    pub why: String,
}

impl fmt::Display for RowsLeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} rows of {}: {}", self.rows, self.of, self.why)
    }
}

/// The result of a comparison.
#[derive(Clone, Debug, Default)]
pub(crate) struct Compared {
    /// Differences beyond the tolerance.
    pub(crate) differences: Vec<Difference>,
    /// Committed rows without counterpart, with the reason.
    pub(crate) left_out: Vec<RowsLeftOut>,
    /// The new figures, and committed rows that were left out.
    pub(crate) kept: Rows,
}

/// Compares rows: columns with a tolerance by their ratios to the column's geometric mean, all others exactly. Rows of
/// techniques that lack something on this machine are left out.
#[must_use]
pub(crate) fn compare(section: &Section, expected: &Rows, found: &Rows) -> Compared {
    let whole = |what: &str, expected: String, found: String| Difference {
        row: what.to_owned(),
        column: "all".to_owned(),
        expected,
        found,
    };
    if expected.columns != found.columns {
        let difference = whole("columns", expected.columns.join(", "), found.columns.join(", "));
        return Compared { differences: vec![difference], left_out: Vec::new(), kept: found.clone() };
    }
    let Aligned { pairs, alone, left_out, kept } = aligned(expected, found);
    let kept = Rows { columns: found.columns.clone(), rows: kept };
    if alone > 0 {
        let differences = vec![whole("rows", count(expected), count(found))];
        return Compared { differences, left_out, kept };
    }
    let mut differences = Vec::new();
    for (c, column) in expected.columns.iter().enumerate() {
        let factor = section.ratios.get(column);
        let means = [
            geometric_mean(pairs.iter().map(|pair| &pair.was[c])),
            geometric_mean(pairs.iter().map(|pair| &pair.is[c])),
        ];
        for &Pair { number, was, is } in &pairs {
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
    Compared { differences, left_out, kept }
}

fn count(rows: &Rows) -> String {
    format!("{} rows", rows.rows.len())
}

/// A committed row, its number, and its counterpart.
#[derive(Clone, Copy)]
struct Pair<'a> {
    number: usize,
    was: &'a [String],
    is: &'a [String],
}

/// Matched rows.
#[derive(Default)]
struct Aligned<'a> {
    pairs: Vec<Pair<'a>>,
    /// Committed rows without counterpart.
    alone: usize,
    left_out: Vec<RowsLeftOut>,
    kept: Vec<Vec<String>>,
}

/// Matches rows in order. A row that states why its technique was not run matches all committed rows of that technique
/// that follow: nodes have one per peer, and a single one without peers.
fn aligned<'a>(expected: &'a Rows, found: &'a Rows) -> Aligned<'a> {
    let mut all = Aligned::default();
    let places = expected.column("technique").zip(expected.column("ended"));
    let mut rest = (1..).zip(&expected.rows).peekable();
    // The technique of the last row, if it was left out.
    let mut last: Option<&str> = None;
    for is in &found.rows {
        let lacking = places.filter(|&(_, ended)| lacks_something_here(&is[ended]));
        if let Some((technique, ended)) = lacking {
            let (name, why) = (is[technique].as_str(), is[ended].as_str());
            let of_it = |(_, was): &(usize, &Vec<String>)| {
                let peer = was[technique].strip_prefix(name).is_some_and(|rest| rest.starts_with(": "));
                (was[technique] == name || peer) && was[ended] != why
            };
            let before = all.kept.len();
            while let Some((_, was)) = rest.next_if(of_it) {
                all.kept.push(was.clone());
            }
            let rows = all.kept.len() - before;
            match all.left_out.iter_mut().find(|of| of.of == name && of.why == why) {
                Some(of) => of.rows += rows,
                None if rows > 0 => {
                    all.left_out.push(RowsLeftOut { rows, of: name.to_owned(), why: why.to_owned() });
                }
                None => {}
            }
            // Rows of other seeds repeat the reason.
            if rows > 0 || last == Some(name) {
                last = Some(name);
                continue;
            }
        }
        last = None;
        match rest.next() {
            Some((number, was)) => all.pairs.push(Pair { number, was, is }),
            None => all.alone += 1,
        }
        all.kept.push(is.clone());
    }
    all.alone += rest.count();
    all
}

/// Geometric mean of the figures above 0; 1 if there are none.
fn geometric_mean<'a>(figures: impl Iterator<Item = &'a String>) -> f64 {
    let figures = figures.filter_map(|figure| figure.parse::<f64>().ok());
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
        let differ = |found| compare(&section(), &expected, &found).differences;
        assert!(differ(expected.clone()).is_empty());
        // A machine three times as fast.
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
        assert_eq!(compare(&section(), &expected, &fewer).differences[0].found, "1 rows");
        let mut renamed = expected.clone();
        renamed.columns[1] = "size".to_owned();
        assert_eq!(compare(&section(), &expected, &renamed).differences[0].row, "columns");
    }

    const RUNS: &str = "label,technique,bytes,speed,ended\n,ours,1,1,settled\n,nodes: a,2,1,settled\n\
                        ,nodes: b,3,1,settled\n,draco,4,1,settled\n,ours,5,1,settled\n,nodes: a,,,not run: of two\n\
                        ,nodes: b,,,not run: of two\n,draco,6,1,settled\n";

    /// Without the file of peers, nodes have one row in place of one per peer; the other rows are compared
    /// nevertheless.
    #[test]
    fn rows_that_this_machine_cannot_reproduce_are_left_out() {
        let peers = "not run: no file of peers is named (--peers FILE)";
        let draco = "not run: draco_encoder is not on this machine";
        let found = |last: &str| {
            let text = format!(
                "label,technique,bytes,speed,ended\n,ours,1,1,settled\n,nodes,,,{peers}\n,draco,,,{draco}\n\
                 ,ours,{last},1,settled\n,nodes,,,{peers}\n,draco,,,{draco}\n"
            );
            Rows::from_csv(&text).unwrap()
        };
        let expected = Rows::from_csv(RUNS).unwrap();
        let compared = compare(&section(), &expected, &found("5"));
        assert_eq!(compared.differences, []);
        let said: Vec<String> = compared.left_out.iter().map(ToString::to_string).collect();
        assert_eq!(said, [format!("4 rows of nodes: {peers}"), format!("2 rows of draco: {draco}")]);
        assert_eq!(compared.kept, expected);
        // Available rows are compared under their number; the others are kept.
        let compared = compare(&section(), &expected, &found("7"));
        assert_eq!(compared.differences[0].to_string(), "row 5, bytes: 7 instead of 5");
        assert_eq!(compared.kept.rows[4][2], "7");
        // Another row is still missing, and a technique that fails for another reason is not left out.
        let mut fewer = found("5");
        fewer.rows.remove(0);
        assert_eq!(compare(&section(), &expected, &fewer).differences[0].column, "all");
        let mut elsewhere = Rows::from_csv(RUNS).unwrap();
        elsewhere.rows[3][4] = "not run: the nodes of \"a\" lie elsewhere than the model".to_owned();
        let compared = compare(&section(), &expected, &elsewhere);
        assert_eq!((compared.left_out.len(), compared.differences[0].column.as_str()), (0, "ended"));
    }

    #[test]
    fn left_out_rows_may_have_seeds_and_may_be_committed_as_such() {
        let peers = "not run: no file of peers is named (--peers FILE)";
        let expected =
            "label,technique,seed,ended\n,nodes: a,1,settled\n,nodes: a,2,settled\n,ours,1,settled\n";
        let found =
            format!("label,technique,seed,ended\n,nodes,1,{peers}\n,nodes,2,{peers}\n,ours,1,settled\n");
        let (expected, found) = (Rows::from_csv(expected).unwrap(), Rows::from_csv(&found).unwrap());
        let compared = compare(&section(), &expected, &found);
        assert_eq!((compared.differences.len(), compared.left_out[0].rows), (0, 2));
        let same = compare(&section(), &found, &found);
        assert_eq!((same.differences.len(), same.left_out.len()), (0, 0));
    }
}
