//! What an asset looks like beyond its geometry: materials and textures.
//!
//! Travels inside the base mesh (`geometry::base::Base::description`, opaque there), so it is part of
//! the first flight: an untextured mesh of one material takes about 20 bytes.

mod material;
mod planes;
mod shares;
mod specular;
mod texture_regions;
pub mod tiles;

pub use self::planes::{NORMAL_PLANES, Planes};
pub use self::specular::{ClearCoat, Specular};
pub use self::texture_regions::{MAX_TEXTURE_REGIONS, TexturePatch, TextureRegion, TextureRegions, cells_of};
pub use self::tiles::{TILE_BORDER, TILE_SIDE, is_tiled, tile_grid, tile_place, tile_size};

pub use self::material::{Alpha, MAX_EMISSION, MAX_NORMAL_SCALE, Material, SecondUv, Wrap};
pub use crate::encoding::CodingError;
use crate::encoding::{self, encode_fields, encode_variants};
use crate::limits::{MAX_BLOB_BYTES, MAX_DESCRIPTION_BYTES, MAX_NAME_BYTES};

/// Most materials of an asset.
pub const MAX_MATERIALS: usize = 4096;
/// Most textures of an asset.
pub const MAX_TEXTURES: usize = 4096;
/// Most levels of a texture: 2^15 texels and the levels below.
pub const MAX_TEXTURE_LEVELS: usize = 16;
/// Most memory that a decoded description may take, in bytes.
const MAX_MEMORY_BYTES: usize = 4 * MAX_DESCRIPTION_BYTES;

/// Materials and textures of one asset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AssetDescription {
    /// Name for people.
    pub name: String,
    /// Materials, in the order that faces refer to.
    pub materials: Vec<Material>,
    /// Textures, in the order that materials and [`crate::BlobPart::Texture`] refer to.
    pub textures: Vec<TextureInfo>,
}

encode_fields!(AssetDescription { name, materials, textures });

/// Meaning of a texture's texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureKind {
    /// Colour, sRGB as in the image file; alpha if the file has it.
    Color,
    /// Heights for relief mapping, one channel, linear, lossless.
    Height,
    /// Normals, linear: a component c is stored as (c + 1) / 2; x along u, y along v upwards, z out of the surface.
    Normal,
    /// Occlusion of ambient light (red, 1: open), roughness (green) and metal (blue), linear.
    Surface,
}

encode_variants!(TextureKind { 0 => Color, 1 => Height, 2 => Normal, 3 => Surface });

/// Image format of a texture level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextureFormat {
    /// JPEG, for colours with fine chroma.
    Jpeg,
    /// PNG, for heights, and where it is smaller.
    Png,
    /// WebP: colours, with alpha or without, or grey [`Planes`].
    WebP,
}

encode_variants!(TextureFormat { 0 => Jpeg, 1 => Png, 2 => WebP });

/// A texture: its size and its levels.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureInfo {
    /// Meaning of the texels.
    pub kind: TextureKind,
    /// Width of the finest level, in texels.
    pub width: u32,
    /// Height of the finest level, in texels.
    pub height: u32,
    /// Channels that WebP files hold as [`Planes`]: 1 red, 2 green, 4 blue. [`NORMAL_PLANES`] for normals; for surfaces
    /// those that are not `mean` everywhere; 0 for colours and heights.
    pub planes: u8,
    /// Mean colour, drawn until the first level arrives: sRGB, averaged in linear light and weighted by opacity; for
    /// surface textures the mean of each channel. `None` for heights and normals.
    pub mean: Option<[u8; 3]>,
    /// Texture coordinates per unit of the asset: the square root of uv area over area, of the input's faces that show
    /// it. 0 if none has an area.
    pub uv_per_unit: f32,
    /// Levels, coarsest first, at least one; each is an image of its own, or cut into tiles ([`is_tiled`]).
    pub levels: Vec<TextureLevel>,
}

encode_fields!(TextureInfo { kind, width, height, planes, mean, uv_per_unit, levels });

/// One level of a texture: one blob, or one for each of its tiles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TextureLevel {
    /// Width in texels.
    pub width: u32,
    /// Height in texels.
    pub height: u32,
    /// Length of the image file, in bytes; of a level that is cut, the mean over its tiles.
    pub bytes: u32,
    /// Format of the image file; of a level that is cut, of its first tile.
    pub format: TextureFormat,
}

encode_fields!(TextureLevel { width, height, bytes, format });

/// Width and height of a texture's level, of which there are `levels`: each level is half as wide and high as the
/// next finer one, the last as large as `finest`. Level 0 is the coarsest.
#[must_use]
pub fn level_size(finest: [u32; 2], levels: u32, level: u32) -> [u32; 2] {
    let halvings = levels.saturating_sub(level.saturating_add(1));
    finest.map(|side| side.checked_shr(halvings).unwrap_or(0).max(1))
}

