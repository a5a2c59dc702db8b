//! The lines of an MTL file that are used, in the form that `tobj` 4 reads without failing.

use std::fmt::Write as _;

/// How `tobj` wants a keyword to be written, by what exporters write in any case, and what it takes.
const KEYWORDS: [(&str, &str, Takes); 18] = [
    ("kd", "Kd", Takes::Color),
    ("ke", "Ke", Takes::Color),
    ("ns", "Ns", Takes::Number),
    ("d", "d", Takes::Number),
    ("tr", "Tr", Takes::Number),
    ("pr", "Pr", Takes::Number),
    ("pm", "Pm", Takes::Number),
    ("illum", "illum", Takes::Number),
    ("map_kd", "map_Kd", Takes::Texture),
    ("map_ke", "map_Ke", Takes::Texture),
    ("map_d", "map_d", Takes::Texture),
    ("map_pr", "map_Pr", Takes::Texture),
    ("map_pm", "map_Pm", Takes::Texture),
    ("norm", "norm", Takes::Texture),
    ("map_bump", "map_Bump", Takes::Texture),
    ("bump", "map_Bump", Takes::Texture),
    ("disp", "disp", Takes::Texture),
    ("newmtl", "newmtl", Takes::Name),
];

#[derive(Clone, Copy, PartialEq)]
enum Takes {
    Color,
    Number,
    Texture,
    Name,
}

/// The lines that are used: no leading blanks, one space after the keyword, colours with three values, `Tr` as `d`.
pub(super) fn sanitise(text: &str, warnings: &mut Vec<(usize, String)>) -> String {
    let mut out = String::with_capacity(text.len());
    // Of the material at hand: whether there is one, and whether it has said `d`.
    let (mut named, mut dissolved) = (false, false);
    for (number, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        let lower = keyword.to_ascii_lowercase();
        let Some(&(_, written, takes)) = KEYWORDS.iter().find(|(known, ..)| *known == lower) else {
            continue;
        };
        let mut ignore = |why: &str| warnings.push((number + 1, format!("{why}; the line is ignored")));
        if rest.is_empty() {
            ignore(&format!("{keyword} without a value"));
            continue;
        }
        if takes == Takes::Name {
            (named, dissolved) = (true, false);
        } else if !named {
            ignore(&format!("{keyword} before the first newmtl"));
            continue;
        }
        let line = match takes {
            Takes::Name | Takes::Texture => format!("{written} {rest}"),
            Takes::Color => match finite(rest).collect::<Vec<_>>()[..] {
                [r, g, b, ..] => format!("{written} {r:?} {g:?} {b:?}"),
                [grey] => format!("{written} {grey:?} {grey:?} {grey:?}"),
                _ => {
                    ignore(&format!(
                        "{written} needs one or three numbers (spectral and xyz colours are not read)"
                    ));
                    continue;
                }
            },
            Takes::Number => {
                // "d -halo x" is an option of an effect that is not drawn: the value still counts.
                let Some(value) = finite(rest.trim_start_matches("-halo")).next() else {
                    ignore(&format!("{keyword} needs a number"));
                    continue;
                };
                match written {
                    // Exporters that write both mean one thing, but not all count Tr from the same end.
                    "Tr" if dissolved => continue,
                    "Tr" => format!("d {:?}", 1.0 - value),
                    "illum" => {
                        if !(0.0..=10.0).contains(&value) {
                            ignore("illum is none of 0 to 10");
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

/// The finite numbers that a text begins with.
fn finite(text: &str) -> impl Iterator<Item = f64> + '_ {
    text.split_whitespace().map_while(|word| word.parse::<f64>().ok().filter(|x| x.is_finite()))
}
