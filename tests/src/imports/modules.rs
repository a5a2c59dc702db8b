//! The modules of a crate's target: file, declared items and imports of each.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::visit::Visit;

use crate::support::source::attributes_of;

/// Where sources are read from: a folder, or a test's own texts.
pub(super) trait Sources {
    /// The text of a file, if there is one.
    fn read(&self, file: &Path) -> Option<String>;
}

/// A module, in a file of its own or within one.
#[derive(Debug, Default)]
pub(super) struct Module {
    pub(super) file: PathBuf,
    pub(super) parent: Option<usize>,
    pub(super) children: BTreeMap<String, usize>,
    /// Functions, types, constants, traits and macros.
    pub(super) items: BTreeSet<String>,
    /// Imports by `use`.
    pub(super) imports: Vec<Import>,
    /// Every other path of two names or more.
    pub(super) paths: BTreeSet<Vec<String>>,
}

/// A leaf of a `use`: the local name and the path that it stands for.
#[derive(Clone, Debug)]
pub(super) struct Import {
    /// `None` for a glob.
    pub(super) name: Option<String>,
    pub(super) path: Vec<String>,
    /// Whether it is re-exported: `pub use`, with any visibility.
    pub(super) exported: bool,
}

/// Reads the modules of a target, the root first, without those compiled for tests only.
///
/// # Panics
/// If a file is missing or is not valid Rust.
pub(super) fn modules(sources: &dyn Sources, root: &Path) -> Vec<Module> {
    let mut modules = Vec::new();
    let folder = root.parent().expect("a root file lies in a folder").to_owned();
    file_module(sources, root.to_owned(), folder, None, &mut modules);
    modules
}

fn file_module(
    sources: &dyn Sources,
    file: PathBuf,
    folder: PathBuf,
    parent: Option<usize>,
    modules: &mut Vec<Module>,
) -> usize {
    let text = sources.read(&file).unwrap_or_else(|| panic!("{}: cannot be read", file.display()));
    let parsed = syn::parse_file(&text).unwrap_or_else(|why| panic!("{}: {why}", file.display()));
    add(sources, &parsed.items, file, folder, parent, modules)
}

/// Adds a module with its items; `folder` contains the files of its children.
fn add(
    sources: &dyn Sources,
    items: &[syn::Item],
    file: PathBuf,
    folder: PathBuf,
    parent: Option<usize>,
    modules: &mut Vec<Module>,
) -> usize {
    let number = modules.len();
    modules.push(Module { file: file.clone(), parent, ..Module::default() });
    for item in items {
        if let syn::Item::Mod(child) = item {
            if is_test_only(&child.attrs) {
                continue;
            }
            let name = child.ident.to_string();
            let inner = folder.join(&name);
            let added = match (&child.content, named_file(&child.attrs)) {
                (Some((_, items)), _) => add(sources, items, file.clone(), inner, Some(number), modules),
                (None, Some(named)) => {
                    let own = file.with_file_name(named);
                    let beside = own.parent().expect("a file lies in a folder").to_owned();
                    file_module(sources, own, beside, Some(number), modules)
                }
                (None, None) => {
                    let beside = folder.join(format!("{name}.rs"));
                    let own = if sources.read(&beside).is_some() { beside } else { inner.join("mod.rs") };
                    file_module(sources, own, inner, Some(number), modules)
                }
            };
            modules[number].children.insert(name, added);
        } else if !is_test_only(attributes_of(item)) {
            modules[number].items.extend(name_of(item));
            let mut collector = ImportCollector { module: &mut modules[number] };
            collector.visit_item(item);
        }
    }
    number
}

/// Whether an item is compiled for tests only.
fn is_test_only(attributes: &[syn::Attribute]) -> bool {
    let is_test = |attribute: &syn::Attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute.parse_args::<syn::Path>().is_ok_and(|condition| condition.is_ident("test"))
    };
    attributes.iter().any(is_test)
}

