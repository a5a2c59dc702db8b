//! Tables on Markdown pages, generated from figures.
//!
//! A table follows a line `<!-- table: ID -->` and ends at the first line that is not a row. A cell is a template:
//! `{column}` is the figure as it is, `{column:.2}` has two decimals, `{column:,}` thousands separated by commas.
//! `{a*100}`, `{a/b}` and longer expressions of columns and numbers are evaluated from left to right. A missing figure
//! is a dash.
//!
//! A table may show some rows only, and rows that differ in one column (`across`) may share a line: `{column@value}` is
//! the figure of the row with this value in that column.

use std::collections::BTreeMap;

use anyhow::Context as _;

use super::Rows;
use super::section::{Section, Table};

/// The section's tables by their ids, as Markdown.
///
/// # Errors
/// A template or condition that names a column which the rows lack.
pub(super) fn all<'a>(section: &'a Section, rows: &Rows) -> anyhow::Result<Vec<(&'a str, String)>> {
    let shown = shown(section, rows)?;
    Ok(shown.into_iter().map(|shown| (shown.id, markdown(&shown))).collect())
}

/// A table with evaluated cells.
pub(crate) struct EvaluatedTable<'a> {
    pub(crate) id: &'a str,
    pub(crate) headings: Vec<String>,
    pub(crate) lines: Vec<Vec<String>>,
}

/// The section's tables.
///
/// # Errors
/// A template or condition that names a column which the rows lack.
pub(crate) fn shown<'a>(section: &'a Section, rows: &Rows) -> anyhow::Result<Vec<EvaluatedTable<'a>>> {
    let table = |table: &'a Table| {
        let headings = table.columns.iter().map(|[heading, _]| heading.clone()).collect();
        let lines = lines(table, rows).with_context(|| format!("table {}", table.id))?;
        Ok(EvaluatedTable { id: &table.id, headings, lines })
    };
    section.tables.iter().map(table).collect()
}

/// The line above a table.
pub(super) fn mark(id: &str) -> String {
    format!("<!-- table: {id} -->\n")
}

/// Start and end of a table, if the document has its mark.
pub(super) fn place(document: &str, id: &str) -> Option<[usize; 2]> {
    let mark = mark(id);
    let start = document.find(&mark)? + mark.len();
    let rows = document[start..].split_inclusive('\n').take_while(|line| line.starts_with('|'));
    Some([start, start + rows.map(str::len).sum::<usize>()])
}

fn markdown(table: &EvaluatedTable<'_>) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(&table.headings);
    text += &format!("|{}\n", "---|".repeat(table.headings.len()));
    for cells in &table.lines {
        text += &line(cells);
    }
    text
}

/// The cells of a table's lines, without its headings.
///
/// # Errors
/// Templates and conditions that name unknown columns.
fn lines(table: &Table, rows: &Rows) -> anyhow::Result<Vec<Vec<String>>> {
    let across = table.across.as_ref().map(|name| rows.place(name)).transpose()?;
    let of_line = |group: &Vec<&[String]>| {
        let group = Group { rows, across, line: group };
        table.columns.iter().map(|[_, template]| cell(template, &group)).collect()
    };
    groups(table, rows)?.iter().map(of_line).collect()
}

/// The rows that a table shows, grouped by line.
fn groups<'a>(table: &Table, rows: &'a Rows) -> anyhow::Result<Vec<Vec<&'a [String]>>> {
    let by = table.by.iter().map(|name| rows.place(name)).collect::<anyhow::Result<Vec<usize>>>()?;
    let mut groups: Vec<Vec<&[String]>> = Vec::new();
    for row in only(&table.only, rows)? {
        let alike = |group: &&mut Vec<&[String]>| by.iter().all(|&c| group[0][c] == row[c]);
        match groups.iter_mut().find(alike).filter(|_| table.across.is_some()) {
            Some(group) => group.push(row),
            None => groups.push(vec![row]),
        }
    }
    Ok(groups)
}

