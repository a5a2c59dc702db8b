//! Features of a file that are not imported, counted by name for one warning.

use std::collections::BTreeMap;

use super::container::Document;
use super::lights;
use super::root::SPECULAR_GLOSSINESS;

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
            ("cameras", root.cameras),
            ("directional lights (set [light] in the scene file instead)", lights::directional(document)),
        ] {
            if count > 0 {
                ignored.counts.insert(what.to_owned(), count);
            }
        }
        for (name, materials) in document.unknown_extensions() {
            let instead = match name {
                SPECULAR_GLOSSINESS => " drawn as metallic-roughness",
                _ => "",
            };
            ignored.counts.insert(format!("extension {name}{instead}"), materials.max(1));
        }
        ignored
    }

    /// The animations of a file whose meshes are merged into one, which does not move.
    pub(super) fn note_animations(&mut self, document: &Document) {
        let count = document.root.animations.len();
        if count > 0 {
            self.counts.insert("animations, since the meshes are merged into one".to_owned(), count);
        }
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
