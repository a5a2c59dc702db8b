//! A picture of a run, with the time at which it was taken.

use std::sync::Arc;

use image::RgbaImage;
use lodestream_scene::view::View;

/// When a picture of a run is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Instant {
    /// As soon as every visible instance could be drawn.
    FirstFrame,
    /// Seconds since the connect call.
    At(f64),
    /// Settled: the selection is complete, with the camera at rest.
    Settled,
    /// The end of a run that did not settle.
    End,
}

impl std::fmt::Display for Instant {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::FirstFrame => f.write_str("first frame"),
            Self::At(seconds) => write!(f, "{seconds} s"),
            Self::Settled => f.write_str("settled"),
            Self::End => f.write_str("end"),
        }
    }
}

/// A picture with the state of the run at that time.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    pub(crate) instant: Instant,
    pub(crate) at_ns: u64,
    pub(crate) bytes: u64,
    pub(crate) error_px: Option<f64>,
    pub(crate) unoccluded_error_px: Option<f64>,
    /// The camera.
    pub(crate) view: View,
    /// Instants after the end share their picture with the last shot.
    pub(crate) picture: Arc<RgbaImage>,
}
