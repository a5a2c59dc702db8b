//! Counts of vertices, wedges and faces.

/// Counts by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Elements {
    pub(crate) vertices: u32,
    pub(crate) wedges: u32,
    pub(crate) faces: u32,
}

impl Elements {
    /// Sum of the counts.
    pub(crate) fn total(&self) -> u64 {
        u64::from(self.vertices) + u64::from(self.wedges) + u64::from(self.faces)
    }
}

impl std::fmt::Display for Elements {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} vertices, {} wedges and {} faces", self.vertices, self.wedges, self.faces)
    }
}
