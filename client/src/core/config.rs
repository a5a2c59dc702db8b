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
    /// The same in parallel projection ([`Camera::orthographic`]).
    ///
    /// [`Camera::orthographic`]: lodestream_scene::description::Camera::orthographic
    OrthographicOfScene {
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
    /// Most bytes that meshes may take in client and renderer, with what undone chunks have left: fewer faces are selected
    /// while they take more than faces usually do.
    pub max_mesh_bytes: u64,
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

/// Memory of a face in bytes: in the tests of memory at most 157 in the client's mesh and 116 in the renderer's buffers, and
/// reserve for what chunks leave until meshes are compacted.
const FACE_BYTES: u64 = 360;
/// Steps by which the faces that are selected follow the memory that meshes take: small changes change no selection.
const MESH_STEPS: u64 = 16;
/// Bytes of a texel in GPU memory, without the borders of tiles and free pages.
const TEXEL_BYTES: u64 = 4;

impl Config {
    /// Sets the cache and the budgets of the selection so that client and renderer together take at most about
    /// `memory_bytes`, render targets and terrain apart: an eighth for the cache, a quarter for texels, three eighths for
    /// faces, and the rest for decoding and what waits (never raised again).
    pub fn bound_memory(&mut self, memory_bytes: u64) {
        let eighth = memory_bytes / 8;
        self.cache_bytes = eighth;
        self.select.max_bytes = eighth;
        self.select.max_texels = (2 * eighth / TEXEL_BYTES).min(SelectSettings::default().max_texels);
        self.max_mesh_bytes = 3 * eighth;
        self.select.max_faces = self.max_mesh_bytes / FACE_BYTES;
        self.max_waiting_bytes =
            self.max_waiting_bytes.min(usize::try_from(eighth / 2).unwrap_or(usize::MAX));
    }

    /// Most faces to select while meshes of so many faces take so many bytes.
    pub(crate) fn max_faces(&self, faces: u64, bytes: u64) -> u64 {
        let step = (self.max_mesh_bytes / MESH_STEPS).max(1);
        let more = bytes.saturating_sub(faces.saturating_mul(FACE_BYTES)) / step * step;
        self.select.max_faces.min(self.max_mesh_bytes.saturating_sub(more) / FACE_BYTES)
    }

    /// Defaults for a start view.
    #[must_use]
    pub fn new(start: StartView) -> Self {
        Self {
            session: ClientConfig::default(),
            ranges: RangeSettings::default(),
            select: SelectSettings::default(),
            start,
            max_mesh_bytes: u64::MAX,
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

    #[test]
    fn fewer_faces_are_selected_while_meshes_take_more_than_usual() {
        let mut config = Config::new(StartView::OfScene { viewport_px: [1, 1], target_px: 1.0 });
        assert_eq!(config.max_faces(1, u64::MAX / 2), config.select.max_faces);
        config.bound_memory(64 << 20);
        let (most, usual) = (config.select.max_faces, 10_000 * FACE_BYTES);
        let limits = [0, 1, 4, 16, 99].map(|steps| {
            let more = steps * config.max_mesh_bytes / MESH_STEPS;
            config.max_faces(10_000, usual + more)
        });
        assert_eq!([limits[0], limits[3], limits[4]], [most, 0, 0]);
        assert!(limits[1] < most && limits[2].abs_diff(most * 3 / 4) < 2, "{limits:?} of {most}");
        config.bound_memory(0);
        assert_eq!(config.max_faces(10_000, usual), 0);
    }
}
