//! The Markdown pages with the tables.

use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::rows::Rows;
use super::section::Section;
use super::table;

/// Where tables are searched by default: a page and a folder of pages.
const USUAL: [&str; 2] = ["BENCHMARKS.md", "docs/benchmarks"];

/// Markdown files by name.
#[derive(Clone, Debug, Default)]
pub(crate) struct Documents {
    pages: Vec<Page>,
}

#[derive(Clone, Debug)]
struct Page {
    file: PathBuf,
    text: String,
}

/// A table on a page that differs from the figures.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Stale {
    pub(crate) file: PathBuf,
    pub(crate) table: String,
}

impl Documents {
    /// Reads files, and from folders the files `*.md`; by default the project's: `BENCHMARKS.md` and those of
    /// `docs/benchmarks`, as far as they exist.
    ///
    /// # Errors
    /// Pages that cannot be read, and if there is none at all.
    pub(crate) fn read(named: &[PathBuf], project: &Path) -> anyhow::Result<Self> {
        let usual = || USUAL.iter().map(|path| project.join(path)).filter(|path| path.exists()).collect();
        let named: Vec<PathBuf> = if named.is_empty() { usual() } else { named.to_vec() };
        let mut files = Vec::new();
        for path in named {
            if path.is_dir() {
                files.extend(pages_of(&path)?);
            } else {
                files.push(path);
            }
        }
        anyhow::ensure!(
            !files.is_empty(),
            "there is no page for the tables: run this in the project's folder, or name --document FILE or a folder"
        );
        let page = |file: PathBuf| {
            let text = std::fs::read_to_string(&file);
            let text = text.with_context(|| format!("{}: cannot be read", file.display()))?;
            Ok(Page { file, text })
        };
        Ok(Self { pages: files.into_iter().map(page).collect::<anyhow::Result<_>>()? })
    }

    /// One page in memory.
    #[cfg(test)]
    pub(crate) fn of(text: &str) -> Self {
        Self { pages: vec![Page { file: PathBuf::from("page.md"), text: text.to_owned() }] }
    }

    /// The section's tables that differ from the figures, on all pages.
    ///
    /// # Errors
    /// A table whose mark is on no page, and templates that name unknown columns.
    pub(crate) fn stale(&self, section: &Section, rows: &Rows) -> anyhow::Result<Vec<Stale>> {
        let mut stale = Vec::new();
        for (id, text) in table::all(section, rows)? {
            for (page, [start, end]) in self.places(id)? {
                let Page { file, text: whole } = &self.pages[page];
                if whole[start..end] != text {
                    stale.push(Stale { file: file.clone(), table: id.to_owned() });
                }
            }
        }
        Ok(stale)
    }

    /// Rewrites the section's tables on all pages and returns the changed files. Files are read again, since sections
    /// run for minutes and a page may have been edited meanwhile.
    ///
    /// # Errors
    /// As [`Documents::stale`], and pages that cannot be read; then nothing is changed.
    pub(crate) fn update(
        &mut self,
        section: &Section,
        rows: &Rows,
    ) -> anyhow::Result<Vec<(PathBuf, String)>> {
        for page in &mut self.pages {
            match std::fs::read_to_string(&page.file) {
                Ok(text) => page.text = text,
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
                Err(error) => return Err(error).with_context(|| page.file.display().to_string()),
            }
        }
        let before = self.pages.clone();
        for (id, text) in table::all(section, rows)? {
            for (page, [start, end]) in self.places(id)? {
                self.pages[page].text.replace_range(start..end, &text);
            }
        }
        let pairs = before.iter().zip(&self.pages);
        let changed = pairs.filter(|(before, page)| before.text != page.text);
        Ok(changed.map(|(_, page)| (page.file.clone(), page.text.clone())).collect())
    }

    /// The pages with a table's mark, with start and end of the table. A page has a mark at most once.
    fn places(&self, id: &str) -> anyhow::Result<Vec<(usize, [usize; 2])>> {
        let places: Vec<_> = (0..)
            .zip(&self.pages)
            .filter_map(|(number, page)| Some((number, table::place(&page.text, id)?)))
            .collect();
        let files = || self.pages.iter().map(|page| page.file.display().to_string()).collect::<Vec<_>>();
        anyhow::ensure!(
            !places.is_empty(),
            "there is no line {} in {}",
            table::mark(id).trim_end(),
            files().join(", ")
        );
        Ok(places)
    }
}

