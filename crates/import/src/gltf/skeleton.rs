//! What is known of a skeleton that moves.

use glam::DMat4;
use lodestream_geometry::mesh::skin::Pose;

/// A skeleton that moves.
#[derive(Debug)]
pub(super) struct Skeleton {
    /// From the bind pose to the scene: the map of the first joint at rest.
    pub(super) reference: DMat4,
    /// Poses that differ most, for measuring errors.
    pub(super) poses: Vec<Pose>,
}
