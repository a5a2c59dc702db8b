//! Normals reconstructed from depth for occlusion: `occlusion_normal.wgsl`.

use crate::cpu_reference::surface::{DepthPicture, V3, dot, facing, sub};

const AGREEMENT: f64 = 0.01;

/// Choice of the neighbours: see [`crate::OcclusionNormals`].
#[derive(Clone, Copy, Debug, Default)]
pub enum Normals<'a> {
    /// The nearer in depth.
    #[default]
    Nearest,
    /// By the normals that are drawn, in view space, rows from the top; `None` where a surface is unlit.
    Drawn(&'a [Option<[f64; 3]>]),
    /// The neighbours that are collinear with the pixel.
    Extended,
}

impl Normals<'_> {
    /// The normal of the surface at a pixel which lies at `centre`, towards the eye.
    #[must_use]
    pub fn of(&self, picture: &DepthPicture<'_>, pixel: [i64; 2], centre: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Nearest => picture.normal_at(pixel, centre),
            Self::Drawn(normals) => {
                let [x, y] = pixel.map(|x| x as usize);
                let nearest = picture.normal_at(pixel, centre);
                let drawn = normals[y * picture.size_px[0] as usize + x];
                drawn.map_or(nearest, |drawn| agreeing(picture, pixel, centre, (nearest, drawn)))
            }
            Self::Extended => extended(picture, pixel, centre),
        }
    }
}

fn agreeing(picture: &DepthPicture<'_>, [x, y]: [i64; 2], centre: V3, (nearest, drawn): (V3, V3)) -> V3 {
    let mut best = (nearest, dot(nearest, drawn) + AGREEMENT);
    for side in [[-1, -1], [1, -1], [-1, 1], [1, 1]] {
        let beside = [[x + side[0], y], [x, y + side[1]]];
        if beside.iter().any(|p| !is_inside(picture, *p) || picture.depth_at(*p) >= 1e30) {
            continue;
        }
        let [dx, dy] = beside.map(|p| sub(picture.position_at(p), centre));
        let normal = facing(dx, dy, centre);
        if dot(normal, drawn) > best.1 {
            best = (normal, dot(normal, drawn));
        }
    }
    best.0
}

fn is_inside(picture: &DepthPicture<'_>, pixel: [i64; 2]) -> bool {
    (0..2).all(|i| (0..i64::from(picture.size_px[i])).contains(&pixel[i]))
}

fn extended(picture: &DepthPicture<'_>, pixel: [i64; 2], centre: V3) -> V3 {
    let beside = |axis: usize, steps: i64| {
        let mut place = pixel;
        place[axis] += steps;
        place
    };
    let [dx, dy] = [0, 1].map(|axis| {
        let stored = |steps| picture.stored_at(beside(axis, steps));
        let off_line = |side: i64| (2.0 * stored(side) - stored(2 * side) - stored(0)).abs();
        let last = i64::from(picture.size_px[axis]) - 1;
        let after = pixel[axis] == 0 || (off_line(1) < off_line(-1) && pixel[axis] < last);
        sub(picture.position_at(beside(axis, if after { 1 } else { -1 })), centre)
    });
    facing(dx, dy, centre)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu_reference::depth::view_ray;

    /// Two walls that meet at a right angle in an edge running away from the eye, z = -(4 - |x|), with their own
    /// normals in the G-buffer.
    #[test]
    fn beside_an_inner_edge_the_normal_is_its_own_walls() {
        let size = 64_u32;
        let rays: Vec<V3> = (0..size * size)
            .map(|i| view_ray([i64::from(i % size), i64::from(i / size)], [size; 2], [0.5; 2]))
            .collect();
        let stored: Vec<f32> = rays.iter().map(|r| (0.01 * (1.0 + r[0].abs()) / 4.0) as f32).collect();
        let wall = |r: &V3| [-r[0].signum() * 0.5_f64.sqrt(), 0.0, 0.5_f64.sqrt()];
        let drawn: Vec<Option<V3>> = rays.iter().map(|r| Some(wall(r))).collect();
        let picture =
            DepthPicture { stored: &stored, size_px: [size; 2], tan_half_fov: [0.5; 2], near: 0.01 };
        let least = |normals: Normals<'_>, columns: &[i64]| {
            let pixels = columns.iter().flat_map(|&x| (0..i64::from(size)).map(move |y| [x, y]));
            let cosine = |p: [i64; 2]| {
                let i = (p[1] * i64::from(size) + p[0]) as usize;
                dot(normals.of(&picture, p, picture.position_at(p)), wall(&rays[i]))
            };
            pixels.map(cosine).fold(1.0_f64, f64::min)
        };
        let middle = i64::from(size / 2);
        let beside = [middle - 1, middle];
        let all: Vec<i64> = (0..i64::from(size)).collect();
        // The two pixels beside the edge have equal depth, and the other wall's is nearer: the normal is off by 45°.
        assert!(least(Normals::Nearest, &beside) < 0.8, "{}", least(Normals::Nearest, &beside));
        for normals in [Normals::Drawn(&drawn), Normals::Extended] {
            assert!(least(normals, &all) > 0.9999, "{normals:?}: {}", least(normals, &all));
        }
        // `drawn` fails with normals that are smooth over the edge, and unlit surfaces have no normals.
        let smooth = vec![Some([0.0, 0.0, 1.0]); drawn.len()];
        assert!(least(Normals::Drawn(&smooth), &beside) < 0.8);
        let unlit = vec![None; drawn.len()];
        assert_eq!(least(Normals::Drawn(&unlit), &all), least(Normals::Nearest, &all));
    }
}
