//! Sections of a reproduction, as TOML.
//!
//! ```toml
//! [[section]]
//! name = "position-bits"          # name of its CSV and its folder
//! title = "Bits per axis of positions"
//! seconds = 60                    # approximate run time
//! columns = ["payload_bytes", "view.bytes", "prepare_faces_per_s"]   # the figures that are stored
//! ratios = { prepare_faces_per_s = 1.5 }    # compared as ratios, within this factor; the others exactly
//!
//! [section.trade]                 # for sections that show the cost of a setting
//! setting = "--position-bits"
//! default = "12"
//! reason = "half a pixel at 1280×720"
//!
//! [[section.command]]
//! label = "10"                    # first column of its rows
//! run = "assess {models}/stanford-bunny.obj --position-bits 10 --json"   # {models}, {out}: folders
//! # file = "results.csv"          # rows are read from this file in {out} instead of the command's output
//! # rows = "level_ends"           # or from this field of the output
//! # bench = "prepare {models}/stanford-bunny.obj"   # instead of `run`: a benchmark of the checkout, with --json
//!
//! [[section.table]]
//! id = "position-bits"            # placed on a page below <!-- table: position-bits -->
//! columns = [["bits", "{label}"], ["chunks, B", "{payload_bytes:,}"], ["view", "{view.bytes*100:.0} %"]]
//! # only = { scene = "demo" }     # keeps rows with these values; "nodes*": values with this prefix,
//! #                               # "!nodes*": all others
//! # by = ["transport"]            # rows with equal values in these columns share a line,
//! # across = "rate_bits_per_s"    # on which {ttff_ms@2000000} is the figure of the row with that value here
//!
//! [[section.plot]]                # a plot on the page (plot.rs)
//! title = "Bytes"
//! x = { label = "bits", figures = ["label"] }      # label of the axis; products and quotients as in cells
//! y = { label = "bytes", figures = ["payload_bytes"], log = true }   # as many figures as for x: points of a row
//! # line = "{camera}"             # rows with the same text form a line of this name
//! # only = { camera = "still" }
//! ```

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context as _;
use serde::Deserialize;

/// Placeholders of the folder of models and of the command's output folder.
const MODELS: &str = "{models}";
const OUT: &str = "{out}";

/// A group of figures, with the commands that produce them.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Section {
    /// Name of its CSV and its folder.
    pub name: String,
    /// Title.
    pub title: String,
    /// Approximate run time.
    pub seconds: f64,
    /// The figures that are stored.
    pub columns: Vec<String>,
    /// Tolerances of columns that depend on the machine's speed: largest factor between figures relative to the
    /// column's geometric mean.
    #[serde(default)]
    pub ratios: BTreeMap<String, f64>,
    /// The cost of a setting, if the section shows that.
    pub trade: Option<Trade>,
    /// The commands.
    #[serde(rename = "command")]
    pub commands: Vec<CommandLine>,
    /// Tables on pages.
    #[serde(default, rename = "table")]
    pub tables: Vec<Table>,
    /// Plots on the HTML page.
    #[serde(default, rename = "plot")]
    pub plots: Vec<Plot>,
}

/// A setting that trades cost for quality.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trade {
    /// The flag or setting.
    pub setting: String,
    /// Its default.
    pub default: String,
    /// Reason for the default.
    pub reason: String,
}

/// A run of this program, or of one of its benchmarks.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandLine {
    /// First column of its rows.
    #[serde(default)]
    pub label: String,
    /// Arguments of this program, separated by spaces.
    pub run: Option<String>,
    /// Name of a benchmark and its arguments.
    pub bench: Option<String>,
    /// File with its rows.
    pub file: Option<String>,
    /// Field of the printed JSON object that holds the rows, if it is not the object itself.
    pub rows: Option<String>,
}

/// A table on a page.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    /// Its id in the page's mark.
    pub id: String,
    /// Heading and cell template of each column; braces are replaced by figures of the row.
    pub columns: Vec<[String; 2]>,
    /// Required values by column.
    #[serde(default)]
    pub only: BTreeMap<String, String>,
    /// Rows with equal values in these columns share a line if they differ in the column `across`.
    #[serde(default)]
    pub by: Vec<String>,
    /// The column in which rows of a line differ.
    pub across: Option<String>,
}