/// The file that `#[path = "…"]` names.
fn named_file(attributes: &[syn::Attribute]) -> Option<String> {
    let value = attributes.iter().find_map(|attribute| match &attribute.meta {
        syn::Meta::NameValue(meta) if meta.path.is_ident("path") => Some(&meta.value),
        _ => None,
    });
    match value {
        Some(syn::Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(file), .. })) => Some(file.value()),
        _ => None,
    }
}

fn name_of(item: &syn::Item) -> Option<String> {
    let name = match item {
        syn::Item::Const(item) => &item.ident,
        syn::Item::Enum(item) => &item.ident,
        syn::Item::Fn(item) => &item.sig.ident,
        syn::Item::Macro(item) => item.ident.as_ref()?,
        syn::Item::Static(item) => &item.ident,
        syn::Item::Struct(item) => &item.ident,
        syn::Item::Trait(item) => &item.ident,
        syn::Item::Type(item) => &item.ident,
        syn::Item::Union(item) => &item.ident,
        _ => return None,
    };
    Some(name.to_string())
}

/// Collects imports and paths of a module's items.
struct ImportCollector<'a> {
    module: &'a mut Module,
}

impl<'a> Visit<'a> for ImportCollector<'_> {
    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        let exported = !matches!(item.vis, syn::Visibility::Inherited);
        self.leaves(&item.tree, &mut Vec::new(), exported);
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        let names: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.add_path(names);
        syn::visit::visit_path(self, path);
    }

    fn visit_visibility(&mut self, _: &'a syn::Visibility) {
        // The path in `pub(in …)` is no import.
    }

    fn visit_macro(&mut self, call: &'a syn::Macro) {
        self.tokens(call.tokens.clone());
        syn::visit::visit_macro(self, call);
    }

    fn visit_attribute(&mut self, _: &'a syn::Attribute) {
        // Links in documentation and names of derives are not imports.
    }
}

impl ImportCollector<'_> {
    fn add_path(&mut self, names: Vec<String>) {
        if names.len() > 1 {
            self.module.paths.insert(names);
        }
    }

    fn leaves(&mut self, tree: &syn::UseTree, before: &mut Vec<String>, exported: bool) {
        let mut import = |name: Option<String>, path: Vec<String>| {
            self.module.imports.push(Import { name, path, exported });
        };
        match tree {
            syn::UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.leaves(&path.tree, before, exported);
                before.pop();
            }
            syn::UseTree::Name(name) if name.ident == "self" => {
                import(before.last().cloned(), before.clone());
            }
            syn::UseTree::Name(name) => {
                let name = name.ident.to_string();
                import(Some(name.clone()), [before.as_slice(), &[name]].concat());
            }
            syn::UseTree::Rename(renamed) => {
                let path = [before.as_slice(), &[renamed.ident.to_string()]].concat();
                import(Some(renamed.rename.to_string()), path);
            }
            syn::UseTree::Glob(_) => import(None, before.clone()),
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.leaves(tree, before, exported);
                }
            }
        }
    }

    /// Collects paths from a macro's tokens: names separated by `::`.
    fn tokens(&mut self, tokens: proc_macro2::TokenStream) {
        let mut names: Vec<String> = Vec::new();
        let mut colons = 0;
        for token in tokens {
            match token {
                proc_macro2::TokenTree::Ident(name) => {
                    if colons != 2 {
                        self.add_path(std::mem::take(&mut names));
                    }
                    names.push(name.to_string());
                    colons = 0;
                }
                proc_macro2::TokenTree::Punct(mark) if mark.as_char() == ':' => colons += 1,
                other => {
                    self.add_path(std::mem::take(&mut names));
                    colons = 0;
                    if let proc_macro2::TokenTree::Group(group) = other {
                        self.tokens(group.stream());
                    }
                }
            }
        }
        self.add_path(names);
    }
}
