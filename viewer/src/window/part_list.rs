//! The list of a scene's parts: what they are called, which are hidden, and which one was chosen.

use std::collections::{BTreeMap, BTreeSet};

use lodestream_client::core::PartAbsence;
use lodestream_client::streaming::{Answer, Streaming};
use lodestream_render::HiddenParts;
use lodestream_scene::parts::ScenePart;
use lodestream_scene::placement::Placement;

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

/// What is known of a part.
#[derive(Debug, Default)]
struct Known {
    /// Path and name.
    path: String,
    in_file: Option<Placement>,
}

/// The list.
#[derive(Debug, Default)]
pub(super) struct PartList {
    parts: Vec<ScenePart>,
    asking: Option<Answer<Vec<ScenePart>>>,
    /// What is known of parts; nothing of those without names.
    known: BTreeMap<ScenePart, Known>,
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
        if !self.known.contains_key(&part) && self.asked.insert(part) && !streaming.look_up_part(part) {
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
            let known = answer.info.map(|info| {
                let path =
                    if info.path.is_empty() { info.name } else { format!("{}/{}", info.path, info.name) };
                Known { path, in_file: Some(info.in_file) }
            });
            let known = match known {
                Ok(known) => known,
                // These do not change; others are asked again.
                Err(PartAbsence::NoNames | PartAbsence::NoSuchPart) => Known::default(),
                Err(_) => continue,
            };
            self.known.insert(answer.id, known);
            changed = true;
        }
        for part in std::mem::take(&mut self.seen) {
            self.look_up(part, streaming);
        }
        changed
    }

    /// A part's name, or its numbers while it is not known.
    pub(super) fn name(&self, part: ScenePart) -> String {
        let numbers = || format!("{}:{}", part.instance, part.part);
        let path = self.known.get(&part).map(|known| &known.path).filter(|path| !path.is_empty());
        path.cloned().unwrap_or_else(numbers)
    }

    /// Takes places of a part's asset to those of its file; `None` while that is not known.
    pub(super) fn in_file(&self, part: ScenePart) -> Option<Placement> {
        self.known.get(&part)?.in_file
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
