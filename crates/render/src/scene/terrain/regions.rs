//! Uniforms of a frame's rough regions.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3};

use lodestream_terrain::tiles::{MAX_REGIONS, TileRegion};

/// Number of spacings with distances: more than any terrain has.
const SPACINGS: usize = 32;

/// `Regions` of `terrain.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct RegionsUniform {
    /// Ends of segments in the plane, relative to the eye.
    lines: [[f32; 4]; MAX_REGIONS],
    /// Radii, four to a vector.
    radii: [[f32; 4]; MAX_REGIONS / 4],
    /// Morph distances, two spacings to a vector.
    morph: [[[f32; 4]; SPACINGS / 2]; MAX_REGIONS],
}

impl RegionsUniform {
    /// At most [`MAX_REGIONS`] regions, seen from `eye`.
    pub(super) fn new(regions: &[TileRegion], eye: DVec3) -> Self {
        let mut out = Self::zeroed();
        let eye = DVec2::new(eye.x, eye.z);
        for (r, region) in regions.iter().enumerate() {
            let [from, to] = [region.from - eye, region.to - eye].map(|p| p.as_vec2());
            out.lines[r] = [from.x, from.y, to.x, to.y];
            out.radii[r / 4][r % 4] = region.radius as f32;
            for (s, morph) in region.morph.iter().take(SPACINGS).enumerate() {
                let [begin, end] = shader_morph(*morph);
                out.morph[r][s / 2][2 * (s % 2)] = begin;
                out.morph[r][s / 2][2 * (s % 2) + 1] = end;
            }
        }
        out
    }
}

/// Morph distances for the shader. The morph ends slightly early, so that rounding leaves no point in motion where a
/// coarser tile begins.
pub(crate) fn shader_morph([begin, end]: [f64; 2]) -> [f32; 2] {
    const EARLY: f64 = 0.995;
    if end.is_finite() { [begin as f32, (begin + (end - begin) * EARLY) as f32] } else { [1e37, 2e37] }
}

#[cfg(test)]
mod tests {
    use lodestream_geometry::random::Random;

    use super::*;
    use crate::cpu_reference::terrain::morph_at;
    use crate::tests::{headless, terrain::compute};

    #[test]
    fn morph_distances_match_the_cpu_reference() {
        let Some(h) = headless(16, 16) else { return };
        let mut random = Random::new(9);
        let eye = DVec3::new(120.0, 8.0, -77.0);
        let regions: Vec<TileRegion> = (0..MAX_REGIONS)
            .map(|i| {
                let mut place = || DVec2::new(random.unit(), random.unit()) * 3000.0 - 1500.0;
                let (from, to) = (place(), if i == 3 { DVec2::splat(40.0) } else { place() });
                let first = 40.0 + 900.0 * random.unit();
                let morph = |s: i32| [first * 2_f64.powi(s), first * 2_f64.powi(s) * 1.2];
                TileRegion { from, to, radius: 60.0 * random.unit(), morph: (0..8).map(morph).collect() }
            })
            .collect();
        let places: Vec<[f32; 2]> =
            (0..2000).map(|_| [0, 1].map(|_| (random.unit() * 4000.0 - 2000.0) as f32)).collect();
        let uniform = RegionsUniform::new(&regions, eye);
        // `unit` is the fifth number of the terrain's block.
        let mut terrain = [0.0_f32; 20];
        terrain[4] = 2.0;
        let blocks: [(u32, &[u8]); 2] =
            [(0, bytemuck::cast_slice(&terrain)), (4, bytemuck::bytes_of(&uniform))];
        for (spacing, mask) in [(0_u8, u32::MAX), (3, 0x8000_0401), (5, 0b1000), (6, 0)] {
            let call = format!(
                "vec4(morph_at(TileIn(0u, vec2(0), vec2(0), vec2(300.0, 350.0), vec2({spacing}u, {mask}u)), given), 0.0, 0.0)"
            );
            let taken: Vec<TileRegion> = (0..MAX_REGIONS)
                .filter(|r| mask & (1 << r) != 0)
                .map(|r| {
                    let eye = DVec2::new(eye.x, eye.z);
                    let morph = regions[r]
                        .morph
                        .iter()
                        .map(|m| crate::scene::terrain::regions::shader_morph(*m).map(f64::from));
                    TileRegion {
                        from: regions[r].from - eye,
                        to: regions[r].to - eye,
                        radius: regions[r].radius,
                        morph: morph.collect(),
                    }
                })
                .collect();
            let mut changed = 0;
            for (place, found) in places.iter().zip(compute(h.gpu(), &call, &blocks, &places)) {
                let at = DVec2::from(place.map(f64::from));
                let expected = morph_at(&taken, spacing, 2.0, at, [300.0, 350.0]);
                for (found, expected) in found.iter().zip(expected) {
                    // The slope of 64 amplifies f32 rounding of kilometres.
                    assert!((f64::from(*found) - expected).abs() < 0.1, "{place:?}: {found}, {expected}");
                }
                changed += usize::from(expected[0] > 300.0);
            }
            assert_eq!(changed > 20, mask != 0, "{changed} places changed with mask {mask:b}");
        }
    }
}
