//! How good lossy files are, and how much work goes into making them small.

use crate::setting;

setting! {
    /// Quality of textures: that of WebP files (libwebp), which colours, normals and surfaces share; at 100 all are
    /// lossless PNG.
    TextureQuality(u8), 1..=100, "steps of quality"
}

impl Eq for TextureQuality {}

impl Default for TextureQuality {
    /// Pictures of scans and models differ from those of lossless textures by 0.007 to 0.008 (FLIP), a globe with grain of
    /// a texel by 0.018 (docs/benchmarks/textures.md); normals and surfaces by less than as JPEG at 90 and 85, in half the
    /// bytes.
    fn default() -> Self {
        Self(80)
    }
}

impl TextureQuality {
    /// Whether files are lossless.
    pub(super) fn is_lossless(self) -> bool {
        self == Self(100)
    }

    /// Quality of JPEG files (IJG), about as good.
    pub(super) fn jpeg(self) -> u8 {
        self.0.saturating_sub(5).max(1)
    }
}

setting! {
    /// Work that goes into making lossy textures small: libwebp's method. 6 takes 0.93 to 0.98 of the bytes of 4 at equal
    /// PSNR, and 1.2 to 1.5 times as long.
    TextureEffort(u8), 0..=6, "steps of effort"
}

impl Eq for TextureEffort {}

impl TextureEffort {
    /// For textures that stay on a machine.
    pub const LEAST: Self = Self(0);
}

impl Default for TextureEffort {
    fn default() -> Self {
        Self(6)
    }
}

/// How textures are encoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TextureSettings {
    /// Quality of lossy files.
    pub quality: TextureQuality,
    /// Work per texel.
    pub effort: TextureEffort,
}
