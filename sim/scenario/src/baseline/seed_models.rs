//! Three small models for the older system's table of transfer times, with the same numbers of triangles as its models,
//! which are not available.
//!
//! They are curved, closed, textured surfaces, computed with + − × ÷ and a polynomial for the sine only, so that they
//! are identical on every machine.

use lodestream_geometry::mesh::{Corner, SourceMesh};

/// A model with its name.
#[derive(Clone, Debug)]
pub struct SeedModel {
    /// Its name.
    pub name: &'static str,
    /// The mesh, with texture coordinates.
    pub mesh: SourceMesh,
}

/// The models, of 902, 298 and 950 triangles.
#[must_use]
pub fn seed_models() -> Vec<SeedModel> {
    let mut stone = Builder::default();
    stone.ball(41, 12, [1.0, 0.7, 1.2]);
    let mut padlock = Builder::default();
    padlock.cuboid([-0.8, -1.4, -0.35], [0.8, -0.1, 0.35]);
    padlock.ring(13, 11, 0.6, 0.14);
    let mut vase = Builder::default();
    vase.ball(25, 20, [0.8, 1.6, 0.8]);
    let models = [("stone", stone), ("padlock", padlock), ("vase", vase)];
    models.into_iter().map(|(name, builder)| SeedModel { name, mesh: builder.mesh }).collect()
}

/// Sine and cosine of an angle in turns, by Taylor's series within an eighth of a turn; error below 1e-12.
fn sine_cosine(turns: f64) -> (f64, f64) {
    let quarters = (turns * 4.0).round();
    let x = (turns - quarters / 4.0) * std::f64::consts::TAU;
    let square = x * x;
    // Horner's scheme: coefficients 1/n!, alternating.
    let series = |first: u32| {
        (0..7).rev().fold(0.0, |sum: f64, k| {
            let n = f64::from(first + 2 * k + 2);
            1.0 - square / (n * (n - 1.0)) * if k == 6 { 1.0 } else { sum }
        })
    };
    let (sine, cosine) = (x * series(1), series(0));
    match quarters.rem_euclid(4.0) {
        q if q < 0.5 => (sine, cosine),
        q if q < 1.5 => (cosine, -sine),
        q if q < 2.5 => (-sine, -cosine),
        _ => (-cosine, sine),
    }
}

#[derive(Default)]
struct Builder {
    mesh: SourceMesh,
}

impl Builder {
    fn corner(&mut self, position: [f64; 3], uv: [f64; 2]) -> Corner {
        // A few hundred of each.
        let corner =
            Corner { uv: self.mesh.uvs.len() as u32, ..Corner::at(self.mesh.positions.len() as u32) };
        self.mesh.positions.push(position);
        self.mesh.uvs.push(uv.map(|x| x as f32));
        corner
    }

    fn triangle(&mut self, corners: [Corner; 3]) {
        self.mesh.faces.push(corners);
        self.mesh.materials.push(0);
    }

    /// A lattice of `columns` by `rows` quadrilaterals over 0..=1 in both directions, counter-clockwise if the first
    /// direction of `at` points right and its second up. Degenerate triangles are omitted, so a row may end in a point.
    fn lattice(&mut self, columns: u32, rows: u32, at: impl Fn(f64, f64) -> [f64; 3]) {
        let mut corners = Vec::new();
        for row in 0..=rows {
            for column in 0..=columns {
                let (u, v) = (f64::from(column) / f64::from(columns), f64::from(row) / f64::from(rows));
                corners.push(self.corner(at(u, v), [u, v]));
            }
        }
        let corner = |column: u32, row: u32| corners[(row * (columns + 1) + column) as usize];
        for row in 0..rows {
            for column in 0..columns {
                let [a, b] = [corner(column, row), corner(column + 1, row)];
                let [c, d] = [corner(column + 1, row + 1), corner(column, row + 1)];
                for triangle in [[a, b, c], [a, c, d]] {
                    let [p, q, r] = triangle.map(|c| self.mesh.positions[c.position as usize]);
                    if p != q && q != r && r != p {
                        self.triangle(triangle);
                    }
                }
            }
        }
    }

