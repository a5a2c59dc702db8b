//! Settings of the client.

use std::time::Duration;

use crate::core::decoders::Decoders;
use crate::ranges::RangeSettings;
use lodestream_protocol::client::ClientConfig;
use lodestream_scene::view::View;
use lodestream_select::SelectSettings;

/// The camera at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StartView {
    /// The scene's start camera.
    OfScene {
        /// Width and height of the picture.
        viewport_px: [u32; 2],
        /// Screen error to refine to, in pixels.
        target_px: f32,
    },
    /// A given view.
    Given(View),
}

/// Settings of a [`super::ClientCore`].
#[derive(Clone, Debug)]
pub struct Config {
    /// Scene and limits of the session.
    pub session: ClientConfig,
    /// Bounds on range requests, for published scenes.
    pub ranges: RangeSettings,
    /// Settings of the selection.
    pub select: SelectSettings,
    /// The camera at the start.
    pub start: StartView,
    /// Size of the cache of received blobs, in bytes. With a smaller cache, undone chunks are fetched again more often.
    pub cache_bytes: u64,
    /// Where chunks are decoded: by default on the thread that calls [`super::ClientCore::update`].
    pub decoders: Decoders,
    /// Least time between two selections. A longer one saves work, a shorter one reacts faster.
    pub select_interval: Duration,
    /// Most bytes of changes that wait for the renderer, meshes not counted; beyond it, no texture is decoded.
    pub max_waiting_bytes: usize,
    /// Whether changes are recorded for [`super::ClientCore::take_changes`]; if not, textures are not decoded.
    pub track_changes: bool,
    /// Whether changes carry the files of texture levels ([`super::TexturePixels::File`]), which the host decodes: the
    /// default without the feature `images`, and all that there is then.
    pub host_decodes_textures: bool,
    /// Whether received and used bytes are counted per blob, for [`super::ClientCore::received`].
    pub track_received: bool,
    /// Most assets, and most instances, of a scene; larger scenes are refused.
    pub max_entries: u32,
}

/// Memory of a face in bytes, rounded up from what the test of a tab's memory shows: 221 in the client's mesh and 116 in
/// the renderer's buffers.
const FACE_BYTES: u64 = 360;
/// Bytes of a texel in GPU memory.
const TEXEL_BYTES: u64 = 4;

impl Config {
    /// Sets the cache and the budgets of the selection so that client and renderer together take at most about
    /// `memory_bytes`, render targets and terrain apart: an eighth for the cache, a quarter for texels, three eighths for
    /// faces, and the rest for decoding and what waits (never raised again).
    pub fn bound_memory(&mut self, memory_bytes: u64) {
        let eighth = memory_bytes / 8;
        self.cache_bytes = eighth;
        self.select.max_bytes = eighth;
        self.select.max_texels = 2 * eighth / TEXEL_BYTES;
        self.select.max_faces = 3 * eighth / FACE_BYTES;
        self.max_waiting_bytes =
            self.max_waiting_bytes.min(usize::try_from(eighth / 2).unwrap_or(usize::MAX));
    }

    /// Defaults for a start view.
    #[must_use]
    pub fn new(start: StartView) -> Self {
        Self {
            session: ClientConfig::default(),
            ranges: RangeSettings::default(),
            select: SelectSettings::default(),
            start,
            cache_bytes: 128 << 20,
            decoders: Decoders::default(),
            select_interval: Duration::from_millis(10),
            max_waiting_bytes: 64 << 20,
            track_changes: true,
            host_decodes_textures: !cfg!(feature = "images"),
            track_received: false,
            max_entries: 1 << 20,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_memory_bound_add_up_to_less() {
        for megabytes in [1, 64, 256, 512, 8192] {
            let mut config = Config::new(StartView::OfScene { viewport_px: [1, 1], target_px: 1.0 });
            let memory = megabytes << 20;
            config.bound_memory(memory);
            let select = config.select;
            let parts = [
                config.cache_bytes,
                select.max_bytes,
                select.max_texels * TEXEL_BYTES,
                select.max_faces * FACE_BYTES,
                config.max_waiting_bytes as u64,
            ];
            assert!(parts.iter().all(|part| *part > 0), "{parts:?}");
            assert!(parts.iter().sum::<u64>() < memory, "{parts:?}");
        }
    }
}
