//! Checks the lines of a document.

use super::markdown::{Kind, Line, anchors, code_spans, lines, links};
use super::repository::{Repository, is_word, join};

/// Longest line of prose.
const MAX_LINE: usize = 120;
/// Prefixes of paths of one machine, which mean nothing to a reader.
const MACHINE_PATHS: [&str; 4] = ["/root/", "/home/", "/Users/", "/tmp/"];
/// Extensions of files that must exist if a document names them.
const OWN_FILES: [&str; 4] = ["rs", "md", "wgsl", "py"];

/// The faults of a document, one line each.
pub(super) fn faults(repository: &Repository, name: &str, text: &str) -> Vec<String> {
    let mut faults = Vec::new();
    let mut continued = String::new();
    for line in lines(text) {
        let mut wrong = |what: String| faults.push(format!("{name}:{}: {what}", line.number));
        for path in MACHINE_PATHS.iter().filter(|path| line.text.contains(**path)) {
            wrong(format!("names a path of one machine, {path}"));
        }
        match line.kind {
            Kind::Fence => {}
            Kind::Code(language) => {
                if matches!(language, "" | "sh" | "bash" | "console" | "shell") {
                    let command = format!("{continued}{}", line.text);
                    continued.clear();
                    match command.strip_suffix('\\') {
                        Some(begun) => continued = begun.to_owned(),
                        None => commands(repository, &command, &mut wrong),
                    }
                }
            }
            Kind::Prose | Kind::Heading | Kind::Table => {
                if line.kind == Kind::Prose && is_too_long(&line) {
                    wrong(format!("{} characters of prose, at most {MAX_LINE}", line.text.chars().count()));
                }
                for target in links(line.text) {
                    link(repository, name, &target, &mut wrong);
                }
                for span in code_spans(line.text) {
                    code(repository, name, span, &mut wrong);
                }
            }
        }
    }
    faults
}

/// Whether a line of prose is too long; a line with a link may be longer, since links cannot be broken.
fn is_too_long(line: &Line<'_>) -> bool {
    line.text.chars().count() > MAX_LINE && !line.text.contains("](")
}

fn link(repository: &Repository, document: &str, target: &str, wrong: &mut dyn FnMut(String)) {
    if target.contains("://") || target.starts_with("mailto:") {
        return;
    }
    let (path, anchor) = target.split_once('#').map_or((target, None), |(path, anchor)| (path, Some(anchor)));
    let folder = document.rsplit_once('/').map_or("", |(folder, _)| folder);
    let path = if path.is_empty() { document.to_owned() } else { join(folder, path) };
    if !repository.files.contains(&path) && !repository.folders.contains(&path) {
        return wrong(format!("links to {path}, which does not exist"));
    }
    if let Some(anchor) = anchor {
        let there = std::fs::read_to_string(repository.root.join(&path))
            .is_ok_and(|text| !path.ends_with(".md") || anchors(&text).iter().any(|known| known == anchor));
        if !there {
            wrong(format!("links to #{anchor}, which {path} does not have"));
        }
    }
}

/// Checks a code span: a command, a file path, a module path, or a name.
fn code(repository: &Repository, document: &str, span: &str, wrong: &mut dyn FnMut(String)) {
    if span.contains(' ') {
        return commands(repository, span, wrong);
    }
    if span.contains("::") {
        return module_path(repository, span, wrong);
    }
    if span.starts_with("lodestream-") && !span.contains(['/', '.', '*']) {
        let known = repository.packages.contains_key(span) || repository.programs.contains_key(span);
        if !known {
            wrong(format!("`{span}` is neither a package nor a program"));
        }
        return;
    }
    let is_name = |c: char| is_word(c) || matches!(c, '/' | '.' | '-' | '*');
    let (stem, extension) = span.rsplit_once('.').unwrap_or((span, ""));
    let is_file = OWN_FILES.contains(&extension) && !stem.is_empty();
    let first = span.split('/').next().unwrap_or("");
    let is_path = span.contains('/') && (repository.folders.contains(first) || span.ends_with('/'));
    if span.chars().all(is_name) && (is_file || is_path) {
        // Outputs and placeholders need not exist.
        let placeholder = |part: &str| part.len() > 2 && part.chars().all(|c| c.is_ascii_uppercase());
        let is_output = matches!(first, "out" | "" | "target") || span.split('/').any(placeholder);
        if !is_output && !repository.has_path(document, span) {
            wrong(format!("`{span}` does not exist"));
        }
    } else if is_identifier(span) && !repository.has_word(span.trim_end_matches("()")) {
        wrong(format!("`{span}` occurs in no source"));
    }
}

