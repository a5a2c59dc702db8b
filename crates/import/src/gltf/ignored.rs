//! Features of a file that are not imported, counted by name for one warning.

use std::collections::BTreeMap;

use super::container::Document;
use super::lights;

/// Number of occurrences of each ignored feature.
#[derive(Default)]
pub(super) struct Ignored {
    counts: BTreeMap<String, usize>,
}

impl Ignored {
    /// Ignored features that belong to the file as a whole.
    pub(super) fn of_file(document: &Document) -> Self {
        let mut ignored = Self::default();
        let root = &document.root;
        for (what, count) in [
            ("animations", root.animations),
            ("skins", root.skins),
            ("cameras", root.cameras),
            ("directional lights (set [light] in the scene file instead)", lights::directional(document)),
        ] {
            if count > 0 {
                ignored.counts.insert(what.to_owned(), count);
            }
        }
        for name in document.unknown_extensions() {
            let instead = match name {
                "KHR_materials_transmission" => " (drawn as opacity unless it has a texture)",
                "KHR_materials_pbrSpecularGlossiness" => " (drawn as metallic-roughness)",
                _ => "",
            };
            ignored.note(&format!("extension {name}{instead}"));
        }
        ignored
    }

    pub(super) fn note(&mut self, what: &str) {
        *self.counts.entry(what.to_owned()).or_default() += 1;
    }

    /// The warning, one line; `None` if nothing was ignored.
    pub(super) fn warning(&self, document: &Document) -> Option<String> {
        let name = |(what, count): (&String, &usize)| {
            if *count > 1 { format!("{what} ({count})") } else { what.clone() }
        };
        let list: Vec<String> = self.counts.iter().map(name).collect();
        (!list.is_empty()).then(|| format!("{}: ignored: {}", document.path.display(), list.join(", ")))
    }
}
