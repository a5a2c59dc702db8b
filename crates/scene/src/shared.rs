//! Textures that several assets share, which are sent once per scene.
//!
//! An asset's entry lists which of its textures are byte-identical, at every level, to a texture of an earlier asset. A
//! client requests the earlier one and uses it for both. Costs some three bytes per shared texture in the scene
//! description.

use bincode::de::Decoder;
use bincode::enc::Encoder;
use bincode::error::{DecodeError, EncodeError};
use bincode::{Decode, Encode};

/// Most shared textures of an asset; further ones are sent for each asset.
pub const MAX_SHARED_TEXTURES: usize = 32;

/// A texture of an asset that equals an earlier texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct SharedTexture {
    /// Index of the asset's texture.
    pub texture: u16,
    /// An earlier asset, or the asset itself.
    pub asset: u32,
    /// Index of the equal texture of that asset, which is not shared itself; if in the same asset, a lower index.
    pub of: u16,
}

pub(crate) fn encode<E: Encoder>(shared: &[SharedTexture], e: &mut E) -> Result<(), EncodeError> {
    let count = u8::try_from(shared.len()).map_err(|_| EncodeError::Other("too many shared textures"))?;
    count.encode(e)?;
    shared.iter().try_for_each(|texture| texture.encode(e))
}

pub(crate) fn decode<D: Decoder<Context = C>, C>(d: &mut D) -> Result<Vec<SharedTexture>, DecodeError> {
    let count = usize::from(u8::decode(d)?);
    if count == 0 || count > MAX_SHARED_TEXTURES {
        return Err(DecodeError::Other("no shared texture, or too many"));
    }
    d.claim_bytes_read(count * size_of::<SharedTexture>())?;
    (0..count).map(|_| SharedTexture::decode(d)).collect()
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
