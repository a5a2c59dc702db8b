//! What is said of a picture of a run: figures alone, so that runs need no graphics.

use serde::Serialize;

/// A picture in the report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Picture {
    /// "first frame", "3 s", "settled"; "end" where the run ended otherwise.
    pub instant: String,
    /// Time since the connect call, in milliseconds.
    pub at_ms: f64,
    /// Transport payload received until then.
    pub bytes: u64,
    /// Upper bound on the screen error then, in pixels of the plan's viewport; `None` while something visible could
    /// not be drawn.
    pub error_px: Option<f64>,
    /// How far the picture is from its reference; `None` where there is none to be had.
    pub error: Option<ImageError>,
    /// The file, relative to the report's folder; instants after a run has settled share that picture's.
    pub file: String,
}

/// What separates a picture from its reference. Opacity is not looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ImageError {
    /// Peak signal-to-noise ratio in dB, over the three channels of 8-bit sRGB values; `None` where the pictures are
    /// equal, for which it is infinite.
    pub psnr_db: Option<f64>,
    /// Mean structural similarity of luma, 1 for equal pictures (Wang, Bovik, Sheikh, Simoncelli 2004; Gaussian window
    /// of 11 × 11, σ = 1.5).
    pub ssim: f64,
    /// Mean FLIP error, 0 for equal pictures, 1 at most (Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström,
    /// Fairchild, "FLIP: A difference evaluator for alternating images", 2020).
    pub flip: f64,
}
