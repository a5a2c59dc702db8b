//! The client's settings of a plan: `[client]`.

use lodestream_client::core::Config;
use serde::Deserialize;

use super::Fault;

/// Client settings that differ from the default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClientSettings {
    /// Target screen error, in pixels.
    pub target_px: f32,
    /// Bytes kept in flight, instead of the product of measured rate and round trip.
    pub request_depth_bytes: Option<u64>,
    /// Whether base meshes of instances out of view are fetched, last.
    pub prefetch_bases: bool,
    /// Whether chunks are fetched only up to the first truncation point that suffices.
    pub truncation_points: bool,
    /// Whether parts occluded by the scene's own surfaces come last, in the server's pushes too.
    pub hidden_last: bool,
    /// Whether casters out of view whose shadow falls into view are refined.
    pub shadows: bool,
    /// Vertex splits that the client decodes and applies per second of virtual time; `None`: decoding takes no time.
    pub splits_per_s: Option<f64>,
}

impl ClientSettings {
    /// The default settings with a target screen error.
    #[must_use]
    pub fn to(target_px: f32) -> Self {
        Self {
            target_px,
            request_depth_bytes: None,
            prefetch_bases: true,
            truncation_points: true,
            hidden_last: true,
            shadows: false,
            splits_per_s: None,
        }
    }

    /// Changes a client's configuration accordingly.
    pub(crate) fn apply(&self, config: &mut Config) {
        config.select.prefetch_bases = self.prefetch_bases;
        config.select.truncation_points = self.truncation_points;
        config.select.hidden_last = self.hidden_last;
        config.select.shadows = self.shadows;
        if let Some(depth) = self.request_depth_bytes {
            config.session.min_in_flight_bytes = depth;
            config.session.max_in_flight_bytes = depth;
        }
    }
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClientFile {
    target_px: Option<f64>,
    request_depth_bytes: Option<u64>,
    prefetch_bases: Option<bool>,
    truncation_points: Option<bool>,
    hidden_last: Option<bool>,
    shadows: Option<bool>,
    splits_per_s: Option<f64>,
}

impl ClientFile {
    /// `ttq_px` are the screen errors whose time is reported; the default target is the smallest of them.
    pub(super) fn check(&self, ttq_px: &[f64]) -> Result<ClientSettings, Fault> {
        let target_px =
            self.target_px.unwrap_or_else(|| ttq_px.iter().copied().fold(f64::INFINITY, f64::min));
        if !(0.01..=1000.0).contains(&target_px) {
            return Err(Fault::new(
                "target_px",
                format!("{target_px} is not a screen error from 0.01 to 1000"),
            ));
        }
        if let Some(depth) = self.request_depth_bytes.filter(|depth| !(1..=1 << 30).contains(depth)) {
            let message = format!("{depth} is not a number of bytes from 1 to 1 GiB");
            return Err(Fault::new("request_depth_bytes", message));
        }
        if let Some(rate) = self.splits_per_s.filter(|rate| !(1e3..=1e12).contains(rate)) {
            return Err(Fault::new(
                "splits_per_s",
                format!("{rate} is not a rate from 1e3 to 1e12 splits a second"),
            ));
        }
        let shipped = ClientSettings::to(target_px as f32);
        Ok(ClientSettings {
            request_depth_bytes: self.request_depth_bytes,
            prefetch_bases: self.prefetch_bases.unwrap_or(shipped.prefetch_bases),
            truncation_points: self.truncation_points.unwrap_or(shipped.truncation_points),
            hidden_last: self.hidden_last.unwrap_or(shipped.hidden_last),
            shadows: self.shadows.unwrap_or(shipped.shadows),
            splits_per_s: self.splits_per_s,
            ..shipped
        })
    }
}
