//! Geometric errors are monotone, and never below densely sampled distances.

use lodestream_geometry::ancestor_closed_cut::{self, Member};
use lodestream_geometry::distance::TriangleBvh;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, decode_stated_page, expected_rest_error};
use lodestream_geometry::mesh::QuantisedMesh;
use lodestream_geometry::prepare::Prepared;
use lodestream_geometry::random::Random;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_geometry::screen::visible_error;

use crate::common::{
    all, in_blocks, prepared, quantised, regions, shapes, with_bits, with_truncation_points,
};
use crate::invariants::{apply, deltas};

#[test]
fn errors_are_monotone_along_parents() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &regions(200));
        for (id, info) in asset.infos.iter().enumerate() {
            assert!(info.error <= asset.base.geometric_error, "{name}: chunk {id} and the root");
            for &p in &info.parents {
                assert!((p as usize) < id && asset.infos[p as usize].level <= info.level);
                assert!(asset.infos[p as usize].error >= info.error, "{name}: chunk {id}, parent {p}");
            }
        }
    }
}

/// The bound on later errors that an index page states or implies is never below theirs.
#[test]
fn pages_bound_the_errors_of_those_behind_them() {
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &regions(200));
        for (number, bytes) in asset.pages.iter().enumerate().take(asset.pages.len() - 1) {
            let end = (number + 1) * CHUNKS_PER_PAGE;
            let page = decode_stated_page(bytes, (end - CHUNKS_PER_PAGE) as u32).unwrap();
            let bound = page.rest_error.unwrap_or_else(|| expected_rest_error(&asset.infos[..end]));
            let errors = asset.infos[end..].iter().map(|info| visible_error(info, 1.0));
            let largest = errors.fold(0.0, f32::max);
            assert!(bound >= largest, "{name}: {bound} on page {number}, {largest} on later pages");
            assert!(page.rest_error.is_none_or(|stated| stated == largest));
        }
    }
}

/// Distances in grid cells below this are rounding errors of the sampling.
const NOISE: f64 = 1e-6;

/// A surface relative to the grid's origin, in grid cells.
struct Surface {
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    bvh: TriangleBvh,
}

impl Surface {
    fn new(mesh: &QuantisedMesh) -> Self {
        let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.map(f64::from)).collect();
        let triangles: Vec<[u32; 3]> =
            mesh.faces.iter().map(|f| f.wedges.map(|w| mesh.wedges[w as usize].vertex)).collect();
        let bvh = TriangleBvh::new(&positions, &triangles);
        Self { positions, triangles, bvh }
    }

    fn area(&self) -> f64 {
        self.triangles.iter().map(|&t| self.area_of(t)).sum()
    }

    fn area_of(&self, t: [u32; 3]) -> f64 {
        let [a, b, c] = t.map(|v| self.positions[v as usize]);
        let (e, f) = ([0, 1, 2].map(|k| b[k] - a[k]), [0, 1, 2].map(|k| c[k] - a[k]));
        let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
        0.5 * (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt()
    }

    /// Largest distance from lattice points of this surface to another: 15 points per face, more on faces larger than
    /// `area`, so that each `area` gets about 15.
    fn farthest(&self, other: &Surface, area: f64) -> f64 {
        let mut worst = 0.0_f64;
        for &t in &self.triangles {
            let [a, b, c] = t.map(|v| self.positions[v as usize]);
            let n = ((self.area_of(t) / area).sqrt().max(1.0) * 4.0).ceil().min(60.0) as usize;
            for i in 0..=n {
                for j in 0..=n - i {
                    let (u, v) = (i as f64 / n as f64, j as f64 / n as f64);
                    let p = [0, 1, 2].map(|k| u * a[k] + v * b[k] + (1.0 - u - v) * c[k]);
                    if !other.bvh.any_within(p, worst) {
                        worst = worst.max(other.bvh.nearest(p, f64::INFINITY).unwrap().0);
                    }
                }
            }
        }
        worst
    }
}

fn refined(asset: &Prepared, set: &[Member]) -> QuantisedMesh {
    let mut active = ActiveMesh::new(&asset.base);
    for &member in set {
        apply(&mut active, asset, member);
    }
    active.to_mesh()
}

/// Error that the index states for an ancestor-closed cut.
fn stated(asset: &Prepared, set: &[Member]) -> f32 {
    let left = |(id, info): (usize, &ChunkInfo)| {
        let member = set.binary_search_by_key(&(id as u32), |m| m.chunk);
        member.map_or(info.error, |at| info.extent(set[at].truncation).error)
    };
    asset.infos.iter().enumerate().map(left).fold(0.0, f32::max)
}

/// The generated meshes, and needles on a grid fine enough to represent them.
fn meshes() -> Vec<(&'static str, QuantisedMesh)> {
    let mut list: Vec<_> = all().into_iter().map(|(name, source)| (name, quantised(&source))).collect();
    list.push(("needles on a fine grid", with_bits(&shapes::needles(800), 24)));
    list
}

