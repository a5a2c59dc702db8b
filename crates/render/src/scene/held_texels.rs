//! Texels that a host has decoded, kept under numbers until the changes that name them are uploaded.

use std::collections::BTreeMap;

use lodestream_client::core::TexturePixels;

use crate::resources::texture_data::TextureData;

/// Texels of one level from a host.
#[derive(Debug)]
pub enum Texels {
    /// In memory.
    Pixels(TexturePixels),
    /// A picture that the browser has decoded.
    #[cfg(target_family = "wasm")]
    Bitmap(web_sys::ImageBitmap),
}

/// Texels by number, with the number of changes that are still to come.
#[derive(Debug, Default)]
pub(crate) struct HeldTexels(BTreeMap<u32, (u32, Texels)>);

impl HeldTexels {
    pub(crate) fn hold(&mut self, number: u32, uses: u32, texels: Texels) {
        self.0.insert(number, (uses, texels));
    }

    /// The texels of a change; none if they are not decoded.
    pub(crate) fn texels<'a>(&'a self, pixels: &'a TexturePixels) -> Option<TextureData<'a>> {
        match pixels {
            TexturePixels::Rgba8(texels) => Some(TextureData::Rgba8(texels)),
            TexturePixels::R8(texels) => Some(TextureData::R8(texels)),
            TexturePixels::R16(texels) => Some(TextureData::R16(texels)),
            TexturePixels::File { .. } => None,
            TexturePixels::Held { number, .. } => match &self.0.get(number)?.1 {
                // Numbers do not lead to numbers.
                Texels::Pixels(TexturePixels::Held { .. }) => None,
                Texels::Pixels(pixels) => self.texels(pixels),
                #[cfg(target_family = "wasm")]
                Texels::Bitmap(picture) => Some(TextureData::Bitmap(picture)),
            },
        }
    }

    /// Notes that a change is uploaded, and frees the texels after the last.
    pub(crate) fn used(&mut self, pixels: &TexturePixels) {
        let TexturePixels::Held { number, .. } = pixels else { return };
        let Some((uses, _)) = self.0.get_mut(number) else { return };
        *uses = uses.saturating_sub(1);
        if *uses == 0 {
            let freed = self.0.remove(number);
            #[cfg(target_family = "wasm")]
            if let Some((_, Texels::Bitmap(picture))) = freed {
                // Otherwise it keeps its memory until the next garbage collection.
                picture.close();
            }
            #[cfg(not(target_family = "wasm"))]
            drop(freed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texels_stay_until_their_last_use() {
        let mut held = HeldTexels::default();
        let change = TexturePixels::Held { number: 7, bytes: 2 };
        assert!(held.texels(&change).is_none());
        held.hold(7, 2, Texels::Pixels(TexturePixels::R8(vec![1, 2])));
        held.used(&change);
        assert!(matches!(held.texels(&change), Some(TextureData::R8([1, 2]))));
        held.used(&change);
        assert!(held.texels(&change).is_none());
    }
}
