//! Collects the textures of an asset; equal sources become one texture.

use std::collections::BTreeMap;
use std::path::Path;

use lodestream_geometry::pool::Pool;
use lodestream_import::ImageSource;
use lodestream_import::texture::{
    self, Level, Texture, TextureError, TextureSettings, TextureSource, Transparency,
};
use lodestream_scene::asset::{MAX_TEXTURES, TextureFormat, TextureInfo, TextureLevel};
use lodestream_scene::limits::MAX_BLOB_BYTES;

use super::error::DescribeError;

/// Textures encoded so far.
pub(super) struct Textures<'a> {
    settings: TextureSettings,
    pool: &'a dyn Pool,
    known: BTreeMap<(TextureSource, bool), Option<EncodedTexture>>,
    pub(super) infos: Vec<TextureInfo>,
    pub(super) levels: Vec<Vec<Level>>,
    pub(super) warnings: Vec<String>,
}

/// The texture of a source.
#[derive(Clone)]
pub(super) struct EncodedTexture {
    pub(super) index: u16,
    pub(super) transparency: Transparency,
    /// The source, without images that could not be read.
    pub(super) of: TextureSource,
}

impl<'a> Textures<'a> {
    /// None; the pool encodes them.
    pub(super) fn new(settings: TextureSettings, pool: &'a dyn Pool) -> Self {
        let (known, infos, levels, warnings) = Default::default();
        Self { settings, pool, known, infos, levels, warnings }
    }

    /// Encodes a source's texture. Unreadable images become warnings and are omitted from it.
    pub(super) fn make(
        &mut self,
        source: Option<TextureSource>,
    ) -> Result<Option<EncodedTexture>, DescribeError> {
        source.map_or(Ok(None), |source| self.made(source, false))
    }

    /// Encodes heights, or a normal map if the image is one: exporters write them under the same keyword.
    pub(super) fn heights_or_normals(
        &mut self,
        image: ImageSource,
    ) -> Result<Option<EncodedTexture>, DescribeError> {
        self.made(TextureSource::Height(image), true)
    }

    fn made(
        &mut self,
        source: TextureSource,
        or_normals: bool,
    ) -> Result<Option<EncodedTexture>, DescribeError> {
        let key = (source.clone(), or_normals);
        if let Some(known) = self.known.get(&key) {
            return Ok(known.clone());
        }
        let mut left = Some(source);
        let mut made = None;
        while let Some(of) = left.take() {
            match (texture::load(&of, self.settings, self.pool), &of) {
                (Ok(texture), _) => {
                    let transparency = texture.transparency;
                    let path = of.first_image().map(|image| image.path.clone()).unwrap_or_default();
                    made = Some(EncodedTexture { index: self.add(&path, texture)?, transparency, of });
                }
                (Err(TextureError::NormalMap { .. }), TextureSource::Height(image)) if or_normals => {
                    made = self.made(TextureSource::Normal(image.clone()), false)?;
                }
                (
                    Err(
                        error @ (TextureError::TooLarge { .. }
                        | TextureError::TooLong { .. }
                        | TextureError::Encode { .. }),
                    ),
                    _,
                ) => {
                    return Err(error.into());
                }
                (Err(error), _) => {
                    left = of.without(error.path());
                    self.warn(format!("{error}; the material is drawn without it"));
                }
            }
        }
        self.known.insert(key, made.clone());
        Ok(made)
    }

    fn warn(&mut self, what: String) {
        if !self.warnings.contains(&what) {
            self.warnings.push(what);
        }
    }

    fn add(&mut self, path: &Path, texture: Texture) -> Result<u16, DescribeError> {
        if self.infos.len() >= MAX_TEXTURES {
            return Err(DescribeError::TooManyTextures);
        }
        let finest = texture.levels.len() - 1;
        let mut levels = Vec::with_capacity(texture.levels.len());
        for (i, images) in texture.levels.iter().enumerate() {
            let longest = images.iter().map(Vec::len).max().unwrap_or_default();
            if longest > MAX_BLOB_BYTES as usize {
                return Err(DescribeError::LongLevel { path: path.to_owned(), bytes: longest });
            }
            let all: usize = images.iter().map(Vec::len).sum();
            let bytes = u32::try_from(all.div_ceil(images.len().max(1))).unwrap_or(u32::MAX);
            let shift = finest - i;
            levels.push(TextureLevel {
                width: (texture.width_px >> shift).max(1),
                height: (texture.height_px >> shift).max(1),
                bytes,
                format: format(images.first().map_or(&[], |image| image)),
            });
        }
        self.infos.push(TextureInfo {
            kind: texture.kind,
            width: texture.width_px,
            height: texture.height_px,
            planes: texture.planes,
            mean: texture.mean,
            // Known once the mesh is (`texture_regions`).
            uv_per_unit: 0.0,
            levels,
        });
        self.levels.push(texture.levels);
        Ok((self.infos.len() - 1) as u16)
    }
}

/// Format of a file that the importer has written.
fn format(file: &[u8]) -> TextureFormat {
    match file {
        [b'R', b'I', b'F', b'F', ..] => TextureFormat::WebP,
        [0x89, ..] => TextureFormat::Png,
        _ => TextureFormat::Jpeg,
    }
}
