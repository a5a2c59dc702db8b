//! Reversed-Z projection without a far plane, and back: `common.wgsl`.

/// View-space point to normalised device coordinates and stored depth (1 at the near plane, 0 at
/// infinity). `tan_half_fov` is `(tan(fov_x / 2), tan(fov_y / 2))`.
#[must_use]
pub fn project(p: [f64; 3], tan_half_fov: [f64; 2], near: f64) -> ([f64; 2], f64) {
    let w = -p[2];
    ([p[0] / (tan_half_fov[0] * w), p[1] / (tan_half_fov[1] * w)], near / w)
}

/// Position on the image plane at depth 1 of a pixel's centre.
#[must_use]
pub fn view_ray(pixel: [i64; 2], size_px: [u32; 2], tan_half_fov: [f64; 2]) -> [f64; 3] {
    let u = (pixel[0] as f64 + 0.5) / f64::from(size_px[0]);
    let v = (pixel[1] as f64 + 0.5) / f64::from(size_px[1]);
    [(u * 2.0 - 1.0) * tan_half_fov[0], (1.0 - v * 2.0) * tan_half_fov[1], -1.0]
}

/// View depth from stored depth; infinite where nothing was drawn.
#[must_use]
pub fn view_depth(stored: f64, near: f64) -> f64 {
    if stored > 0.0 { near / stored } else { f64::INFINITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_come_back_from_depth() {
        let (size, tan, near) = ([320, 180], [1.2, 0.675], 1e-3);
        for pixel in [[0, 0], [17, 93], [319, 179]] {
            for z in [0.0011, 1.0, 12_345.0, 1e7] {
                let ray = view_ray(pixel, size, tan);
                let p = ray.map(|x| x * z);
                let (ndc, stored) = project(p, tan, near);
                assert!((0.0..=1.0).contains(&stored));
                // In f32, as in the depth buffer: the relative precision is the same at every distance.
                let z_back = view_depth(f64::from(stored as f32), near);
                assert!((z_back / z - 1.0).abs() < 1e-7, "{z} {z_back}");
                let px = (ndc[0] * 0.5 + 0.5) * 320.0;
                assert!((px - (pixel[0] as f64 + 0.5)).abs() < 1e-9);
            }
        }
        assert_eq!(view_depth(0.0, near), f64::INFINITY);
    }
}
