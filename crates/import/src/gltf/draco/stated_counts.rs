//! The counts that a primitive states for its stream.

/// Most points and triangles that a stream may decode to: the counts of the primitive's accessors.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(not(feature = "draco"), expect(dead_code, reason = "nothing is decoded, however large"))]
pub(super) struct StatedCounts {
    pub(super) points: u64,
    pub(super) triangles: u64,
}
