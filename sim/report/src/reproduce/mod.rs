//! Reproduction of the benchmarks' figures with one command.
//!
//! `docs/report/sections.toml` lists sections: commands of this program, the figures taken from their output or files,
//! and tables that show them (`section`). A section's figures are stored beside the list as CSV. A reproduction runs
//! the commands and compares the figures with the committed ones (`compare`): bytes and virtual times exactly, figures
//! that depend on the machine's speed in their ratios to each other. Tables on pages (`document`) are generated from
//! the figures alone (`table`).
//!
//! Commands run one after the other in separate processes, as a reader would run them; benchmarks need cargo and the
//! sources in the current folder.

mod compare;
mod document;
#[cfg(test)]
mod headline_test;
mod outcome;
mod page;
mod plot;
mod rows;
mod section;
mod table;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::Context as _;
use lodestream_compress::whole_file::write_atomically;
use lodestream_scenario::baseline::lacks_something_here;

use compare::{Compared, compare};
pub use compare::{Difference, RowsLeftOut};
use document::Documents;
pub use outcome::{Outcome, Reproduction};
pub use rows::Rows;
pub use section::{CommandLine, Section, read};

/// Options of a reproduction.
#[derive(Clone, Debug)]
pub struct Options {
    /// The list of sections; their committed figures are beside it.
    pub sections: PathBuf,
    /// Pages with the tables, and folders of pages; the project's if empty.
    pub documents: Vec<PathBuf>,
    /// Folder of models that are not part of the project.
    pub models: Option<PathBuf>,
    /// Environment variables of the commands, such as files of peers.
    pub environment: Vec<(&'static str, OsString)>,
    /// Names of the sections to run; all if empty.
    pub only: Vec<String>,
    /// Folder of reports and figures.
    pub output: PathBuf,
    /// What to do with the committed figures.
    pub mode: Mode,
}

/// What to do with the committed figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Compare them with the new ones.
    Compare,
    /// Replace them with the new ones, and the pages' tables accordingly. Rows that cannot be reproduced here stay.
    Update,
    /// Run nothing; regenerate the pages' tables from the committed figures.
    Tables,
}

/// Runs the sections. `report` receives progress messages.
///
/// # Errors
/// A list or page that cannot be read, an unknown section, and commands that fail.
pub fn run(options: &Options, mut report: impl FnMut(&str)) -> anyhow::Result<Reproduction> {
    let sections = read(&options.sections)?;
    for name in &options.only {
        anyhow::ensure!(
            sections.iter().any(|s| s.name == *name),
            "{}: no section is called {name}; there are {}",
            options.sections.display(),
            sections.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ")
        );
    }
    let wanted = |s: &&Section| options.only.is_empty() || options.only.contains(&s.name);
    let sections: Vec<&Section> = sections.iter().filter(wanted).collect();
    let seconds: f64 = sections.iter().filter(|s| runs(s, options)).map(|s| s.seconds).sum();
    report(&format!(
        "{} sections; about {:.0} minutes where they were written",
        sections.len(),
        seconds / 60.0
    ));
    if options.mode != Mode::Tables {
        let benchmarks = sections.iter().filter(|s| runs(s, options)).flat_map(|s| &s.commands);
        check_benchmarks(benchmarks.filter_map(CommandLine::benchmark))?;
    }
    let mut documents = Documents::read(&options.documents, Path::new(""))?;
    let mut outcomes = Vec::with_capacity(sections.len());
    let mut printed = BTreeMap::new();
    let mut figures = Vec::with_capacity(sections.len());
    for section in &sections {
        let (outcome, rows) = one(section, options, &mut documents, &mut printed, &mut report)?;
        outcomes.push(outcome);
        figures.push((*section, rows));
    }
    let made = Reproduction {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        machine: format!("{} {}", std::env::consts::ARCH, std::env::consts::OS),
        processors: std::thread::available_parallelism().map_or(1, usize::from),
        models: hashes(&sections, options)?,
        sections: outcomes,
    };
    let json = serde_json::to_vec_pretty(&made)?;
    write(&options.output.join("reproduction.json"), &json)?;
    write(&options.output.join("reproduction.html"), page::page(&made, &figures)?.as_bytes())?;
    Ok(made)
}

/// Whether a section's models are available.
fn runs(section: &Section, options: &Options) -> bool {
    options.models.is_some() || !section.needs_models()
}

