//! What an asset looks like beyond its geometry: materials and textures.
//!
//! Travels inside the base mesh (`geometry::base::Base::description`, opaque there), so it is part of
//! the first flight: an untextured mesh of one material takes about 20 bytes.

use bincode::{Decode, Encode};

pub use crate::coding::CodingError;
use crate::coding::{decode_description, encode_description};
use crate::limits::{MAX_BLOB_BYTES, MAX_NAME_BYTES};

/// Most materials of an asset.
pub const MAX_MATERIALS: usize = 4096;
/// Most textures of an asset.
pub const MAX_TEXTURES: usize = 4096;
/// Most levels of a texture: 2^15 texels and the levels below.
pub const MAX_TEXTURE_LEVELS: usize = 16;

/// Materials and textures of one asset.
#[derive(Clone, Debug, Default, PartialEq, Encode, Decode)]
pub struct AssetDescription {
    /// Name for people.
    pub name: String,
    /// Materials, in the order that faces refer to.
    pub materials: Vec<Material>,
    /// Textures, in the order that materials and [`crate::BlobPart::Texture`] refer to.
    pub textures: Vec<TextureInfo>,
}

/// Surface parameters of the faces that name this material.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name for people.
    pub name: String,
    /// Linear red, green, blue and opacity, each in 0..=1; kept in steps of 1/65535. Multiplies the
    /// base colour texture, if any.
    pub base_color: [f32; 4],
    /// Roughness in 0..=1, kept in steps of 1/255.
    pub roughness: f32,
    /// Index of the colour texture.
    pub base_color_texture: Option<u16>,
    /// Index of the height map for relief mapping; white is the surface, black is the deepest point.
    pub height_texture: Option<u16>,
    /// Depth of black in the height map below the surface, in units of texture coordinates
    /// (uv space: 0.05 is a twentieth of the texture's width). Zero without height map.
    pub relief_depth: f32,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: [0.8, 0.8, 0.8, 1.0],
            roughness: 0.8,
            base_color_texture: None,
            height_texture: None,
            relief_depth: 0.0,
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // clamped to the range first
fn to_u16(x: f32) -> u16 {
    (x.clamp(0.0, 1.0) * 65_535.0).round() as u16
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn to_u8(x: f32) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0).round() as u8
}

const HAS_COLOR: u8 = 1;
const HAS_HEIGHT: u8 = 2;

// By hand: one byte of flags instead of one per option, and fixed-point colours (8 bytes, not 20).
impl Encode for Material {
    fn encode<E: bincode::enc::Encoder>(&self, e: &mut E) -> Result<(), bincode::error::EncodeError> {
        let flags = if self.base_color_texture.is_some() { HAS_COLOR } else { 0 }
            | if self.height_texture.is_some() { HAS_HEIGHT } else { 0 };
        flags.encode(e)?;
        self.name.encode(e)?;
        for x in self.base_color {
            to_u16(x).to_le_bytes().encode(e)?;
        }
        to_u8(self.roughness).encode(e)?;
        if let Some(texture) = self.base_color_texture {
            texture.encode(e)?;
        }
        if let Some(texture) = self.height_texture {
            texture.encode(e)?;
            self.relief_depth.encode(e)?;
        }
        Ok(())
    }
}

impl<Context> Decode<Context> for Material {
    fn decode<D: bincode::de::Decoder<Context = Context>>(
        d: &mut D,
    ) -> Result<Self, bincode::error::DecodeError> {
        let flags = u8::decode(d)?;
        if flags & !(HAS_COLOR | HAS_HEIGHT) != 0 {
            return Err(bincode::error::DecodeError::Other("unknown material flags"));
        }
        let name = String::decode(d)?;
        let mut base_color = [0.0; 4];
        for x in &mut base_color {
            *x = f32::from(u16::from_le_bytes(<[u8; 2]>::decode(d)?)) / 65_535.0;
        }
        let roughness = f32::from(u8::decode(d)?) / 255.0;
        let base_color_texture = if flags & HAS_COLOR == 0 { None } else { Some(u16::decode(d)?) };
        let (height_texture, relief_depth) =
            if flags & HAS_HEIGHT == 0 { (None, 0.0) } else { (Some(u16::decode(d)?), f32::decode(d)?) };
        Ok(Self { name, base_color, roughness, base_color_texture, height_texture, relief_depth })
    }
}

