//! Counts of what a chunk adds.

/// So many elements of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Elements {
    pub(crate) vertices: u32,
    pub(crate) wedges: u32,
    pub(crate) faces: u32,
}

impl Elements {
    /// All kinds together.
    pub(crate) fn total(&self) -> u64 {
        u64::from(self.vertices) + u64::from(self.wedges) + u64::from(self.faces)
    }
}

impl std::fmt::Display for Elements {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} vertices, {} wedges and {} faces", self.vertices, self.wedges, self.faces)
    }
}
