//! The graph of imports between files, and its circles.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use super::modules::{Import, Module};

/// For each file, the files that it imports from, each with one path that it imports.
pub(super) type Imports = BTreeMap<PathBuf, BTreeMap<PathBuf, String>>;

/// Most re-exports that a name is followed through.
const MAX_REEXPORTS: usize = 32;

/// The graph of a target's modules. A name counts for the file that declares it, however many modules re-export it; a
/// `pub use` is therefore no import.
pub(super) fn imports(modules: &[Module]) -> Imports {
    let mut all = Imports::new();
    for (number, module) in modules.iter().enumerate() {
        let from = all.entry(module.file.clone()).or_default();
        let used = module.imports.iter().filter(|import| !import.exported).map(|import| &import.path);
        let globs: BTreeSet<&Vec<String>> =
            module.imports.iter().filter(|import| import.name.is_none()).map(|import| &import.path).collect();
        for path in used.chain(&module.paths) {
            let place = resolve(modules, number, path, MAX_REEXPORTS);
            let to = match place {
                Some(Resolved::Item(to)) => to,
                // An imported module counts only through the names used of it; a glob import names nothing.
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

/// The module or item that a path names.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Resolved {
    Module(usize),
    /// An item that this module declares.
    Item(usize),
}

/// Resolves a path; `None` for names of other crates.
fn resolve(modules: &[Module], from: usize, path: &[String], left: usize) -> Option<Resolved> {
    let (first, rest) = path.split_first()?;
    let start = match first.as_str() {
        "crate" => Resolved::Module(0),
        "self" => Resolved::Module(from),
        "super" => Resolved::Module(modules[from].parent?),
        name => named(modules, from, name, left)?,
    };
    rest.iter().try_fold(start, |place, name| match place {
        // Variants and associated functions count for their type.
        Resolved::Item(_) => Some(place),
        Resolved::Module(module) if name == "super" => modules[module].parent.map(Resolved::Module),
        // Unknown names, such as those that macros declare, count for the module.
        Resolved::Module(module) => named(modules, module, name, left).or(Some(Resolved::Item(module))),
    })
}

/// Resolves a name within a module.
fn named(modules: &[Module], module: usize, name: &str, left: usize) -> Option<Resolved> {
    let left = left.checked_sub(1)?;
    let Module { children, items, imports, .. } = &modules[module];
    if let Some(child) = children.get(name) {
        return Some(Resolved::Module(*child));
    }
    if items.contains(name) {
        return Some(Resolved::Item(module));
    }
    // A name that is imported under itself is a crate.
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

/// A circle of imports: its files in order, and the path by which each imports from the next.
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

/// For each import that lies on a circle, the shortest such circle.
pub(super) fn circles(imports: &Imports) -> Vec<Circle> {
    let mut circles = BTreeMap::new();
    for (a, targets) in imports {
        for b in targets.keys() {
            let Some(back) = shortest_path(imports, b, a) else { continue };
            let mut files = vec![a.clone()];
            files.extend(back.into_iter().filter(|file| file != a));
            let least = (0..files.len()).min_by_key(|&i| &files[i]).unwrap_or(0);
            files.rotate_left(least);
            let next = |i: usize| &files[(i + 1) % files.len()];
            let paths = (0..files.len()).map(|i| imports[&files[i]][next(i)].clone()).collect();
            circles.insert(files.clone(), Circle { files, paths });
        }
    }
    circles.into_values().collect()
}

/// The shortest path along imports from one file to another, both included (breadth-first search).
fn shortest_path(imports: &Imports, from: &Path, to: &Path) -> Option<Vec<PathBuf>> {
    let mut before: BTreeMap<&Path, &Path> = BTreeMap::new();
    let mut queue = VecDeque::from([from]);
    while let Some(file) = queue.pop_front() {
        for next in imports.get(file).into_iter().flat_map(BTreeMap::keys) {
            if next == from || before.contains_key(next.as_path()) {
                continue;
            }
            before.insert(next, file);
            if next == to {
                let mut path = vec![to.to_owned()];
                while let Some(&file) = before.get(path.last().expect("it is not empty").as_path()) {
                    path.push(file.to_owned());
                }
                path.reverse();
                return Some(path);
            }
            queue.push_back(next);
        }
    }
    None
}
