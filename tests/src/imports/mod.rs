//! Files do not import in circles, so that each can be read after those that it imports.
//!
//! Every crate's sources are parsed. A name counts for the file that declares it; code compiled for tests only does not
//! count.

mod graph;
mod modules;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use graph::{Circle, circles, imports};
use modules::{Sources, modules};

struct Folder(PathBuf);

impl Sources for Folder {
    fn read(&self, file: &Path) -> Option<String> {
        std::fs::read_to_string(self.0.join(file)).ok()
    }
}

/// A crate's files in a test.
impl Sources for BTreeMap<&str, &str> {
    fn read(&self, file: &Path) -> Option<String> {
        self.get(file.to_str()?).map(|text| (*text).to_owned())
    }
}

/// The roots of the targets of the workspace's crates: libraries and programs.
fn roots(workspace: &Path) -> Vec<PathBuf> {
    let read = |file: &Path| -> toml::Table {
        std::fs::read_to_string(workspace.join(file)).unwrap().parse().unwrap()
    };
    let members = read(Path::new("Cargo.toml"))["workspace"]["members"].clone();
    let mut roots = Vec::new();
    for member in members.as_array().unwrap() {
        let folder = Path::new(member.as_str().unwrap());
        for root in ["src/lib.rs", "src/main.rs"] {
            let root = folder.join(root);
            if workspace.join(&root).is_file() {
                roots.push(root);
            }
        }
        let manifest = read(&folder.join("Cargo.toml"));
        for program in manifest.get("bin").and_then(toml::Value::as_array).into_iter().flatten() {
            let root = program.get("path").and_then(toml::Value::as_str).map(|path| folder.join(path));
            roots.extend(root.filter(|root| !roots.contains(root)));
        }
    }
    roots
}

#[test]
fn files_do_not_import_in_circles() {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let sources = Folder(workspace.to_owned());
    let roots = roots(workspace);
    assert!(roots.len() >= 10, "{roots:?}");
    let found: Vec<String> = roots
        .iter()
        .flat_map(|root| circles(&imports(&modules(&sources, root))))
        .map(|circle| circle.to_string())
        .collect();
    assert!(found.is_empty(), "circles of imports:\n{}", found.join("\n"));
}

fn circles_of(files: &[(&'static str, &'static str)]) -> Vec<Vec<String>> {
    let sources: BTreeMap<&str, &str> = files.iter().copied().collect();
    let circles = circles(&imports(&modules(&sources, Path::new("c/lib.rs"))));
    let names = |circle: Circle| circle.files.iter().map(|file| file.display().to_string()).collect();
    circles.into_iter().map(names).collect()
}

#[test]
fn circles_of_two_and_three_files_are_found() {
    let inner = ("c/b/mod.rs", "pub fn two() { crate::a::one() }");
    let beside = ("c/b.rs", inner.1);
    let root = ("c/lib.rs", "mod a; mod b;");
    let a = ("c/a.rs", "use crate::b; pub fn one() { b::two() }");
    assert_eq!(circles_of(&[root, a, beside]), [["c/a.rs", "c/b.rs"]]);
    assert_eq!(circles_of(&[root, a, inner]), [["c/a.rs", "c/b/mod.rs"]]);
    let three = [
        ("c/lib.rs", "mod a; mod b; mod d;"),
        a,
        ("c/b.rs", "use super::d::Third; pub fn two(_: Third) {}"),
        ("c/d.rs", "pub struct Third; impl Third { fn f() { assert!(crate::a::one()); } }"),
    ];
    assert_eq!(circles_of(&three), [["c/a.rs", "c/b.rs", "c/d.rs"]]);
}

#[test]
fn a_name_counts_for_the_file_that_declares_it() {
    let files = |root: &'static str| {
        [
            ("c/lib.rs", root),
            ("c/a/mod.rs", "mod deep; pub use deep::{One, Two as Three};"),
            ("c/a/deep.rs", "use crate::b::Other; pub struct One(Other); pub struct Two;"),
            ("c/b.rs", "pub struct Other; #[cfg(test)] mod tests { use crate::a::One; }"),
            ("c/d.rs", "use crate::a::{self, One as First}; pub fn f(_: First, _: a::Three) {}"),
        ]
    };
    assert_eq!(circles_of(&files("mod a; mod b; mod d; pub use d::f;")), Vec::<Vec<String>>::new());
    // Deep files may use items of the root, unless the root uses theirs.
    let both = "mod a; mod b; mod d; pub struct Root; pub fn g() { a::Three; }";
    assert_eq!(circles_of(&files(both)), Vec::<Vec<String>>::new());
    let mut circle = files(both);
    circle[2].1 = "use crate::b::Other; pub struct One(Other); pub struct Two; fn f(_: crate::Root) {}";
    assert_eq!(circles_of(&circle), [["c/a/deep.rs", "c/lib.rs"]]);
}