/// A plot.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plot {
    /// Title.
    #[serde(default)]
    pub title: String,
    /// Rows with the same text here are a line, which has it as its name; figures in braces, as in cells.
    #[serde(default)]
    pub line: String,
    /// The independent figure, such as a setting's value.
    pub x: PlotAxis,
    /// The dependent figure.
    pub y: PlotAxis,
    /// Required values by column.
    #[serde(default)]
    pub only: BTreeMap<String, String>,
}

/// An axis of a plot.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlotAxis {
    /// Label.
    pub label: String,
    /// The figures, products and quotients as in cells: a row gives as many points.
    pub figures: Vec<String>,
    /// Whether the axis is logarithmic.
    #[serde(default)]
    pub log: bool,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    section: Vec<Section>,
}

impl CommandLine {
    /// The words of the command.
    pub(crate) fn words(&self) -> impl Iterator<Item = &str> {
        self.run.iter().chain(&self.bench).flat_map(|line| line.split_whitespace())
    }

    /// The benchmark that it runs, if any.
    pub(crate) fn benchmark(&self) -> Option<&str> {
        self.bench.as_ref()?.split_whitespace().next()
    }

    /// The command as a reader would type it, with placeholders.
    pub(crate) fn shown(&self) -> String {
        let words = || self.words().map(str::to_owned).collect();
        self.line(words()).join(" ")
    }

    /// Program and arguments, from [`Self::words`] after replacing placeholders.
    pub(crate) fn line(&self, words: Vec<String>) -> Vec<String> {
        let mut words = words.into_iter();
        let mut line: Vec<String> = match &self.bench {
            None => vec!["lodestream-sim".to_owned()],
            Some(_) => ["cargo", "bench", "-q", "-p", "lodestream-sim", "--bench"]
                .map(str::to_owned)
                .into_iter()
                .chain(words.next())
                .chain(["--", "--json"].map(str::to_owned))
                .collect(),
        };
        line.extend(words);
        line
    }
}

impl Section {
    /// Whether it reads models that are not part of the project.
    #[must_use]
    pub fn needs_models(&self) -> bool {
        self.commands.iter().flat_map(CommandLine::words).any(|word| word.contains(MODELS))
    }

    /// The files that it reads from the folder of models.
    pub(crate) fn models(&self) -> impl Iterator<Item = &str> {
        let words = self.commands.iter().flat_map(CommandLine::words);
        words.filter_map(|word| word.strip_prefix(MODELS)?.strip_prefix('/'))
    }
}

/// Replaces the placeholders in the words of a command.
pub(crate) fn arguments<'a>(
    words: impl Iterator<Item = &'a str>,
    models: Option<&Path>,
    out: &Path,
) -> anyhow::Result<Vec<String>> {
    let fill = |word: &str| {
        let mut word = word.to_owned();
        for (mark, folder) in [(MODELS, models), (OUT, Some(out))] {
            if word.contains(mark) {
                let folder = folder.and_then(Path::to_str).with_context(|| format!("{mark}: no folder"))?;
                word = word.replace(mark, folder);
            }
        }
        Ok(word)
    };
    words.map(fill).collect()
}

/// Reads a list of sections.
///
/// # Errors
/// Names the file, the section and the fault.
pub fn read(path: &Path) -> anyhow::Result<Vec<Section>> {
    let text =
        std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
    parse(&text).with_context(|| path.display().to_string())
}

