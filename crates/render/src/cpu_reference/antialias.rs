//! Post-process anti-aliasing, `antialias.wgsl`, and upscaling, `enlarge.wgsl`.

/// As in the shader.
const RELATIVE_CONTRAST: f64 = 0.125;
const LEAST_CONTRAST: f64 = 0.03;
const END: f64 = 0.25;
const STEPS: i64 = 12;
const SUBPIXEL: f64 = 0.5;

/// A displayed picture: sRGB-encoded, 0 to 1, rows from the top.
#[derive(Clone, Copy, Debug)]
pub struct Display<'a> {
    /// Its pixels.
    pub pixels: &'a [[f64; 3]],
    /// Width and height.
    pub size_px: [u32; 2],
}

impl Display<'_> {
    fn shown(&self, [x, y]: [i64; 2]) -> [f64; 3] {
        let [width, height] = self.size_px.map(i64::from);
        self.pixels[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize]
    }

    fn luma(&self, at: [i64; 2]) -> f64 {
        let [r, g, b] = self.shown(at);
        0.299 * r + 0.587 * g + 0.114 * b
    }

    /// Bilinear upscaling: the value at a pixel of a larger picture.
    #[must_use]
    pub fn enlarged(&self, at: [u32; 2], shown_px: [u32; 2]) -> [f64; 3] {
        let place: [f64; 2] = std::array::from_fn(|i| {
            (f64::from(at[i]) + 0.5) * f64::from(self.size_px[i]) / f64::from(shown_px[i]) - 0.5
        });
        let low = place.map(|p| p.floor() as i64);
        let part = place.map(|p| p - p.floor());
        let near = |x: i64, y: i64| self.shown([low[0] + x, low[1] + y]);
        let mix = |a: [f64; 3], b: [f64; 3], t: f64| std::array::from_fn(|c| a[c] + (b[c] - a[c]) * t);
        let [above, below] = [0, 1].map(|y| mix(near(0, y), near(1, y), part[0]));
        mix(above, below, part[1])
    }

    /// The anti-aliased pixel.
    #[must_use]
    pub fn smoothed(&self, at: [i64; 2]) -> [f64; 3] {
        let near = |x: i64, y: i64| self.luma([at[0] + x, at[1] + y]);
        let (m, n, s, w, e) = (near(0, 0), near(0, -1), near(0, 1), near(-1, 0), near(1, 0));
        let most = [m, n, s, w, e].into_iter().fold(f64::NEG_INFINITY, f64::max);
        let contrast = most - [m, n, s, w, e].into_iter().fold(f64::INFINITY, f64::min);
        if contrast < LEAST_CONTRAST.max(most * RELATIVE_CONTRAST) {
            return self.shown(at);
        }
        let (nw, ne, sw, se) = (near(-1, -1), near(1, -1), near(-1, 1), near(1, 1));
        let rows = (nw - 2.0 * w + sw).abs() + 2.0 * (n - 2.0 * m + s).abs() + (ne - 2.0 * e + se).abs();
        let columns = (nw - 2.0 * n + ne).abs() + 2.0 * (w - 2.0 * m + e).abs() + (sw - 2.0 * s + se).abs();
        let horizontal = rows >= columns;
        let (before, after) = if horizontal { (n, s) } else { (w, e) };
        let is_before = (before - m).abs() >= (after - m).abs();
        let sign = if is_before { -1 } else { 1 };
        let (across, along) = if horizontal { ([0, sign], [1, 0]) } else { ([sign, 0], [0, 1]) };
        let beyond = if is_before { before } else { after };
        let middle = 0.5 * (m + beyond);
        let end = END * (beyond - m).abs();
        let ends = [-1, 1].map(|direction| {
            let off = |i: i64| {
                let [x, y] = along.map(|a| a * direction * i);
                0.5 * (near(x, y) + near(x + across[0], y + across[1])) - middle
            };
            let reach = (1..=STEPS).find(|&i| off(i).abs() >= end).unwrap_or(STEPS);
            (reach, off(reach))
        });
        let nearer = usize::from(ends[0].0 >= ends[1].0);
        let (reach, last) = ends[nearer];
        let bends = (last < 0.0) != (m < middle);
        let offset = if bends { 0.5 - reach as f64 / (ends[0].0 + ends[1].0) as f64 } else { 0.0 };
        let mean = (2.0 * (n + s + w + e) + nw + ne + sw + se) / 12.0;
        let t = ((mean - m).abs() / contrast).clamp(0.0, 1.0);
        let single = t * t * (3.0 - 2.0 * t);
        let offset = offset.max(SUBPIXEL * single * single);
        let other = self.shown([at[0] + across[0], at[1] + across[1]]);
        let own = self.shown(at);
        std::array::from_fn(|c| own[c] + (other[c] - own[c]) * offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: u32 = 48;

    /// A picture of the half plane below a line of the given slope, one sample per pixel.
    fn half_plane(slope: f64) -> Vec<[f64; 3]> {
        let lit = |x: u32, y: u32| f64::from(y) + 0.5 > 20.3 + slope * (f64::from(x) + 0.5);
        (0..SIDE * SIDE).map(|i| [f64::from(u8::from(lit(i % SIDE, i / SIDE))); 3]).collect()
    }

    /// The share of a pixel that the half plane covers.
    fn covered(slope: f64, [x, y]: [i64; 2]) -> f64 {
        let lit = |i: i64, j: i64| {
            let at = [x as f64 + (i as f64 + 0.5) / 16.0, y as f64 + (j as f64 + 0.5) / 16.0];
            f64::from(u8::from(at[1] > 20.3 + slope * at[0]))
        };
        (0..256).map(|k| lit(k % 16, k / 16)).sum::<f64>() / 256.0
    }

    #[test]
    fn edges_come_nearer_to_what_they_cover() {
        for slope in [0.0, 0.08, 0.21, 0.45, 0.9] {
            let pixels = half_plane(slope);
            let display = Display { pixels: &pixels, size_px: [SIDE; 2] };
            let (mut before, mut after) = (0.0, 0.0);
            for i in 0..i64::from(SIDE * SIDE) {
                let at = [i % i64::from(SIDE), i / i64::from(SIDE)];
                let truth = covered(slope, at);
                before += (display.shown(at)[0] - truth).powi(2);
                after += (display.smoothed(at)[0] - truth).powi(2);
            }
            // A horizontal edge along pixel borders has no steps to smooth.
            let most = if slope == 0.0 { 1.0 } else { 0.65 };
            assert!(after <= most * before, "{slope}: {before} {after}");
        }
    }

    #[test]
    fn pictures_without_edges_are_unchanged() {
        let pixels: Vec<_> = (0..SIDE * SIDE).map(|i| [f64::from(i % SIDE) * 0.02; 3]).collect();
        let display = Display { pixels: &pixels, size_px: [SIDE; 2] };
        for i in 0..i64::from(SIDE * SIDE) {
            let at = [i % i64::from(SIDE), i / i64::from(SIDE)];
            // Differences as small as these count as edges only in the dark.
            if at[0] > 4 {
                assert_eq!(display.smoothed(at), display.shown(at), "{at:?}");
            }
        }
    }
}