/// An asset description with an invalid value.
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
    /// A depth that is not a finite positive number.
    #[error("a relief depth is not a finite positive number")]
    ReliefDepth,
    /// An emission that is not from 0 to [`MAX_EMISSION`].
    #[error("a material's emission is not from 0 to {MAX_EMISSION}")]
    Emission,
    /// A scale that is not from 0 to [`MAX_NORMAL_SCALE`].
    #[error("a normal map's scale is not from 0 to {MAX_NORMAL_SCALE}")]
    NormalScale,
    /// Transmission of a material that is not blended.
    #[error("a material transmits light but is not blended")]
    Transmission,
    /// At least one, at most [`MAX_TEXTURE_LEVELS`].
    #[error("a texture has no level, or too many")]
    LevelCount,
    /// A level smaller than the one before.
    #[error("a texture's levels are not ordered coarse to fine")]
    LevelOrder,
    /// Longer than [`MAX_BLOB_BYTES`].
    #[error("a texture level is too long")]
    LevelTooLong,
    /// A size other than the texture's.
    #[error("a texture's finest level has another size")]
    FinestLevel,
    /// A coarsest level that is cut into tiles.
    #[error("a texture's coarsest level is larger than a tile")]
    CoarsestLevel,
    /// Planes that textures of the kind do not have, or a surface without a mean.
    #[error("a texture has planes that its kind does not have")]
    Planes,
    /// A density that is not a finite number from 0.
    #[error("a texture's density is not a finite number that is not below 0")]
    TextureDensity,
    /// More than 2^15 texels a side.
    #[error("a texture is too large")]
    TextureTooLarge,
    /// The bytes do not decode.
    #[error(transparent)]
    Coding(#[from] CodingError),
}

/// Checks the length of an encoded description.
fn check_length(bytes: &[u8]) -> Result<(), CodingError> {
    if bytes.len() > MAX_DESCRIPTION_BYTES {
        return Err(CodingError::TooLong { bytes: bytes.len(), limit: MAX_DESCRIPTION_BYTES });
    }
    Ok(())
}

impl AssetDescription {
    /// Encodes the description.
    ///
    /// # Errors
    /// Refuses descriptions that [`AssetDescription::decode`] would refuse.
    pub fn encode(&self) -> Result<Vec<u8>, DescriptionError> {
        self.check()?;
        let bytes = encoding::encode(self)?;
        check_length(&bytes)?;
        Ok(bytes)
    }