/// Whether a span is an identifier of more than one word, in CamelCase or snake_case.
fn is_identifier(span: &str) -> bool {
    let name = span.trim_end_matches("()");
    let humps = name.chars().filter(char::is_ascii_uppercase).count();
    let is_camel =
        name.starts_with(|c: char| c.is_ascii_uppercase()) && humps > 1 && name.contains(char::is_lowercase);
    let is_snake = name.contains('_') && name.starts_with(|c: char| c.is_ascii_alphabetic());
    name.chars().all(is_word) && (is_camel || is_snake)
}

/// Checks a module path such as `geometry::refine::ActiveMesh`: after the name of a crate of this workspace, the other
/// names must occur in its sources; otherwise all must occur in some source. External crates are not checked.
fn module_path(repository: &Repository, span: &str, wrong: &mut dyn FnMut(String)) {
    let path = span.split(['(', '<', '{', ' ']).next().unwrap_or("");
    let names: Vec<&str> = path.split("::").filter(|name| !name.is_empty()).collect();
    let Some(first) = names.first() else { return };
    if repository.external_crates.contains(*first) {
        return;
    }
    let home = first.trim_start_matches("lodestream_");
    for name in names.iter().map(|name| name.trim_start_matches("lodestream_").trim_end_matches('!')) {
        if name != home && !repository.has_word_in(home, name) || !repository.has_word(name) {
            wrong(format!("`{span}`: {name} occurs in no source of {home}"));
        }
    }
}

/// Checks the commands in a line: the workspace's programs with subcommand and flags, cargo with package and target,
/// scripts.
fn commands(repository: &Repository, line: &str, wrong: &mut dyn FnMut(String)) {
    let line = line.split(" # ").next().unwrap_or("").split("     #").next().unwrap_or("");
    for command in line.split([';', '|', '&']) {
        let words: Vec<&str> = command.split_whitespace().collect();
        let words: &[&str] = match words.iter().position(|word| !word.contains('=') || word.starts_with('-'))
        {
            Some(start) => &words[start..],
            None => continue,
        };
        let program = words[0].trim_matches(['"', '\'', '(', '$']);
        let name = program.rsplit('/').next().unwrap_or("");
        if let Some(known) = repository.programs.get(name) {
            arguments(known, name, &words[1..], wrong);
        } else if program.starts_with("script/") && !repository.files.contains(program) {
            wrong(format!("there is no {program}"));
        } else if name == "cargo" {
            cargo(repository, &words[1..], wrong);
        }
    }
}

fn arguments(
    program: &super::repository::Program,
    name: &str,
    words: &[&str],
    wrong: &mut dyn FnMut(String),
) {
    let is_command =
        |word: &&&str| word.chars().all(|c| c.is_ascii_lowercase() || c == '-') && !word.starts_with('-');
    let command = words.first().filter(|_| !program.commands.is_empty()).filter(is_command);
    if let Some(command) =
        command.filter(|command| !program.commands.contains(**command) && **command != "help")
    {
        wrong(format!("{name} has no command {command}"));
    }
    for flag in words.iter().filter(|word| word.starts_with("--") && word.len() > 2) {
        let flag = flag.split('=').next().unwrap_or("").trim_end_matches([',', '.', ')', '"', '\'', ']']);
        if !program.flags.contains(flag) {
            wrong(format!("{name} has no flag {flag}"));
        }
    }
}

fn cargo(repository: &Repository, words: &[&str], wrong: &mut dyn FnMut(String)) {
    let own = words.iter().position(|word| *word == "--").unwrap_or(words.len());
    let (own, passed) = words.split_at(own);
    let after = |flags: &[&str]| {
        let found = own.iter().zip(own.iter().skip(1)).filter(|(flag, _)| flags.contains(flag));
        found.map(|(_, value)| *value).collect::<Vec<_>>()
    };
    let packages = after(&["-p", "--package"]);
    for package in packages.iter().filter(|package| package.starts_with("lodestream")) {
        if !repository.packages.contains_key(*package) {
            wrong(format!("there is no package {package}"));
        }
    }
    let [package] = packages[..] else { return };
    let Some(known) = repository.packages.get(package) else { return };
    for (flag, folder) in [("--bench", "benches"), ("--example", "examples"), ("--test", "tests")] {
        for target in after(&[flag]) {
            let declared = known.manifest.contains(&format!("name = \"{target}\""));
            let file = repository.has_path("", &format!("{folder}/{target}.rs"));
            if !declared && !file {
                wrong(format!("{package} has no {flag} {target}"));
            }
        }
    }
    if let (Some(program), [_, passed @ ..], Some(&"run")) =
        (repository.programs.get(package), passed, own.first())
    {
        arguments(program, package, passed, wrong);
    }
}