/// Runs a section; returns its outcome and the committed figures.
fn one(
    section: &Section,
    options: &Options,
    documents: &mut Documents,
    printed: &mut Printed,
    report: &mut impl FnMut(&str),
) -> anyhow::Result<(Outcome, Rows)> {
    let committed = options.sections.with_file_name(format!("{}.csv", section.name));
    let mut outcome = Outcome {
        name: section.name.clone(),
        left_out: None,
        seconds: 0.0,
        differences: Vec::new(),
        stale_tables: Vec::new(),
        rows_left_out: Vec::new(),
    };
    if options.mode != Mode::Tables && !runs(section, options) {
        let why = "its models are not here; name their folder with --models DIR";
        report(&format!("{}: left out: {why}", section.name));
        outcome.left_out = Some(why.to_owned());
        // Without figures of an earlier run there are none to show.
        let rows = if committed.exists() { read_rows(&committed)? } else { Rows::default() };
        return Ok((outcome, rows));
    }
    if options.mode == Mode::Tables {
        let rows = read_rows(&committed)?;
        write_tables(documents, section, &rows)?;
        outcome.left_out = Some("only its tables were written".to_owned());
        return Ok((outcome, rows));
    }
    report(&format!("{}: {}, about {:.0} s", section.name, section.title, section.seconds));
    let start = Instant::now();
    let rows = match measure(section, options, printed)? {
        Measured::Rows(rows) => rows,
        Measured::Lacking(why) => {
            report(&format!("  left out: {why}"));
            outcome.left_out = Some(why);
            let rows = if committed.exists() { read_rows(&committed)? } else { Rows::default() };
            return Ok((outcome, rows));
        }
    };
    outcome.seconds = start.elapsed().as_secs_f64();
    write(&options.output.join(format!("{}.csv", section.name)), rows.to_csv().as_bytes())?;
    let expected = if options.mode == Mode::Update {
        // Rows that cannot be reproduced here are kept.
        let Compared { kept, left_out, .. } = match committed.exists() {
            true => compare(section, &read_rows(&committed)?, &rows),
            false => Compared { kept: rows, ..Compared::default() },
        };
        outcome.rows_left_out = left_out;
        write(&committed, kept.to_csv().as_bytes())?;
        write_tables(documents, section, &kept)?;
        kept
    } else {
        let expected = read_rows(&committed)?;
        let compared = compare(section, &expected, &rows);
        (outcome.differences, outcome.rows_left_out) = (compared.differences, compared.left_out);
        // Pages show the committed figures, from which those of another machine may differ within the tolerance.
        for stale in documents.stale(section, &expected).with_context(|| section.name.clone())? {
            let (file, table) = (stale.file.display(), stale.table);
            report(&format!("  {file}: table {table} does not show the committed figures"));
            outcome.stale_tables.push(table);
        }
        expected
    };
    for difference in &outcome.differences {
        report(&format!("  {difference}"));
    }
    for rows in &outcome.rows_left_out {
        report(&format!("  left out: {rows}"));
    }
    let verdict = match (options.mode == Mode::Update, outcome.differences.len(), outcome.stale_tables.len())
    {
        (true, ..) => "written".to_owned(),
        (false, 0, 0) => "as committed".to_owned(),
        (false, figures, tables) => format!("{figures} figures and {tables} tables differ"),
    };
    report(&format!("  {verdict}, {:.0} s", outcome.seconds));
    Ok((outcome, expected))
}

/// Writes a section's tables into the pages.
fn write_tables(documents: &mut Documents, section: &Section, rows: &Rows) -> anyhow::Result<()> {
    let changed = documents.update(section, rows).with_context(|| section.name.clone())?;
    changed.iter().try_for_each(|(file, text)| write(file, text.as_bytes()))
}

/// Reads committed figures.
fn read_rows(committed: &Path) -> anyhow::Result<Rows> {
    let text = std::fs::read_to_string(committed)
        .with_context(|| format!("{}: cannot be read; --update writes it", committed.display()))?;
    Rows::from_csv(&text).with_context(|| format!("{}: is not a table", committed.display()))
}

/// Output of commands that write no files: several sections include the run with default settings.
type Printed = BTreeMap<Vec<String>, String>;

/// Result of a section's commands.
enum Measured {
    Rows(Rows),
    /// There is no table, since all of it needs something that this machine lacks.
    Lacking(String),
}

/// What a run lacked on this machine, from the results in its folder.
fn lacked(folder: &Path) -> Option<String> {
    let results = Rows::from_csv(&std::fs::read_to_string(folder.join("results.csv")).ok()?).ok()?;
    let ended = results.column("ended")?;
    results.rows.iter().map(|row| &row[ended]).find(|ended| lacks_something_here(ended)).cloned()
}

