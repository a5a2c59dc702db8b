//! The viewer's part of the tab's memory.
//!
//! Of what the bound leaves beside the heaps of two instances that hold nothing, render targets take at most a share; the
//! rest is for the scene, whatever the size of the canvas.

use lodestream_viewing::fit_targets;
use wasm_bindgen::prelude::*;

use super::Viewer;

/// Heaps of page and worker with a scene of a few meshes, in bytes (measured: 17 MB).
const HEAPS_BYTES: f64 = 17e6;
/// Share of render targets.
const TARGETS_SHARE: f64 = 0.75;
/// Share of content for tiles: what the streamer selects (`Config::bound_memory`, a quarter) always fits, although tiles
/// fill only two thirds of it where a larger array replaced a smaller one. And most for tiles, in bytes.
const TILES_SHARE: f64 = 0.4;
const MAX_TILE_BYTES: u64 = 256 << 20;
/// Bytes of a pixel of the canvas: browsers keep one picture that is drawn and one that is shown.
const CANVAS_BYTES: u64 = 2 * 4;

impl Viewer {
    /// Takes settings whose render targets leave memory for what they show. On large canvases the picture is drawn
    /// smaller then, and enlarged.
    pub(super) fn fit_targets(&mut self) {
        let most = self.shared_bytes() * TARGETS_SHARE - self.canvas_bytes() as f64;
        self.fitted = fit_targets(self.settings, (self.config.width, self.config.height), most as u64);
    }

    /// Bounds the renderer's pages for tiles of textures as the streamer bounds texels.
    pub(super) fn bound_tiles(&self) {
        let bytes = (self.content_bytes() * TILES_SHARE) as u64;
        self.renderer.set_texture_tile_budget(bytes.min(MAX_TILE_BYTES));
    }

    /// Memory that render targets and scene share.
    fn shared_bytes(&self) -> f64 {
        (self.memory_bytes - HEAPS_BYTES).max(0.0)
    }

    fn canvas_bytes(&self) -> u64 {
        u64::from(self.config.width) * u64::from(self.config.height) * CANVAS_BYTES
    }

    fn fixed_bytes(&self) -> u64 {
        self.renderer.target_bytes() + self.canvas_bytes()
    }
}

#[wasm_bindgen]
impl Viewer {
    /// What the scene may take in the streamer's heap and GPU memory, in bytes: what render targets, canvas and terrain
    /// leave, and at least what is not for render targets.
    #[must_use]
    pub fn content_bytes(&self) -> f64 {
        let targets = self.fitted.most_target_bytes((self.config.width, self.config.height));
        let fixed = targets + self.canvas_bytes() + self.scene.terrain_bytes();
        let shared = self.shared_bytes();
        (shared - fixed as f64).max(shared * (1.0 - TARGETS_SHARE))
    }

    /// GPU memory, in bytes: meshes with what is free in their pages, terrain, textures, render targets and the canvas.
    #[must_use]
    pub fn gpu_bytes(&self) -> f64 {
        let scene = self.renderer.mesh_bytes() + self.scene.terrain_bytes() + self.scene.textures().1;
        (scene + self.fixed_bytes()) as f64
    }

    /// GPU memory of render targets and the canvas, in bytes.
    #[must_use]
    pub fn target_bytes(&self) -> f64 {
        self.fixed_bytes() as f64
    }
}
