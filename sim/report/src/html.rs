//! Pages of HTML that need nothing beside themselves: no script, no file, no network.

const STYLE: &str = include_str!("html.css");

/// A page, from its title and its body.
pub(crate) fn page(title: &str, body: &str) -> String {
    let title = escaped(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" \
         content=\"width=device-width\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <h1>{title}</h1>\n{body}</body>\n</html>\n"
    )
}

/// Text as HTML shows it.
pub(crate) fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => safe += "&lt;",
            '>' => safe += "&gt;",
            '&' => safe += "&amp;",
            '"' => safe += "&quot;",
            '\'' => safe += "&#39;",
            c => safe.push(c),
        }
    }
    safe
}

/// A table: names of columns, of which the first `texts` hold words, and lines. Each text goes through `show`.
pub(crate) fn table<'a>(
    texts: usize,
    names: &[String],
    lines: impl IntoIterator<Item = &'a Vec<String>>,
    show: fn(&str) -> String,
) -> String {
    let cells = |tag: &str, cells: &[String]| {
        let cell = |(i, text): (usize, &String)| {
            let class = if i < texts { " class=\"text\"" } else { "" };
            format!("<{tag}{class}>{}</{tag}>", show(text))
        };
        cells.iter().enumerate().map(cell).collect::<String>()
    };
    let mut html = format!("<div class=\"scroll\"><table>\n<tr>{}</tr>\n", cells("th", names));
    for line in lines {
        html += &format!("<tr>{}</tr>\n", cells("td", line));
    }
    html + "</table></div>\n"
}
