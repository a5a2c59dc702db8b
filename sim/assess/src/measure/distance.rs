//! Sampled distance in both directions, on all cores; independent of the number of threads.

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};

use lodestream_geometry::distance::TriangleBvh;

use super::sample::BLOCK;
use super::{Surface, SurfaceSampler};

/// Settings of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Points on each surface. The standard error of an RMS falls as 1/√samples; 200,000 repeat to
    /// well under 1 %.
    pub samples: NonZeroUsize,
    /// Seed of the points.
    pub seed: u64,
    /// Number of threads; affects only the time.
    pub threads: NonZeroUsize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: NonZeroUsize::new(200_000).unwrap_or(NonZeroUsize::MIN),
            seed: 1,
            threads: std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN),
        }
    }
}

/// Why two surfaces cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MeasureError {
    /// A surface without area has no points to draw.
    #[error("the {which} mesh has no face with an area")]
    NoArea {
        /// "first" or "second".
        which: &'static str,
    },
}

/// Distances from the points of one surface to another surface, as fractions of the diagonal.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Distances {
    /// Root mean square.
    pub rms: f64,
    /// Largest.
    pub max: f64,
}

/// What [`compare`] found; all distances are fractions of `diagonal`.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// Diagonal of the bounding box of the first mesh, the reference, in the files' units.
    pub diagonal: f64,
    /// Points on each surface.
    pub samples: usize,
    /// From points of the first mesh to the second.
    pub a_to_b: Distances,
    /// From points of the second mesh to the first.
    pub b_to_a: Distances,
    /// The larger RMS of both directions.
    pub rms: f64,
    /// The larger maximum of both directions.
    pub max: f64,
}

/// Measures the distance between two surfaces in both directions; `a` is the reference.
///
/// # Errors
/// Refuses surfaces without area.
pub fn compare(a: &Surface, b: &Surface, settings: &Settings) -> Result<Comparison, MeasureError> {
    let sampler_a = SurfaceSampler::new(a).ok_or(MeasureError::NoArea { which: "first" })?;
    let sampler_b = SurfaceSampler::new(b).ok_or(MeasureError::NoArea { which: "second" })?;
    let (bvh_a, bvh_b) = (bvh(a), bvh(b));
    let diagonal = a.diagonal();
    // Different seeds, so that a mesh and its copy are not sampled at the same points.
    let a_to_b = one_way(&sampler_a, &bvh_b, diagonal, settings, settings.seed.wrapping_mul(2));
    let b_to_a = one_way(&sampler_b, &bvh_a, diagonal, settings, settings.seed.wrapping_mul(2) | 1);
    Ok(Comparison {
        diagonal,
        samples: settings.samples.get(),
        a_to_b,
        b_to_a,
        rms: a_to_b.rms.max(b_to_a.rms),
        max: a_to_b.max.max(b_to_a.max),
    })
}

fn bvh(surface: &Surface) -> TriangleBvh {
    TriangleBvh::new(&surface.positions, &surface.triangles)
}

