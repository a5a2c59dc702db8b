//! What documents may name: files, words of the sources, packages, and programs with their commands and flags.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders at the root that are not the project's: build output, generated scenes.
const IGNORED: [&str; 3] = ["target", "shared", "demo"];
/// Extensions of files whose words are looked up.
const SOURCES: [&str; 8] = ["rs", "toml", "py", "wgsl", "sh", "csv", "yml", "html"];

/// A program: its subcommands and the long flags that its sources declare.
#[derive(Default)]
pub(super) struct Program {
    pub(super) commands: BTreeSet<String>,
    pub(super) flags: BTreeSet<String>,
}

/// A Cargo package.
pub(super) struct Package {
    folder: PathBuf,
    /// Its Cargo.toml.
    pub(super) manifest: String,
}

/// Everything that documents may name.
pub(super) struct Repository {
    pub(super) root: PathBuf,
    /// All files, relative to the root, with `/`.
    pub(super) files: BTreeSet<String>,
    /// All folders, the same way.
    pub(super) folders: BTreeSet<String>,
    /// Words of all sources, and of file names.
    words: BTreeSet<String>,
    /// Words of each package's own sources, by its name without "lodestream-".
    words_of: BTreeMap<String, BTreeSet<String>>,
    pub(super) packages: BTreeMap<String, Package>,
    pub(super) programs: BTreeMap<String, Program>,
    /// External crates, as written in module paths.
    pub(super) external_crates: BTreeSet<String>,
}

/// Whether a character belongs to a name.
pub(super) fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

impl Repository {
    pub(super) fn read() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned();
        let mut this = Self {
            root: root.clone(),
            files: BTreeSet::new(),
            folders: BTreeSet::new(),
            words: BTreeSet::new(),
            words_of: BTreeMap::new(),
            packages: BTreeMap::new(),
            programs: BTreeMap::new(),
            external_crates: ["std", "core"].map(str::to_owned).into(),
        };
        this.walk(&root, "");
        let sources: BTreeMap<String, String> = this
            .files
            .iter()
            .filter(|file| {
                SOURCES.iter().any(|end| file.ends_with(&format!(".{end}"))) || file.starts_with("script/")
            })
            // The test's own examples of faults.
            .filter(|file| !file.starts_with("tests/src/documents/"))
            .filter_map(|file| Some((file.clone(), std::fs::read_to_string(root.join(file)).ok()?)))
            .collect();
        for (file, text) in &sources {
            this.words.extend(text.split(|c| !is_word(c)).filter(|word| !word.is_empty()).map(str::to_owned));
            if file.ends_with("Cargo.toml") {
                this.manifest(file, text);
            }
        }
        let files = this.files.iter().chain(&this.folders);
        let names = files.flat_map(|file| file.split(['/', '.'])).map(str::to_owned).collect::<Vec<_>>();
        this.words.extend(names);
        this.find_programs(&sources);
        for (file, text) in &sources {
            let homes =
                this.packages.iter().filter(|(_, package)| Path::new(file).starts_with(&package.folder));
            if let Some((name, _)) = homes.max_by_key(|(_, package)| package.folder.as_os_str().len()) {
                let names = text.split(|c| !is_word(c)).chain(file.split(['/', '.'])).map(str::to_owned);
                this.words_of
                    .entry(name.trim_start_matches("lodestream-").to_owned())
                    .or_default()
                    .extend(names);
            }
        }
        this
    }

    fn walk(&mut self, folder: &Path, relative: &str) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            let path = if relative.is_empty() { name.clone() } else { format!("{relative}/{name}") };
            if entry.file_type().unwrap().is_dir() {
                let hidden = name.starts_with('.') && name != ".ci";
                // A folder that is a workspace of its own has a target folder of its own.
                if !hidden && !(IGNORED.contains(&name.as_str()) && (relative.is_empty() || name == "target"))
                {
                    self.walk(&entry.path(), &path);
                    self.folders.insert(path);
                }
            } else {
                self.files.insert(path);
            }
        }
    }

    fn manifest(&mut self, file: &str, text: &str) {
        let folder = Path::new(file).parent().unwrap().to_owned();
        let mut section = String::new();
        for line in text.lines() {
            if line.starts_with('[') {
                section = line.trim_matches(['[', ']']).to_owned();
            }
            let name = || line.split(['=', '.']).next().unwrap().trim().to_owned();
            if section == "package" && line.starts_with("name") {
                let package = line.split('"').nth(1).unwrap().to_owned();
                self.packages.insert(package, Package { folder: folder.clone(), manifest: text.to_owned() });
            } else if section.ends_with("dependencies")
                && line.contains('=')
                && !line.starts_with("lodestream")
            {
                self.external_crates.insert(name().replace('-', "_"));
            }
        }
    }

    fn find_programs(&mut self, sources: &BTreeMap<String, String>) {
        for program in ["lodestream-server", "lodestream-viewer", "lodestream-sim"] {
            // The package of that name, or the one that has a program of that name.
            let declares =
                |package: &Package| package.manifest.contains(&format!("[[bin]]\nname = \"{program}\""));
            let folder = match self.packages.get(program) {
                Some(package) => package.folder.clone(),
                None => self
                    .packages
                    .values()
                    .find(|p| declares(p))
                    .expect("a package of the program")
                    .folder
                    .clone(),
            };
            let nested =
                self.packages.values().map(|p| &p.folder).filter(|f| f.starts_with(&folder) && **f != folder);
            let nested: Vec<_> = nested.cloned().collect();
            let mut found =
                Program { flags: ["--help", "--version"].map(str::to_owned).into(), ..Program::default() };
            for (file, text) in sources {
                let path = Path::new(file);
                let own = path.starts_with(folder.join("src"))
                    && !nested.iter().any(|inner| path.starts_with(inner));
                if own && file.ends_with(".rs") {
                    collect_arguments(text, &mut found);
                }
            }
            self.programs.insert(program.to_owned(), found);
        }
    }

    pub(super) fn has_word(&self, word: &str) -> bool {
        self.words.contains(word)
    }

    /// Whether a word occurs in the sources of a package, or in any source if there is no such package.
    pub(super) fn has_word_in(&self, package: &str, word: &str) -> bool {
        self.words_of.get(package).map_or_else(|| self.has_word(word), |words| words.contains(word))
    }

    /// Whether a file or folder has this path: from the root, relative to a document, or as a suffix. A `*` matches
    /// anything within a name.
    pub(super) fn has_path(&self, document: &str, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        let beside = document.rsplit_once('/').map_or(path.to_owned(), |(folder, _)| join(folder, path));
        self.files.iter().chain(&self.folders).any(|known| {
            let tail = known.strip_suffix(path).is_some_and(|head| head.is_empty() || head.ends_with('/'));
            tail || *known == beside
                || (path.contains('*') && (matches(path, known) || matches(&beside, known)))
        })
    }
}