    /// Decodes a description, all of `bytes`.
    ///
    /// # Errors
    /// Refuses truncated, overlong and inconsistent descriptions.
    pub fn decode(bytes: &[u8]) -> Result<Self, DescriptionError> {
        check_length(bytes)?;
        let this: Self = encoding::decode(bytes, MAX_MEMORY_BYTES)?;
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
            let known = material.textures().all(|texture| usize::from(texture) < textures);
            ensure(known, DescriptionError::MissingTexture)?;
            let lit = material.emission.iter().all(|light| (0.0..=MAX_EMISSION).contains(light));
            ensure(lit, DescriptionError::Emission)?;
            ensure((0.0..=MAX_NORMAL_SCALE).contains(&material.normal_scale), DescriptionError::NormalScale)?;
            let may_transmit = material.alpha == Alpha::Blend || material.transmission == 0.0;
            ensure(may_transmit, DescriptionError::Transmission)?;
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
            ensure(texture.has_valid_planes(), DescriptionError::Planes)?;
            ensure(texture.whole_levels() > 0, DescriptionError::CoarsestLevel)?;
            ensure(
                texture.uv_per_unit >= 0.0 && texture.uv_per_unit.is_finite(),
                DescriptionError::TextureDensity,
            )?;
            ensure(texture.width <= 1 << 15 && texture.height <= 1 << 15, DescriptionError::TextureTooLarge)?;
        }
        Ok(())
    }
}

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
                ..Material::default()
            }],
            textures: [TextureKind::Color, TextureKind::Height]
                .map(|kind| TextureInfo {
                    kind,
                    width: 512,
                    height: 256,
                    planes: 0,
                    mean: (kind == TextureKind::Color).then_some([180, 90, 40]),
                    uv_per_unit: 0.5,
                    levels: vec![
                        TextureLevel { width: 64, height: 32, bytes: 900, format: TextureFormat::Jpeg },
                        TextureLevel { width: 256, height: 128, bytes: 9000, format: TextureFormat::WebP },
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

    #[test]
    fn planes_that_a_kind_does_not_have_are_refused() {
        use TextureKind::{Color, Height, Normal, Surface};
        let encoded = |kind, planes, mean: Option<[u8; 3]>| {
            let mut description = textured();
            description.textures[0] = TextureInfo { kind, planes, mean, ..description.textures[0].clone() };
            description.encode().map(|bytes| AssetDescription::decode(&bytes).unwrap().textures[0].planes)
        };
        let (mean, refused) = (Some([1, 2, 3]), Err(DescriptionError::Planes));
        for planes in 0..=u8::MAX {
            let only = |right: bool| if right { Ok(planes) } else { refused.clone() };
            assert_eq!(encoded(Color, planes, mean), only(planes == 0));
            assert_eq!(encoded(Height, planes, None), only(planes == 0));
            assert_eq!(encoded(Normal, planes, None), only(planes == NORMAL_PLANES));
            assert_eq!(encoded(Surface, planes, mean), only(planes < 8));
            assert_eq!(encoded(Surface, planes, None), only(planes == 7), "others need a value");
        }
    }

    fn full_material() -> Material {
        Material {
            metallic: 0.2,
            specular: Specular::of_bytes([51, 255, 0, 102]),
            clear_coat: ClearCoat { factor: 0.8, roughness: 0.2 },
            emission: [12.5, 0.0, 1e-6],
            alpha: Alpha::Mask(0.6),
            unlit: true,
            flat: true,
            wrap: [Wrap::Mirror, Wrap::Clamp],
            surface_texture: Some(1),
            normal_texture: Some(1),
            normal_scale: 0.5,
            emission_texture: Some(0),
            ..textured().materials[0].clone()
        }
    }

    #[test]
    fn all_material_fields_round_trip() {
        let fields: [fn(&mut Material); 14] = [
            |m| m.metallic = 0.0,
            |m| m.specular = Specular::default(),
            |m| m.clear_coat = ClearCoat::default(),
            |m| m.emission = [0.0; 3],
            |m| m.alpha = Alpha::Blend,
            |m| (m.alpha, m.transmission) = (Alpha::Blend, 0.4),
            |m| m.unlit = false,
            |m| m.flat = false,
            |m| m.wrap = [Wrap::Repeat, Wrap::Mirror],
            |m| m.surface_texture = None,
            |m| (m.normal_texture, m.normal_scale) = (None, 1.0),
            |m| m.emission_texture = None,
            |m| m.base_color_texture = None,
            |m| (m.height_texture, m.relief_depth) = (None, 0.0),
        ];
        for mask in 0..1_u32 << fields.len() {
            let mut description = textured();
            description.materials[0] = full_material();
            for (i, without) in fields.iter().enumerate() {
                if mask & (1 << i) != 0 {
                    without(&mut description.materials[0]);
                }
            }
            let bytes = description.encode().unwrap();
            let back = AssetDescription::decode(&bytes).unwrap();
            assert_eq!(back.materials[0].wrap, description.materials[0].wrap);
            assert_eq!(back.encode().unwrap(), bytes, "{mask:b}");
            // 0.2 and 0.6 are whole 255ths, so all is exact but the base colour.
            let exact = |m: &Material| Material { base_color: [0.0; 4], ..m.clone() };
            assert_eq!(exact(&back.materials[0]), exact(&description.materials[0]), "{mask:b}");
        }
    }

    #[test]
    fn invalid_materials_are_refused() {
        let refused = |change: fn(&mut Material), why| {
            let mut description = textured();
            change(&mut description.materials[0]);
            assert_eq!(description.encode(), Err(why));
        };
        refused(|m| m.emission[1] = f32::NAN, DescriptionError::Emission);
        refused(|m| m.emission[2] = 2.0 * MAX_EMISSION, DescriptionError::Emission);
        refused(|m| m.normal_scale = -1.0, DescriptionError::NormalScale);
        refused(|m| m.transmission = 0.5, DescriptionError::Transmission);
        refused(|m| m.emission_texture = Some(2), DescriptionError::MissingTexture);
        // On the wire: mask and blend together, an unknown wrap mode, an invalid flag for metal.
        let plain =
            AssetDescription { name: String::new(), materials: vec![Material::default()], textures: vec![] };
        let bytes = plain.encode().unwrap();
        let flags = bytes.iter().position(|&b| b == 0).unwrap() + 2;
        let with = |first: u8, last: &[u8]| {
            let mut bytes = bytes.clone();
            bytes[flags] = first;
            let end = bytes.len() - 1;
            bytes.splice(end..end, last.iter().copied());
            AssetDescription::decode(&bytes)
        };
        assert!(with(0, &[]).is_ok() && with(4, &[9]).is_ok() && with(128, &[2]).is_ok());
        for (first, last) in [(4, 0), (128, 0), (128, 3), (128, 24), (128, 131)] {
            assert!(with(first, &[last]).is_err(), "{first} {last}");
        }
        // A third byte: of nothing, unknown, mask and blend together, of the usual specular, of a coat that covers
        // nothing, of transmission that is none or not blended, of less than it says.
        assert!(
            with(128, &[3, 12, 1, 2, 3, 4, 5, 6]).is_ok()
                && with(128, &[3, 18, 9]).is_ok()
                && with(128, &[3, 4, 1, 2, 3, 4]).is_ok()
                && with(128, &[3, 5, 9, 1, 2, 3, 4]).is_ok()
        );
        for last in [
            &[3, 0][..],
            &[3, 2],
            &[3, 36, 1, 2, 3, 4],
            &[3, 7, 1, 2, 3, 4],
            &[3, 4, 51, 51, 51, 255],
            &[3, 8, 0, 9],
            &[3, 18, 0],
            &[3, 16, 9],
            &[3, 4, 1],
        ] {
            assert!(with(128, last).is_err(), "{last:?}");
        }
    }

    proptest::proptest! {
        #[test]
        fn random_bytes_never_panic(bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..300)) {
            let _ = AssetDescription::decode(&bytes);
        }
    }
}
