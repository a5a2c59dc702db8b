//! What a view wants of the tiles of an asset.

use super::state::TextureState;

/// What regions want of the tiles of an asset.
#[derive(Debug, Default)]
pub(super) struct TileDemand {
    /// Difference and foveation of each tile; no difference where it is not wanted.
    pub(super) tiles: Vec<(f32, f32)>,
    /// By texture and level that is cut: where its tiles begin.
    pub(super) first: Vec<Vec<usize>>,
}

impl TileDemand {
    pub(super) fn reset(&mut self, textures: &[TextureState]) {
        let mut end = 0;
        self.first.clear();
        for texture in textures {
            let mut first_of = Vec::with_capacity(texture.tiled.len());
            for (_, states) in &texture.tiled {
                first_of.push(end);
                end += states.len();
            }
            self.first.push(first_of);
        }
        self.tiles.clear();
        self.tiles.resize(end, (0.0, 0.0));
    }
}
