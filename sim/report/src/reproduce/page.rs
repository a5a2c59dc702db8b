//! All sections as a self-contained HTML page.
//!
//! It shows the committed figures and lists deviations of this run. Two runs without deviations write the same page,
//! whatever the machine's speed.

use anyhow::Context as _;
use maud::{Markup, PreEscaped, html};

use super::{CommandLine, Outcome, Reproduction, Rows, Section};
use super::{plot, table};
use crate::html as pages;

/// The XML namespace attribute of an SVG file.
const SVG_NAME: &str = " xmlns=\"http://www.w3.org/2000/svg\"";

/// The page; `sections` have the committed figures of each of the reproduction's sections.
///
/// # Errors
/// Tables and plots that name unknown columns.
pub(super) fn page(made: &Reproduction, sections: &[(&Section, Rows)]) -> anyhow::Result<String> {
    let bodies =
        sections.iter().zip(&made.sections).map(|((section, rows), outcome)| one(section, rows, outcome));
    let bodies = bodies.collect::<anyhow::Result<Vec<Markup>>>()?;
    let body = html! {
        (head(made, sections))
        @for body in bodies { (body) }
    };
    Ok(pages::page("Lodestream: figures and what they cost", &body))
}

/// Versions, models, contents.
fn head(made: &Reproduction, sections: &[(&Section, Rows)]) -> Markup {
    let models: Vec<Vec<String>> =
        made.models.iter().map(|(name, hash)| vec![name.clone(), hash.clone()]).collect();
    let names = ["model", "BLAKE3 of the file"].map(str::to_owned);
    html! {
        p {
            "Made by lodestream-sim " (made.version) " on " (made.machine) ". Figures are the committed ones; beside each "
            "section are the deviations of this run. Bytes and virtual time must be equal; figures that depend on the "
            "machine's speed are compared as ratios to their column's geometric mean."
        }
        "\n"
        h2 { "Sections" } "\n"
        ul {
            "\n"
            @for (section, _) in sections {
                li { a href={ "#" (section.name) } { (section.title) } } "\n"
            }
        }
        "\n"
        @if !models.is_empty() {
            h2 { "Models" } "\n"
            (pages::table(2, &names, &models, pages::plain))
        }
    }
}

fn one(section: &Section, rows: &Rows, outcome: &Outcome) -> anyhow::Result<Markup> {
    let tables = table::shown(section, rows)?;
    let plots = plot::svgs(section, rows).with_context(|| section.name.clone())?;
    let command = |command: &CommandLine| match command.label.as_str() {
        "" => format!("{}\n", command.shown()),
        label => format!("{}   # {label}\n", command.shown()),
    };
    let commands: String = section.commands.iter().map(command).collect();
    Ok(html! {
        h2 id=(section.name) { (section.title) } "\n"
        @if let Some(trade) = &section.trade {
            dl {
                dt { "Setting" } dd { (marked(&trade.setting)) }
                dt { "Default" } dd { (marked(&trade.default)) }
                dt { "Why" } dd { (marked(&trade.reason)) }
            }
            "\n"
        }
        p { (verdict(section, outcome)) } "\n"
        @for table in &tables { (pages::table(1, &table.headings, &table.lines, marked)) }
        @for svg in &plots {
            // Inline SVG needs no namespace, and without it the page contains no URL.
            figure class="plot" { (PreEscaped(svg.replace(SVG_NAME, ""))) } "\n"
        }
        details {
            summary { "Commands, about " (format!("{:.0}", section.seconds)) " s" }
            pre { (commands) }
        }
        "\n"
        details {
            summary { "All figures (" (section.name) ".csv)" }
            (pages::table(1, &rows.columns, &rows.rows, pages::plain))
        }
        "\n"
    })
}

/// Tolerances, and outcome of the section.
fn verdict(section: &Section, outcome: &Outcome) -> String {
    let mut text = "Tolerance: none".to_owned();
    let ratios: Vec<String> = section
        .ratios
        .iter()
        .map(|(column, factor)| format!("{column} ratios within a factor {factor}"))
        .collect();
    if !ratios.is_empty() {
        text += &format!(", but {}", ratios.join(", "));
    }
    text += ". ";
    text += &match (&outcome.left_out, outcome.differences.as_slice()) {
        (Some(why), _) => format!("Not run: {why}."),
        (None, []) => "As committed.".to_owned(),
        (None, differences) => {
            let list: Vec<String> = differences.iter().map(ToString::to_string).collect();
            format!("Differs: {}.", list.join("; "))
        }
    };
    for rows in &outcome.rows_left_out {
        text += &format!(" Left out: {rows}.");
    }
    text
}

