//! Rolling ground, levelled where the temple and its avenue stand.

use super::maths::smoothstep;
use super::mesh::{Corner, ObjMesh};
use super::noise::fractal3;
use glam::{DVec2, DVec3};

/// Side of the square of ground, in metres.
pub(super) const SIDE: f64 = 320.0;
/// Metres to one repeat of the ground's texture.
const TILE: f64 = SIDE / 12.0;

/// How wild the ground is at a place: 0 on the levelled site, 1 away from it.
fn wildness(x: f64, z: f64) -> f64 {
    // Distance from the site, a rectangle around temple and avenue (see `layout`).
    let (dx, dz) = ((x.abs() - 11.0).max(0.0), ((z - 14.0).abs() - 34.0).max(0.0));
    smoothstep(0.0, 38.0, (dx * dx + dz * dz).sqrt())
}

/// Height of the ground in metres; 0 is the level of the site.
///
/// The hills sink back to that level at the border, so that even two triangles through its corners
/// stand for the ground without burying the site.
pub(super) fn height(seed: u64, x: f64, z: f64) -> f64 {
    let p = DVec3::new(x, 0.0, z);
    let border = 1.0 - smoothstep(0.70, 0.99, x.abs().max(z.abs()) / (SIDE * 0.5));
    let wild = wildness(x, z) * border;
    let far = smoothstep(50.0, 95.0, (x * x + z * z).sqrt());
    let hills = 13.0 * fractal3(seed ^ 31, p / 62.0, 5) + 9.0 * far;
    let mounds = 0.9 * fractal3(seed ^ 32, p / 9.0, 4);
    let bumps = 0.05 * fractal3(seed ^ 33, p / 1.3, 3);
    wild * (hills + mounds) + bumps * (0.45 + 0.55 * wild) - 0.04
}

/// The ground as `cells`² quads.
pub(super) fn mesh(seed: u64, cells: usize) -> ObjMesh {
    let mut mesh = ObjMesh::new();
    mesh.group("ground", "grass");
    let step = SIDE / cells as f64;
    let at = |i: usize| i as f64 * step - SIDE * 0.5;
    for j in 0..=cells {
        for i in 0..=cells {
            let (x, z) = (at(i), at(j));
            let e = step * 0.5;
            let slope = DVec2::new(
                height(seed, x + e, z) - height(seed, x - e, z),
                height(seed, x, z + e) - height(seed, x, z - e),
            );
            mesh.position(DVec3::new(x, height(seed, x, z), z));
            mesh.normal(DVec3::new(-slope.x, 2.0 * e, -slope.y));
            mesh.uv(i as f64 * step / TILE, (cells - j) as f64 * step / TILE);
        }
    }
    for j in 0..cells {
        for i in 0..cells {
            let a = (j * (cells + 1) + i) as u32;
            let (b, c, d) = (a + 1, a + cells as u32 + 1, a + cells as u32 + 2);
            let corner = |v: u32| Corner { position: v, uv: Some(v), normal: v };
            // Alternate diagonals, so that the grid has no grain.
            let split = if (i + j) % 2 == 0 { [[a, c, d], [a, d, b]] } else { [[a, c, b], [b, c, d]] };
            for face in split {
                mesh.face(face.map(corner));
            }
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn site_and_border_lie_at_the_same_level_and_hills_between() {
        let mut highest: f64 = 0.0;
        for i in -40..=40 {
            let t = f64::from(i) * 4.0;
            for (x, z) in [(t, -160.0), (t, 160.0), (-160.0, t), (160.0, t)] {
                assert!(height(1, x, z).abs() < 0.08, "border at {x}, {z}");
            }
            // What stands on the site must not be buried.
            for z in [-19.0, 0.0, 30.0, 47.0] {
                assert!((-0.08..0.0).contains(&height(1, t / 16.0, z)), "site at {}, {z}", t / 16.0);
            }
            highest = highest.max(height(1, t, -70.0));
        }
        assert!(highest > 5.0, "{highest}");
    }
}
