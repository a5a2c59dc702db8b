//! As much of Markdown as the documents use.

/// A line of a document.
pub(super) struct Line<'a> {
    /// From 1.
    pub(super) number: usize,
    pub(super) text: &'a str,
    pub(super) kind: Kind<'a>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind<'a> {
    Prose,
    Heading,
    Table,
    /// Within a code fence, with its language.
    Code(&'a str),
    Fence,
}

pub(super) fn lines(text: &str) -> Vec<Line<'_>> {
    let mut fence = None;
    let kind = |text: &'_ str| {
        if text.starts_with('#') {
            Kind::Heading
        } else if text.trim_start().starts_with('|') {
            Kind::Table
        } else {
            Kind::Prose
        }
    };
    let mut out = Vec::new();
    for (number, text) in (1..).zip(text.lines()) {
        let kind = match (text.trim_start().strip_prefix("```"), fence) {
            (Some(language), None) => {
                fence = Some(language.trim());
                Kind::Fence
            }
            (Some(_), Some(_)) => {
                fence = None;
                Kind::Fence
            }
            (None, Some(language)) => Kind::Code(language),
            (None, None) => kind(text),
        };
        out.push(Line { number, text, kind });
    }
    out
}

/// What stands between single backticks.
pub(super) fn code_spans(line: &str) -> Vec<&str> {
    line.split('`').skip(1).step_by(2).collect()
}

/// The targets of `[text](target)`, outside code.
pub(super) fn links(line: &str) -> Vec<String> {
    let outside: String = line.split('`').step_by(2).collect::<Vec<_>>().join("``");
    outside.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0.to_owned())).collect()
}

/// The anchors of a document's headings, as GitHub makes them.
pub(super) fn anchors(text: &str) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for line in lines(text).iter().filter(|line| line.kind == Kind::Heading) {
        let title = line.text.trim_start_matches('#').trim();
        let title = title.to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        let slug: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect();
        let again = (1..).map(|n| format!("{slug}-{n}")).find(|name| !found.contains(name)).unwrap();
        found.push(if found.contains(&slug) { again } else { slug });
    }
    found
}
