//! SSAO: `ssao.wgsl`.

use super::receiver::{MIN_ELEVATION, Receiver, basis};
use crate::cpu_reference::surface::{V3, dot, sub};
use crate::passes::occlusion_kernel::kernel;

pub(super) fn sums(r: &Receiver<'_>, centred: bool) -> [f64; 2] {
    let [tangent, bitangent] = basis(r.normal);
    let (sin, cos) = (f64::from(r.rotation) * std::f64::consts::TAU / 16.0).sin_cos();
    let (size_px, tan_half_fov) = (r.picture.size_px, r.picture.tan_half_fov);
    let mut occluded = 0.0;
    for [x, y, z, counts] in kernel(r.samples, centred) {
        let (x, y) = (x * cos - y * sin, x * sin + y * cos);
        let s: V3 =
            [0, 1, 2].map(|i| r.centre[i] + r.radius * (tangent[i] * x + bitangent[i] * y + r.normal[i] * z));
        if s[2] >= 0.0 {
            continue;
        }
        let ndc = [0, 1].map(|i| s[i] / (tan_half_fov[i] * -s[2]));
        if ndc.iter().any(|n| n.abs() >= 1.0) {
            continue;
        }
        let uv = [ndc[0] * 0.5 + 0.5, 0.5 - ndc[1] * 0.5];
        let there = [0, 1].map(|i| (uv[i] * f64::from(size_px[i])) as i64);
        let depth_there = r.picture.depth_at(there);
        let height = dot(sub(r.picture.position_at(there), r.centre), r.normal);
        if depth_there < -s[2] && height > MIN_ELEVATION * r.radius {
            let t = (r.radius / (r.depth - depth_there).abs().max(1e-30)).clamp(0.0, 1.0);
            occluded += t * t * (3.0 - 2.0 * t) * counts;
        }
    }
    [occluded, r.samples as f64]
}
