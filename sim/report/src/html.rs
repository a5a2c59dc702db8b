//! Self-contained HTML pages: no script, no external file, no network.

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = include_str!("html.css");

/// A page with a title and a body.
pub(crate) fn page(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE) "\n"
        html lang="en" {
            "\n"
            head {
                "\n"
                meta charset="utf-8"; "\n"
                meta name="viewport" content="width=device-width"; "\n"
                title { (title) } "\n"
                style { "\n" (PreEscaped(STYLE)) } "\n"
            }
            "\n"
            body {
                "\n"
                h1 { (title) } "\n"
                (body)
            }
            "\n"
        }
        "\n"
    };
    page.into_string()
}

/// A table with column names, of which the first `texts` hold words, and lines. Each text goes through `show`.
pub(crate) fn table<'a>(
    texts: usize,
    names: &[String],
    lines: impl IntoIterator<Item = &'a Vec<String>>,
    show: fn(&str) -> Markup,
) -> Markup {
    let class = |column: usize| (column < texts).then_some("text");
    html! {
        div class="scroll" {
            table {
                "\n"
                tr { @for (column, name) in names.iter().enumerate() { th class=[class(column)] { (show(name)) } } } "\n"
                @for line in lines {
                    tr { @for (column, text) in line.iter().enumerate() { td class=[class(column)] { (show(text)) } } } "\n"
                }
            }
        }
        "\n"
    }
}

/// Text without formatting.
pub(crate) fn plain(text: &str) -> Markup {
    html! { (text) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_text_and_the_first_columns_hold_words() {
        let names = ["a & b", "n"].map(str::to_owned);
        let lines = [["<b>", "\"1\""].map(str::to_owned).to_vec()];
        let expected = "<div class=\"scroll\"><table>\n<tr><th class=\"text\">a &amp; b</th><th>n</th></tr>\n\
                        <tr><td class=\"text\">&lt;b&gt;</td><td>&quot;1&quot;</td></tr>\n</table></div>\n";
        assert_eq!(table(1, &names, &lines, plain).into_string(), expected);
    }

    #[test]
    fn a_page_is_complete_html() {
        let page = page("<1>", &plain("body"));
        assert!(
            page.starts_with("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"),
            "{page}"
        );
        assert!(page.contains("<title>&lt;1&gt;</title>\n<style>\n:root {"), "{page}");
        assert!(
            page.ends_with("</style>\n</head>\n<body>\n<h1>&lt;1&gt;</h1>\nbody</body>\n</html>\n"),
            "{page}"
        );
    }
}
