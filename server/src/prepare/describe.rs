//! Imported materials and their texture files, as the description and blobs of an asset.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use lodestream_import::ImageSource;
use lodestream_import::recipe::ReliefDepth;
use lodestream_import::srgb::srgb_to_linear;
use lodestream_import::texture::{self, Texture, TextureError, TextureKind};
use lodestream_protocol::asset::{
    AssetDescription, DescriptionError, MAX_TEXTURES, Material, TextureFormat, TextureInfo, TextureLevel,
};
use lodestream_protocol::limits::{MAX_BLOB_BYTES, MAX_NAME_BYTES};

/// Depth of relief at `-bm 1`, in units of texture coordinates, where nothing else is said: brick and
/// cobble textures of a metre or two then have joints of a few centimetres.
pub const DEFAULT_RELIEF_DEPTH: f32 = 0.04;
/// Colour in place of a colour texture that is missing.
const FALLBACK_COLOR: [f32; 3] = [0.8; 3];

/// An asset's description with its texture blobs.
#[derive(Clone, Debug)]
pub struct Described {
    /// Materials and textures.
    pub description: AssetDescription,
    /// For each texture its levels, coarse first.
    pub textures: Vec<Vec<Vec<u8>>>,
    /// What was odd but could be worked around, a line each.
    pub warnings: Vec<String>,
}

