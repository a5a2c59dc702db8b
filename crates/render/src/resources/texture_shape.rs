//! Size and purpose of a texture.

use lodestream_scene::asset::{TextureInfo, TextureKind, level_size, tiles};

/// Longest side of a texture with tiles.
pub(crate) const MAX_TILED_SIDE: u32 = 1 << 15;

/// Size and purpose of a texture, known before any of its levels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureShape {
    /// Width of the finest level in texels.
    pub width: u32,
    /// Height of the finest level in texels.
    pub height: u32,
    /// Number of levels, each half as wide and high as the next finer one (at least 1; a chain
    /// need not go down to 1×1).
    pub levels: u32,
    /// Purpose.
    pub kind: TextureKind,
    /// Number of levels, coarsest first, that arrive whole; finer ones arrive in tiles
    /// ([`lodestream_scene::asset::tiles`]). `levels` or more, the default: all are whole.
    pub whole_levels: u32,
    /// Mean of the texels, colours linear: stands for a colour or surface texture until its coarsest level is here.
    pub mean: [f32; 3],
}

impl TextureShape {
    /// A shape with all levels down to 1×1, all whole, white until then.
    #[must_use]
    pub fn full(width: u32, height: u32, kind: TextureKind) -> Self {
        let levels = width.max(height).max(1).ilog2() + 1;
        Self { width, height, levels, kind, whole_levels: u32::MAX, mean: [1.0; 3] }
    }

    /// Width and height of a level; level 0 is the coarsest, as on the wire.
    #[must_use]
    pub fn level_size(&self, level: u32) -> (u32, u32) {
        level_size([self.width, self.height], self.levels, level).into()
    }

    /// The same with all levels in tiles that may be: those longer than a tile, but the coarsest.
    #[must_use]
    pub fn tiled(self) -> Self {
        Self { whole_levels: self.least_whole(), ..self }
    }

    /// Number of levels that are never tiled.
    fn least_whole(&self) -> u32 {
        let is_whole = |level: &u32| tiles::is_whole(self.level_size(*level).into());
        ((0..self.levels).take_while(is_whole).count() as u32).max(1)
    }

    /// Number of whole levels, from 1 to all: all of height maps, which relief mapping searches, and of textures that
    /// are too long for the page table.
    pub(crate) fn whole(&self) -> u32 {
        if self.kind == TextureKind::Height || self.width.max(self.height) > MAX_TILED_SIDE {
            return self.levels;
        }
        self.whole_levels.max(self.least_whole()).min(self.levels)
    }
}

/// Linear light of an sRGB byte (IEC 61966-2-1).
fn from_srgb(encoded: u8) -> f32 {
    let encoded = f32::from(encoded) / 255.0;
    if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

impl From<&TextureInfo> for TextureShape {
    fn from(info: &TextureInfo) -> Self {
        let &TextureInfo { kind, width, height, mean, ref levels, .. } = info;
        let decode = |encoded| match kind {
            TextureKind::Color => from_srgb(encoded),
            TextureKind::Height | TextureKind::Normal | TextureKind::Surface => f32::from(encoded) / 255.0,
        };
        let mean = mean.map_or([1.0; 3], |mean| mean.map(decode));
        let whole_levels = info.whole_levels() as u32;
        Self { width, height, levels: levels.len() as u32, kind, whole_levels, mean }
    }
}

#[cfg(test)]
mod tests {
    use lodestream_scene::asset::{TextureFormat, TextureLevel};

    use super::*;

    #[test]
    fn level_sizes_follow_the_halving_rule() {
        let shape = TextureShape::full(300, 7, TextureKind::Color);
        assert_eq!(shape.levels, 9);
        assert_eq!(shape.level_size(8), (300, 7));
        assert_eq!(shape.level_size(7), (150, 3));
        assert_eq!(shape.level_size(0), (1, 1));
        let short = TextureShape { levels: 2, ..shape };
        assert_eq!((short.level_size(0), short.level_size(1)), ((150, 3), (300, 7)));
    }

    #[test]
    fn levels_of_a_tile_or_less_stay_whole_and_heights_do() {
        let whole = |width, height, kind| TextureShape::full(width, height, kind).tiled().whole();
        assert_eq!(whole(1024, 1024, TextureKind::Color), 9);
        assert_eq!(whole(1000, 700, TextureKind::Normal), 8);
        assert_eq!(whole(2048, 1, TextureKind::Surface), 9);
        assert_eq!(whole(256, 256, TextureKind::Color), 9, "all");
        assert_eq!(whole(1024, 1024, TextureKind::Height), 11, "all");
        assert_eq!(whole(65_536, 4, TextureKind::Color), 17, "all");
        let full = TextureShape::full(1024, 1024, TextureKind::Color);
        assert_eq!(full.whole(), 11, "all");
        assert_eq!(TextureShape { whole_levels: 10, ..full }.whole(), 10);
        assert_eq!(TextureShape { whole_levels: 0, ..full }.whole(), 9);
        assert_eq!(
            TextureShape { levels: 2, ..full }.tiled().whole(),
            1,
            "the coarsest, though it is larger"
        );
    }

    #[test]
    fn the_mean_colour_is_linear_and_white_where_none_is_said() {
        let info = |mean| TextureInfo {
            kind: TextureKind::Color,
            width: 8,
            height: 8,
            planes: 0,
            mean,
            uv_per_unit: 1.0,
            levels: vec![TextureLevel { width: 8, height: 8, bytes: 100, format: TextureFormat::Png }],
        };
        assert_eq!(TextureShape::from(&info(None)).mean, [1.0; 3]);
        let [r, g, b] = TextureShape::from(&info(Some([255, 188, 10]))).mean;
        assert!(
            (r - 1.0).abs() < 1e-6 && (g - 0.5029).abs() < 1e-4 && (b - 0.003_035).abs() < 1e-6,
            "{r} {g} {b}"
        );
    }
}
