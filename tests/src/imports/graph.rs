//! Which file imports from which, and circles among them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use super::modules::{Import, Module};

/// Files, and for each those that it imports from, with a path that says so.
pub(super) type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, String>>;

/// How often a name may be handed on from module to module.
const MOST_HANDED_ON: usize = 32;

/// The files of a target's modules. A name counts for the file that declares it, however many modules hand it on; so a
/// `pub use` is no import.
pub(super) fn imports(modules: &[Module]) -> Imports {
    let mut all = Imports::new();
    for (number, module) in modules.iter().enumerate() {
        let from = all.entry(module.file.clone()).or_default();
        let used = module.imports.iter().filter(|import| !import.exported).map(|import| &import.path);
        let globs: BTreeSet<&Vec<String>> =
            module.imports.iter().filter(|import| import.name.is_none()).map(|import| &import.path).collect();
        for path in used.chain(&module.paths) {
            let place = resolve(modules, number, path, MOST_HANDED_ON);
            let to = match place {
                Some(Resolved::Item(to)) => to,
                // A module that is imported counts for what is then named of it; a glob names nothing.
                Some(Resolved::Module(to)) if globs.contains(path) => to,
                _ => continue,
            };
            if modules[to].file != module.file {
                from.entry(modules[to].file.clone()).or_insert_with(|| path.join("::"));
            }
        }
    }
    all
}

/// What a path names.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Resolved {
    Module(usize),
    /// Something that this module declares.
    Item(usize),
}

/// `None` for what is not of this crate.
fn resolve(modules: &[Module], from: usize, path: &[String], left: usize) -> Option<Resolved> {
    let (first, rest) = path.split_first()?;
    let start = match first.as_str() {
        "crate" => Resolved::Module(0),
        "self" => Resolved::Module(from),
        "super" => Resolved::Module(modules[from].parent?),
        name => named(modules, from, name, left)?,
    };
    rest.iter().try_fold(start, |place, name| match place {
        // Variants and associated functions belong to what they are of.
        Resolved::Item(_) => Some(place),
        Resolved::Module(module) if name == "super" => modules[module].parent.map(Resolved::Module),
        // What is not known by name, as what a macro declares, is taken for the module's.
        Resolved::Module(module) => named(modules, module, name, left).or(Some(Resolved::Item(module))),
    })
}

/// What a name stands for within a module.
fn named(modules: &[Module], module: usize, name: &str, left: usize) -> Option<Resolved> {
    let left = left.checked_sub(1)?;
    let Module { children, items, imports, .. } = &modules[module];
    if let Some(child) = children.get(name) {
        return Some(Resolved::Module(*child));
    }
    if items.contains(name) {
        return Some(Resolved::Item(module));
    }
    // A name that stands for itself is a crate's.
    let of_name = |import: &&Import| import.name.as_deref() == Some(name) && import.path[0] != name;
    if let Some(import) = imports.iter().find(of_name) {
        return resolve(modules, module, &import.path, left);
    }
    let globs = imports.iter().filter(|import| import.name.is_none());
    globs.filter_map(|import| resolve(modules, module, &import.path, left)).find_map(|place| match place {
        Resolved::Module(other) if other != module => named(modules, other, name, left),
        _ => None,
    })
}

/// A circle that must not be: its files in order, and by which path each imports from the next.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Circle {
    pub(super) files: Vec<PathBuf>,
    pub(super) paths: Vec<String>,
}

impl std::fmt::Display for Circle {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (file, path) in self.files.iter().zip(&self.paths) {
            write!(f, "{} ({path}) → ", file.display())?;
        }
        write!(f, "{}", self.files[0].display())
    }
}

/// For each import that lies on a circle which must not be, the shortest such circle: one between files of different
/// folders, or of more than two files.
pub(super) fn circles(imports: &Imports) -> Vec<Circle> {
    let mut found = BTreeMap::new();
    for (a, targets) in imports {
        for b in targets.keys() {
            let back = if a.parent() == b.parent() {
                // The way straight back is allowed; a longer one is not.
                way(imports, b, a, true)
            } else {
                way(imports, b, a, false)
            };
            let Some(back) = back else { continue };
            let mut files = vec![a.clone()];
            files.extend(back.into_iter().filter(|file| file != a));
            let least = (0..files.len()).min_by_key(|&i| &files[i]).unwrap_or(0);
            files.rotate_left(least);
            let next = |i: usize| &files[(i + 1) % files.len()];
            let paths = (0..files.len()).map(|i| imports[&files[i]][next(i)].clone()).collect();
            found.insert(files.clone(), Circle { files, paths });
        }
    }
    found.into_values().collect()
}

/// The shortest way from one file to another, both included.
fn way(imports: &Imports, from: &Path, to: &Path, not_straight: bool) -> Option<Vec<PathBuf>> {
    let mut before: BTreeMap<&Path, &Path> = BTreeMap::new();
    let mut queue = VecDeque::from([from]);
    while let Some(file) = queue.pop_front() {
        for next in imports.get(file).into_iter().flat_map(BTreeMap::keys) {
            let straight = file == from && next == to;
            if straight && not_straight || next == from || before.contains_key(next.as_path()) {
                continue;
            }
            before.insert(next, file);
            if next == to {
                let mut way = vec![to.to_owned()];
                while let Some(&file) = before.get(way.last().expect("it is not empty").as_path()) {
                    way.push(file.to_owned());
                }
                way.reverse();
                return Some(way);
            }
            queue.push_back(next);
        }
    }
    None
}
