//! The client's interface without the feature `runtime` names no type of a network library.
//!
//! Otherwise a program without a tokio runtime would have to compile, and keep up with, the versions of libraries that
//! are internal to the client. The sources are parsed: public are items in public modules, and what these re-export.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use syn::punctuated::Punctuated;
use syn::visit::Visit;

use crate::support::source::attributes_of;

/// Crates whose types must not appear.
const HIDDEN: [&str; 5] = ["tokio", "quinn", "tokio_rustls", "tokio_tungstenite", "futures_util"];
/// Enabled features: all but `runtime`.
const FEATURES: [&str; 4] = ["quic", "websocket", "tls", "zstd"];

/// The compiled items of a module, without its child modules.
struct Module {
    /// Path from the crate's root.
    path: Vec<String>,
    public: bool,
    items: Vec<syn::Item>,
}

/// Whether an item with these attributes is compiled.
fn compiled(attributes: &[syn::Attribute]) -> bool {
    attributes
        .iter()
        .filter(|a| a.path().is_ident("cfg"))
        .all(|a| holds(&a.parse_args().expect("a condition")))
}

fn holds(condition: &syn::Meta) -> bool {
    let parts = |list: &syn::MetaList| -> Vec<bool> {
        let parse = Punctuated::<syn::Meta, syn::Token![,]>::parse_terminated;
        list.parse_args_with(parse).expect("conditions").iter().map(holds).collect()
    };
    match condition {
        syn::Meta::List(list) if list.path.is_ident("not") => !parts(list)[0],
        syn::Meta::List(list) if list.path.is_ident("any") => parts(list).contains(&true),
        syn::Meta::List(list) if list.path.is_ident("all") => !parts(list).contains(&false),
        syn::Meta::NameValue(pair) if pair.path.is_ident("feature") => match &pair.value {
            syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(name), .. }) => {
                FEATURES.contains(&name.value().as_str())
            }
            _ => panic!("a feature that is not a string"),
        },
        syn::Meta::Path(path) if path.is_ident("test") => false,
        // Conditions on the platform may hold.
        _ => true,
    }
}

/// Adds a module and its children. `read` returns the text of a file below the sources' folder.
fn add(
    read: &dyn Fn(&str) -> Option<String>,
    items: Vec<syn::Item>,
    path: &[String],
    public: bool,
    all: &mut Vec<Module>,
) {
    let mut own = Vec::new();
    for item in items.into_iter().filter(|item| compiled(attributes_of(item))) {
        let syn::Item::Mod(child) = item else {
            own.push(item);
            continue;
        };
        let path = [path, &[child.ident.to_string()]].concat();
        let folder = path.join("/");
        let items = child.content.map_or_else(
            || {
                let text = read(&format!("{folder}.rs")).or_else(|| read(&format!("{folder}/mod.rs")));
                syn::parse_file(&text.unwrap_or_else(|| panic!("{folder} is nowhere"))).expect("Rust").items
            },
            |(_, items)| items,
        );
        add(read, items, &path, public && matches!(child.vis, syn::Visibility::Public(_)), all);
    }
    all.push(Module { path: path.to_vec(), public, items: own });
}

/// The leaves of a `use`: local name and path.
fn leaves(tree: &syn::UseTree, before: &[String], found: &mut Vec<(String, Vec<String>)>) {
    let with = |name: &syn::Ident| [before, &[name.to_string()]].concat();
    match tree {
        syn::UseTree::Path(path) => leaves(&path.tree, &with(&path.ident), found),
        syn::UseTree::Name(name) if name.ident == "self" => {
            found.extend(before.last().map(|last| (last.clone(), before.to_vec())));
        }
        syn::UseTree::Name(name) => found.push((name.ident.to_string(), with(&name.ident))),
        syn::UseTree::Rename(name) => found.push((name.rename.to_string(), with(&name.ident))),
        syn::UseTree::Glob(_) => found.push(("*".into(), before.to_vec())),
        syn::UseTree::Group(group) => group.items.iter().for_each(|tree| leaves(tree, before, found)),
    }
}

