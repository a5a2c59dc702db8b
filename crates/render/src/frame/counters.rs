//! What a frame reports.

use crate::frame::graph::PassId;

/// Counters of a frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Passes run, in order.
    pub passes: Vec<PassId>,
    /// Draws of meshes' materials and of terrain, shadow maps and motion aside.
    pub draws: u32,
    /// Calls to the device for meshes in all passes, shadow maps included. A call draws thousands of meshes that share
    /// material and buffers, where the device draws indirectly ([`wgpu::Features::INDIRECT_FIRST_INSTANCE`]).
    pub calls: u32,
    /// Triangles submitted (instances multiplied, unused face slots included).
    pub triangles: u64,
    /// Instances drawn.
    pub instances: u32,
    /// Instances left out because their bounds lie outside the view.
    pub instances_culled: u32,
    /// Shadow maps that had to be drawn anew.
    pub shadow_maps: u32,
    /// Shadow maps that show things as they were, by [`crate::Shadows::max_staleness`].
    pub late_shadow_maps: u32,
    /// Triangles that were drawn into shadow maps; not in `triangles`.
    pub shadow_triangles: u64,
    /// Frames in a row in which nothing changed, this one among them, of which the picture is a mean; 0 without
    /// [`crate::AntiAliasing::Temporal`].
    pub still_frames: u32,
    /// Frames that a mean of occlusion still lacks, where nothing changes; 0 without [`crate::AmbientOcclusion::still`].
    pub occlusion_frames_left: u32,
    /// Terrain tiles drawn; one of which only single quadrants are drawn counts once per quadrant.
    pub terrain_tiles: u32,
    /// Triangles of these.
    pub terrain_triangles: u64,
}

/// Frames after which a picture that stands is as good as it gets, to the eye.
const ENOUGH_FRAMES: u32 = 32;

impl Counters {
    /// Whether the next frame, of the same, would be visibly better: that is the case while a picture that stands is a mean
    /// of few.
    #[must_use]
    pub fn is_unfinished(&self) -> bool {
        (1..ENOUGH_FRAMES).contains(&self.still_frames) || self.occlusion_frames_left > 0
    }
}