/// The pages of a folder, in the order of their names.
fn pages_of(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let fail = || format!("{}: cannot be read", folder.display());
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(fail)? {
        let file = entry.with_context(fail)?.path();
        if file.extension().is_some_and(|extension| extension == "md") {
            files.push(file);
        }
    }
    files.sort();
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::super::section::parse;
    use super::*;

    fn section() -> Section {
        let table =
            |id: &str| format!("[[section.table]]\nid = \"{id}\"\ncolumns = [[\"B\", \"{{bytes:,}}\"]]\n");
        let text = "[[section]]\nname = \"s\"\ntitle = \"t\"\nseconds = 1\ncolumns = [\"bytes\"]\n\
                    [[section.command]]\nrun = \"x\"\n";
        parse(&format!("{text}{}{}", table("one"), table("two"))).unwrap().remove(0)
    }

    #[test]
    fn tables_are_found_on_every_page_of_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("topics")).unwrap();
        std::fs::write(at("first.md"), "# First\n\n<!-- table: one -->\n\nEnd.\n").unwrap();
        std::fs::write(at("topics/b.md"), "<!-- table: two -->\n| old |\n").unwrap();
        std::fs::write(at("topics/a.md"), "<!-- table: one -->\n").unwrap();
        std::fs::write(at("topics/a.txt"), "<!-- table: two -->\n").unwrap();
        let rows = Rows::from_csv("label,bytes\n,1234\n").unwrap();
        let named = [at("first.md"), at("topics")];
        let mut documents = Documents::read(&named, Path::new("")).unwrap();
        let stale = |documents: &Documents| -> Vec<(PathBuf, String)> {
            let stale = documents.stale(&section(), &rows).unwrap();
            stale.into_iter().map(|stale| (stale.file, stale.table)).collect()
        };
        let expected = [("first.md", "one"), ("topics/a.md", "one"), ("topics/b.md", "two")];
        assert_eq!(stale(&documents), expected.map(|(file, table)| (at(file), table.to_owned())));
        std::fs::write(at("first.md"), "# First\n\n<!-- table: one -->\n\nAnother end.\n").unwrap();
        for (file, text) in documents.update(&section(), &rows).unwrap() {
            std::fs::write(file, text).unwrap();
        }
        assert_eq!(stale(&documents), []);
        assert_eq!(stale(&Documents::read(&named, Path::new("")).unwrap()), []);
        assert_eq!(documents.update(&section(), &rows).unwrap(), []);
        let written = std::fs::read_to_string(at("first.md")).unwrap();
        assert_eq!(written, "# First\n\n<!-- table: one -->\n| B |\n|---|\n| 1,234 |\n\nAnother end.\n");
    }

    #[test]
    fn a_mark_that_no_page_has_is_named_with_the_pages() {
        let folder = tempfile::tempdir().unwrap();
        let page = folder.path().join("page.md");
        std::fs::write(&page, "<!-- table: one -->\n").unwrap();
        let documents = Documents::read(&[page], Path::new("")).unwrap();
        let error = documents.stale(&section(), &Rows::from_csv("label,bytes\n").unwrap()).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("<!-- table: two -->") && error.contains("page.md"), "{error}");
        let none = Documents::read(&[folder.path().join("none.md")], Path::new("")).unwrap_err();
        assert!(none.to_string().contains("none.md"), "{none}");
        let none = Documents::read(&[], folder.path()).unwrap_err();
        assert!(none.to_string().contains("--document"), "{none}");
    }

    /// The project's own list, figures and pages.
    #[test]
    fn the_committed_list_its_figures_and_the_pages_agree() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).unwrap();
        let documents = Documents::read(&[], root).unwrap();
        let sections = super::super::read(&root.join("docs/report/sections.toml")).unwrap();
        assert!(!sections.is_empty());
        let mut known = Vec::new();
        for section in sections {
            let csv = root.join("docs/report").join(format!("{}.csv", section.name));
            let rows = Rows::from_csv(&std::fs::read_to_string(&csv).unwrap()).unwrap();
            assert_eq!(rows.columns[1..], section.columns[..], "{}", section.name);
            assert_eq!(documents.stale(&section, &rows).unwrap(), [], "{}", csv.display());
            known.extend(table::all(&section, &rows).unwrap().into_iter().map(|(id, _)| table::mark(id)));
        }
        // No page has a mark without figures.
        for Page { file, text } in &documents.pages {
            for line in text.split_inclusive('\n').filter(|line| line.starts_with("<!-- table:")) {
                assert!(known.iter().any(|mark| mark == line), "{}: {line}", file.display());
            }
        }
    }
}
