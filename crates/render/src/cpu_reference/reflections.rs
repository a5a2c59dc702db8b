//! Screen-space ray tracing, `tracing.wgsl`, and the weight of its result.

use super::depth::project;
use super::surface::{DepthPicture, V3, dot, scale};

/// Share of the picture's shorter side over which reflections fade towards its border.
const BORDER: f64 = 0.1;
/// Roughness at which screen-space reflections begin to fade, and at which they end.
const MIRRORS: [f64; 2] = [0.2, 0.5];
/// Largest depth of a ray that goes away from the eye, as a multiple of its first depth.
const FARTHEST: f64 = 1e4;
/// Least depth of a ray that comes towards the eye, as a share of its first depth.
const CLOSEST: f64 = 1e-3;
/// Offset beyond a cell's side at which the next cell is looked up, pixels.
const NUDGE: f64 = 0.01;

/// Depth pyramid: stored depths and the nearest of each 2×2, level by level.
#[derive(Clone, Debug)]
pub struct Pyramid {
    /// Width and values of each level, the picture's own first.
    levels: Vec<(u32, Vec<f32>)>,
}

impl Pyramid {
    /// Builds `levels` levels above full resolution. Sides are rounded up; outside the picture there is nothing.
    #[must_use]
    pub fn new(picture: &DepthPicture<'_>, levels: u32) -> Self {
        let mut size = picture.size_px;
        let mut all = vec![(size[0], picture.stored.to_vec())];
        for _ in 0..levels {
            let half = size.map(|side| side.div_ceil(2));
            let (_, finer) = &all[all.len() - 1];
            let nearest = |x: u32, y: u32| {
                let four = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| [2 * x + i, 2 * y + j]);
                let inside = four.into_iter().filter(|[x, y]| *x < size[0] && *y < size[1]);
                inside.map(|[x, y]| finer[(y * size[0] + x) as usize]).fold(0.0, f32::max)
            };
            let level = (0..half[1]).flat_map(|y| (0..half[0]).map(move |x| (x, y)));
            let level = level.map(|(x, y)| nearest(x, y)).collect();
            all.push((half[0], level));
            size = half;
        }
        Self { levels: all }
    }

    fn nearest_in(&self, cell: [i64; 2], level: usize) -> f64 {
        let (width, values) = &self.levels[level];
        let index = cell[1] as usize * *width as usize + cell[0] as usize;
        values.get(index).map_or(0.0, |stored| f64::from(*stored))
    }

    /// Values of a level above the picture's own, rows from the top.
    #[must_use]
    pub fn level(&self, number: usize) -> (u32, &[f32]) {
        let (width, values) = &self.levels[number];
        (*width, values)
    }
}

/// Search settings.
#[derive(Clone, Copy, Debug)]
pub struct Tracing {
    /// Hierarchical or linear search.
    pub by_cells: bool,
    /// Most steps.
    pub steps: u32,
    /// Assumed thickness of surfaces, as a share of their depth.
    pub thickness: f64,
}

/// Result of a ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It hit the surface at a pixel.
    Met([i64; 2]),
    /// It left the picture or reached the largest distance.
    Left,
    /// It ran out of steps.
    MidAir,
    /// It started below its own surface.
    Below,
}

/// A ray's result and its number of depth lookups.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Traced {
    /// Result.
    pub end: End,
    /// Lookups.
    pub lookups: u32,
}

/// A line on the picture: pixels and stored depth.
#[derive(Clone, Copy, Debug)]
struct Line {
    from: V3,
    way: V3,
}

impl Line {
    fn at(&self, part: f64) -> V3 {
        [0, 1, 2].map(|i| self.from[i] + self.way[i] * part)
    }

    fn pixels(&self) -> f64 {
        self.way[0].abs().max(self.way[1].abs())
    }