/// The rows with the required values; a value that ends in `*` is a prefix, and `!` negates.
pub(super) fn only<'a>(
    conditions: &BTreeMap<String, String>,
    rows: &'a Rows,
) -> anyhow::Result<Vec<&'a [String]>> {
    let places = conditions.iter().map(|(name, value)| Ok((rows.place(name)?, value)));
    let places: Vec<(usize, &String)> = places.collect::<anyhow::Result<_>>()?;
    let has = |row: &&[String]| places.iter().all(|(c, value)| is_one_of(&row[*c], value));
    Ok(rows.rows.iter().map(Vec::as_slice).filter(has).collect())
}

/// Whether a value meets a condition.
fn is_one_of(value: &str, condition: &str) -> bool {
    if let Some(others) = condition.strip_prefix('!') {
        return !is_one_of(value, others);
    }
    match condition.strip_suffix('*') {
        Some(beginning) => value.starts_with(beginning),
        None => value == condition,
    }
}

/// Evaluates an expression of a row's figures and numbers.
pub(super) fn of_row(expression: &str, rows: &Rows, row: &[String]) -> anyhow::Result<Option<f64>> {
    value(expression, &Group { rows, across: None, line: &[row] })
}

/// Evaluates a template with a row's figures.
pub(super) fn text_of_row(template: &str, rows: &Rows, row: &[String]) -> anyhow::Result<String> {
    cell(template, &Group { rows, across: None, line: &[row] })
}

/// The rows of a line.
struct Group<'a> {
    rows: &'a Rows,
    /// The column in which they differ.
    across: Option<usize>,
    line: &'a [&'a [String]],
}

impl Group<'_> {
    /// The figure of a column: of the first row, or after an `@` of the row with that value in the column `across`.
    fn figure(&self, name: &str) -> anyhow::Result<&str> {
        let (name, row) = match name.split_once('@') {
            None => (name, self.line.first()),
            Some((name, value)) => {
                let across = self.across.with_context(|| format!("{name}@{value}: nothing is `across`"))?;
                (name, self.line.iter().find(|row| row[across] == value))
            }
        };
        let column = self.rows.place(name)?;
        Ok(row.map_or("", |row| row[column].as_str()))
    }
}

/// Evaluates a template with the figures of a line.
fn cell(template: &str, group: &Group<'_>) -> anyhow::Result<String> {
    let mut text = String::new();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once('{') {
        let (inside, after) =
            after.split_once('}').with_context(|| format!("{template}: a brace is open"))?;
        text += before;
        text += &figure(inside, group).with_context(|| template.to_owned())?;
        rest = after;
    }
    Ok(text + rest)
}

fn figure(inside: &str, group: &Group<'_>) -> anyhow::Result<String> {
    let (what, format) = inside.split_once(':').unwrap_or((inside, ""));
    if format.is_empty() && !what.contains(['*', '/']) {
        let figure = group.figure(what)?;
        return Ok(if figure.is_empty() { "–".to_owned() } else { figure.to_owned() });
    }
    let Some(number) = value(what, group)? else { return Ok("–".to_owned()) };
    match format {
        "" => Ok(number.to_string()),
        "," => Ok(thousands(number)),
        places => {
            let places = places.strip_prefix('.').and_then(|p| p.parse().ok());
            let places: usize = places.with_context(|| format!("{format} is not a format"))?;
            Ok(format!("{number:.places$}"))
        }
    }
}

/// Evaluates products and quotients of figures and numbers from left to right; `None` if a figure is missing.
fn value(expression: &str, group: &Group<'_>) -> anyhow::Result<Option<f64>> {
    let mut number = 1.0;
    let mut divide = false;
    let mut rest = expression;
    loop {
        let end = rest.find(['*', '/']).unwrap_or(rest.len());
        let name = &rest[..end];
        let operand: f64 = match name.parse() {
            Ok(constant) => constant,
            Err(_) => {
                let figure = group.figure(name)?;
                if figure.is_empty() {
                    return Ok(None);
                }
                figure.parse().with_context(|| format!("{name}: {figure} is not a number"))?
            }
        };
        if divide {
            number /= operand;
        } else {
            number *= operand;
        }
        if end == rest.len() {
            return Ok(Some(number));
        }
        divide = rest[end..].starts_with('/');
        rest = &rest[end + 1..];
    }
}

