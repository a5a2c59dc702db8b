//! Warnings about the parts of model files. A file of many parts brings the same ones over and over: each kind is told once
//! for each file, with a count.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Warnings by file and kind, in the order in which they came.
#[derive(Debug, Default)]
pub struct Warnings {
    told: Vec<(String, usize)>,
    /// Where the first of a kind is in the list.
    kinds: BTreeMap<(PathBuf, String), usize>,
}

impl Warnings {
    /// Adds what a part of a model file brought.
    pub fn add(&mut self, file: &Path, warnings: &[String]) {
        for warning in warnings {
            let next = self.told.len();
            let at = *self.kinds.entry((file.to_owned(), kind(warning))).or_insert(next);
            match self.told.get_mut(at) {
                Some((_, count)) => *count += 1,
                None => self.told.push((warning.clone(), 1)),
            }
        }
    }

    /// The first warning of each kind, with the number of others.
    pub fn lines(&self) -> impl Iterator<Item = String> {
        self.told.iter().map(|(first, count)| match count {
            1 => first.clone(),
            _ => format!("{first} (the first of {count} such warnings)"),
        })
    }
}

/// A warning without what tells those of a kind apart: numbers that stand alone or in brackets, and quoted names. Numbers in
/// names of files stay.
fn kind(warning: &str) -> String {
    let mut kind = String::with_capacity(warning.len());
    let mut before = ' ';
    let mut rest = warning;
    while let Some(next) = rest.chars().next() {
        let digits = rest.len() - rest.trim_start_matches(|c: char| c.is_ascii_digit()).len();
        let after = rest[digits..].chars().next().unwrap_or(' ');
        let quoted = quoted(rest);
        let skipped = match (quoted, digits) {
            (1.., _) => quoted,
            (0, 1..) if " [(:".contains(before) && " ]):,;".contains(after) => digits,
            _ => 0,
        };
        if skipped > 0 {
            kind.push('#');
            before = '#';
            rest = &rest[skipped..];
        } else {
            // All digits of a number at once: the last ones may look like a number of their own.
            let taken = digits.max(next.len_utf8());
            kind.push_str(&rest[..taken]);
            before = if digits > 0 { '0' } else { next };
            rest = &rest[taken..];
        }
    }
    kind
}

/// Length of the quoted name at the start of a text, with its quotes; 0 if there is none.
fn quoted(text: &str) -> usize {
    let Some(inner) = text.strip_prefix('"') else { return 0 };
    let mut escaped = false;
    let end = inner.char_indices().find(|&(_, c)| {
        let ends = c == '"' && !escaped;
        escaped = c == '\\' && !escaped;
        ends
    });
    end.map_or(0, |(at, _)| at + 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(warnings: &[(&str, &str)]) -> Vec<String> {
        let mut all = Warnings::default();
        for (file, warning) in warnings {
            all.add(Path::new(file), &[(*warning).to_owned()]);
        }
        all.lines().collect()
    }

    #[test]
    fn a_kind_is_told_once_for_each_file_with_a_count() {
        let of_part = |n: usize| {
            format!("a.glb: meshes[{n}].primitives[0] has no TEXCOORD_0; export \"m {n}\" again ({n})")
        };
        let parts: Vec<String> = (0..65).map(of_part).collect();
        let mut all: Vec<(&str, &str)> = parts.iter().map(|warning| ("a.glb", warning.as_str())).collect();
        all.push((
            "b.glb",
            "a.glb: meshes[3].primitives[0] has no TEXCOORD_0; export \"x \\\" y\" again (1)",
        ));
        all.push(("a.glb", "a.glb: meshes[3].primitives[0] has no TEXCOORD_1; export \"m\" again (1)"));
        let told = lines(&all);
        assert_eq!(told.len(), 3, "{told:?}");
        assert_eq!(told[0], format!("{} (the first of 65 such warnings)", parts[0]));
        assert_eq!(told[2], all[66].1, "another set is another kind");
    }

    #[test]
    fn files_whose_names_have_numbers_are_different_files() {
        let told = lines(&[
            ("a.obj", "tex/wall1.png: cannot be read"),
            ("a.obj", "tex/wall2.png: cannot be read"),
            ("a.obj", "tex/3.png: cannot be read"),
            ("a.obj", "tex/42.png: cannot be read"),
            ("a.obj", "m.mtl:4: Ns needs a number"),
            ("a.obj", "m.mtl:12: Ns needs a number"),
            ("a.obj", "an end in \"quotes"),
            ("a.obj", ""),
        ]);
        assert_eq!(told.len(), 7, "{told:?}");
        assert_eq!(told[4], "m.mtl:4: Ns needs a number (the first of 2 such warnings)");
    }
}