/// What the texels of a texture mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum TextureKind {
    /// Colour, sRGB as in the image file; alpha if the file has it.
    Color,
    /// Heights for relief mapping, one channel, linear, lossless.
    Height,
}

/// Image format of a texture level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub enum TextureFormat {
    /// JPEG, for opaque colour.
    Jpeg,
    /// PNG, for heights and for colour with alpha.
    Png,
}

/// A texture: its size and the levels it is sent in.
#[derive(Clone, Debug, PartialEq, Eq, Encode, Decode)]
pub struct TextureInfo {
    /// What the texels mean.
    pub kind: TextureKind,
    /// Width of the finest level, in texels.
    pub width: u32,
    /// Height of the finest level, in texels.
    pub height: u32,
    /// Mean colour, sRGB, its mean taken in linear light and by opacity: what the texture is drawn as until its first
    /// level is here. Of colours alone.
    pub mean: Option<[u8; 3]>,
    /// Levels, coarsest first; each is a whole image, at least one.
    pub levels: Vec<TextureLevel>,
}

/// One level of a texture: one blob.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Encode, Decode)]
pub struct TextureLevel {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Length of the image file, in bytes.
    pub bytes: u32,
    /// Format of the image file.
    pub format: TextureFormat,
}

/// Width and height of a texture's level, of which there are `levels`: each level is half as wide and high as the
/// next finer one, the last as large as `finest`. Level 0 is the coarsest.
#[must_use]
pub fn level_size(finest: [u32; 2], levels: u32, level: u32) -> [u32; 2] {
    let halvings = levels.saturating_sub(level.saturating_add(1));
    finest.map(|side| side.checked_shr(halvings).unwrap_or(0).max(1))
}

/// A description that cannot be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DescriptionError {
    /// Longer than [`MAX_NAME_BYTES`].
    #[error("the asset's name is too long")]
    AssetName,
    /// More than [`MAX_MATERIALS`].
    #[error("too many materials")]
    TooManyMaterials,
    /// More than [`MAX_TEXTURES`].
    #[error("too many textures")]
    TooManyTextures,
    /// Longer than [`MAX_NAME_BYTES`].
    #[error("a material's name is too long")]
    MaterialName,
    /// An index beyond the last.
    #[error("a material names a missing texture")]
    MissingTexture,
    /// A depth that is none.
    #[error("a relief depth is not a finite positive number")]
    ReliefDepth,
    /// At least one, at most [`MAX_TEXTURE_LEVELS`].
    #[error("a texture has no level, or too many")]
    LevelCount,
    /// A level smaller than the one before.
    #[error("a texture's levels are not ordered coarse to fine")]
    LevelOrder,
    /// Longer than [`MAX_BLOB_BYTES`].
    #[error("a texture level is too long")]
    LevelTooLong,
    /// Another than the texture's.
    #[error("a texture's finest level has another size")]
    FinestLevel,
    /// More than 2^15 texels a side.
    #[error("a texture is too large")]
    TextureTooLarge,
    /// The bytes are no description.
    #[error(transparent)]
    Coding(#[from] CodingError),
}

impl AssetDescription {
    /// Encodes the description.
    ///
    /// # Errors
    /// Refuses descriptions that [`AssetDescription::decode`] would refuse.
    pub fn encode(&self) -> Result<Vec<u8>, DescriptionError> {
        self.check()?;
        Ok(encode_description(self)?)
    }

    /// Decodes a description, all of `bytes`.
    ///
    /// # Errors
    /// Refuses truncated, overlong and inconsistent descriptions.
    pub fn decode(bytes: &[u8]) -> Result<Self, DescriptionError> {
        let this: Self = decode_description(bytes)?;
        this.check()?;
        Ok(this)
    }

