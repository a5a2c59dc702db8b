//! Settings within a bound on the memory of render targets.

use lodestream_render::{MIN_RENDER_SCALE, Settings, Shadows};

/// Shadow maps take at most one part in so many, unless they are as small as they get: pixels are worth more.
const MAPS_DIVISOR: u64 = 4;
/// Side of shadow maps below which it is not halved.
const LEAST_MAP_SIDE: u32 = 1024;
/// Step by which the drawn picture's sides are reduced.
const SCALE_STEP: f32 = 0.05;

/// Reduces the shadow maps, then the size at which the picture is drawn before it is enlarged, until the render targets of
/// a picture of `size` take at most `most_bytes`, or the size is as small as it gets.
#[must_use]
pub fn fit_targets(settings: Settings, size: (u32, u32), most_bytes: u64) -> Settings {
    let mut fitted = settings;
    if let Some(shadows) = &mut fitted.shadows {
        while Shadows::most_bytes(*shadows) > most_bytes / MAPS_DIVISOR && shadows.map_side >= LEAST_MAP_SIDE
        {
            shadows.map_side /= 2;
        }
    }
    while fitted.most_target_bytes(size) > most_bytes && fitted.render_scale > MIN_RENDER_SCALE {
        fitted.render_scale = (fitted.render_scale - SCALE_STEP).max(MIN_RENDER_SCALE);
    }
    fitted
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodestream_render::{AntiAliasing, LightCulling};

    const MEGABYTE: u64 = 1 << 20;

    fn full() -> Settings {
        Settings {
            shadows: Some(Shadows::default()),
            lights: Some(LightCulling::default()),
            anti_aliasing: AntiAliasing::Temporal,
            ..Settings::default()
        }
    }

    #[test]
    fn usual_windows_lose_nothing() {
        for (size, most) in [((1280, 720), 384), ((1920, 1080), 384), ((2560, 1440), 384)] {
            assert_eq!(fit_targets(full(), size, most * MEGABYTE), full(), "{size:?}");
        }
    }

    #[test]
    fn targets_fit_into_what_is_given() {
        for size in [(640, 360), (1170, 2532), (3840, 2160), (7680, 4320)] {
            for most in [48, 192, 384] {
                let fitted = fit_targets(full(), size, most * MEGABYTE);
                let bytes = fitted.most_target_bytes(size);
                let least = fitted.render_scale == MIN_RENDER_SCALE;
                assert!(bytes <= most * MEGABYTE || least, "{size:?} in {most} MB: {bytes}");
            }
        }
    }

    #[test]
    fn too_little_memory_ends_at_the_smallest_picture() {
        let fitted = fit_targets(full(), (4000, 4000), 0);
        assert_eq!((fitted.render_scale, fitted.shadows.unwrap().map_side), (MIN_RENDER_SCALE, 512));
    }
}