/// Samples one surface and measures to the other. Blocks of samples are handed to threads as they
/// come, and their sums are added in the order of the blocks.
fn one_way(
    from: &SurfaceSampler<'_>,
    to: &TriangleBvh,
    diagonal: f64,
    settings: &Settings,
    seed: u64,
) -> Distances {
    let samples = settings.samples.get();
    let blocks = samples.div_ceil(BLOCK);
    let next = AtomicUsize::new(0);
    let work = || {
        let mut done = Vec::new();
        loop {
            let block = next.fetch_add(1, Ordering::Relaxed);
            if block >= blocks {
                return done;
            }
            done.push((block, block_distances(from, to, seed, block, samples)));
        }
    };
    let mut sums = vec![(0.0, 0.0); blocks];
    std::thread::scope(|scope| {
        let threads = settings.threads.get().min(blocks);
        let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
        let mut done = work();
        for other in others {
            match other.join() {
                Ok(results) => done.extend(results),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        for (block, result) in done {
            sums[block] = result;
        }
    });
    let (sum, max) = sums.iter().fold((0.0, 0.0f64), |(sum, max), s| (sum + s.0, max.max(s.1)));
    Distances { rms: (sum / samples as f64).sqrt() / diagonal, max: max / diagonal }
}

/// Sum of the squared distances and largest distance of one block of samples.
fn block_distances(
    from: &SurfaceSampler<'_>,
    to: &TriangleBvh,
    seed: u64,
    block: usize,
    samples: usize,
) -> (f64, f64) {
    let mut sum = 0.0;
    let mut max = 0.0f64;
    let mut previous: Option<(glam::DVec3, f64)> = None;
    for point in from.block(seed, block, samples) {
        // Neighbouring samples lie close together, so the triangle inequality bounds the search;
        // the slack covers rounding.
        let bound = previous.map_or(f64::INFINITY, |(p, d)| (d + p.distance(point)) * (1.0 + 1e-9));
        let query = point.to_array();
        let nearest = to.nearest(query, bound).or_else(|| to.nearest(query, f64::INFINITY));
        let distance = nearest.map_or(f64::INFINITY, |n| n.0);
        previous = Some((point, distance));
        sum += distance * distance;
        max = max.max(distance);
    }
    (sum, max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::collections::BTreeMap;

    fn settings(samples: usize, threads: usize) -> Settings {
        Settings {
            samples: NonZeroUsize::new(samples).unwrap(),
            seed: 7,
            threads: NonZeroUsize::new(threads).unwrap(),
        }
    }

    /// A square grid of `n × n` cells over `[0, 1]²` at height `z`.
    fn plane(n: u32, z: f64) -> Surface {
        let mut surface = Surface::default();
        for y in 0..=n {
            for x in 0..=n {
                surface.positions.push([f64::from(x) / f64::from(n), f64::from(y) / f64::from(n), z]);
            }
        }
        for y in 0..n {
            for x in 0..n {
                let i = y * (n + 1) + x;
                surface.triangles.push([i, i + 1, i + n + 2]);
                surface.triangles.push([i, i + n + 2, i + n + 1]);
            }
        }
        surface
    }

    /// An icosahedron whose faces are cut in four `times` times, all vertices on the unit sphere.
    fn icosphere(times: u32) -> Surface {
        let g = 0.5 * (1.0 + 5f64.sqrt());
        let mut positions: Vec<DVec3> = Vec::new();
        for (a, b) in [(1.0, g), (-1.0, g), (1.0, -g), (-1.0, -g)] {
            positions.push(DVec3::new(0.0, a, b).normalize());
            positions.push(DVec3::new(a, b, 0.0).normalize());
            positions.push(DVec3::new(b, 0.0, a).normalize());
        }
        // Faces are the triples at mutual edge length.
        let edge = 2.0 / (1.0 + g * g).sqrt();
        let near =
            |i: u32, j: u32| (positions[i as usize].distance(positions[j as usize]) - edge).abs() < 1e-9;
        let mut triangles = Vec::new();
        for i in 0..12u32 {
            for j in i + 1..12 {
                for k in j + 1..12 {
                    if near(i, j) && near(j, k) && near(i, k) {
                        triangles.push([i, j, k]);
                    }
                }
            }
        }
        assert_eq!(triangles.len(), 20);
        for _ in 0..times {
            let mut middles = BTreeMap::new();
            let mut middle = |i: u32, j: u32| {
                *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    positions.push((positions[i as usize] + positions[j as usize]).normalize());
                    positions.len() as u32 - 1
                })
            };
            let mut cut = Vec::with_capacity(4 * triangles.len());
            for [a, b, c] in triangles {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                cut.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
            triangles = cut;
        }
        Surface { positions: positions.iter().map(DVec3::to_array).collect(), triangles }
    }

    #[test]
    fn identical_meshes_are_at_distance_zero() {
        let sphere = icosphere(3);
        let found = compare(&sphere, &sphere, &settings(20_000, 2)).unwrap();
        assert!(found.max < 1e-15, "{found:?}");
        assert!(found.rms <= found.max);
    }

    #[test]
    fn offset_planes_are_at_their_offset() {
        let (a, b) = (plane(8, 0.0), plane(5, 0.25));
        let found = compare(&a, &b, &settings(10_000, 2)).unwrap();
        let expected = 0.25 / 2f64.sqrt();
        for distance in [found.a_to_b.rms, found.a_to_b.max, found.b_to_a.rms, found.b_to_a.max] {
            assert!((distance - expected).abs() < 1e-12, "{found:?}");
        }
        assert!((found.diagonal - 2f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn a_part_is_near_the_whole_but_the_whole_is_not_near_the_part() {
        // The part is the quarter [0, 1/2]² of the unit square. From the whole, the distance is
        // max(0, x - 1/2) and max(0, y - 1/2) combined, whose mean square is 2 × 1/24.
        let whole = plane(8, 0.0);
        let mut part = plane(4, 0.0);
        for position in &mut part.positions {
            *position = position.map(|x| 0.5 * x);
        }
        let found = compare(&whole, &part, &settings(100_000, 2)).unwrap();
        let expected = (2.0f64 / 24.0).sqrt() / 2f64.sqrt();
        assert!((found.a_to_b.rms / expected - 1.0).abs() < 0.005, "{found:?}");
        assert!(found.b_to_a.max < 1e-15);
        assert_eq!(found.rms, found.a_to_b.rms);
        assert!(found.max <= 0.5 + 1e-12 && found.max > 0.49);
    }

    #[test]
    fn concentric_spheres_differ_by_their_radii() {
        // Fine spheres of radius 1 and 1.1: the distance is 0.1 up to the sagitta of a face, which
        // is about (edge length)² / 6 for the inside of a triangle.
        let a = icosphere(5);
        let mut b = icosphere(5);
        for position in &mut b.positions {
            *position = position.map(|x| 1.1 * x);
        }
        let found = compare(&a, &b, &settings(20_000, 2)).unwrap();
        let sagitta = 0.04f64.powi(2);
        assert!((found.rms * found.diagonal - 0.1).abs() < sagitta, "{found:?}");
        assert!((found.max * found.diagonal - 0.1).abs() < sagitta, "{found:?}");
        assert!((found.diagonal - 2.0 * 3f64.sqrt()).abs() < 0.01);
    }

    #[test]
    fn a_coarse_sphere_is_as_far_as_its_faces_are_deep() {
        // The icosahedron's faces are tangent to the sphere of radius 0.7947 (its inradius at
        // circumradius 1), so the furthest point of the sphere is 1 - 0.7947 away.
        let inradius = (5.0 + 2.0 * 5f64.sqrt()).sqrt() / 15f64.sqrt();
        let found = compare(&icosphere(6), &icosphere(0), &settings(50_000, 2)).unwrap();
        let expected = (1.0 - inradius) / found.diagonal;
        assert!((found.a_to_b.max - expected).abs() < 2e-4, "{found:?} {expected}");
        assert!((found.b_to_a.max - expected).abs() < 2e-4, "{found:?} {expected}");
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let (a, b) = (icosphere(3), icosphere(1));
        let one = compare(&a, &b, &settings(30_001, 1)).unwrap();
        for threads in [2, 3, 16] {
            assert_eq!(compare(&a, &b, &settings(30_001, threads)).unwrap(), one);
        }
        let other = Settings { seed: 8, ..settings(30_001, 1) };
        assert_ne!(compare(&a, &b, &other).unwrap(), one);
    }

    #[test]
    fn meshes_without_area_are_refused() {
        let flat = plane(1, 0.0);
        let none = Surface::default();
        let tiny = settings(1, 1);
        assert_eq!(compare(&flat, &none, &tiny), Err(MeasureError::NoArea { which: "second" }));
        assert_eq!(compare(&none, &flat, &tiny), Err(MeasureError::NoArea { which: "first" }));
    }
}
