//! Which components a camera sees, in software.

use glam::DVec3;
use lodestream_scene::description::Camera;
use lodestream_scene::proxy::START_VIEWPORT_PX as VIEWPORT_PX;

/// What a camera sees in each pixel.
pub(super) struct ItemBuffer {
    eye: DVec3,
    /// Right, up, forward.
    axes: [DVec3; 3],
    /// Pixels per unit of tangent.
    scale: f64,
    /// Depth before which nothing is drawn.
    near: f64,
    width: usize,
    height: usize,
    depths: Vec<f64>,
    items: Vec<u32>,
}

impl ItemBuffer {
    pub(super) fn new(eye: DVec3, camera: &Camera, near: f64) -> Self {
        let view = camera.view(VIEWPORT_PX, 1.0);
        let orientation = view.orientation().as_dquat();
        let [width, height] = VIEWPORT_PX.map(|x| x as usize);
        Self {
            eye,
            axes: [DVec3::X, DVec3::Y, DVec3::NEG_Z].map(|axis| orientation * axis),
            scale: view.scale_px(),
            near,
            width,
            height,
            depths: vec![f64::INFINITY; width * height],
            items: vec![u32::MAX; width * height],
        }
    }

    /// In how many pixels each of `count` items is seen.
    pub(super) fn counts(&self, count: usize) -> Vec<u32> {
        let mut counts = vec![0; count];
        for item in &self.items {
            if let Some(count) = counts.get_mut(*item as usize) {
                *count += 1;
            }
        }
        counts
    }

    /// Draws a triangle where nothing nearer is drawn.
    pub(super) fn draw(&mut self, triangle: [DVec3; 3], item: u32) {
        let points = triangle.map(|p| DVec3::from(self.axes.map(|axis| axis.dot(p - self.eye))));
        let mut polygon: Vec<DVec3> = Vec::with_capacity(4);
        for i in 0..3 {
            let (a, b) = (points[i], points[(i + 1) % 3]);
            if a.z >= self.near {
                polygon.push(a);
            }
            if (a.z >= self.near) != (b.z >= self.near) {
                polygon.push(a + (b - a) * ((self.near - a.z) / (b.z - a.z)));
            }
        }
        let half = [self.width as f64 / 2.0, self.height as f64 / 2.0];
        let scale = self.scale;
        let project = |p: DVec3| [half[0] + p.x / p.z * scale, half[1] - p.y / p.z * scale, 1.0 / p.z];
        for i in 2..polygon.len() {
            self.fill([polygon[0], polygon[i - 1], polygon[i]].map(project), item);
        }
    }

    /// Fills a triangle of pixels with reciprocal depths.
    fn fill(&mut self, [a, b, c]: [[f64; 3]; 3], item: u32) {
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let bound = |k: usize, most: usize| {
            let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
            (low.floor().max(0.0) as usize)..(high.ceil().max(0.0) as usize + 1).min(most)
        };
        for y in bound(1, self.height) {
            for x in bound(0, self.width) {
                let p = [x as f64 + 0.5, y as f64 + 0.5];
                let weight = |q: [f64; 3], r: [f64; 3]| {
                    ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])) / area
                };
                let (u, v, w) = (weight(b, c), weight(c, a), weight(a, b));
                if u < 0.0 || v < 0.0 || w < 0.0 {
                    continue;
                }
                let depth = 1.0 / (u * a[2] + v * b[2] + w * c[2]);
                let at = y * self.width + x;
                if depth < self.depths[at] {
                    (self.depths[at], self.items[at]) = (depth, item);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_nearer_is_seen_and_what_reaches_behind_the_camera_is_cut() {
        let camera = Camera { eye: [0.0; 3], target: [0.0, 0.0, -1.0], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        let mut buffer = ItemBuffer::new(DVec3::ZERO, &camera, 0.1);
        let wall = |z: f64| [DVec3::new(-9.0, -9.0, z), DVec3::new(9.0, -9.0, z), DVec3::new(0.0, 12.0, z)];
        buffer.draw(wall(-5.0), 1);
        buffer.draw(wall(-6.0), 2);
        buffer.draw(wall(5.0), 3);
        // A floor, from behind the camera to before the wall.
        buffer.draw([[-4.0, -1.0, 4.0], [4.0, -1.0, 4.0], [0.0, -1.0, -4.0]].map(DVec3::from), 4);
        let seen = buffer.counts(5);
        assert!(seen[1] > 100_000 && seen[4] > 10_000, "{seen:?}");
        assert_eq!([seen[0], seen[2], seen[3]], [0; 3]);
    }
}
