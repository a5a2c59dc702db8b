//! Image files.

use std::io::Cursor;

use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgba, RgbaImage};

use super::seed::seed;

/// Small images in every format that textures may have.
pub(super) fn images() -> Vec<(String, Vec<u8>)> {
    let clear = RgbaImage::from_fn(9, 7, |x, y| Rgba([x as u8 * 28, y as u8 * 36, 90, 255 - x as u8 * 20]));
    let clear = DynamicImage::from(clear);
    let deep = ImageBuffer::<Luma<u16>, _>::from_fn(9, 7, |x, y| Luma([(x * 7001 + y * 13) as u16]));
    let file = |image: &DynamicImage, format: ImageFormat| {
        let mut file = Cursor::new(Vec::new());
        image.write_to(&mut file, format).expect("an image can be written");
        file.into_inner()
    };
    vec![
        seed("rgba.png", file(&clear, ImageFormat::Png)),
        seed("heights.png", file(&deep.into(), ImageFormat::Png)),
        seed("rgb.jpg", file(&clear.to_rgb8().into(), ImageFormat::Jpeg)),
        seed("rgba.webp", file(&clear, ImageFormat::WebP)),
        seed("etc1s.ktx2", include_bytes!("../../../crates/import/src/texture/tests/etc1s.ktx2").to_vec()),
        seed(
            "uastc.ktx2",
            include_bytes!("../../../crates/import/src/texture/tests/uastc-zstd.ktx2").to_vec(),
        ),
        seed("ycbcr.avif", include_bytes!("../../../crates/import/src/texture/avif/ramp.avif").to_vec()),
        seed(
            "opacity.avif",
            include_bytes!("../../../crates/import/src/texture/avif/ramp-alpha.avif").to_vec(),
        ),
    ]
}
