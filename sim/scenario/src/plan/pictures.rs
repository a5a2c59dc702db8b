//! Pictures of a plan's runs: `[pictures]`.

use serde::Deserialize;

use super::Fault;

/// Most listed instants.
const MAX_INSTANTS: usize = 16;
/// Longest time over which errors are integrated, in seconds, and most pictures in it.
const MAX_FIRST_S: f64 = 60.0;
const MAX_FIRST_PICTURES: f64 = 100.0;
/// Most bytes of the pictures of a run.
const MAX_BYTES: f64 = 600e6;
/// Longest side of a picture: keeps the pictures of a run below 300 MB.
const MAX_SIDE_PX: u32 = 2048;
/// Shortest side.
const MIN_SIDE_PX: u32 = 16;
/// Default of the longest side.
const DEFAULT_SIDE_PX: f64 = 640.0;

/// The pictures drawn of each run: the first frame, some instants, the settled picture.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureSettings {
    /// Instants in seconds since the connect call, ascending.
    pub at_s: Vec<f64>,
    /// Width and height.
    pub size_px: [u32; 2],
    /// The interval over which the error is integrated; its pictures are among [`Self::at_s`].
    pub first: Option<FirstSeconds>,
}

/// The first seconds after the connect call, with pictures at equal intervals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstSeconds {
    /// Length of the interval.
    pub until_s: f64,
    /// Time between pictures.
    pub every_s: f64,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PicturesFile {
    #[serde(default = "default_instants")]
    at_s: Vec<f64>,
    size_px: Option<[u32; 2]>,
    first_s: Option<f64>,
    #[serde(default = "default_distance")]
    every_s: f64,
}

fn default_distance() -> f64 {
    0.05
}

fn first_seconds(until_s: f64, every_s: f64) -> Result<FirstSeconds, Fault> {
    if !(until_s > 0.0 && until_s <= MAX_FIRST_S) {
        return Err(Fault::new(
            "first_s",
            format!("{until_s} is not a time from 0 to {MAX_FIRST_S} seconds"),
        ));
    }
    if !(every_s > 0.0 && every_s <= until_s) || until_s / every_s > MAX_FIRST_PICTURES {
        let message = format!(
            "{every_s} s from picture to picture makes no 1 to {MAX_FIRST_PICTURES} pictures in {until_s} s"
        );
        return Err(Fault::new("every_s", message));
    }
    Ok(FirstSeconds { until_s, every_s })
}

fn default_instants() -> Vec<f64> {
    vec![1.0, 3.0]
}

impl PicturesFile {
    pub(super) fn check(self, viewport_px: [u32; 2]) -> Result<PictureSettings, Fault> {
        if let Some(i) = self.at_s.iter().position(|at| !(*at > 0.0 && *at <= 1e6)) {
            let message = format!("{} is not a time from 0 to 1e6 seconds", self.at_s[i]);
            return Err(Fault::new(format!("at_s[{i}]"), message));
        }
        if self.at_s.len() > MAX_INSTANTS {
            let message = format!("lists {} instants; {MAX_INSTANTS} are the most", self.at_s.len());
            return Err(Fault::new("at_s", message));
        }
        if let Some(i) = self.at_s.windows(2).position(|pair| pair[0] >= pair[1]) {
            let message = format!("{} does not come after the instant before it", self.at_s[i + 1]);
            return Err(Fault::new(format!("at_s[{}]", i + 1), message));
        }
        let [width, height] = viewport_px.map(f64::from);
        let size_px = self.size_px.unwrap_or_else(|| {
            let scale = (DEFAULT_SIDE_PX / width.max(height)).min(1.0);
            [width, height].map(|side| (side * scale).round() as u32)
        });
        if let Some(i) = size_px.iter().position(|side| !(MIN_SIDE_PX..=MAX_SIDE_PX).contains(side)) {
            let message = format!("{} is not a size from {MIN_SIDE_PX} to {MAX_SIDE_PX}", size_px[i]);
            return Err(Fault::new(format!("size_px[{i}]"), message));
        }
        // A picture of another aspect ratio would show parts that nobody selects, or omit parts that are counted. Half
        // a pixel of either side is tolerated.
        let [w, h] = size_px.map(f64::from);
        if (w - h * width / height).abs() > 0.5 * (1.0_f64).max(width / height) {
            let message = format!(
                "{w} x {h} is not of the shape of the view, which has viewport_px = [{width}, {height}]"
            );
            return Err(Fault::new("size_px", message));
        }
        let first = self.first_s.map(|until_s| first_seconds(until_s, self.every_s)).transpose()?;
        let mut at_s = self.at_s;
        if let Some(FirstSeconds { until_s, every_s }) = first {
            at_s.extend((1..).map(|i| f64::from(i) * every_s).take_while(|at| *at < until_s + 0.5 * every_s));
            // Rounded to the microsecond, so that listed instants are merged.
            at_s.iter_mut().for_each(|at| *at = (*at * 1e6).round() / 1e6);
            at_s.sort_by(f64::total_cmp);
            at_s.dedup();
            let bytes = at_s.len() as f64 * 4.0 * f64::from(size_px[0]) * f64::from(size_px[1]);
            if bytes > MAX_BYTES {
                let message = format!(
                    "{} pictures of this size take {:.0} MB; {:.0} are the most",
                    at_s.len(),
                    bytes / 1e6,
                    MAX_BYTES / 1e6
                );
                return Err(Fault::new("size_px", message));
            }
        }
        Ok(PictureSettings { at_s, size_px, first })
    }
}
