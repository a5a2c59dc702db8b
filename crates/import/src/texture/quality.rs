//! How good lossy files are.

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
