//! The modules of a crate's target: which file each is in, what it declares and what it imports.

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
    /// What `use` brings in: the name here, and the path that it stands for.
    pub(super) imports: Vec<Import>,
    /// Every other path of two names or more.
    pub(super) paths: BTreeSet<Vec<String>>,
}

/// A leaf of a `use`.
#[derive(Clone, Debug)]
pub(super) struct Import {
    /// `None` for a glob.
    pub(super) name: Option<String>,
    pub(super) path: Vec<String>,
    /// Whether others may import it from here (`pub use`, with whatever in brackets).
    pub(super) exported: bool,
}

/// Reads the modules of a target, the root first. What is only compiled for tests is left out: tests may import what
/// they like.
///
/// # Panics
/// Where a file is missing, or is no Rust.
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

/// Adds a module with its items; `folder` is where files of its children are.
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
            if for_tests(&child.attrs) {
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
        } else if !for_tests(attributes_of(item)) {
            modules[number].items.extend(name_of(item));
            let mut found = Found { module: &mut modules[number] };
            found.visit_item(item);
        }
    }
    number
}

/// Whether attributes say that something is compiled for tests only.
fn for_tests(attributes: &[syn::Attribute]) -> bool {
    let is_test = |attribute: &syn::Attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg")
                && attribute.parse_args::<syn::Path>().is_ok_and(|condition| condition.is_ident("test"))
    };
    attributes.iter().any(is_test)
}

/// What `#[path = "…"]` says.
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
struct Found<'a> {
    module: &'a mut Module,
}

impl<'a> Visit<'a> for Found<'_> {
    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        let exported = !matches!(item.vis, syn::Visibility::Inherited);
        self.leaves(&item.tree, &mut Vec::new(), exported);
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        let names: Vec<String> = path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        self.note(names);
        syn::visit::visit_path(self, path);
    }

    fn visit_visibility(&mut self, _: &'a syn::Visibility) {
        // The path in `pub(in …)` imports nothing.
    }

    fn visit_macro(&mut self, call: &'a syn::Macro) {
        self.tokens(call.tokens.clone());
        syn::visit::visit_macro(self, call);
    }

    fn visit_attribute(&mut self, _: &'a syn::Attribute) {
        // Links in documentation and names of derives are no imports.
    }
}

impl Found<'_> {
    fn note(&mut self, names: Vec<String>) {
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

    /// Paths in what a macro is given: names with `::` between them.
    fn tokens(&mut self, tokens: proc_macro2::TokenStream) {
        let mut names: Vec<String> = Vec::new();
        let mut colons = 0;
        for token in tokens {
            match token {
                proc_macro2::TokenTree::Ident(name) => {
                    if colons != 2 {
                        self.note(std::mem::take(&mut names));
                    }
                    names.push(name.to_string());
                    colons = 0;
                }
                proc_macro2::TokenTree::Punct(mark) if mark.as_char() == ':' => colons += 1,
                other => {
                    self.note(std::mem::take(&mut names));
                    colons = 0;
                    if let proc_macro2::TokenTree::Group(group) = other {
                        self.tokens(group.stream());
                    }
                }
            }
        }
        self.note(names);
    }
}
