//! The picture of a studio's ground, and what it does to the background: `floor*.wgsl`.

use glam::{DMat4, DVec2, DVec3, Vec4};

use crate::passes::floor::FloorUniform;

const SEARCH: f64 = 0.22;
const LIGHT: f64 = 0.13;
const LEAST_BLUR: f64 = 0.012;
const SEARCHED: u32 = 16;
const LOOKED_UP: u32 = 32;
const RAISED: f64 = 0.002;
const REACH: [f64; 2] = [0.14, 0.6];
const HEIGHT: [f64; 2] = [0.05, 0.3];
const HIDDEN: [f64; 2] = [0.6, 0.75];
const AROUND: u32 = 24;
const KEY: f64 = 0.42;
const AMBIENT: f64 = 0.58;

/// A square map of depths, rows from the top; 0 where nothing is.
pub(crate) struct DepthMap {
    pub(crate) side: usize,
    pub(crate) depths: Vec<f32>,
}

impl DepthMap {
    /// The depth at a place, 0 to 1 across the map; 0 outside.
    fn at(&self, place: DVec2) -> f64 {
        let texel = (place * self.side as f64).floor();
        let inside = texel.min_element() >= 0.0 && texel.max_element() < self.side as f64;
        if inside { f64::from(self.depths[texel.y as usize * self.side + texel.x as usize]) } else { 0.0 }
    }
}

/// The ground, from its uniform block and maps.
pub(crate) struct Floor {
    pub(crate) block: FloorUniform,
    pub(crate) undersides: DepthMap,
    pub(crate) key: DepthMap,
    /// Texels of the picture.
    pub(crate) size: [usize; 2],
}

impl Floor {
    fn single(four: [f32; 4]) -> [f64; 4] {
        four.map(f64::from)
    }

    fn radius(&self) -> f64 {
        f64::from(self.block.size[0])
    }

    /// Place of a depth of the map of undersides along the axis down.
    fn down_of(&self, depth: f64) -> f64 {
        let [_, range, below, _] = Self::single(self.block.range);
        depth * range - below
    }

    /// Depth of the lowest underside.
    fn lowest(&self) -> f64 {
        self.undersides.depths.iter().fold(0.0, |lowest, depth| f64::max(lowest, f64::from(*depth)))
    }

    fn key_light(&self, at: DVec3, turn: f64) -> f64 {
        let columns = self.block.key_from_floor.map(|column| Vec4::from(column).as_dvec4());
        let from_floor = DMat4::from_cols(columns[0], columns[1], columns[2], columns[3]);
        let place = from_floor.transform_point3(at);
        let [.., range] = Self::single(self.block.range);
        let radius = self.radius();
        let least = (place.z + RAISED * radius / range).max(0.0);
        let scale = radius * f64::from(self.block.size[1]);
        let depth = |offset: DVec2| self.key.at(place.truncate() + offset * scale);
        let found: Vec<f64> = (0..SEARCHED)
            .map(|i| depth(spiral(i, SEARCHED, turn, 0.5) * SEARCH))
            .filter(|depth| *depth > least)
            .collect();
        if found.is_empty() {
            return 1.0;
        }
        let distance = found.iter().map(|depth| depth - place.z).sum::<f64>() / found.len() as f64;
        let blur = (LIGHT * distance * range / radius).clamp(LEAST_BLUR, SEARCH);
        let lit = (0..LOOKED_UP).filter(|i| depth(spiral(*i, LOOKED_UP, turn, 0.5) * blur) <= least).count();
        lit as f64 / f64::from(LOOKED_UP)
    }

    fn nearness(&self, at: DVec3, turn: f64, reach: f64, height: f64) -> f64 {
        let across = f64::from(self.block.range[0]);
        let sum: f64 = (0..AROUND)
            .map(|i| {
                let there = at.truncate() + spiral(i, AROUND, turn, 0.65) * reach * self.radius();
                let depth = self.undersides.at(0.5 + DVec2::new(there.x, -there.y) * across);
                if depth > 0.0 {
                    ((self.down_of(depth) - at.z) / (height * self.radius())).exp()
                } else {
                    0.0
                }
            })
            .sum();
        sum / f64::from(AROUND)
    }

