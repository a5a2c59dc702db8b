//! The list of a scene's parts: what they are called, which are hidden, and which one was chosen.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_client::streaming::{Answer, Streaming};
use lodestream_render::HiddenParts;
use lodestream_scene::parts::ScenePart;

/// Most parts listed.
const MOST: usize = 10_000;
/// Height of a row in points.
const ROW: f32 = 16.0;

/// What was done in the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PartRequest {
    /// Select a part and go to it.
    Select(ScenePart),
    /// Hide a part, or draw it again.
    SetHidden(ScenePart, bool),
}

/// The list.
#[derive(Debug, Default)]
pub(super) struct PartList {
    parts: Vec<ScenePart>,
    asking: Option<Answer<Vec<ScenePart>>>,
    names: BTreeMap<ScenePart, String>,
    /// Parts whose rows are in view.
    seen: Vec<ScenePart>,
    /// Parts whose names are being looked up.
    asked: BTreeSet<ScenePart>,
    /// What was done since the last frame.
    pub(super) request: Option<PartRequest>,
}

impl PartList {
    /// Whether an answer is awaited.
    pub(super) fn awaits_answer(&self) -> bool {
        self.asking.is_some() || !self.asked.is_empty()
    }

    /// Asks which parts there are by now.
    pub(super) fn refresh(&mut self, streaming: &Streaming) {
        if self.asking.is_none() {
            self.asking = streaming.ask(|core| core.scene_parts(MOST)).ok();
        }
    }

    /// Asks for a part's name, if it is not known.
    pub(super) fn look_up(&mut self, part: ScenePart, streaming: &Streaming) {
        if !self.names.contains_key(&part) && self.asked.insert(part) && !streaming.look_up_part(part) {
            self.asked.remove(&part);
        }
    }

    /// Takes answers and asks for the names of rows in view; returns whether the list has changed.
    pub(super) fn receive(&mut self, streaming: &mut Streaming) -> bool {
        let mut changed = false;
        if let Some(asking) = &mut self.asking {
            match asking.take() {
                Ok(None) => {}
                Ok(Some(parts)) => {
                    changed |= self.parts != parts;
                    self.parts = parts;
                    self.asking = None;
                }
                Err(_) => self.asking = None,
            }
        }
        while let Some(answer) = streaming.take_part() {
            self.asked.remove(&answer.id);
            if let Ok(info) = answer.info {
                let path =
                    if info.path.is_empty() { info.name } else { format!("{}/{}", info.path, info.name) };
                self.names.insert(answer.id, path);
                changed = true;
            }
        }
        for part in std::mem::take(&mut self.seen) {
            self.look_up(part, streaming);
        }
        changed
    }

    /// A part's name, or its numbers while it is not known.
    pub(super) fn name(&self, part: ScenePart) -> String {
        let numbers = || format!("{}:{}", part.instance, part.part);
        self.names.get(&part).filter(|name| !name.is_empty()).cloned().unwrap_or_else(numbers)
    }

    /// Draws the list.
    pub(super) fn contents(&mut self, ui: &mut egui::Ui, hidden: &HiddenParts, selected: Option<ScenePart>) {
        let more = if self.parts.len() == MOST { " or more" } else { "" };
        ui.label(format!("{}{more} parts", self.parts.len()));
        let rows = self.parts.len();
        egui::ScrollArea::vertical().auto_shrink([false, true]).show_rows(ui, ROW, rows, |ui, range| {
            for part in self.parts.get(range).unwrap_or_default().to_owned() {
                self.seen.push(part);
                ui.horizontal(|ui| {
                    let mut shown = !hidden.contains(part);
                    if ui.checkbox(&mut shown, "").changed() {
                        self.request = Some(PartRequest::SetHidden(part, !shown));
                    }
                    let label = egui::Label::new(self.name(part)).truncate();
                    let label = ui.add(label.sense(egui::Sense::click()));
                    if selected == Some(part) {
                        label.clone().highlight();
                    }
                    if label.clicked() {
                        self.request = Some(PartRequest::Select(part));
                    }
                });
            }
        });
    }
}