fn uses(module: &Module, public: bool) -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for item in &module.items {
        if let syn::Item::Use(item) = item
            && (!public || matches!(item.vis, syn::Visibility::Public(_)))
        {
            leaves(&item.tree, &[], &mut found);
        }
    }
    found
}

/// Collects paths to hidden crates in signatures.
struct HiddenTypeCollector<'a> {
    /// Imported names of the module, with their paths.
    names: &'a BTreeMap<String, Vec<String>>,
    found: BTreeSet<String>,
}

impl<'a> Visit<'a> for HiddenTypeCollector<'_> {
    fn visit_path(&mut self, path: &'a syn::Path) {
        let first = path.segments[0].ident.to_string();
        let root = self.names.get(&first).map_or(&first, |path| &path[0]);
        if HIDDEN.contains(&root.as_str()) {
            let names: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
            self.found.insert(format!("{} of {root}", names.join("::")));
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_attribute(&mut self, _: &'a syn::Attribute) {
        // Derives and documentation are not signatures.
    }

    fn visit_block(&mut self, _: &'a syn::Block) {
        // Nor are bodies.
    }

    fn visit_expr(&mut self, _: &'a syn::Expr) {}

    fn visit_field(&mut self, field: &'a syn::Field) {
        // Fields of variants have no visibility of their own; those of structs are checked below.
        self.visit_type(&field.ty);
    }
}

impl HiddenTypeCollector<'_> {
    /// Visits a public item, or an `impl` of one.
    fn item(&mut self, item: &syn::Item) {
        let public = |vis: &syn::Visibility| matches!(vis, syn::Visibility::Public(_));
        match item {
            syn::Item::Struct(item) => {
                self.visit_generics(&item.generics);
                item.fields.iter().filter(|field| public(&field.vis)).for_each(|f| self.visit_field(f));
            }
            syn::Item::Impl(block) => {
                self.visit_generics(&block.generics);
                self.visit_type(&block.self_ty);
                if let Some((_, of, _)) = &block.trait_ {
                    self.visit_path(of);
                }
                for part in &block.items {
                    match part {
                        syn::ImplItem::Fn(f) if public(&f.vis) && compiled(&f.attrs) => {
                            self.visit_signature(&f.sig);
                        }
                        syn::ImplItem::Const(c) if public(&c.vis) => self.visit_type(&c.ty),
                        syn::ImplItem::Type(of_trait) => self.visit_type(&of_trait.ty),
                        _ => {}
                    }
                }
            }
            other => self.visit_item(other),
        }
    }
}

fn declared(item: &syn::Item) -> Option<(&syn::Ident, &syn::Visibility)> {
    Some(match item {
        syn::Item::Const(item) => (&item.ident, &item.vis),
        syn::Item::Enum(item) => (&item.ident, &item.vis),
        syn::Item::Fn(item) => (&item.sig.ident, &item.vis),
        syn::Item::Static(item) => (&item.ident, &item.vis),
        syn::Item::Struct(item) => (&item.ident, &item.vis),
        syn::Item::Trait(item) => (&item.ident, &item.vis),
        syn::Item::Type(item) => (&item.ident, &item.vis),
        _ => return None,
    })
}

/// The places where hidden types appear, and the number of public items.
fn seen(read: &dyn Fn(&str) -> Option<String>) -> (Vec<String>, usize) {
    let root = syn::parse_file(&read("lib.rs").expect("a root")).expect("Rust");
    let mut modules = Vec::new();
    add(read, root.items, &[], true, &mut modules);
    let mut found = Vec::new();
    // Names that public modules re-export, with the module that they come from.
    let mut handed_on: BTreeSet<(Vec<String>, String)> = BTreeSet::new();
    for module in modules.iter().filter(|module| module.public) {
        for (_, mut path) in uses(module, true) {
            if HIDDEN.contains(&path[0].as_str()) {
                found.push(format!("{} hands on {}", module.path.join("::"), path.join("::")));
            }
            let name = path.pop().expect("a path has a name");
            let from = match path.first().map(String::as_str) {
                Some("crate") => path[1..].to_vec(),
                Some("self") => [&module.path, &path[1..]].concat(),
                _ => [&module.path, &path[..]].concat(),
            };
            handed_on.insert((from, name));
        }
    }
    let open = |module: &Module, item: &syn::Item| -> Option<String> {
        let (name, vis) = declared(item)?;
        let name = name.to_string();
        let public = module.public && matches!(vis, syn::Visibility::Public(_));
        (public || handed_on.contains(&(module.path.clone(), name.clone()))).then_some(name)
    };
    let names: BTreeSet<String> =
        modules.iter().flat_map(|module| module.items.iter().filter_map(|item| open(module, item))).collect();
    for module in &modules {
        let imported = uses(module, false).into_iter().collect();
        let mut seen = HiddenTypeCollector { names: &imported, found: BTreeSet::new() };
        for item in &module.items {
            let of_open = match item {
                syn::Item::Impl(block) => match &*block.self_ty {
                    syn::Type::Path(of) => {
                        of.path.segments.last().is_some_and(|last| names.contains(&last.ident.to_string()))
                    }
                    _ => false,
                },
                _ => open(module, item).is_some(),
            };
            if of_open {
                seen.item(item);
            }
        }
        found.extend(seen.found.into_iter().map(|path| format!("{}: {path}", module.path.join("::"))));
    }
    (found, names.len())
}

#[test]
fn the_clients_interface_names_no_type_of_a_network_library() {
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("../client/src");
    let (found, names) = seen(&|file| std::fs::read_to_string(sources.join(file)).ok());
    assert!(names > 20, "only {names} names are public");
    assert!(found.is_empty(), "{found:#?}");
}

#[test]
fn hidden_types_are_detected_everywhere() {
    let of = |streaming: &str| {
        let files = BTreeMap::from([
            ("lib.rs", "pub mod streaming; mod net;"),
            ("streaming.rs", streaming),
            (
                "net/mod.rs",
                "pub struct Clock { start: tokio::time::Instant } pub fn free(_: quinn::Endpoint) {}",
            ),
        ]);
        seen(&|file| files.get(file).map(|text| (*text).to_owned())).0
    };
    let seen = [
        "use tokio::sync::watch; pub struct S(u8); impl S { pub fn tokens(&self) -> watch::Sender<u8> { new(self.0) } }",
        "pub struct S(pub Option<tokio::time::Instant>);",
        "use quinn as q; pub enum E { A(q::Connection) }",
        "pub struct E; impl From<quinn::ReadError> for E { fn from(_: quinn::ReadError) -> Self { E } }",
        "pub fn f(_: impl tokio::io::AsyncRead) {}",
        "pub use tokio::time::Instant;",
        "pub use crate::net::free;",
        "#[cfg(not(feature = \"runtime\"))] pub fn f(_: quinn::Endpoint) {}",
    ];
    for text in seen {
        assert_eq!(of(text).len(), 1, "{text}");
    }
    let hidden = [
        "use tokio::sync::watch; pub struct S(watch::Sender<u8>); impl S { fn f(_: watch::Sender<u8>) {} }",
        "pub fn f() { tokio::spawn(async {}); }",
        "pub use crate::net::Clock;",
        "#[cfg(all(feature = \"quic\", feature = \"runtime\"))] pub fn f(_: quinn::Endpoint) {}",
        "struct S; impl S { pub fn f(_: quinn::Endpoint) {} }",
    ];
    for text in hidden {
        assert_eq!(of(text), Vec::<String>::new(), "{text}");
    }
}