/// A path relative to a folder, without `..`.
pub(super) fn join(folder: &str, path: &str) -> String {
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in path.split('/') {
        match part {
            "." | "" => {}
            ".." => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

/// Whether a path matches a pattern, part by part.
fn matches(pattern: &str, path: &str) -> bool {
    let (a, b): (Vec<&str>, Vec<&str>) = (pattern.split('/').collect(), path.split('/').collect());
    let fits = |pattern: &str, name: &str| match pattern.split_once('*') {
        Some((head, tail)) => {
            name.len() >= head.len() + tail.len() && name.starts_with(head) && name.ends_with(tail)
        }
        None => pattern == name,
    };
    a.len() == b.len() && a.iter().zip(&b).all(|(pattern, name)| fits(pattern, name))
}

/// Collects the commands and flags that a source file declares with clap's derive.
fn collect_arguments(text: &str, found: &mut Program) {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    for (n, line) in lines.iter().enumerate() {
        // `long = "name"`, or a field below an attribute with `long`.
        for rest in line.split("long = \"").skip(1) {
            found.flags.insert(format!("--{}", rest.split('"').next().unwrap()));
        }
        let field = line
            .trim_start_matches("pub ")
            .trim_start_matches("pub(crate) ")
            .trim_start_matches("pub(super) ");
        if let Some((name, _)) = field.split_once(':')
            && name.chars().all(is_word)
            && !name.is_empty()
        {
            let attributes = lines[..n].iter().rev().take_while(|line| !is_field(line));
            if attributes.clone().any(|line| line.split(|c| !is_word(c)).any(|word| word == "long")) {
                found.flags.insert(format!("--{}", name.replace('_', "-")));
            }
        }
        if line.contains("derive(") && line.contains("Subcommand") {
            variants(&lines[n..], &mut found.commands);
        }
        for rest in line.split("#[command(name = \"").skip(1) {
            let name = rest.split('"').next().unwrap();
            if !name.starts_with("lodestream-") {
                found.commands.insert(name.to_owned());
            }
        }
    }
}

/// Whether a line ends the item that the attributes above it belong to.
fn is_field(line: &str) -> bool {
    (line.ends_with(',') || line.ends_with('{') || line.ends_with('}'))
        && !line.starts_with('#')
        && line.contains(": ")
        || line.ends_with('{')
        || line.starts_with('}')
}

/// The variants of the enum that begins in these lines, as clap names subcommands.
fn variants(lines: &[&str], commands: &mut BTreeSet<String>) {
    let mut depth = 0_i32;
    for line in lines {
        let name: String = line.chars().take_while(|c| is_word(*c)).collect();
        if depth == 1 && name.starts_with(|c: char| c.is_ascii_uppercase()) {
            commands.insert(kebab(&name));
        }
        depth += line.matches(['{', '(']).count() as i32 - line.matches(['}', ')']).count() as i32;
        if depth == 0 && *line == "}" {
            return;
        }
    }
}

fn kebab(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_ascii_uppercase() && !out.is_empty() {
            out.push('-');
        }
        out.push(c.to_ascii_lowercase());
    }
    out
}