#[test]
fn errors_bound_the_sampled_distance_within_a_factor() {
    let mut random = Random::new(19);
    let mut failures = Vec::new();
    for (name, mesh) in meshes() {
        let input = Surface::new(&mesh);
        let area = input.area() / input.triangles.len() as f64;
        let mut ratios = Vec::new();
        for settings in [
            with_truncation_points(200),
            with_truncation_points(300),
            regions(1000),
            in_blocks(500, with_truncation_points(100)),
        ] {
            let asset = prepared(&mesh, &settings);
            for attempt in 0..5 {
                let set = if attempt == 0 {
                    Vec::new()
                } else {
                    ancestor_closed_cut::random(&asset.infos, &mut random)
                };
                let mut error = stated(&asset, &set);
                if attempt == 0 {
                    error = error.max(asset.base.geometric_error);
                }
                let coarse = Surface::new(&refined(&asset, &set));
                let cells = input.farthest(&coarse, area).max(coarse.farthest(&input, area));
                let distance = cells * mesh.grid.step;
                if cells > NOISE {
                    ratios.push(f64::from(error) / distance);
                } else {
                    // No visible change: at most coplanar neighbours merged. Errors of parts that deform before they are
                    // flat again may be too large, by up to a few percent of a part.
                    let most = if mesh.parts.is_empty() { mesh.grid.step } else { 0.03 };
                    assert!(f64::from(error) <= most, "{name}: {error} for nothing");
                }
            }
        }
        ratios.sort_by(f64::total_cmp);
        if let (Some(&least), Some(&most)) = (ratios.first(), ratios.last()) {
            let median = ratios[ratios.len() / 2];
            println!("{name}: reported / sampled: {least:.3} {median:.3} {most:.3}");
            // Where components overlap, missing parts of one are near another, which a region cannot know.
            let overlapping = name == "medley";
            if least < 0.99 || (median > 1.6 && !overlapping) {
                failures.push(format!("{name}: {least:.3} {median:.3}"));
            }
        }
    }
    assert!(failures.is_empty(), "{failures:?}");
}

/// Cuts of all coarser chunks and all chunks of one level at the same truncation point: then the stated error is that
/// of the truncation points, whereas in a random cut it is usually that of a missing chunk. Of each level's truncation
/// points, every second is sampled, from the first.
#[test]
fn errors_at_truncation_points_bound_the_sampled_distance() {
    let mut failures = Vec::new();
    let mut tried = 0;
    for (name, mesh) in meshes() {
        let input = Surface::new(&mesh);
        let area = input.area() / input.triangles.len() as f64;
        let settings = [with_truncation_points(200), in_blocks(500, with_truncation_points(100))];
        let assets = settings.map(|settings| prepared(&mesh, &settings));
        for (asset, level) in
            assets.iter().flat_map(|a| (1..=a.base.level_count).map(move |level| (a, level)))
        {
            let truncation_points =
                asset.infos.iter().filter(|i| i.level == level).map(|i| i.truncation_points.len()).max();
            for truncation in (0..truncation_points.unwrap_or(0)).step_by(3) {
                let member = |(chunk, info): (u32, &ChunkInfo)| {
                    let truncation = (info.level == level && truncation < info.truncation_points.len())
                        .then_some(truncation as u8);
                    (info.level <= level).then_some(Member { chunk, truncation })
                };
                let set: Vec<Member> = (0..).zip(&asset.infos).filter_map(member).collect();
                let error = f64::from(stated(asset, &set));
                let coarse = Surface::new(&refined(asset, &set));
                let cells = input.farthest(&coarse, area).max(coarse.farthest(&input, area));
                tried += 1;
                if cells > NOISE && error < 0.99 * cells * mesh.grid.step {
                    let ratio = error / (cells * mesh.grid.step);
                    failures.push(format!("{name}, level {level}, truncation {truncation}: {ratio:.3}"));
                }
            }
        }
    }
    assert!(tried >= 20, "only {tried} meshes");
    assert!(failures.is_empty(), "{failures:?}");
}

#[test]
fn truncation_points_help_and_are_never_better_than_the_children() {
    let (mut truncation_points, mut better) = (0, 0);
    for (name, source) in all() {
        let asset = prepared(&quantised(&source), &with_truncation_points(200));
        for (id, info) in asset.infos.iter().enumerate() {
            // Intermediate states can be farther off, so some points have a larger error than the chunk.
            truncation_points += info.truncation_points.len();
            better += info.truncation_points.iter().filter(|s| s.error < info.error).count();
            for &parent in &info.parents {
                let truncation_points = &asset.infos[parent as usize].truncation_points;
                assert!(
                    truncation_points.iter().all(|s| s.error >= info.error),
                    "{name}: chunk {id} of {parent}"
                );
            }
        }
    }
    assert!(
        truncation_points > 100 && better * 4 > truncation_points * 3,
        "{better} of {truncation_points} truncation points help"
    );
}

#[test]
fn spheres_hold_what_their_chunks_add() {
    for (name, source) in all() {
        let mesh = quantised(&source);
        let asset = prepared(&mesh, &regions(200));
        let deltas = deltas(&asset).1;
        for (delta, info) in deltas.iter().zip(&asset.infos) {
            for v in &delta.vertices {
                let p = v.position.map(|x| f64::from(x) * mesh.grid.step);
                let d: f64 = (0..3).map(|k| (p[k] - f64::from(info.sphere.center[k])).powi(2)).sum();
                let r = f64::from(info.sphere.radius);
                assert!(d.sqrt() <= r * (1.0 + 1e-5), "{name}: chunk {} {} > {r}", delta.chunk, d.sqrt());
            }
        }
    }
}
