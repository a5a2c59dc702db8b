//! Figures of a run's pictures, separate from drawing, so that runs need no graphics.

use serde::Serialize;

/// A picture in the report.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Picture {
    /// "first frame", "3 s", "settled"; "end" if the run ended otherwise.
    pub instant: String,
    /// Time since the connect call, in milliseconds.
    pub at_ms: f64,
    /// Transport payload received until then.
    pub bytes: u64,
    /// Upper bound on the screen error at that time, in pixels of the plan's viewport; `None` while a visible instance
    /// could not be drawn.
    pub error_px: Option<f64>,
    /// The same over visible parts only, without those occluded by the scene's own surfaces.
    pub unoccluded_error_px: Option<f64>,
    /// Error against the reference; `None` without a reference.
    pub error: Option<ImageError>,
    /// The file, relative to the report's folder; instants after settling share the settled picture.
    pub file: String,
}

/// Error of the screen against the settled picture, integrated over the first seconds: a picture counts until the next;
/// before the first frame the window is empty.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FirstSecondsError {
    /// Length of the interval from the connect call.
    pub until_s: f64,
    /// FLIP error of the empty window.
    pub blank_flip: f64,
    /// ∫ FLIP dt, in seconds: 0 if the settled picture is shown at once.
    pub flip_s: f64,
    /// ∫ (1 − SSIM) dt, in seconds.
    pub dissimilarity_s: f64,
    /// PSNR of these seconds in dB, from the mean over time of squared errors. `None` if that is 0.
    pub psnr_db: Option<f64>,
}

impl FirstSecondsError {
    /// Integrates the errors of pictures, given in order with their times in seconds; the first is the first frame.
    /// Values are rounded to six decimals.
    #[must_use]
    pub fn integrated(until_s: f64, blank: ImageError, pictures: &[(f64, ImageError)]) -> Self {
        let (mut flip_s, mut dissimilarity_s, mut squares_s) = (0.0, 0.0, 0.0);
        let mut add = |from: f64, to: f64, error: &ImageError| {
            let seconds = (to.min(until_s) - from).max(0.0);
            flip_s += seconds * error.flip;
            dissimilarity_s += seconds * (1.0 - error.ssim);
            // Relative to the square of white.
            squares_s += seconds * error.psnr_db.map_or(0.0, |db| 10_f64.powf(-db / 10.0));
        };
        let first = pictures.first().map_or(until_s, |(at, _)| *at);
        add(0.0, first, &blank);
        for (i, (at, error)) in pictures.iter().enumerate() {
            add(*at, pictures.get(i + 1).map_or(until_s, |(next, _)| *next), error);
        }
        let rounded = |value: f64| (value * 1e6).round() / 1e6;
        Self {
            until_s,
            blank_flip: blank.flip,
            flip_s: rounded(flip_s),
            dissimilarity_s: rounded(dissimilarity_s),
            psnr_db: (squares_s > 0.0).then(|| rounded(10.0 * (until_s / squares_s).log10())),
        }
    }
}

/// Error of a picture against its reference. Opacity is ignored.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_counts_until_the_next_and_the_empty_window_until_the_first() {
        let error = |flip, ssim, psnr_db| ImageError { psnr_db, ssim, flip };
        let (blank, coarse) = (error(0.8, 0.2, Some(10.0)), error(0.2, 0.7, Some(20.0)));
        let fine = error(0.0, 1.0, None);
        let seen = FirstSecondsError::integrated(3.0, blank, &[(0.5, coarse), (1.5, fine), (4.0, coarse)]);
        assert_eq!((seen.flip_s, seen.dissimilarity_s), (0.6, 0.7));
        // Half a second of 0.1, one of 0.01, the rest of nothing: 0.02 on average.
        assert_eq!(seen.psnr_db, Some(16.9897));
        let at_once = FirstSecondsError::integrated(3.0, blank, &[(0.0, fine)]);
        assert_eq!((at_once.flip_s, at_once.psnr_db), (0.0, None));
        let never = FirstSecondsError::integrated(3.0, blank, &[]);
        assert_eq!((never.flip_s, never.blank_flip), (2.4, 0.8));
        assert_eq!(FirstSecondsError::integrated(3.0, blank, &[(3.5, coarse)]).flip_s, 2.4);
    }
}
