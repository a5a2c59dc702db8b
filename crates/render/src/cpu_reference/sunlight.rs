//! Lookups in shadow maps: `sunlight.wgsl`.

use glam::{DMat4, DQuat, DVec2, DVec3};

use super::surface::DepthPicture;

/// As in the shader: share of a map's side at its border over which the next one takes over.
const BLEND: f64 = 0.05;
/// As in the shader: what rounding of depths may come to, in texels.
const ROUNDING: f64 = 0.1;

/// A map of shadows.
#[derive(Clone, Debug)]
pub struct Map<'a> {
    /// Depths along the light, 1 nearest to the sun, rows from the top; as many rows as columns.
    pub stored: &'a [f32],
    /// Matrix from positions relative to the eye to the map: 0 to 1 across, rows from the top, and depth.
    pub map_from_world: DMat4,
    /// World units of a texel.
    pub texel: f64,
}

impl Map<'_> {
    fn side(&self) -> usize {
        self.stored.len().isqrt()
    }

    /// Share of the four texels around a place, by their nearness, that are not nearer to the sun than it is.
    #[must_use]
    pub fn compared(&self, at: DVec2, depth: f64) -> f64 {
        let last = self.side() as i64 - 1;
        let place = at * self.side() as f64 - 0.5;
        let low = place.floor();
        let part = place - low;
        let lit = |x: i64, y: i64| {
            let [x, y] = [low.x as i64 + x, low.y as i64 + y].map(|c| c.clamp(0, last) as usize);
            f64::from(u8::from(depth >= f64::from(self.stored[y * self.side() + x])))
        };
        let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
        mix(mix(lit(0, 0), lit(1, 0), part.x), mix(lit(0, 1), lit(1, 1), part.x), part.y)
    }
}

/// Radius of a lookup in texels.
#[must_use]
pub fn reach(filter: u32) -> f64 {
    0.5 * f64::from(filter + 1) * std::f64::consts::SQRT_2
}

/// Share of the sun's light that reaches a pixel, from maps in order of distance. `rotation` turns view space into the
/// world; `lit_by` is the shading normal in the world.
#[must_use]
pub fn sunlight(
    picture: &DepthPicture<'_>,
    pixel: [i64; 2],
    (rotation, to_sun): (DQuat, DVec3),
    lit_by: DVec3,
    maps: &[Map<'_>],
    filter: u32,
) -> f64 {
    if picture.depth_at(pixel) >= 1e30 {
        return 1.0;
    }
    let centre = picture.position_at(pixel);
    let mut normal = rotation * DVec3::from(picture.normal_at(pixel, centre));
    let position = rotation * DVec3::from(centre);
    let to_sun = to_sun.normalize();
    let mut cosine = normal.dot(to_sun);
    if cosine <= 0.0 {
        normal = lit_by.normalize();
        cosine = normal.dot(to_sun);
        if cosine <= 0.0 {
            return 0.0;
        }
    }
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (mut lit, mut left) = (0.0, 1.0);
    for map in maps {
        let lifted = position + map.texel * (normal * (reach(filter) * sine) + to_sun * ROUNDING);
        let place = map.map_from_world.transform_point3(lifted);
        let inside =
            [place.x, 1.0 - place.x, place.y, 1.0 - place.y].into_iter().fold(f64::INFINITY, f64::min);
        let border = (reach(filter) + 1.0) / map.side() as f64;
        let weight = if place.z > 0.0 { ((inside - border) / BLEND).clamp(0.0, 1.0) } else { 0.0 };
        if weight <= 0.0 {
            continue;
        }
        let first = -0.5 * f64::from(filter - 1);
        let offsets =
            (0..filter).flat_map(|y| (0..filter).map(move |x| DVec2::new(f64::from(x), f64::from(y))));
        let compared = offsets
            .map(|offset| map.compared(place.truncate() + (offset + first) / map.side() as f64, place.z));
        lit += left * weight * compared.sum::<f64>() / f64::from(filter * filter);
        left *= 1.0 - weight;
    }
    lit + left
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A map of the unit square with an occluder at depth ½ for x < ½, and nothing elsewhere.
    fn half(side: usize) -> Vec<f32> {
        (0..side * side).map(|i| if i % side < side / 2 { 0.5 } else { 0.0 }).collect()
    }

    #[test]
    fn an_edge_is_blurred_over_a_texel_and_is_where_it_belongs() {
        let stored = half(64);
        let map = Map { stored: &stored, map_from_world: DMat4::IDENTITY, texel: 1.0 / 64.0 };
        let lit = |x: f64| map.compared(DVec2::new(x, 0.3), 0.4);
        assert_eq!((lit(0.5 - 1.0 / 64.0), lit(0.5), lit(0.5 + 1.0 / 64.0)), (0.0, 0.5, 1.0));
        assert_eq!(map.compared(DVec2::new(0.2, 0.3), 0.6), 1.0, "what lies above the edge is lit");
    }
}