/// Text with Markdown's `code` and **bold**.
fn marked(text: &str) -> Markup {
    let mut html = pages::plain(text).into_string();
    for (mark, tag) in [("`", "code"), ("**", "b")] {
        while let Some((before, rest)) = html.split_once(mark)
            && let Some((inside, after)) = rest.split_once(mark)
        {
            html = format!("{before}<{tag}>{inside}</{tag}>{after}");
        }
    }
    PreEscaped(html)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::{Difference, RowsLeftOut, section};
    use super::*;

    /// The project's own list and figures.
    fn committed() -> Vec<(Section, Rows)> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/report");
        let rows = |name: &str| std::fs::read_to_string(folder.join(format!("{name}.csv"))).unwrap();
        let sections = section::read(&folder.join("sections.toml")).unwrap();
        sections.into_iter().map(|s| (s.clone(), Rows::from_csv(&rows(&s.name)).unwrap())).collect()
    }

    fn reproduction(sections: &[(Section, Rows)]) -> Reproduction {
        let outcome = |(section, _): &(Section, Rows)| Outcome {
            name: section.name.clone(),
            left_out: None,
            seconds: 1.0,
            differences: Vec::new(),
            stale_tables: Vec::new(),
            rows_left_out: Vec::new(),
        };
        Reproduction {
            version: "1".to_owned(),
            machine: "<one>".to_owned(),
            processors: 1,
            models: vec![("m.obj".to_owned(), "00ff".to_owned())],
            sections: sections.iter().map(outcome).collect(),
        }
    }

    #[test]
    fn the_committed_sections_make_a_self_contained_page() {
        let sections = committed();
        let made = reproduction(&sections);
        let shown: Vec<_> = sections.iter().map(|(section, rows)| (section, rows.clone())).collect();
        let page = page(&made, &shown).unwrap();
        assert!(page.len() < 1_000_000, "{} bytes", page.len());
        assert!(page.contains("&lt;one&gt;") && page.contains("m.obj") && !page.contains("<one>"));
        for (section, rows) in &sections {
            assert!(page.contains(&format!("<h2 id=\"{}\">", section.name)), "{}", section.name);
            for figure in &rows.rows[0] {
                assert!(page.contains(&pages::plain(figure).into_string()), "{}: {figure}", section.name);
            }
            if let Some(trade) = &section.trade {
                assert!(page.contains(&marked(&trade.reason).into_string()), "{}", section.name);
            }
            for plot in &section.plots {
                assert!(page.contains(&plot.y.label), "{}: {}", section.name, plot.y.label);
            }
        }
        assert!(!page.contains("src=") && !page.contains("<script") && !page.contains("http"));
        let plots = sections.iter().map(|(section, _)| section.plots.len().div_ceil(plot::PER_PICTURE));
        assert_eq!(page.matches("<svg").count(), plots.sum::<usize>());
        // Run times are not in it.
        let mut slower = made.clone();
        slower.sections[0].seconds = 1e3;
        assert_eq!(super::page(&slower, &shown).unwrap(), page);
    }

    #[test]
    fn the_page_lists_differences_and_omissions() {
        let mut sections = committed();
        sections.truncate(2);
        let mut made = reproduction(&sections);
        made.sections[0].left_out = Some("no models".to_owned());
        let figure = |text: &str| text.to_owned();
        made.sections[1].differences = vec![Difference {
            row: figure("row 1"),
            column: figure("bytes"),
            expected: figure("1"),
            found: figure("2"),
        }];
        let rows = RowsLeftOut { rows: 16, of: "nodes".to_owned(), why: "no file".to_owned() };
        made.sections[1].rows_left_out = vec![rows];
        let shown: Vec<_> = sections.iter().map(|(section, rows)| (section, rows.clone())).collect();
        let page = page(&made, &shown).unwrap();
        assert!(page.contains("Left out: 16 rows of nodes: no file."), "{page}");
        assert!(
            page.contains("Not run: no models.") && page.contains("Differs: row 1, bytes: 2 instead of 1.")
        );
    }

    #[test]
    fn code_and_bold_are_marked() {
        assert_eq!(marked("a `--b` **c** `d").into_string(), "a <code>--b</code> <b>c</b> `d");
        assert_eq!(marked("<`&`>").into_string(), "&lt;<code>&amp;</code>&gt;");
    }
}