    fn check(&self) -> Result<(), DescriptionError> {
        let ensure = |ok: bool, why| if ok { Ok(()) } else { Err(why) };
        ensure(self.name.len() <= MAX_NAME_BYTES, DescriptionError::AssetName)?;
        ensure(self.materials.len() <= MAX_MATERIALS, DescriptionError::TooManyMaterials)?;
        ensure(self.textures.len() <= MAX_TEXTURES, DescriptionError::TooManyTextures)?;
        let textures = self.textures.len();
        for material in &self.materials {
            ensure(material.name.len() <= MAX_NAME_BYTES, DescriptionError::MaterialName)?;
            let known = |t: Option<u16>| t.is_none_or(|t| usize::from(t) < textures);
            ensure(
                known(material.base_color_texture) && known(material.height_texture),
                DescriptionError::MissingTexture,
            )?;
            ensure(
                material.relief_depth.is_finite() && material.relief_depth >= 0.0,
                DescriptionError::ReliefDepth,
            )?;
        }
        for texture in &self.textures {
            ensure((1..=MAX_TEXTURE_LEVELS).contains(&texture.levels.len()), DescriptionError::LevelCount)?;
            let mut last = (0, 0);
            for level in &texture.levels {
                ensure(
                    level.width >= last.0.max(1) && level.height >= last.1.max(1),
                    DescriptionError::LevelOrder,
                )?;
                ensure(level.bytes <= MAX_BLOB_BYTES, DescriptionError::LevelTooLong)?;
                last = (level.width, level.height);
            }
            ensure(last == (texture.width, texture.height), DescriptionError::FinestLevel)?;
            ensure(texture.width <= 1 << 15 && texture.height <= 1 << 15, DescriptionError::TextureTooLarge)?;
        }
        Ok(())
    }
}

bincode::impl_borrow_decode!(Material);

#[cfg(test)]
mod tests {
    use super::*;

    fn textured() -> AssetDescription {
        AssetDescription {
            name: "wall".into(),
            materials: vec![Material {
                name: "brick".into(),
                base_color: [1.0, 0.5, 0.0, 1.0],
                roughness: 1.0,
                base_color_texture: Some(0),
                height_texture: Some(1),
                relief_depth: 0.05,
            }],
            textures: [TextureKind::Color, TextureKind::Height]
                .map(|kind| TextureInfo {
                    kind,
                    width: 512,
                    height: 256,
                    mean: (kind == TextureKind::Color).then_some([180, 90, 40]),
                    levels: vec![
                        TextureLevel { width: 64, height: 32, bytes: 900, format: TextureFormat::Jpeg },
                        TextureLevel { width: 512, height: 256, bytes: 30_000, format: TextureFormat::Png },
                    ],
                })
                .to_vec(),
        }
    }

    #[test]
    fn plain_description_is_tiny() {
        let plain = AssetDescription {
            name: "bunny".into(),
            materials: vec![Material::default()],
            textures: Vec::new(),
        };
        let bytes = plain.encode().unwrap();
        assert!(bytes.len() <= 20, "{} bytes", bytes.len());
        let back = AssetDescription::decode(&bytes).unwrap();
        assert_eq!(back.name, "bunny");
        for (a, b) in back.materials[0].base_color.iter().zip(plain.materials[0].base_color) {
            assert!((a - b).abs() < 1e-4);
        }
    }

    #[test]
    fn description_round_trips_and_every_truncation_is_refused() {
        let bytes = textured().encode().unwrap();
        let back = AssetDescription::decode(&bytes).unwrap();
        assert_eq!(back.encode().unwrap(), bytes);
        assert_eq!(back.textures, textured().textures);
        for length in 0..bytes.len() {
            assert!(AssetDescription::decode(&bytes[..length]).is_err(), "length {length}");
        }
        let mut longer = bytes;
        longer.push(0);
        assert_eq!(AssetDescription::decode(&longer), Err(CodingError::TrailingBytes { left: 1 }.into()));
    }

    #[test]
    fn inconsistent_descriptions_are_refused() {
        let mut missing = textured();
        missing.textures.pop();
        assert!(missing.encode().is_err());
        let mut unordered = textured();
        unordered.textures[0].levels.reverse();
        assert!(unordered.encode().is_err());
    }

    proptest::proptest! {
        #[test]
        fn random_bytes_never_panic(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..300)) {
            let _ = AssetDescription::decode(&bytes);
        }
    }
}
