//! Tables of a Markdown document, written from figures.
//!
//! A table stands below a line `<!-- table: ID -->` and ends with the first line that is no row. A cell is a
//! template: `{column}` is the figure as it is, `{column*FACTOR}` a product, `{column:.2}` has two places,
//! `{column:,}` thousands divided by commas. What has no figure is a dash.

use anyhow::Context as _;

use super::Rows;
use super::section::{Section, Table};

/// The document with the section's tables written anew.
///
/// # Errors
/// Tables without a mark in the document, and templates that name no column.
pub(crate) fn update(document: &str, section: &Section, rows: &Rows) -> anyhow::Result<String> {
    section.tables.iter().try_fold(document.to_owned(), |document, table| {
        let [start, end] = place(&document, table)?;
        let text = markdown(table, rows).with_context(|| format!("table {}", table.id))?;
        Ok(format!("{}{text}{}", &document[..start], &document[end..]))
    })
}

/// The section's tables in the document that are not those of the figures.
///
/// # Errors
/// As [`update`].
pub(crate) fn stale(document: &str, section: &Section, rows: &Rows) -> anyhow::Result<Vec<String>> {
    let mut stale = Vec::new();
    for table in &section.tables {
        let [start, end] = place(document, table)?;
        if document[start..end] != markdown(table, rows).with_context(|| format!("table {}", table.id))? {
            stale.push(table.id.clone());
        }
    }
    Ok(stale)
}

/// Where a table begins and ends.
fn place(document: &str, table: &Table) -> anyhow::Result<[usize; 2]> {
    let mark = format!("<!-- table: {} -->\n", table.id);
    let start = document.find(&mark).with_context(|| format!("there is no line {}", mark.trim_end()))?;
    let start = start + mark.len();
    let rows = document[start..].split_inclusive('\n').take_while(|line| line.starts_with('|'));
    Ok([start, start + rows.map(str::len).sum::<usize>()])
}

fn markdown(table: &Table, rows: &Rows) -> anyhow::Result<String> {
    let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
    let mut text = line(table.columns.iter().map(|[heading, _]| heading.clone()).collect());
    text += &format!("|{}\n", "---|".repeat(table.columns.len()));
    for row in &rows.rows {
        let cells = table.columns.iter().map(|[_, template]| cell(template, rows, row));
        text += &line(cells.collect::<anyhow::Result<_>>()?);
    }
    Ok(text)
}

/// A template with the figures of a row in place of what is in braces.
fn cell(template: &str, rows: &Rows, row: &[String]) -> anyhow::Result<String> {
    let mut text = String::new();
    let mut rest = template;
    while let Some((before, after)) = rest.split_once('{') {
        let (inside, after) =
            after.split_once('}').with_context(|| format!("{template}: a brace is open"))?;
        text += before;
        text += &figure(inside, rows, row).with_context(|| template.to_owned())?;
        rest = after;
    }
    Ok(text + rest)
}

fn figure(inside: &str, rows: &Rows, row: &[String]) -> anyhow::Result<String> {
    let (what, format) = inside.split_once(':').unwrap_or((inside, ""));
    let (name, factor) = match what.split_once('*') {
        Some((name, factor)) => (name, factor.parse().with_context(|| format!("{factor} is no number"))?),
        None => (what, 1.0),
    };
    let column = rows.column(name).with_context(|| format!("there is no column {name}"))?;
    let figure = row[column].as_str();
    if figure.is_empty() {
        return Ok("–".to_owned());
    }
    if format.is_empty() && factor == 1.0 {
        return Ok(figure.to_owned());
    }
    let number: f64 = figure.parse().with_context(|| format!("{name}: {figure} is no number"))?;
    let number = number * factor;
    match format {
        "" => Ok(number.to_string()),
        "," => Ok(thousands(number)),
        places => {
            let places = places.strip_prefix('.').and_then(|p| p.parse().ok());
            let places: usize = places.with_context(|| format!("{format} is no format"))?;
            Ok(format!("{number:.places$}"))
        }
    }
}

/// Rounded, with commas.
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
        assert_eq!(stale(DOCUMENT, &section(), &rows).unwrap(), ["one"]);
        let document = update(DOCUMENT, &section(), &rows).unwrap();
        assert_eq!(
            document,
            "Text.\n\n<!-- table: one -->\n| what | B | of |\n|---|---|---|\n| **a** | 1,234,567 | 25.0 % |\n\
             | **b** | 999 | – % |\n\nMore.\n"
        );
        assert!(stale(&document, &section(), &rows).unwrap().is_empty());
        assert_eq!(update(&document, &section(), &rows).unwrap(), document);
    }

    #[test]
    fn what_is_missing_is_named() {
        let rows = Rows::from_csv(ROWS).unwrap();
        let error = update("Text.\n", &section(), &rows).unwrap_err();
        assert!(format!("{error:#}").contains("<!-- table: one -->"));
        let mut other = section();
        other.tables[0].columns[1][1] = "{size}".to_owned();
        let error = update(DOCUMENT, &other, &rows).unwrap_err();
        assert!(format!("{error:#}").contains("no column size"), "{error:#}");
        for bad in ["{bytes", "{bytes:x}", "{bytes*y}", "{label:,}"] {
            assert!(cell(bad, &rows, &rows.rows[0]).is_err(), "{bad}");
        }
    }
}