    /// An ellipsoid with bumps: 2 × `segments` × (`rings` − 1) triangles.
    fn ball(&mut self, segments: u32, rings: u32, radii: [f64; 3]) {
        self.lattice(segments, rings, |u, v| {
            let (sine, cosine) = sine_cosine(if u == 1.0 { 0.0 } else { u });
            let pole = v == 0.0 || v == 1.0;
            let (height, around) = if pole { (2.0 * v - 1.0, 0.0) } else { latitude(v) };
            let bumps = 1.0 + 0.12 * sine * around * sine_cosine(1.5 * v).0;
            let point = [around * sine, height, around * cosine];
            [0, 1, 2].map(|k| point[k] * radii[k] * bumps)
        });
    }

    /// A ring in the x-y plane: 2 × `columns` × `rows` triangles.
    fn ring(&mut self, columns: u32, rows: u32, radius: f64, thickness: f64) {
        self.lattice(columns, rows, |u, v| {
            let (sine, cosine) = sine_cosine(if u == 1.0 { 0.0 } else { u });
            let (up, out) = sine_cosine(if v == 1.0 { 0.0 } else { v });
            let distance = radius + thickness * out;
            [distance * cosine, distance * sine, thickness * up]
        });
    }

    /// A box of twelve triangles.
    fn cuboid(&mut self, least: [f64; 3], most: [f64; 3]) {
        for axis in 0..3 {
            for (side, far) in [(least, false), (most, true)] {
                let (right, up) = ((axis + 1) % 3, (axis + 2) % 3);
                let corner = |u: f64, v: f64| {
                    let mut point = side;
                    point[right] = if u > 0.5 { most[right] } else { least[right] };
                    point[up] = if v > 0.5 { most[up] } else { least[up] };
                    point
                };
                // Seen from outside, the first direction of the near side points left.
                self.lattice(1, 1, |u, v| corner(if far { u } else { 1.0 - u }, v));
            }
        }
    }
}

/// Height and distance from the axis on the unit sphere, from pole to pole.
fn latitude(v: f64) -> (f64, f64) {
    let (sine, cosine) = sine_cosine(v / 2.0);
    (-cosine, sine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_geometry::quantise::{QuantiseSettings, quantise};

    #[test]
    fn sine_and_cosine_are_accurate() {
        for i in -100..=300 {
            let turns = f64::from(i) / 97.0;
            let (sine, cosine) = sine_cosine(turns);
            let (s, c) = (turns * std::f64::consts::TAU).sin_cos();
            assert!((sine - s).abs() < 1e-12 && (cosine - c).abs() < 1e-12, "{turns}: {sine} {cosine}");
        }
    }

    #[test]
    fn models_have_their_number_of_triangles_and_are_closed() {
        let counts: Vec<usize> = seed_models().iter().map(|model| model.mesh.faces.len()).collect();
        assert_eq!(counts, [902, 298, 950]);
        for SeedModel { name, mesh } in seed_models() {
            let mesh = quantise(&mesh, &QuantiseSettings::default()).unwrap();
            // No triangle was dropped, every edge has two faces, and all faces point outwards.
            let mut edges = std::collections::BTreeMap::new();
            let mut volume = 0.0;
            for face in &mesh.faces {
                let corners = face.wedges.map(|w| mesh.wedges[w as usize].vertex);
                for k in 0..3 {
                    *edges.entry((corners[k], corners[(k + 1) % 3])).or_insert(0) += 1;
                }
                let [p, q, r] =
                    corners.map(|v| glam::DVec3::from(mesh.grid.position(mesh.positions[v as usize])));
                volume += p.dot(q.cross(r)) / 6.0;
            }
            assert!(counts.contains(&mesh.faces.len()), "{name}: {}", mesh.faces.len());
            assert!(edges.iter().all(|(&(a, b), &n)| n == 1 && edges.contains_key(&(b, a))), "{name}");
            assert!(volume > 0.0, "{name}");
        }
    }
}
