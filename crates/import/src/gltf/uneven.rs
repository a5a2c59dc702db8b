//! Whether an animation scales meshes unevenly, which an instance cannot.

use glam::DAffine3;
use lodestream_scene::animation::{AnimatedModel, is_similarity};

/// Most times of a clip that are looked at.
const MAX_TIMES: usize = 16;
/// Most maps that are computed for all clips together.
const MAX_MAPS: usize = 1 << 20;
/// Relative difference of axes that is not seen.
const TOLERANCE: f64 = 1e-3;
/// Scale below which nothing is left to see.
const VANISHED: f64 = 1e-5;

/// Whether any part is scaled unevenly, sheared or mirrored at some of the times of a clip.
pub(super) fn scales_unevenly(model: &AnimatedModel) -> bool {
    let per_time = (model.nodes.len() + model.parts.len()).saturating_mul(model.clips.len()).max(1);
    let times = (MAX_MAPS / per_time).clamp(1, MAX_TIMES);
    model.clips.iter().any(|clip| {
        let duration_s = model.duration_s(clip);
        let time_s = |step: usize| duration_s * (step as f64 + 0.5) / times as f64;
        (0..times).any(|step| model.maps_at(Some(clip), time_s(step)).iter().any(is_uneven))
    })
}

fn is_uneven(map: &DAffine3) -> bool {
    let axes = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis];
    let vanishes = axes.iter().all(|axis| axis.length() < VANISHED);
    !vanishes && !is_similarity(&map.matrix3, TOLERANCE)
}