    /// Part at which it leaves a cell, and a little more.
    fn leaving(&self, cell: [i64; 2], side: f64) -> f64 {
        let parts = [0, 1].map(|i| {
            let bound = (cell[i] + i64::from(self.way[i] > 0.0)) as f64 * side;
            if self.way[i] == 0.0 { 1e30 } else { (bound - self.from[i]) / self.way[i] }
        });
        parts[0].min(parts[1]) + NUDGE / self.pixels()
    }
}

/// A depth buffer in which rays are traced.
#[derive(Clone, Copy, Debug)]
pub struct Mirror<'a> {
    /// The depth buffer.
    pub picture: DepthPicture<'a>,
    /// The depth pyramid.
    pub pyramid: &'a Pyramid,
}

impl Mirror<'_> {
    /// A place in view space as pixels and stored depth.
    fn on_picture(&self, place: V3) -> V3 {
        let (ndc, stored) = project(place, self.picture.tan_half_fov, self.picture.near);
        let [width, height] = self.picture.size_px.map(f64::from);
        [(ndc[0] * 0.5 + 0.5) * width, (0.5 - ndc[1] * 0.5) * height, stored]
    }

    fn line_of(&self, place: V3, direction: V3) -> Line {
        let depth = -place[2];
        let mut length = FARTHEST * depth;
        if direction[2] > 0.0 {
            length = length.min((1.0 - CLOSEST) * depth / direction[2]);
        }
        let from = self.on_picture(place);
        let to = self.on_picture([0, 1, 2].map(|i| place[i] + direction[i] * length));
        let way = [0, 1, 2].map(|i| to[i] - from[i]);
        let parts = [0, 1].map(|i| {
            let room = if way[i] > 0.0 { f64::from(self.picture.size_px[i]) - from[i] } else { -from[i] };
            if way[i] == 0.0 { 1.0 } else { room / way[i] }
        });
        Line { from, way: scale(way, parts[0].min(parts[1]).clamp(0.0, 1.0)) }
    }

    fn is_inside(&self, pixel: [i64; 2]) -> bool {
        [0, 1].iter().all(|&i| (0..i64::from(self.picture.size_px[i])).contains(&pixel[i]))
    }

    /// Traces a ray from a surface, a pixel's width above it, in a unit direction in view space.
    #[must_use]
    pub fn trace(&self, tracing: &Tracing, place: V3, normal: V3, direction: V3) -> Traced {
        if dot(direction, normal) <= 0.0 {
            return Traced { end: End::Below, lookups: 0 };
        }
        let scale_px = f64::from(self.picture.size_px[1]) / (2.0 * self.picture.tan_half_fov[1]);
        let lifted = [0, 1, 2].map(|i| place[i] + normal[i] * (-place[2] / scale_px));
        let line = self.line_of(lifted, direction);
        if tracing.by_cells { self.by_cells(tracing, &line) } else { self.by_pixels(tracing, &line) }
    }

    fn by_pixels(&self, tracing: &Tracing, line: &Line) -> Traced {
        let pixels = line.pixels();
        let step = scale(line.way, 1.0 / pixels.max(1.0));
        let (all, mut lookups) = (pixels as u32, 0);
        for i in 1..=all.min(tracing.steps) {
            let at = [0, 1, 2].map(|k| line.from[k] + step[k] * f64::from(i));
            let pixel = [at[0], at[1]].map(|x| x.floor() as i64);
            if !self.is_inside(pixel) {
                return Traced { end: End::Left, lookups };
            }
            lookups += 1;
            if meets(tracing, at[2].max(at[2] - step[2]), at[2], self.pyramid.nearest_in(pixel, 0)) {
                return Traced { end: End::Met(pixel), lookups };
            }
        }
        Traced { end: if all > tracing.steps { End::MidAir } else { End::Left }, lookups }
    }

    fn by_cells(&self, tracing: &Tracing, line: &Line) -> Traced {
        if line.pixels() < 1.0 {
            return Traced { end: End::Left, lookups: 0 };
        }
        let top = self.pyramid.levels.len() - 1;
        let first = [line.from[0], line.from[1]].map(|x| x.floor() as i64);
        let (mut part, mut level) = (line.leaving(first, 1.0), 0_usize);
        for lookups in 0..tracing.steps {
            let (side, at) = (f64::from(1_u32 << level), line.at(part));
            let pixel = [at[0], at[1]].map(|x| x.floor() as i64);
            if part >= 1.0 || !self.is_inside(pixel) {
                return Traced { end: End::Left, lookups };
            }
            let cell = [at[0], at[1]].map(|x| (x / side).floor() as i64);
            let nearest = self.pyramid.nearest_in(cell, level);
            let after = line.leaving(cell, side).max(part);
            let left = line.from[2] + line.way[2] * after.min(1.0);
            let further = at[2].min(left);
            if further > nearest {
                (part, level) = (after, (level + 1).min(top));
            } else if level > 0 {
                if at[2] > nearest {
                    part = part.max((nearest - line.from[2]) / line.way[2]);
                }
                level -= 1;
            } else if meets(tracing, at[2].max(left), further, nearest) {
                return Traced { end: End::Met(cell), lookups: lookups + 1 };
            } else {
                part = after;
            }
        }
        Traced { end: if part >= 1.0 { End::Left } else { End::MidAir }, lookups: tracing.steps }
    }

    /// Weight of a hit at a pixel.
    #[must_use]
    pub fn share(&self, pixel: [i64; 2]) -> f64 {
        let [width, height] = self.picture.size_px.map(f64::from);
        let inside = |x: i64, side: f64| (x as f64 + 0.5).min(side - x as f64 - 0.5);
        let nearest = inside(pixel[0], width).min(inside(pixel[1], height));
        (nearest / (BORDER * width.min(height))).clamp(0.0, 1.0)
    }
}

