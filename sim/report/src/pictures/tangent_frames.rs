//! Errors of meshes' tangent frames against those of the surfaces that they approximate.
//!
//! A sphere between 60° of latitude and a torus, as meshes of 48 × 24 squares, with a texture mirrored half way round:
//! its direction changes at two seams, and the torus has one more where the texture repeats. At seven places of each
//! face, each method's frame, and a normal tilted by 45° between u and v, are compared with the surface's. Everything
//! is computed in f64, so figures are reproducible.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};
use std::fmt;

use glam::{DVec2, DVec3};
use lodestream_render::cpu_reference::tangents::{Corner, Mesh, TangentMethod};
use serde::Serialize;

/// Squares around the axis and along the other coordinate.
const SQUARES: [u32; 2] = [48, 24];
/// Radii of the torus.
const RADII: [f64; 2] = [1.0, 0.4];
/// Half of the sphere's range of latitudes.
const LATITUDE: f64 = PI / 3.0;
/// Barycentric weights of the places that are compared.
const PLACES: [[f64; 3]; 7] = [
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
    [0.8, 0.1, 0.1],
    [0.1, 0.8, 0.1],
    [0.1, 0.1, 0.8],
    [0.45, 0.45, 0.1],
    [0.45, 0.1, 0.45],
    [0.1, 0.45, 0.45],
];

/// A surface with exact directions of u and v.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Sphere,
    Torus,
}

/// A point of a surface: position, normal, and unit vectors around the axis and along the other coordinate.
struct Place {
    position: DVec3,
    normal: DVec3,
    round: DVec3,
    along: DVec3,
}

impl Shape {
    const ALL: [Self; 2] = [Self::Sphere, Self::Torus];

    fn name(self) -> &'static str {
        match self {
            Self::Sphere => "sphere",
            Self::Torus => "torus",
        }
    }

    /// The place at normalised coordinates.
    fn at(self, [s, t]: [f64; 2]) -> Place {
        let (sin, cos) = (TAU * s).sin_cos();
        let outwards = DVec3::new(cos, sin, 0.0);
        let round = DVec3::new(-sin, cos, 0.0);
        let angle = match self {
            Self::Sphere => LATITUDE * (2.0 * t - 1.0),
            Self::Torus => TAU * t,
        };
        let (up, out) = angle.sin_cos();
        let normal = outwards * out + DVec3::Z * up;
        let position = match self {
            Self::Sphere => normal,
            Self::Torus => outwards * RADII[0] + normal * RADII[1],
        };
        Place { position, normal, round, along: DVec3::Z * out - outwards * up }
    }

    fn corner(self, [s, t]: [f64; 2]) -> Corner {
        let Place { position, normal, .. } = self.at([s, t]);
        Corner { position, normal, uv: DVec2::new(folded(s), t) }
    }
}

/// Texture coordinate around the axis: mirrored, up to 1 half way round, and back.
fn folded(s: f64) -> f64 {
    1.0 - (1.0 - 2.0 * s).abs()
}

/// One method on one surface; angles in degrees.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameError {
    /// The surface.
    pub shape: &'static str,
    /// How frames are computed.
    pub way: &'static str,
    /// Error of u: root mean square.
    pub u_rms: f64,
    /// Error of u: maximum.
    pub u_most: f64,
    /// Error of a normal tilted by 45°: root mean square.
    pub normal_rms: f64,
    /// Error of a tilted normal: maximum.
    pub normal_most: f64,
    /// Maximum away from seams, over faces without a corner on one.
    pub normal_most_inside: f64,
}

/// All methods on all surfaces.
#[must_use]
pub fn compare() -> Vec<FrameError> {
    Shape::ALL.into_iter().flat_map(of_shape).collect()
}

fn of_shape(shape: Shape) -> Vec<FrameError> {
    let [round, along] = SQUARES;
    let share = |i: u32, j: u32| [f64::from(i) / f64::from(round), f64::from(j) / f64::from(along)];
    let squares = (0..round * along).map(|k| (k % round, k / round));
    let shares: Vec<[[f64; 2]; 3]> = squares
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [share(i, j), share(i + 1, j), share(i + 1, j + 1), share(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    // The full turn ends where it began.
    let corner = |[s, t]: [f64; 2]| shape.corner([s % 1.0, t]);
    let mesh = Mesh::new(shares.iter().map(|face| face.map(corner)).collect());
    let seam = |[s, t]: [f64; 2]| [0.0, 0.5, 1.0].contains(&s) || [0.0, 1.0].contains(&t);
    let error = |way: TangentMethod| {
        let (mut squares, mut most, mut inside, mut count) = ([0.0; 2], [0.0_f64; 2], 0.0_f64, 0);
        for (number, face) in shares.iter().enumerate() {
            for weights in PLACES {
                let Some((frame, normal)) = mesh.frame(number, weights, way) else { continue };
                let at = [0, 1].map(|k| (0..3).map(|i| face[i][k] * weights[i]).sum::<f64>());
                let exact = shape.at(at);
                let sense = if at[0] > 0.5 { -1.0 } else { 1.0 };
                let tilted = |u: DVec3, v: DVec3, normal: DVec3| {
                    (normal + (u + v) * FRAC_1_SQRT_2).normalize_or_zero()
                };
                let of_u = exact.round * sense;
                let angles = [
                    frame.u.angle_between(of_u).to_degrees(),
                    tilted(frame.u, frame.v, normal)
                        .angle_between(tilted(of_u, exact.along, exact.normal))
                        .to_degrees(),
                ];
                for k in 0..2 {
                    squares[k] += angles[k] * angles[k];
                    most[k] = most[k].max(angles[k]);
                }
                if !face.iter().any(|corner| seam(*corner)) {
                    inside = inside.max(angles[1]);
                }
                count += 1;
            }
        }
        let rms = squares.map(|sum| (sum / f64::from(count.max(1))).sqrt());
        let rounded = |degrees: f64| (degrees * 1e4).round() / 1e4;
        FrameError {
            shape: shape.name(),
            way: way.name(),
            u_rms: rounded(rms[0]),
            u_most: rounded(most[0]),
            normal_rms: rounded(rms[1]),
            normal_most: rounded(most[1]),
            normal_most_inside: rounded(inside),
        }
    };
    TangentMethod::ALL.map(error).into()
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:7} {:29} u {:.2}° (at most {:.1}°), tilted normal {:.2}° (at most {:.1}°, away from seams {:.1}°)",
            self.shape,
            self.way,
            self.u_rms,
            self.u_most,
            self.normal_rms,
            self.normal_most,
            self.normal_most_inside
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertex_averages_over_a_mirrored_seam_are_worst() {
        let all = compare();
        assert_eq!((all.len(), &compare()), (2 * TangentMethod::ALL.len(), &all), "figures repeat");
        for of_shape in all.chunks(TangentMethod::ALL.len()) {
            let [face, averaged, orthogonal, split, derivatives] = of_shape else { panic!("five ways") };
            assert!(
                averaged.normal_most > 30.0 && orthogonal.normal_most > 30.0,
                "{averaged:?} {orthogonal:?}"
            );
            assert!(split.normal_most < 10.0 && derivatives.normal_most < 10.0, "{split:?} {derivatives:?}");
            assert!(derivatives.normal_rms < face.normal_rms, "{derivatives:?} {face:?}");
        }
    }
}