/// A description that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum DescribeError {
    /// A texture of absurd size, or one that cannot be encoded.
    #[error(transparent)]
    Texture(#[from] TextureError),
    /// More textures than the protocol numbers.
    #[error("the asset uses more than {MAX_TEXTURES} textures; split it")]
    TooManyTextures,
    /// A texture level longer than a blob may be.
    #[error("{}: a level of this texture takes {bytes} bytes, above {MAX_BLOB_BYTES}; scale it down", path.display())]
    LongLevel {
        /// The texture's file.
        path: PathBuf,
        /// Length of the level.
        bytes: usize,
    },
    /// Values that the protocol refuses.
    #[error("the asset cannot be described: {0}")]
    Refused(#[from] DescriptionError),
}

/// Describes an asset: reads and encodes the textures of its materials.
///
/// Textures that are missing or unreadable become warnings, the material's colour stands in. Each file
/// is sent once per use as colours or heights.
///
/// # Errors
/// See [`DescribeError`].
pub fn describe(
    name: &str,
    materials: &[lodestream_import::Material],
    relief_depth: Option<ReliefDepth>,
) -> Result<Described, DescribeError> {
    let mut textures = Textures::default();
    let mut described = Vec::with_capacity(materials.len());
    for material in materials {
        let color = textures.index(material.color_texture.as_ref(), TextureKind::Color)?;
        let height = textures.index(material.height_texture.as_ref(), TextureKind::Height)?;
        let mut base_color = material.base_color;
        if color.is_none() && material.color_texture.is_some() && base_color == [1.0; 3] {
            base_color = FALLBACK_COLOR.map(srgb_to_linear);
        }
        let [r, g, b] = base_color;
        let depth = relief_depth.map_or(DEFAULT_RELIEF_DEPTH * material.height_scale.abs(), ReliefDepth::get);
        described.push(Material {
            name: truncated(&material.name),
            base_color: [r, g, b, material.opacity],
            roughness: material.roughness,
            base_color_texture: color,
            height_texture: height,
            relief_depth: if height.is_some() { depth.clamp(0.0, 1.0) } else { 0.0 },
            ..Material::default()
        });
    }
    let description =
        AssetDescription { name: truncated(name), materials: described, textures: textures.infos };
    // The encoder checks all limits; better here than when everything is prepared.
    description.encode()?;
    Ok(Described { description, textures: textures.levels, warnings: textures.warnings })
}

#[derive(Default)]
struct Textures {
    known: BTreeMap<(PathBuf, TextureKind), Option<u16>>,
    infos: Vec<TextureInfo>,
    levels: Vec<Vec<Vec<u8>>>,
    warnings: Vec<String>,
}

impl Textures {
    fn index(
        &mut self,
        source: Option<&ImageSource>,
        kind: TextureKind,
    ) -> Result<Option<u16>, DescribeError> {
        let Some(source) = source else { return Ok(None) };
        let key = (source.path.clone(), kind);
        if let Some(&known) = self.known.get(&key) {
            return Ok(known);
        }
        let index = match texture::load(source, kind) {
            Ok(texture) => Some(self.add(&source.path, texture)?),
            Err(error @ (TextureError::TooLarge { .. } | TextureError::Encode { .. })) => {
                return Err(error.into());
            }
            Err(error) => {
                self.warnings.push(format!("{error}; the material is drawn without it"));
                None
            }
        };
        self.known.insert(key, index);
        Ok(index)
    }

    fn add(&mut self, path: &Path, texture: Texture) -> Result<u16, DescribeError> {
        if self.infos.len() >= MAX_TEXTURES {
            return Err(DescribeError::TooManyTextures);
        }
        let finest = texture.levels.len() - 1;
        let mut levels = Vec::with_capacity(texture.levels.len());
        for (i, blob) in texture.levels.iter().enumerate() {
            let bytes = u32::try_from(blob.len()).ok().filter(|&bytes| bytes <= MAX_BLOB_BYTES);
            let bytes =
                bytes.ok_or_else(|| DescribeError::LongLevel { path: path.to_owned(), bytes: blob.len() })?;
            let shift = finest - i;
            levels.push(TextureLevel {
                width: (texture.width_px >> shift).max(1),
                height: (texture.height_px >> shift).max(1),
                bytes,
                format: if blob.starts_with(b"\x89PNG") { TextureFormat::Png } else { TextureFormat::Jpeg },
            });
        }
        self.infos.push(TextureInfo {
            kind: match texture.kind {
                TextureKind::Color => lodestream_protocol::asset::TextureKind::Color,
                TextureKind::Height => lodestream_protocol::asset::TextureKind::Height,
            },
            width: texture.width_px,
            height: texture.height_px,
            mean: texture.mean,
            levels,
        });
        self.levels.push(texture.levels);
        Ok((self.infos.len() - 1) as u16)
    }
}

/// A name cut to what the protocol carries, between characters.
fn truncated(name: &str) -> String {
    name[..name.floor_char_boundary(MAX_NAME_BYTES)].to_owned()
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma, Rgb, RgbImage};
    use tempfile::TempDir;

    use super::*;

    #[test]
    fn a_textured_material_names_its_blobs() {
        let dir = TempDir::new().unwrap();
        let (color, height) = (dir.path().join("c.png"), dir.path().join("h.png"));
        RgbImage::from_pixel(32, 16, Rgb([9, 200, 30])).save(&color).unwrap();
        GrayImage::from_fn(64, 64, |x, y| Luma([(x * y) as u8])).save(&height).unwrap();
        let brick = lodestream_import::Material {
            name: "brick".repeat(99),
            base_color: [1.0; 3],
            color_texture: Some(color.into()),
            height_texture: Some(height.into()),
            height_scale: 0.5,
            ..lodestream_import::Material::default()
        };
        let again = lodestream_import::Material { name: "same".into(), ..brick.clone() };
        let described = describe("wall", &[brick, again], None).unwrap();
        assert!(described.warnings.is_empty(), "{:?}", described.warnings);
        let AssetDescription { materials, textures, .. } = &described.description;
        assert_eq!(materials[0].name.len(), MAX_NAME_BYTES);
        assert_eq!(materials[0].relief_depth, DEFAULT_RELIEF_DEPTH / 2.0);
        assert_eq!(materials[1].base_color_texture, Some(0));
        assert_eq!(textures.len(), 2);
        assert_eq!(
            textures[0].levels.iter().map(|l| (l.width, l.height)).collect::<Vec<_>>(),
            [(8, 4), (16, 8), (32, 16)]
        );
        assert_eq!(
            textures.iter().map(|texture| texture.mean).collect::<Vec<_>>(),
            [Some([9, 200, 30]), None]
        );
        for (info, blobs) in textures.iter().zip(&described.textures) {
            let lengths: Vec<usize> = info.levels.iter().map(|l| l.bytes as usize).collect();
            assert_eq!(lengths, blobs.iter().map(Vec::len).collect::<Vec<_>>());
        }
        let fixed =
            describe("wall", &[lodestream_import::Material::default()], ReliefDepth::try_from(0.3).ok())
                .unwrap();
        assert_eq!(fixed.description.materials[0].relief_depth, 0.0);
    }

    #[test]
    fn a_missing_texture_is_a_warning_and_a_colour() {
        let material = lodestream_import::Material {
            base_color: [1.0; 3],
            color_texture: Some(PathBuf::from("/no/brick.png").into()),
            ..lodestream_import::Material::default()
        };
        let described = describe("wall", &[material], None).unwrap();
        assert_eq!(described.warnings.len(), 1);
        assert!(described.warnings[0].contains("/no/brick.png: cannot be read"), "{:?}", described.warnings);
        let shown = &described.description.materials[0];
        assert_eq!(shown.base_color_texture, None);
        assert_eq!(shown.base_color[0], srgb_to_linear(0.8));
    }
}