/// Whether depths that a ray goes through, as they are stored, meet a surface.
fn meets(tracing: &Tracing, nearer: f64, further: f64, surface: f64) -> bool {
    surface > 0.0 && further <= surface && surface <= nearer * (1.0 + tracing.thickness)
}

/// Weight of a single ray by roughness.
#[must_use]
pub fn mirrors(roughness: f64) -> f64 {
    let t = ((roughness - MIRRORS[0]) / (MIRRORS[1] - MIRRORS[0])).clamp(0.0, 1.0);
    1.0 - t * t * (3.0 - 2.0 * t)
}

/// Share of what is mirrored that occlusion leaves (Lagarde 2014, 4.10.2): `mirror_open` of `brdf.wgsl`.
#[must_use]
pub fn mirror_open(open: f64, normal_eye: f64, roughness: f64) -> f64 {
    ((normal_eye + open).powf((-16.0 * roughness - 1.0).exp2()) - 1.0 + open).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [96, 64];
    const NEAR: f64 = 0.01;

    /// A floor one unit below the eye, up to a wall at a depth of 5; above the wall nothing.
    fn room(wall: f64) -> Vec<f32> {
        let tan = [0.75, 0.5];
        let all = (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| [x, y].map(i64::from)));
        let stored = all.map(|pixel| {
            let ray = super::super::depth::view_ray(pixel, SIZE, tan);
            let floor = if ray[1] < 0.0 { 1.0 / -ray[1] } else { f64::INFINITY };
            let depth = if ray[1] * 5.0 < wall { floor.min(5.0) } else { floor };
            (NEAR / depth) as f32
        });
        stored.collect()
    }

    fn ends(thickness: f64, wall: f64, each: impl Fn([i64; 2], Traced, Traced)) {
        let stored = room(wall);
        let picture = DepthPicture { stored: &stored, size_px: SIZE, tan_half_fov: [0.75, 0.5], near: NEAR };
        let mirror = Mirror { picture, pyramid: &Pyramid::new(&picture, 5) };
        for y in 40..62 {
            let place = picture.position_at([30, y]);
            // The floor is a mirror.
            let length = dot(place, place).sqrt();
            let direction = [place[0], -place[1], place[2]].map(|x| x / length);
            let traced = [false, true].map(|by_cells| {
                let tracing = Tracing { by_cells, steps: 1000, thickness };
                mirror.trace(&tracing, place, [0.0, 1.0, 0.0], direction)
            });
            each([30, y], traced[0], traced[1]);
        }
    }

    #[test]
    fn a_floor_mirrors_the_wall_behind_it_where_the_law_says() {
        ends(0.02, 1.0, |pixel, linear, cells| {
            let ray = super::super::depth::view_ray(pixel, SIZE, [0.75, 0.5]);
            if ray[1] * 5.0 > -1.0 {
                // The pixel shows the wall.
                return;
            }
            // The mirror image of the eye is one unit below the floor.
            let (End::Met(linear_at), End::Met(cells_at)) = (linear.end, cells.end) else {
                panic!("{pixel:?}: {linear:?} {cells:?}")
            };
            let height = -2.0 - ray[1] * 5.0;
            let want = 32.0 * (1.0 - height / 5.0 / 0.5);
            // Rays begin a pixel higher, and end at most one step further.
            for at in [linear_at, cells_at] {
                assert!((at[1] as f64 + 0.5 - want).abs() < 2.6, "{pixel:?} {at:?} {want}");
            }
            assert!(cells.lookups < 40 && linear.lookups < 64);
        });
    }

    #[test]
    fn rays_ignore_the_background_and_end_after_their_steps() {
        // Without a wall all rays leave the picture.
        ends(0.02, -10.0, |pixel, linear, cells| {
            assert_eq!([linear.end, cells.end], [End::Left; 2], "{pixel:?}");
        });
        let stored = room(1.0);
        let picture = DepthPicture { stored: &stored, size_px: SIZE, tan_half_fov: [0.75, 0.5], near: NEAR };
        let mirror = Mirror { picture, pyramid: &Pyramid::new(&picture, 5) };
        let place = picture.position_at([30, 60]);
        let direction = scale([place[0], -place[1], place[2]], 1.0 / dot(place, place).sqrt());
        let few = |by_cells| Tracing { by_cells, steps: 3, thickness: 0.02 };
        for by_cells in [false, true] {
            let traced = mirror.trace(&few(by_cells), place, [0.0, 1.0, 0.0], direction);
            assert_eq!(traced, Traced { end: End::MidAir, lookups: 3 });
            let below = mirror.trace(&few(by_cells), place, [0.0, 1.0, 0.0], scale(direction, -1.0));
            assert_eq!(below.end, End::Below);
        }
    }

    #[test]
    fn a_pyramid_of_odd_sides_covers_every_pixel() {
        let stored: Vec<f32> = (0..7 * 5).map(|i| (i * 37 % 35) as f32 / 35.0).collect();
        let picture = DepthPicture { stored: &stored, size_px: [7, 5], tan_half_fov: [1.0; 2], near: NEAR };
        let pyramid = Pyramid::new(&picture, 3);
        let most = stored.iter().copied().fold(0.0, f32::max);
        assert_eq!(pyramid.level(3), (1, &[most][..]));
        for (number, width) in [(1, 4), (2, 2)] {
            let (wide, values) = pyramid.level(number);
            assert_eq!(wide, width);
            for (i, stored) in stored.iter().enumerate() {
                let (x, y) = ((i as u32 % 7) >> number, (i as u32 / 7) >> number);
                assert!(values[(y * wide + x) as usize] >= *stored);
            }
        }
    }

    #[test]
    fn reflections_fade_with_roughness_and_towards_the_border() {
        assert_eq!([0.0, 0.2, 0.5, 1.0].map(mirrors), [1.0, 1.0, 0.0, 0.0]);
        assert!((0..100).map(|i| mirrors(f64::from(i) / 100.0)).is_sorted_by(|a, b| a >= b));
        let stored = room(1.0);
        let picture = DepthPicture { stored: &stored, size_px: SIZE, tan_half_fov: [0.75, 0.5], near: NEAR };
        let mirror = Mirror { picture, pyramid: &Pyramid::new(&picture, 1) };
        assert!(mirror.share([0, 30]) < 0.1 && mirror.share([48, 32]) == 1.0);
    }
}
