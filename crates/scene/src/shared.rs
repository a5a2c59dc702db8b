//! Textures that several assets share, which are sent once per scene.
//!
//! An asset's entry lists which of its textures are byte-identical, at every level, to a texture of an earlier asset. A
//! client requests the earlier one and uses it for both. Costs some three bytes per shared texture in the scene
//! description.

use crate::encoding::{CodingError, Decode, Encode, Reader, Writer, encode_fields};

/// Most shared textures of an asset; further ones are sent for each asset.
pub const MAX_SHARED_TEXTURES: usize = 32;

/// A texture of an asset that equals an earlier texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SharedTexture {
    /// Index of the asset's texture.
    pub texture: u16,
    /// An earlier asset, or the asset itself.
    pub asset: u32,
    /// Index of the equal texture of that asset, which is not shared itself; if in the same asset, a lower index.
    pub of: u16,
}

encode_fields!(SharedTexture { texture, asset, of });

pub(crate) fn encode<W: Writer>(shared: &[SharedTexture], writer: &mut W) -> Result<(), CodingError> {
    let count = u8::try_from(shared.len()).map_err(|_| CodingError::value("too many shared textures"))?;
    count.encode(writer)?;
    shared.iter().try_for_each(|texture| texture.encode(writer))
}

pub(crate) fn decode<R: Reader>(reader: &mut R) -> Result<Vec<SharedTexture>, CodingError> {
    let count = usize::from(u8::decode(reader)?);
    if count == 0 || count > MAX_SHARED_TEXTURES {
        return Err(CodingError::value("no shared texture, or too many"));
    }
    reader.claim(count * size_of::<SharedTexture>())?;
    (0..count).map(|_| SharedTexture::decode(reader)).collect()
}

/// Whether the shared textures of asset `number` are sorted, without duplicates, and refer only to earlier textures.
pub(crate) fn in_order(number: u32, shared: &[SharedTexture]) -> bool {
    shared.len() <= MAX_SHARED_TEXTURES
        && shared.is_sorted_by(|a, b| a.texture < b.texture)
        && shared.iter().all(|s| (s.asset, s.of) < (number, s.texture))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shared(texture: u16, asset: u32, of: u16) -> SharedTexture {
        SharedTexture { texture, asset, of }
    }

    #[test]
    fn only_earlier_textures_are_shared_and_each_once() {
        assert!(in_order(3, &[shared(0, 1, 9), shared(2, 3, 1)]));
        assert!(!in_order(3, &[shared(0, 4, 0)]), "a later asset");
        assert!(!in_order(3, &[shared(1, 3, 1)]), "itself");
        assert!(!in_order(3, &[shared(1, 3, 2)]), "a later texture of itself");
        assert!(!in_order(3, &[shared(1, 0, 0), shared(1, 1, 0)]), "one twice");
        let many = (0..).map(|texture| shared(texture, 0, 0)).take(MAX_SHARED_TEXTURES + 1);
        assert!(!in_order(3, &many.collect::<Vec<_>>()), "too many");
    }
}
