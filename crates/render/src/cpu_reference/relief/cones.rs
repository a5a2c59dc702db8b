//! Cone step maps: per texel, a cone that a ray may cross in one step.

use super::ReliefMap;
use super::ray::{Ray, ReliefHit, clearance};

/// A cone per texel, standing on it and opening upwards.
#[derive(Clone, Debug)]
pub struct Cones {
    /// Radius over height, in texture widths per depth; as many as texels.
    ratios: ReliefMap,
    /// Largest step along the surface, in texture widths: cones beyond were not searched.
    most: f64,
}

/// Search radius in texture widths.
const WINDOW: f64 = 0.25;
/// Least ratio of a cone in texels per depth, so that every step advances.
const LEAST_TEXELS: f64 = 0.25;
/// Rounding margin of the distance bound.
const SURELY: f64 = 1.0 - 1e-9;
/// Texels a step by which a relaxed cone's rays are followed below the surface.
const FOLLOW_TEXELS: f64 = 0.5;

impl Cones {
    /// The widest empty cones (Dummer 2006).
    #[must_use]
    pub fn safe(map: &ReliefMap) -> Self {
        Self::new(map, &|[x, y], [dx, dy]| {
            let rise = map.texel(x + dx, y + dy) - map.texel(x, y);
            (rise > 0.0).then(|| distance(map, [dx as f64, dy as f64]) / rise)
        })
    }

    /// Relaxed cones: the widest in which a ray from above meets the surface at most once (Policarpo and Oliveira
    /// 2007). For each other texel, the ray from above this one through it is followed to its exit.
    #[must_use]
    pub fn relaxed(map: &ReliefMap) -> Self {
        Self::new(map, &|[x, y], [dx, dy]| {
            let own = map.texel(x, y);
            let there = map.texel(x + dx, y + dy);
            if there <= own {
                return None;
            }
            // From the top, at this texel, to the other's surface: so much down for the way (dx, dy).
            let down = 1.0 - there;
            let texels = (dx as f64).hypot(dy as f64);
            let window = WINDOW * map.width.min(map.height) as f64;
            let (mut along, mut out) = (1.0 + FOLLOW_TEXELS / texels, None);
            while along * texels <= window {
                let at = [x as f64 + dx as f64 * along, y as f64 + dy as f64 * along];
                let ray = 1.0 - down * along;
                if ray <= own {
                    break;
                }
                if ray > map.at_texels(at) {
                    out = Some((along, ray));
                    break;
                }
                along += FOLLOW_TEXELS / texels;
            }
            let (along, ray) = out?;
            Some(distance(map, [dx as f64 * along, dy as f64 * along]) / (ray - own))
        })
    }

    /// The texels' cones, radius over height in texture widths per depth; rows from the top.
    #[must_use]
    pub fn ratios(&self) -> &[f64] {
        &self.ratios.texels
    }

    /// Computes each texel's narrowest cone; `cone` gives the ratio that another texel at an offset requires.
    fn new(map: &ReliefMap, cone: &dyn Fn([i64; 2], [i64; 2]) -> Option<f64>) -> Self {
        let reach = (WINDOW * map.width.max(map.height) as f64) as i64;
        let least = LEAST_TEXELS / map.width.max(map.height) as f64;
        let mut ratios = Vec::with_capacity(map.texels.len());
        for y in 0..map.height as i64 {
            for x in 0..map.width as i64 {
                let mut ratio = 1.0_f64;
                // How wide the cone is at the top, where what narrows it ends at the latest.
                let above = 1.0 - map.texel(x, y);
                let beyond = |away: f64, ratio: f64| away * SURELY > ratio * above;
                // Rings outwards.
                for ring in 1..=reach {
                    let nearest = distance(map, [ring as f64, 0.0]).min(distance(map, [0.0, ring as f64]));
                    if beyond(nearest, ratio) {
                        break;
                    }
                    for k in -ring..=ring {
                        for other in [[k, ring], [k, -ring], [ring, k], [-ring, k]] {
                            if beyond(distance(map, other.map(|way| way as f64)), ratio) {
                                continue;
                            }
                            if let Some(other) = cone([x, y], other) {
                                ratio = ratio.min(other);
                            }
                        }
                    }
                }
                ratios.push(ratio.max(least));
            }
        }
        let ratios = ReliefMap { width: map.width, height: map.height, texels: ratios };
        Self { ratios, most: WINDOW }
    }

    /// The narrowest of the four surrounding cones. Interpolated, the wide cones on top of a wall would let rays
    /// beside it jump over obstacles.
    fn narrowest(&self, uv: [f64; 2]) -> f64 {
        let [x, y] = self.ratios.to_texels(uv).map(|x| x.floor() as i64);
        [[0, 0], [1, 0], [0, 1], [1, 1]]
            .into_iter()
            .fold(f64::INFINITY, |least, [i, j]| least.min(self.ratios.texel(x + i, y + j)))
    }

    /// Cone steps until the surface is reached; returns the last position before it and the hit.
    pub(super) fn step(&self, map: &ReliefMap, ray: &Ray, steps: u32) -> (f64, ReliefHit) {
        let length = ray.span[0].hypot(ray.span[1]);
        let (mut before, mut at, mut lookups) = (0.0, 0.0, 0);
        for _ in 0..steps {
            let over = clearance(map, ray, at);
            // Height, and the four ratios gathered.
            lookups += 2;
            if over <= 0.0 || at >= 1.0 {
                break;
            }
            before = at;
            let ratio = self.narrowest(ray.at(at));
            let step = ratio * over / (length + ratio);
            at = (at + step.min(self.most / length.max(1e-30))).min(1.0);
        }
        (before, ReliefHit { at, lookups })
    }
}

/// Texture widths of a way in texels.
fn distance(map: &ReliefMap, [dx, dy]: [f64; 2]) -> f64 {
    (dx / map.width as f64).hypot(dy / map.height as f64)
}

#[cfg(test)]
mod tests {
    use super::super::height_maps;
    use super::*;

    #[test]
    fn a_cone_beside_a_step_leans_against_it() {
        // One column of height 1 in a plain of 0.
        let size = 16_usize;
        let texels = (0..size * size).map(|i| if i % size == 8 { 1.0 } else { 0.0 });
        let map = ReliefMap { width: size, height: size, texels: texels.collect() };
        let cones = Cones::safe(&map);
        for (x, texels) in [(7, 1.0), (6, 2.0), (9, 1.0), (12, 4.0)] {
            let ratio = cones.ratios.texel(x, 5);
            assert!((ratio - texels / 16.0).abs() < 1e-12, "{x}: {ratio}");
        }
        assert!((cones.ratios.texel(8, 5) - 1.0).abs() < 1e-12, "nothing is higher");
    }

    #[test]
    fn relaxed_cones_are_never_narrower() {
        let map = height_maps::bricks(24);
        let (safe, relaxed) = (Cones::safe(&map), Cones::relaxed(&map));
        let both = || safe.ratios.texels.iter().zip(&relaxed.ratios.texels);
        assert!(both().all(|(safe, relaxed)| relaxed >= safe));
        assert!(both().filter(|(safe, relaxed)| relaxed > safe).count() > 24, "and some are wider");
    }
}
