//! AVIF files of one image (AOMedia, "AV1 Image File Format", 1.1): items of colours and opacity, each a key frame of AV1.

mod boxes;
mod color;
#[cfg(test)]
mod tests;

use image::DynamicImage;
use re_rav1d::{Decoder, Picture, Settings};

use self::boxes::{Container, Property};
use self::color::{Coding, Image};
use super::limits::MAX_WHOLE_PIXELS;

/// Item type of AV1.
const AV1: [u8; 4] = *b"av01";
/// Most calls until the frame of an item is there.
const MAX_CALLS: usize = 16;

/// An AVIF file.
pub(super) struct Avif<'a> {
    container: Container<'a>,
    /// As it is stored, before it is turned.
    stored_px: (u32, u32),
    /// As it is shown.
    size_px: (u32, u32),
}

impl<'a> Avif<'a> {
    /// Whether it is a file of this family, which HEIF with other codes is too.
    pub(super) fn is_one(bytes: &[u8]) -> bool {
        bytes.get(4..8) == Some(b"ftyp")
    }

    /// Reads all but the pixels.
    ///
    /// # Errors
    /// What is wrong or not supported.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let container = Container::open(bytes)?;
        match container.kind(container.primary) {
            Some(AV1) => {}
            Some(kind) if kind == *b"grid" => {
                return Err("its image is a grid of others; convert it".to_owned());
            }
            Some(kind) => return Err(format!("its image is {}, not AV1; convert it", kind.escape_ascii())),
            None => return Err("its image is missing".to_owned()),
        }
        let stored_px = size_of(container.properties(container.primary))?;
        let mut size_px = stored_px;
        for property in container.properties(container.primary) {
            match property {
                Property::Crop(crop) => {
                    let [_, _, width, height] = rectangle(crop, size_px)?;
                    size_px = (width, height);
                }
                Property::Rotation(quarters) if quarters % 2 == 1 => size_px = (size_px.1, size_px.0),
                _ => {}
            }
        }
        Ok(Self { container, stored_px, size_px })
    }

    /// Width and height in pixels.
    pub(super) fn size(&self) -> (u32, u32) {
        self.size_px
    }

    /// Decodes the image: 8 bits of each channel, 16 if the file has more.
    ///
    /// # Errors
    /// Damaged data, or of another size than the file states.
    pub(super) fn decode(&self) -> Result<DynamicImage, String> {
        let primary = self.container.primary;
        let color = self.frame(primary)?;
        let alpha_item = self.container.opacity_of(primary);
        let alpha = match alpha_item {
            Some(item) if size_of(self.container.properties(item))? != self.stored_px => {
                return Err("its opacity has another size".to_owned());
            }
            Some(item) => Some((self.frame(item)?, self.coding(item))),
            None => None,
        };
        let alpha = alpha.as_ref().map(|(picture, coding)| (picture, *coding));
        let image = Image { color: (&color, self.coding(primary)), alpha }.decode()?;
        self.container.properties(primary).try_fold(image, |image, property| {
            Ok(match property {
                Property::Crop(crop) => {
                    let [x, y, width, height] = rectangle(crop, (image.width(), image.height()))?;
                    image.crop_imm(x, y, width, height)
                }
                // Anticlockwise.
                Property::Rotation(1) => image.rotate270(),
                Property::Rotation(2) => image.rotate180(),
                Property::Rotation(3) => image.rotate90(),
                Property::Mirror { left_and_right: true } => image.fliph(),
                Property::Mirror { left_and_right: false } => image.flipv(),
                _ => image,
            })
        })
    }

    fn coding(&self, item: u32) -> Option<Coding> {
        self.container.properties(item).find_map(|property| match property {
            Property::Color { matrix, is_full_range } => {
                Some(Coding { matrix: *matrix, is_full_range: *is_full_range })
            }
            _ => None,
        })
    }

    /// The frame of an item.
    fn frame(&self, item: u32) -> Result<Picture, String> {
        let (width, height) = self.stored_px;
        // Of a cropped image, the callers know the size of the part only.
        if u64::from(width) * u64::from(height) > MAX_WHOLE_PIXELS {
            return Err(format!("it is a part of {width} × {height} pixels, which are too many; convert it"));
        }
        let mut settings = Settings::new();
        settings.set_n_threads(1);
        settings.set_max_frame_delay(1);
        // Refuses larger frames before memory is reserved.
        settings.set_frame_size_limit(width * height);
        let mut decoder = Decoder::with_settings(&settings).map_err(|why| why.to_string())?;
        let mut sent = decoder.send_data(self.container.data(item)?, None, None, None);
        for _ in 0..MAX_CALLS {
            if let Err(why) = sent
                && !why.is_again()
            {
                return Err(format!("AV1: {why}"));
            }
            match decoder.get_picture() {
                Ok(picture) if (picture.width(), picture.height()) == self.stored_px => return Ok(picture),
                Ok(_) => return Err("its frame has another size than it states".to_owned()),
                Err(why) if !why.is_again() => return Err(format!("AV1: {why}")),
                Err(_) if sent.is_ok() => break,
                Err(_) => sent = decoder.send_pending_data(),
            }
        }
        Err("AV1: it has no frame".to_owned())
    }
}

/// Left, top, width and height of a part of an image, which must be within it. Fractions of pixels are rounded down.
fn rectangle(crop: &[(u32, u32); 4], (width, height): (u32, u32)) -> Result<[u32; 4], String> {
    let part = || -> Option<[u32; 4]> {
        let [mut at, mut sides] = [[0; 2], [0; 2]];
        for (k, full) in [width, height].into_iter().enumerate() {
            let (side, from_middle) = (crop[k], crop[k + 2]);
            sides[k] = i64::from(side.0.checked_div(side.1)?);
            let twice = (2 * i64::from(from_middle.0.cast_signed())).checked_div(from_middle.1.into())?;
            at[k] = (i64::from(full) - sides[k] + twice).div_euclid(2);
            if sides[k] < 1 || at[k] < 0 || at[k] + sides[k] > full.into() {
                return None;
            }
        }
        let [[x, y], [width, height]] = [at, sides];
        Some([x, y, width, height].map(|value| value as u32))
    };
    part().ok_or_else(|| "it shows a part that is not within it".to_owned())
}

fn size_of<'p>(mut properties: impl Iterator<Item = &'p Property>) -> Result<(u32, u32), String> {
    let size = properties.find_map(|property| match property {
        Property::Size(width, height) => Some((*width, *height)),
        _ => None,
    });
    size.ok_or_else(|| "it states no size".to_owned())
}
