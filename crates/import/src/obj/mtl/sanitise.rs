//! Reduces an MTL file to the supported lines, in a form that `tobj` 4 reads without errors or panics.

use std::fmt::Write as _;

/// Keyword in lower case, keyword as `tobj` expects it, and type of its value.
const KEYWORDS: [(&str, &str, ValueKind); 18] = [
    ("kd", "Kd", ValueKind::Color),
    ("ke", "Ke", ValueKind::Color),
    ("ns", "Ns", ValueKind::Number),
    ("d", "d", ValueKind::Number),
    ("tr", "Tr", ValueKind::Number),
    ("pr", "Pr", ValueKind::Number),
    ("pm", "Pm", ValueKind::Number),
    ("illum", "illum", ValueKind::Number),
    ("map_kd", "map_Kd", ValueKind::Texture),
    ("map_ke", "map_Ke", ValueKind::Texture),
    ("map_d", "map_d", ValueKind::Texture),
    ("map_pr", "map_Pr", ValueKind::Texture),
    ("map_pm", "map_Pm", ValueKind::Texture),
    ("norm", "norm", ValueKind::Texture),
    ("map_bump", "map_Bump", ValueKind::Texture),
    ("bump", "map_Bump", ValueKind::Texture),
    ("disp", "disp", ValueKind::Texture),
    ("newmtl", "newmtl", ValueKind::Name),
];

#[derive(Clone, Copy, PartialEq)]
enum ValueKind {
    Color,
    Number,
    Texture,
    Name,
}

/// Rewrites the supported lines: no leading blanks, one space after the keyword, colours with three values, `Tr` as `d`.
pub(super) fn sanitise(text: &str, warnings: &mut Vec<(usize, String)>) -> String {
    let mut out = String::with_capacity(text.len());
    // Whether a material has begun, and whether it has a `d` line.
    let (mut named, mut dissolved) = (false, false);
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let lower = keyword.to_ascii_lowercase();
        let Some(&(_, written, kind)) = KEYWORDS.iter().find(|(known, ..)| *known == lower) else {
            continue;
        };
        let mut ignore = |why: &str| warnings.push((number + 1, format!("{why}; the line is ignored")));
        if rest.is_empty() {
            ignore(&format!("{keyword} without a value"));
            continue;
        }
        if kind == ValueKind::Name {
            (named, dissolved) = (true, false);
        } else if !named {
            ignore(&format!("{keyword} before the first newmtl"));
            continue;
        }
        let line = match kind {
            ValueKind::Name | ValueKind::Texture => format!("{written} {rest}"),
            ValueKind::Color => match finite(rest).collect::<Vec<_>>()[..] {
                [r, g, b, ..] => format!("{written} {r:?} {g:?} {b:?}"),
                [grey] => format!("{written} {grey:?} {grey:?} {grey:?}"),
                _ => {
                    ignore(&format!(
                        "{written} needs one or three numbers (spectral and xyz colours are not read)"
                    ));
                    continue;
                }
            },
            ValueKind::Number => {
                // The option "-halo" of `d` is not supported; its value is used.
                let Some(value) = finite(rest.trim_start_matches("-halo")).next() else {
                    ignore(&format!("{keyword} needs a number"));
                    continue;
                };
                match written {
                    // `d` takes precedence: exporters disagree whether `Tr` is opacity or transparency.
                    "Tr" if dissolved => continue,
                    "Tr" => format!("d {:?}", 1.0 - value),
                    "illum" => {
                        if !(0.0..=10.0).contains(&value) {
                            ignore("illum is not between 0 and 10");
                            continue;
                        }
                        format!("illum {}", value as u8)
                    }
                    _ => {
                        dissolved |= written == "d";
                        format!("{written} {value:?}")
                    }
                }
            }
        };
        let _ = writeln!(out, "{line}");
    }
    out
}

/// The leading finite numbers of a text.
fn finite(text: &str) -> impl Iterator<Item = f64> + '_ {
    text.split_whitespace().map_while(|word| word.parse::<f64>().ok().filter(|x| x.is_finite()))
}