    /// A texel of the picture before the mean over the pattern: share of the key light, openness.
    fn patterned(&self, [x, y]: [usize; 2], lowest: f64) -> DVec2 {
        let [width, rows] = self.size.map(|side| side as f64);
        let from_middle = DVec2::new((x as f64 + 0.5) / width, (y as f64 + 0.5) / rows) * 2.0 - 1.0;
        let [mx, my, hx, hy] = Self::single(self.block.picture);
        let at = DVec3::new(mx + from_middle.x * hx, my + from_middle.y * hy, self.down_of(lowest));
        let turn = ((y % 4) * 4 + x % 4) as f64 * std::f64::consts::TAU / 16.0;
        let open = [0, 1].map(|i| 1.0 - HIDDEN[i] * self.nearness(at, turn, REACH[i], HEIGHT[i]));
        let t = ((from_middle.abs().max_element() - 0.8) / 0.2).clamp(0.0, 1.0);
        let shown = 1.0 - t * t * (3.0 - 2.0 * t);
        DVec2::ONE.lerp(DVec2::new(self.key_light(at, turn), open[0] * open[1]), shown)
    }

    /// The picture, rows from the top.
    pub(crate) fn picture(&self) -> Vec<DVec2> {
        let [width, rows] = self.size;
        let lowest = self.lowest();
        let all: Vec<DVec2> =
            (0..width * rows).map(|i| self.patterned([i % width, i / width], lowest)).collect();
        let mean = |i: usize| {
            let texel = |j: usize| {
                let x = (i % width + j % 4).saturating_sub(2).min(width - 1);
                let y = (i / width + j / 4).saturating_sub(2).min(rows - 1);
                all[y * width + x]
            };
            (0..16).map(texel).sum::<DVec2>() / 16.0
        };
        (0..width * rows).map(mean).collect()
    }

    /// Factor on the background that is seen along a ray, in the world.
    pub(crate) fn factor(&self, ray: DVec3, picture: &[DVec2]) -> f64 {
        let axes = self.block.axes.map(|axis| Vec4::from(axis).as_dvec4());
        let ray = DVec3::from(axes.map(|axis| axis.truncate().dot(ray)));
        let eye = DVec3::from(axes.map(|axis| axis.w));
        let above = self.down_of(self.lowest()) - eye.z;
        if above <= 0.0 || ray.z <= 0.0 {
            return 1.0;
        }
        let at = eye.truncate() + ray.truncate() * (above / ray.z);
        let [mx, my, hx, hy] = Self::single(self.block.picture);
        let from_middle = (at - DVec2::new(mx, my)) / DVec2::new(hx, hy);
        if from_middle.abs().max_element() >= 1.0 {
            return 1.0;
        }
        // Texels stand for their corners.
        let [width, rows] = self.size;
        let place = (0.5 + 0.5 * from_middle) * DVec2::new(width as f64, rows as f64);
        let (low, part) = (place.floor(), place - place.floor());
        let texel = |dx: usize, dy: usize| {
            let (x, y) = (low.x as usize + dx, low.y as usize + dy);
            picture[y.min(rows - 1) * width + x.min(width - 1)]
        };
        let row = |dy| texel(0, dy).lerp(texel(1, dy), part.x);
        let light = row(0).lerp(row(1), part.y);
        1.0 - KEY * (1.0 - light.x) - AMBIENT * (1.0 - light.y)
    }
}

/// Sample of a spiral in the unit circle (Vogel 1979).
fn spiral(i: u32, count: u32, turn: f64, power: f64) -> DVec2 {
    let (sine, cosine) = (f64::from(i) * 2.399_963_2 + turn).sin_cos();
    ((f64::from(i) + 0.5) / f64::from(count)).powf(power) * DVec2::new(cosine, sine)
}
