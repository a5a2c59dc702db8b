//! Requests, as drivers take them.

use std::ops::Range;

use lodestream_scene::published::pack_name;

/// An object of a published scene.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Object {
    /// The published scene itself.
    Scene,
    /// A pack: its key and length.
    Pack([u8; 32], u64),
}

impl Object {
    /// Its name relative to the published scene's folder; `None` for the scene itself.
    #[must_use]
    pub fn name(&self) -> Option<String> {
        match self {
            Self::Scene => None,
            Self::Pack(key, _) => Some(pack_name(key)),
        }
    }
}

impl std::fmt::Display for Object {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.name() {
            None => f.write_str("the published scene"),
            Some(name) => f.write_str(&name),
        }
    }
}

/// A request for a driver to make.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RangeRequest {
    /// Its number, in what the driver reports about it.
    pub id: u64,
    /// The object.
    pub object: Object,
    /// Its bytes.
    pub range: Range<u64>,
    /// Whether caches must ask the server again: a copy was damaged or outdated.
    pub reload: bool,
}
