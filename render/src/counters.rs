//! What a frame reports.

use super::graph::PassId;

/// What a frame took.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Passes run, in order.
    pub passes: Vec<PassId>,
    /// Draw calls that drew geometry.
    pub draws: u32,
    /// Triangles submitted (instances multiplied, unused face slots included).
    pub triangles: u64,
    /// Instances drawn.
    pub instances: u32,
    /// Instances left out because their bounds lie outside the view.
    pub instances_culled: u32,
    /// Shadow maps that had to be drawn anew.
    pub shadow_maps: u32,
    /// Shadow maps that show things as they were, by [`super::Shadows::patience`].
    pub late_shadow_maps: u32,
    /// Triangles that were drawn into shadow maps; not in `triangles`.
    pub shadow_triangles: u64,
    /// Terrain tiles drawn; one of which only single quadrants are drawn counts once per quadrant.
    pub terrain_tiles: u32,
    /// Triangles of these.
    pub terrain_triangles: u64,
}