/// Runs a section's commands; each gives a row or a file of rows.
fn measure(section: &Section, options: &Options, printed: &mut Printed) -> anyhow::Result<Measured> {
    let mut rows = Rows::default();
    for (number, command) in (1..).zip(&section.commands) {
        let folder = options.output.join(&section.name).join(number.to_string());
        let line = command_line(command, options, &folder)?;
        let new = match &command.file {
            Some(file) => {
                execute(&section.name, &line, options)?;
                let path = folder.join(file);
                if let Some(why) = lacked(&folder).filter(|_| !path.exists()) {
                    return Ok(Measured::Lacking(format!("there is no {file}: {why}")));
                }
                let text = std::fs::read_to_string(&path)
                    .with_context(|| format!("{}: cannot be read", path.display()))?;
                if file.ends_with(".csv") { Rows::from_csv(&text) } else { Rows::from_json(&text) }
            }
            None => {
                let text = match printed.get(&line) {
                    Some(text) => text,
                    None => printed.entry(line.clone()).or_insert(execute(&section.name, &line, options)?),
                };
                match &command.rows {
                    Some(field) => Rows::from_field(text, field),
                    None => Rows::from_json(text),
                }
            }
        };
        let new = new.with_context(|| format!("{}: {}", section.name, command.shown()))?;
        rows.extend(&command.label, &section.columns, &new).with_context(|| section.name.clone())?;
    }
    Ok(Measured::Rows(rows))
}

/// Checks before the first run that benchmarks can run.
fn check_benchmarks<'a>(mut names: impl Iterator<Item = &'a str>) -> anyhow::Result<()> {
    let Some(first) = names.next() else { return Ok(()) };
    for name in std::iter::once(first).chain(names) {
        let source = Path::new("sim/benches").join(name).with_extension("rs");
        anyhow::ensure!(
            source.is_file(),
            "benchmark {name}: there is no {} here; run this in the checkout, or name other sections",
            source.display()
        );
    }
    let cargo = Command::new("cargo").arg("--version").output();
    anyhow::ensure!(
        cargo.is_ok_and(|output| output.status.success()),
        "benchmark {first}: cargo cannot be run; install it, or name other sections"
    );
    Ok(())
}

/// Program and arguments of a command. Folders are absolute for benchmarks, since cargo runs them in their package's
/// folder.
fn command_line(command: &CommandLine, options: &Options, folder: &Path) -> anyhow::Result<Vec<String>> {
    let models = options.models.as_deref();
    let words = if command.benchmark().is_some() {
        let models = models.map(std::path::absolute).transpose().context("the current folder is gone")?;
        section::arguments(command.words(), models.as_deref(), &std::path::absolute(folder)?)?
    } else {
        section::arguments(command.words(), models, folder)?
    };
    Ok(command.line(words))
}

/// Runs this program or a benchmark; returns its output.
fn execute(section: &str, line: &[String], options: &Options) -> anyhow::Result<String> {
    let (program, arguments) = line.split_first().context("there is nothing to run")?;
    let program = match program.as_str() {
        "cargo" => PathBuf::from(program),
        _ => std::env::current_exe().context("this program cannot be found")?,
    };
    let output = Command::new(&program)
        .args(arguments)
        .envs(options.environment.iter().map(|(name, value)| (name, value)))
        .output()
        .with_context(|| format!("{} cannot be run", program.display()))?;
    if !output.status.success() {
        let why = String::from_utf8_lossy(&output.stderr);
        anyhow::bail!(
            "{section}: {}: {}",
            line.join(" "),
            // Cargo ends with a line about the failed process.
            why.lines().rfind(|line| !line.starts_with("error: bench failed")).unwrap_or("it failed")
        );
    }
    String::from_utf8(output.stdout).with_context(|| format!("{section}: its output is not text"))
}

/// Hashes of the models that the sections read.
fn hashes(sections: &[&Section], options: &Options) -> anyhow::Result<Vec<(String, String)>> {
    let Some(folder) = &options.models else { return Ok(Vec::new()) };
    let mut names: Vec<&str> = sections.iter().flat_map(|s| s.models()).collect();
    names.sort_unstable();
    names.dedup();
    let hash = |name: &&str| {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        Ok(((*name).to_owned(), blake3::hash(&bytes).to_hex().to_string()))
    };
    names.iter().map(hash).collect()
}

/// Writes a file atomically.
fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    let put = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        write_atomically(path, |out| out.write_all(bytes))
    };
    put().with_context(|| format!("{}: cannot be written", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A section of which nothing can be run on this machine is reported with the reason.
    #[test]
    fn a_missing_table_is_explained_by_what_the_machine_lacks() {
        let folder = tempfile::tempdir().unwrap();
        let results = |ended: &str| {
            std::fs::write(folder.path().join("results.csv"), format!("run,ended\n1,settled\n2,{ended}\n"))
                .unwrap();
            lacked(folder.path())
        };
        assert_eq!(lacked(folder.path()), None);
        assert_eq!(results("time limit"), None);
        let why = "not run: draco_encoder is not on this machine";
        assert_eq!(results(why).as_deref(), Some(why));
    }
}