/// Rounded, with thousands separated by commas.
fn thousands(number: f64) -> String {
    let digits = format!("{:.0}", number.abs());
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    if number < 0.0 { format!("-{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::super::document::Documents;
    use super::super::section::parse;
    use super::*;

    fn section() -> Section {
        let text = "[[section]]\nname = \"s\"\ntitle = \"t\"\nseconds = 1\ncolumns = [\"bytes\", \"share\"]\n\
                    [[section.command]]\nrun = \"x\"\n[[section.table]]\nid = \"one\"\n\
                    columns = [[\"what\", \"**{label}**\"], [\"B\", \"{bytes:,}\"], [\"of\", \"{share*100:.1} %\"]]\n";
        parse(text).unwrap().remove(0)
    }

    const ROWS: &str = "label,bytes,share\na,1234567,0.25\nb,999,\n";
    const DOCUMENT: &str = "Text.\n\n<!-- table: one -->\n| old |\n|---|\n| 1 |\n\nMore.\n";

    #[test]
    fn a_table_is_written_from_figures_and_then_it_is_not_stale() {
        let rows = Rows::from_csv(ROWS).unwrap();
        let mut documents = Documents::of(DOCUMENT);
        assert_eq!(documents.stale(&section(), &rows).unwrap()[0].table, "one");
        let changed = documents.update(&section(), &rows).unwrap();
        assert_eq!(
            changed[0].1,
            "Text.\n\n<!-- table: one -->\n| what | B | of |\n|---|---|---|\n| **a** | 1,234,567 | 25.0 % |\n\
             | **b** | 999 | – % |\n\nMore.\n"
        );
        assert!(documents.stale(&section(), &rows).unwrap().is_empty());
        assert!(documents.update(&section(), &rows).unwrap().is_empty());
    }

    #[test]
    fn missing_columns_and_marks_are_named() {
        let rows = Rows::from_csv(ROWS).unwrap();
        let error = Documents::of("Text.\n").update(&section(), &rows).unwrap_err();
        assert!(format!("{error:#}").contains("<!-- table: one -->"));
        let mut other = section();
        other.tables[0].columns[1][1] = "{size}".to_owned();
        let error = Documents::of(DOCUMENT).update(&other, &rows).unwrap_err();
        assert!(format!("{error:#}").contains("no column size"), "{error:#}");
        let line = [rows.rows[0].as_slice()];
        let group = Group { rows: &rows, across: None, line: &line };
        for bad in ["{bytes", "{bytes:x}", "{bytes*y}", "{label:,}", "{bytes*}", "{bytes@1}"] {
            assert!(cell(bad, &group).is_err(), "{bad}");
        }
        for (template, expected) in [("{bytes/1000*2:.1}", "2469.1"), ("{share/share}", "1")] {
            assert_eq!(cell(template, &group).unwrap(), expected);
        }
    }

    #[test]
    fn rows_may_be_left_out_and_share_a_line() {
        let rows = "label,what,rate,ms\n,a,2,9\n,a,4,5\n,b,2,8\n,c,4,1\n";
        let rows = Rows::from_csv(rows).unwrap();
        let mut table = section().tables.remove(0);
        table.columns = vec![["what".to_owned(), "{what}: {ms@2} / {ms@4} / {ms@2*10/ms@4:.1}".to_owned()]];
        (table.by, table.across) = (vec!["what".to_owned()], Some("rate".to_owned()));
        let found = |table: &Table| lines(table, &rows).unwrap().concat();
        assert_eq!(found(&table), ["a: 9 / 5 / 18.0", "b: 8 / – / –", "c: – / 1 / –"]);
        table.only.insert("what".to_owned(), "b".to_owned());
        assert_eq!(found(&table), ["b: 8 / – / –"]);
        for (condition, expected) in
            [("b*", &["b"][..]), ("*", &["a", "b", "c"]), ("!b", &["a", "c"]), ("!*", &[]), ("b!", &[])]
        {
            table.only.insert("what".to_owned(), condition.to_owned());
            let shown: Vec<String> = found(&table).iter().map(|line| line[..1].to_owned()).collect();
            assert_eq!(shown, expected, "{condition}");
        }
        table.only.insert("what".to_owned(), "b".to_owned());
        table.only.insert("where".to_owned(), String::new());
        assert!(lines(&table, &rows).unwrap_err().to_string().contains("no column where"));
    }
}
