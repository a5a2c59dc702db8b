//! What the parts of a model are called, and where they are in its file.

use std::ops::Range;
use std::sync::Arc;

use lodestream_import::gltf::{Contents, PartNames};
use lodestream_scene::parts::{MAX_PATH_BYTES, PartInfo};
use lodestream_scene::placement::Placement;

/// A part: a mesh of a file, and the node that places it.
pub(super) type PlacedPart = (Option<u32>, usize);

/// What the parts of a model are called: those of each of its [`Model::parts`](super::Model), which has many if it is a
/// batch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ModelPartNames {
    /// Name of the model.
    model: String,
    /// Names of its file; `None` if each of its parts is called as the model.
    file: Option<Arc<PartNames>>,
    /// Parts of all instances, and where those of each end.
    parts: Vec<PlacedPart>,
    ends: Vec<u32>,
    /// Of each instance, its placement in the file.
    in_file: Vec<Placement>,
}

impl ModelPartNames {
    /// A model of one part, called as the model.
    pub(super) fn of_one(model: &str) -> Self {
        let (parts, ends, in_file) = (vec![(None, 0)], vec![1], vec![Placement::default()]);
        Self { model: model.to_owned(), file: None, parts, ends, in_file }
    }

    /// A model with the whole of a glTF file as one mesh.
    pub(super) fn of_merged(model: &str, contents: &Contents) -> Self {
        let Some(parts) = contents.merged_parts() else { return Self::of_one(model) };
        let mut names = Self::of_file(model, Arc::clone(&contents.part_names));
        names.add(Placement::default(), parts);
        names
    }

    pub(super) fn of_file(model: &str, file: Arc<PartNames>) -> Self {
        Self { model: model.to_owned(), file: Some(file), ..Self::default() }
    }

    /// Adds the parts of the model's next instance, and where that is in the file.
    pub(super) fn add(&mut self, in_file: Placement, parts: impl IntoIterator<Item = PlacedPart>) {
        self.in_file.push(in_file);
        self.parts.extend(parts);
        self.ends.push(self.parts.len() as u32);
    }

    /// Number of parts.
    pub(crate) fn len(&self) -> u32 {
        self.parts.len() as u32
    }

    /// The parts of an instance, by number among the model's; `None` if it has none.
    pub(crate) fn of_instance(&self, instance: usize) -> Option<Range<u32>> {
        let end = *self.ends.get(instance)?;
        let start = instance.checked_sub(1).and_then(|before| self.ends.get(before)).copied().unwrap_or(0);
        Some(start..end).filter(|range| !range.is_empty())
    }

    /// What the parts are called, one after the other. Paths begin with the model's name if it is one `of_several`.
    pub(crate) fn infos(&self, of_several: bool) -> impl Iterator<Item = PartInfo> {
        let mut start = 0;
        let counts = self.ends.iter().map(move |&end| end - std::mem::replace(&mut start, end));
        let placements = self.in_file.iter().zip(counts);
        let placements = placements.flat_map(|(in_file, parts)| (0..parts).map(|_| *in_file));
        self.parts.iter().zip(placements).map(move |(&(node, mesh), in_file)| match &self.file {
            Some(file) => {
                let info = file.of(node, mesh);
                let path = if of_several { self.below_model(&info.path) } else { info.path };
                PartInfo { path, in_file, ..info }
            }
            None => PartInfo { name: self.model.clone(), in_file, ..PartInfo::default() },
        })
    }

    /// A path below the model's name; its beginning is left out if both are too long.
    fn below_model(&self, path: &str) -> String {
        let model = &self.model;
        let free = MAX_PATH_BYTES.saturating_sub(model.len() + "/".len());
        if path.is_empty() {
            return model.clone();
        }
        if path.len() <= free {
            return format!("{model}/{path}");
        }
        let start = path.len() - free.saturating_sub("…".len());
        format!("{model}/…{}", &path[path.ceil_char_boundary(start)..])
    }
}
