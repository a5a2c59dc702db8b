//! Pictures with a transparent background: difference matting of two pictures, before black and before white (Smith and
//! Blinn, "Blue screen matting", 1996). What lets light through, edges and shadows on a studio's ground are partly
//! transparent.

use image::{Rgba, RgbaImage};
use lodestream_render::{AntiAliasing, Settings};

/// Radiance of the white background; black is 0.
const WHITE: f32 = 1.0;

/// The picture before nothing, of those that `draw` draws with the settings it is given.
///
/// # Errors
/// Those of `draw`.
pub(crate) fn drawn(
    usual: &Settings,
    mut draw: impl FnMut(&Settings) -> anyhow::Result<RgbaImage>,
) -> anyhow::Result<RgbaImage> {
    // Bloom would spread the white background, noise would differ, and a mean of frames would mix both.
    let anti_aliasing = match usual.anti_aliasing {
        AntiAliasing::Temporal => AntiAliasing::Spatial,
        other => other,
    };
    let plain = |radiance: f32| {
        let background = Some([radiance; 3]);
        Settings { anti_aliasing, bloom: None, dither: false, background, ..*usual }
    };
    Ok(matte(&draw(&plain(0.0))?, &draw(&plain(WHITE))?))
}

/// The picture before nothing, of one before black and one before white, both in sRGB and equally large. Nothing covers
/// the background where the two differ most.
fn matte(on_black: &RgbaImage, on_white: &RgbaImage) -> RgbaImage {
    let differences = on_black
        .pixels()
        .zip(on_white.pixels())
        .flat_map(|(black, white)| (0..3).map(|channel| white.0[channel].saturating_sub(black.0[channel])));
    let whole = f64::from(differences.max().unwrap_or_default().max(1));
    RgbaImage::from_fn(on_black.width(), on_black.height(), |x, y| {
        let (black, white) = (on_black.get_pixel(x, y).0, on_white.get_pixel(x, y).0);
        let let_through =
            (0..3).map(|i| f64::from(white[i]) - f64::from(black[i])).sum::<f64>() / (3.0 * whole);
        let opacity = 1.0 - let_through.clamp(0.0, 1.0);
        // Within the range of a byte.
        let colour = |i: usize| (f64::from(black[i]) / opacity.max(1e-9)).round().clamp(0.0, 255.0) as u8;
        let alpha = (255.0 * opacity).round() as u8;
        if alpha == 0 { Rgba([0; 4]) } else { Rgba([colour(0), colour(1), colour(2), alpha]) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_both_show_is_opaque_and_what_differs_is_let_through() {
        let pixels = |colours: [[u8; 3]; 4]| {
            let of = |x: u32, _| {
                let [r, g, b] = colours[x as usize];
                Rgba([r, g, b, 255])
            };
            RgbaImage::from_fn(4, 1, of)
        };
        // A surface, nothing, an edge of it that covers half, and a shadow that takes half.
        let black = pixels([[200, 100, 40], [0, 0, 0], [100, 50, 20], [0, 0, 0]]);
        let white = pixels([[200, 100, 40], [240, 240, 240], [220, 170, 140], [120, 120, 120]]);
        let shown = matte(&black, &white);
        let shown: Vec<[u8; 4]> = shown.pixels().map(|pixel| pixel.0).collect();
        assert_eq!(shown, [[200, 100, 40, 255], [0; 4], [200, 100, 40, 128], [0, 0, 0, 128]]);
    }
}
