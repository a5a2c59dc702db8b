//! Debug views: `debug.wgsl`. Display values 0 to 1 of red, green and blue.

use super::brdf::from_octahedral;
use super::tone::encode_srgb;

/// Colour of a world normal in the G-buffer's octahedral encoding; values beyond 1 mark unlit surfaces.
#[must_use]
pub fn normal(stored: [f64; 2]) -> [f64; 3] {
    if stored[0] > 1.5 { [0.0; 3] } else { from_octahedral(stored).map(|x| 0.5 + 0.5 * x) }
}

/// Colour of roughness, metalness and occlusion.
#[must_use]
pub fn surface(roughness: f64, metal: f64, occlusion: f64) -> [f64; 3] {
    [roughness, metal, occlusion]
}

/// Colour of a linear albedo.
#[must_use]
pub fn albedo(albedo: [f64; 3]) -> [f64; 3] {
    albedo.map(encode_srgb)
}

/// Colour of a view depth.
#[must_use]
pub fn depth(view_depth: f64) -> [f64; 3] {
    let octaves = view_depth.log2();
    let octave = octaves.floor();
    level(octave + 128.0).map(|x| x * (1.0 - 0.6 * (octaves - octave)))
}

/// Colour of an overdraw count.
#[must_use]
pub fn count(count: f64) -> [f64; 3] {
    let t = 4.0 * (count / 8.0).min(1.0);
    [3.0, 2.0, 1.0].map(|at| if count > 0.0 { (1.5 - (t - at).abs()).clamp(0.0, 1.0) } else { 0.0 })
}

/// Colours that tell levels apart: `level_colour` of `common.wgsl`.
#[must_use]
pub fn level(level: f64) -> [f64; 3] {
    let hue = (level * 0.618_033_99 + 0.02).fract() * 6.0;
    [(hue - 3.0).abs() - 1.0, 2.0 - (hue - 2.0).abs(), 2.0 - (hue - 4.0).abs()]
        .map(|x| 0.15 + 0.65 * x.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_tell_octaves_apart_and_fade_within_one() {
        let (near, far, next) = (depth(2.0), depth(3.99), depth(4.0));
        assert!((0..3).all(|i| far[i] < near[i] && (far[i] / near[i] - 0.4).abs() < 0.01));
        assert!((0..3).any(|i| (next[i] - near[i]).abs() > 0.2), "{near:?} {next:?}");
    }

    #[test]
    fn counts_go_from_black_over_blue_and_green_to_red() {
        assert_eq!(count(0.0), [0.0; 3]);
        assert_eq!(count(1.0), [0.0, 0.0, 1.0]);
        assert_eq!(count(4.0), [0.5, 1.0, 0.5]);
        assert_eq!((count(8.0), count(100.0)), ([0.5, 0.0, 0.0], [0.5, 0.0, 0.0]));
    }
}
