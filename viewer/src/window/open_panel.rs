//! The panel that opens files: those opened last, and the files of a folder.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use lodestream_bake::prepare::is_pack;
use lodestream_bake::scene::{MODEL_EXTENSIONS, has_extension};

/// Most entries of a folder that are listed.
const MOST: usize = 2_000;

/// An entry of a folder.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Entry {
    /// Folders come first.
    is_file: bool,
    name: String,
    path: PathBuf,
}

/// State of the panel.
#[derive(Debug, Default)]
pub(super) struct OpenPanel {
    folder: PathBuf,
    entries: Vec<Entry>,
    /// Why the folder cannot be listed.
    error: Option<String>,
    /// A path or an address that is typed.
    typed: String,
    /// What was opened last, the newest first.
    pub(super) recent: Vec<Vec<OsString>>,
    /// What is to be opened, as words of a command line.
    pub(super) chosen: Option<Vec<OsString>>,
}

impl OpenPanel {
    /// Lists the current folder anew.
    pub(super) fn refresh(&mut self) {
        if self.folder.as_os_str().is_empty() {
            self.folder = std::env::current_dir().unwrap_or_else(|_| PathBuf::from("/"));
        }
        self.list(self.folder.clone());
    }

    fn list(&mut self, folder: PathBuf) {
        (self.entries, self.error) = match entries(&folder) {
            Ok(entries) => (entries, None),
            Err(why) => (Vec::new(), Some(format!("{}: {why}", folder.display()))),
        };
        self.folder = folder;
    }

    /// Draws the panel.
    pub(super) fn contents(&mut self, ui: &mut egui::Ui) {
        let typed = ui.add(
            egui::TextEdit::singleline(&mut self.typed)
                .hint_text("path or address")
                .desired_width(f32::INFINITY),
        );
        if typed.lost_focus()
            && ui.input(|input| input.key_pressed(egui::Key::Enter))
            && !self.typed.is_empty()
        {
            self.chosen = Some(vec![std::mem::take(&mut self.typed).into()]);
        }
        self.recent_contents(ui);
        ui.separator();
        ui.horizontal(|ui| {
            if ui.button("up").clicked()
                && let Some(parent) = self.folder.parent()
            {
                self.list(parent.to_owned());
            }
            if ui.button("open folder").clicked() {
                self.chosen = Some(vec![self.folder.clone().into()]);
            }
        });
        ui.add(egui::Label::new(self.folder.display().to_string()).truncate());
        if let Some(error) = &self.error {
            ui.label(error);
        }
        let mut enter = None;
        for entry in &self.entries {
            let text = if entry.is_file { entry.name.clone() } else { format!("{}/", entry.name) };
            if ui.add(egui::Button::new(text).frame(false).truncate()).clicked() {
                if entry.is_file {
                    self.chosen = Some(vec![entry.path.clone().into()]);
                } else {
                    enter = Some(entry.path.clone());
                }
            }
        }
        if let Some(folder) = enter {
            self.list(folder);
        }
    }

    /// Draws the buttons of what was opened last.
    pub(super) fn recent_contents(&mut self, ui: &mut egui::Ui) {
        for words in &self.recent {
            let text = describe(words);
            let button = ui.add(egui::Button::new(&text).frame(false).truncate()).on_hover_text(&text);
            if button.clicked() {
                self.chosen = Some(words.clone());
            }
        }
    }
}

/// Words of a command line, for people: the last part of the first, which tells files of a folder apart.
fn describe(words: &[OsString]) -> String {
    let Some(first) = words.first() else { return String::new() };
    let text = first.to_string_lossy().into_owned();
    if words.len() > 1 { format!("{text} and {} more", words.len() - 1) } else { text }
}

/// Folders, and files that can be shown, sorted.
fn entries(folder: &Path) -> std::io::Result<Vec<Entry>> {
    let mut entries = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let Some(name) = path.file_name().map(|name| name.to_string_lossy().into_owned()) else { continue };
        if name.starts_with('.') {
            continue;
        }
        let is_file = !path.is_dir();
        let fits = || {
            has_extension(&path, &MODEL_EXTENSIONS)
                || has_extension(&path, &["toml", "lss"])
                || is_pack(&path)
        };
        if !is_file || fits() {
            entries.push(Entry { is_file, name, path });
        }
        // More than anybody looks through.
        if entries.len() >= MOST {
            break;
        }
    }
    entries.sort();
    Ok(entries)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_lists_folders_first_and_only_what_can_be_shown() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.OBJ", "a.glb", "scene.toml", "notes.txt", ".hidden.obj", "x.lsp"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("z")).unwrap();
        let names: Vec<String> =
            entries(folder.path()).unwrap().into_iter().map(|entry| entry.name).collect();
        assert_eq!(names, ["z", "a.glb", "b.OBJ", "scene.toml", "x.lsp"]);
        let mut panel = OpenPanel { folder: folder.path().join("missing"), ..OpenPanel::default() };
        panel.refresh();
        assert!(panel.error.is_some() && panel.entries.is_empty());
    }
}
