//! Settings of the client.

use std::time::Duration;

use crate::core::decoders::Decoders;
use lodestream_protocol::client::ClientConfig;
use lodestream_scene::view::View;
use lodestream_select::SelectSettings;

/// Where the camera is before anybody moves it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StartView {
    /// The scene's own start camera, for a picture of this size and quality.
    OfScene {
        /// Width and height in pixels.
        viewport_px: [u32; 2],
        /// Screen error to refine to, in pixels.
        target_px: f32,
    },
    /// This view.
    Given(View),
}

/// Settings of a [`super::ClientCore`].
#[derive(Clone, Debug)]
pub struct Config {
    /// Scene and limits of the session.
    pub session: ClientConfig,
    /// What is selected.
    pub select: SelectSettings,
    /// The first view.
    pub start: StartView,
    /// Bytes of received blobs that are kept. A smaller cache fetches more often what was undone.
    pub cache_bytes: u64,
    /// What decodes chunks: by default the thread that calls [`super::ClientCore::update`].
    pub decoders: Decoders,
    /// Least time between two selections. Longer saves work, shorter reacts faster.
    pub select_interval: Duration,
    /// Decoded texels and vertices that may wait for the renderer before decoding of textures pauses.
    pub max_waiting_bytes: usize,
    /// Whether somebody takes [`super::ClientCore::take_changes`]; without, textures are not decoded.
    pub track_changes: bool,
    /// Whether bytes are counted per blob, for [`super::ClientCore::received`]: for those who ask afterwards
    /// what of them was of use.
    pub track_received: bool,
    /// Most assets and instances of a scene that are taken; a scene beyond that is refused.
    pub max_entries: u32,
}

impl Config {
    /// Defaults for a start view.
    #[must_use]
    pub fn new(start: StartView) -> Self {
        Self {
            session: ClientConfig::default(),
            select: SelectSettings::default(),
            start,
            cache_bytes: 128 << 20,
            decoders: Decoders::default(),
            select_interval: Duration::from_millis(10),
            max_waiting_bytes: 64 << 20,
            track_changes: true,
            track_received: false,
            max_entries: 1 << 20,
        }
    }
}
