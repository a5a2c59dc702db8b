//! Selection of the codec for a mesh.

use crate::entropy::Codec;
use crate::mesh::QuantisedMesh;

/// Smallest [`axis_aligned_share`] of an axis-aligned mesh. Parts of buildings and machines have 0.3 to 0.4, regular
/// height grids 0.2; surfaces of revolution such as columns and teapots 0.1; scans and sculptures less. Surfaces of
/// revolution are smaller with the axis-aligned codec when complete, but larger while coarse
/// (docs/benchmarks/codecs.md).
const MIN_AXIS_ALIGNED_SHARE: f64 = 0.15;
/// Most faces sampled, spread evenly over the mesh.
const MAX_SAMPLED_FACES: usize = 1 << 20;

/// Selects [`Codec::AxisAligned`] or [`Codec::Range`] by [`axis_aligned_share`].
#[must_use]
pub fn select_codec(mesh: &QuantisedMesh) -> Codec {
    if axis_aligned_share(mesh) >= MIN_AXIS_ALIGNED_SHARE { Codec::AxisAligned } else { Codec::Range }
}

/// Converts a mesh to the form that a codec encodes best. The surface, its attributes and errors are unchanged.
pub fn suit(mesh: &mut QuantisedMesh, codec: Codec) {
    if codec == Codec::AxisAligned {
        mesh.renumber_groups_by_orientation();
    }
}

/// Share of the coordinates that are equal at both ends of an edge, on the mesh's grid, beyond the expected share for
/// arbitrary edges: about 0 for arbitrary edges, 0.56 for a flat grid along the axes. Inner edges count twice.
///
/// For arbitrary edges, small coordinate differences are equally frequent, so 0 is half as frequent as 1 and −1
/// together; any excess is due to alignment. Cost: some nanoseconds per face.
#[must_use]
pub fn axis_aligned_share(mesh: &QuantisedMesh) -> f64 {
    let step = mesh.faces.len().div_ceil(MAX_SAMPLED_FACES).max(1);
    let (mut same, mut next, mut all) = (0_u64, 0_u64, 0_u64);
    for face in mesh.faces.iter().step_by(step) {
        let corners = face.wedges.map(|w| mesh.positions[mesh.wedges[w as usize].vertex as usize]);
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            for (from, to) in corners[a].into_iter().zip(corners[b]) {
                let apart = from.abs_diff(to);
                same += u64::from(apart == 0);
                next += u64::from(apart == 1);
                all += 1;
            }
        }
    }
    (same as f64 - 0.5 * next as f64) / all.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::common;
    use crate::mesh::{Corner, SourceMesh};
    use crate::quantise::{Precision, QuantiseSettings, quantise};

    /// The codec selected for a square of 40 × 40 cells, deformed by `bend`.
    fn selected(bits: u8, bend: fn(f64, f64) -> [f64; 3]) -> Codec {
        let mut mesh = SourceMesh::default();
        for (y, x) in (0..=40_u8).flat_map(|y| (0..=40_u8).map(move |x| (y, x))) {
            mesh.positions.push(bend(f64::from(x) / 40.0, f64::from(y) / 40.0));
        }
        for i in (0..40).flat_map(|y| (0..40).map(move |x| y * 41 + x)) {
            mesh.faces.extend([[i, i + 1, i + 42], [i, i + 42, i + 41]].map(|face| face.map(Corner::at)));
        }
        mesh.materials = vec![0; mesh.faces.len()];
        let settings = QuantiseSettings { precision: Precision::Bits(bits), ..QuantiseSettings::default() };
        select_codec(&quantise(&mesh, &settings).unwrap())
    }

    #[test]
    fn axis_alignment_selects_the_codec() {
        for bits in [8, 12, 16] {
            assert_eq!(selected(bits, |s, t| [s, t, 0.0]), Codec::AxisAligned, "a flat grid at {bits} bits");
            assert_eq!(
                selected(bits, |s, t| [s, t, 0.1 * (7.0 * s).sin() * (5.0 * t + s).cos()]),
                Codec::AxisAligned,
                "heights on a grid at {bits} bits"
            );
            assert_eq!(
                selected(bits, |s, t| [(6.0 * s).cos(), (6.0 * s).sin(), (20.0 * t).floor()]),
                Codec::AxisAligned,
                "steps of a round tower at {bits} bits"
            );
            // The same grid, rotated about all axes.
            let turned = |s: f64, t: f64| [0.8 * s - 0.36 * t, 0.6 * s + 0.48 * t, 0.13 * s + 0.8 * t];
            assert_eq!(selected(bits, turned), Codec::Range, "a turned grid at {bits} bits");
        }
        let stone = common::quantised(&common::shapes::sphere(30, 60, 0.05));
        assert_eq!(select_codec(&stone), Codec::Range);
    }
}