pub(crate) fn parse(text: &str) -> anyhow::Result<Vec<Section>> {
    let List { section: sections } = toml::from_str(text).map_err(|e| anyhow::anyhow!("{}", e.message()))?;
    for (i, section) in sections.iter().enumerate() {
        let name = &section.name;
        let plain = |c: char| c.is_ascii_alphanumeric() || c == '-';
        anyhow::ensure!(
            !name.is_empty() && name.chars().all(plain),
            "section {}: {name:?} is not a name: use letters, digits and hyphens",
            i + 1
        );
        anyhow::ensure!(sections[..i].iter().all(|s| s.name != *name), "{name}: two sections have this name");
        anyhow::ensure!(!section.commands.is_empty(), "{name}: it has no command");
        for (number, command) in (1..).zip(&section.commands) {
            anyhow::ensure!(
                command.run.is_some() != command.bench.is_some(),
                "{name}: command {number}: it needs either `run` or `bench`"
            );
            anyhow::ensure!(
                command.bench.is_none() || command.benchmark().is_some_and(|b| b.chars().all(plain)),
                "{name}: command {number}: `bench` begins with no name of a benchmark"
            );
        }
        for (column, factor) in &section.ratios {
            anyhow::ensure!(
                section.columns.contains(column),
                "{name}: ratios: {column} is not one of its columns"
            );
            anyhow::ensure!(
                factor.is_finite() && *factor >= 1.0,
                "{name}: ratios: {column}: {factor} is not a factor of 1 or more"
            );
        }
        for Plot { title, x, y, .. } in &section.plots {
            let (across, up) = (x.figures.len(), y.figures.len());
            anyhow::ensure!(
                across == up && across > 0,
                "{name}: plot {title:?}: {across} figures for x and {up} for y: as many are needed, at least one"
            );
        }
    }
    Ok(sections)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "[[section]]\nname = \"a-1\"\ntitle = \"t\"\nseconds = 3\ncolumns = [\"x\", \"y\"]\n\
                        ratios = { y = 1.5 }\n[[section.command]]\nrun = \"assess {models}/m.obj -o {out}\"\n";

    #[test]
    fn sections_name_their_models() {
        let sections = parse(GOOD).unwrap();
        assert!(sections[0].needs_models());
        assert_eq!(sections[0].models().collect::<Vec<_>>(), ["m.obj"]);
        let filled = |models| arguments(sections[0].commands[0].words(), models, Path::new("o/1"));
        assert_eq!(filled(Some(Path::new("d"))).unwrap(), ["assess", "d/m.obj", "-o", "o/1"]);
        assert!(filled(None).is_err());
    }

    #[test]
    fn a_benchmark_is_run_by_cargo_and_prints_json() {
        let text =
            GOOD.replace("run = \"assess {models}/m.obj -o {out}\"", "bench = \"prepare {models}/m.obj\"");
        let sections = parse(&text).unwrap();
        let command = &sections[0].commands[0];
        assert_eq!(command.benchmark(), Some("prepare"));
        assert_eq!(sections[0].models().collect::<Vec<_>>(), ["m.obj"]);
        let expected = "cargo bench -q -p lodestream-sim --bench prepare -- --json {models}/m.obj";
        assert_eq!(command.shown(), expected);
        let words = arguments(command.words(), Some(Path::new("/d")), Path::new("o")).unwrap();
        assert_eq!(command.line(words).join(" "), expected.replace("{models}", "/d"));
    }

    #[test]
    fn bad_lists_are_refused_with_the_section_and_the_reason() {
        let cases = [
            (GOOD.replace("a-1", "a/1"), "section 1", "not a name"),
            (format!("{GOOD}{GOOD}"), "a-1", "two sections"),
            (GOOD.replace("y = 1.5", "z = 1.5"), "ratios", "z is not one of its columns"),
            (GOOD.replace("y = 1.5", "y = 0.5"), "y", "factor"),
            (GOOD.replace("run =", "bench = \"x\"\nrun ="), "command 1", "either"),
            (GOOD.replace("run =", "label ="), "command 1", "either"),
            (GOOD.replace("run = \"assess", "bench = \"../x"), "command 1", "no name"),
            (GOOD.replace("title", "titel"), "titel", "unknown field"),
            (
                format!(
                    "{GOOD}[[section.plot]]\ntitle = \"p\"\nx = {{ label = \"\", figures = [\"x\"] }}\n\
                     y = {{ label = \"\", figures = [\"x\", \"y\"] }}\n"
                ),
                "plot \"p\"",
                "1 figures for x and 2 for y",
            ),
        ];
        for (text, what, why) in cases {
            let error = format!("{:#}", parse(&text).unwrap_err());
            assert!(error.contains(what) && error.contains(why), "{error}");
        }
    }
}
