//! Errors of the frames that a viewer's window showed (`lodestream-viewer --frames DIR`) against the last one.

use std::path::Path;

use anyhow::{Context as _, ensure};
use image::RgbaImage;
use lodestream_scenario::picture::{FirstSecondsError, ImageError};
use serde::{Deserialize, Serialize};

use super::blank;
use crate::image_error::image_error;

/// Longest `frames.json`, in bytes.
const MAX_INDEX_BYTES: u64 = 1 << 20;

/// The contents of `frames.json`.
#[derive(Debug, Deserialize)]
struct Index {
    until_ms: f64,
    settled: bool,
    frames: Vec<Entry>,
}

#[derive(Debug, Deserialize)]
struct Entry {
    at_ms: f64,
    whole: bool,
    #[serde(flatten)]
    received: Received,
    file: String,
}

/// Data received when a frame was drawn, as reported by the viewer.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Received {
    /// Transport payload.
    pub bytes: u64,
    /// Upper bound on the screen error over all visible parts; `None` while one of them could not be drawn.
    pub error_px: Option<f64>,
    /// The same without parts that the scene's own surfaces occlude.
    pub unoccluded_error_px: Option<f64>,
}

/// A frame's error against the last one.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShownFrame {
    /// When it was shown, in milliseconds after the connect call.
    pub at_ms: f64,
    /// Whether it showed every visible instance.
    pub whole: bool,
    /// Data received by then.
    #[serde(flatten)]
    pub received: Received,
    /// Its error.
    #[serde(flatten)]
    pub error: ImageError,
}

/// One line of text.
impl std::fmt::Display for ShownFrame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { at_ms, whole, received, error } = self;
        let Received { bytes, error_px, unoccluded_error_px } = *received;
        let ImageError { psnr_db, ssim, flip } = error;
        let psnr = psnr_db.map_or("equal".into(), |db| format!("{db:.1} dB"));
        let kb = bytes as f64 / 1e3;
        write!(f, "{at_ms:6.0} ms, {kb:7.1} kB: FLIP {flip:.3}, SSIM {ssim:.3}, {psnr}")?;
        if let Some((all, seen)) = error_px.zip(unoccluded_error_px) {
            write!(f, ", screen error {all:.1} px, where seen {seen:.1} px")?;
        }
        if *whole { Ok(()) } else { write!(f, ", not all of the first frame") }
    }
}

/// The frames of a window.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ShownFrames {
    /// Whether the last frame is the settled picture; otherwise it is no valid reference.
    pub settled: bool,
    /// The integrated error of the first seconds.
    pub first_seconds: FirstSecondsError,
    /// The frames in order, without the last.
    pub frames: Vec<ShownFrame>,
}

/// Compares the frames in a folder that a viewer has written.
///
/// # Errors
/// A folder without frames; pictures that cannot be read or differ in size.
pub fn judge(folder: &Path) -> anyhow::Result<ShownFrames> {
    let index = folder.join("frames.json");
    let unread = || format!("{}: cannot be read", index.display());
    ensure!(
        std::fs::metadata(&index).with_context(unread)?.len() <= MAX_INDEX_BYTES,
        "{}: is longer than {MAX_INDEX_BYTES} bytes: not written by lodestream-viewer --frames",
        index.display()
    );
    let text = std::fs::read_to_string(&index).with_context(unread)?;
    let Index { until_ms, settled, frames } = serde_json::from_str(&text)
        .with_context(|| format!("{}: not written by lodestream-viewer --frames", index.display()))?;
    let picture = |entry: &Entry| -> anyhow::Result<RgbaImage> {
        // Only names that the viewer writes.
        let path = folder.join(Path::new(&entry.file).file_name().unwrap_or_default());
        let image = image::open(&path).with_context(|| format!("{}: no picture", path.display()))?;
        Ok(image.into_rgba8())
    };
    let Some((last, earlier)) = frames.split_last() else {
        anyhow::bail!("{}: no frame was shown", index.display());
    };
    let reference = picture(last)?;
    let mut shown = Vec::with_capacity(earlier.len());
    for entry in earlier {
        let error = image_error(&picture(entry)?, &reference)
            .with_context(|| format!("{} and {} cannot be compared", entry.file, last.file))?;
        let &Entry { at_ms, whole, received, .. } = entry;
        shown.push(ShownFrame { at_ms, whole, received, error });
    }
    let blank = image_error(&blank(&reference), &reference)?;
    let mut errors: Vec<_> = shown.iter().map(|frame| (frame.at_ms / 1e3, frame.error)).collect();
    errors.push((last.at_ms / 1e3, image_error(&reference, &reference)?));
    let first_seconds = FirstSecondsError::integrated(until_ms / 1e3, blank, &errors);
    Ok(ShownFrames { settled, first_seconds, frames: shown })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    #[test]
    fn frames_are_compared_with_the_last_and_count_until_the_next() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, value: u8| {
            let picture = RgbaImage::from_pixel(16, 16, Rgba([value, value, value, 255]));
            picture.save(folder.path().join(name)).unwrap();
        };
        write("a.png", 250);
        write("b.png", 200);
        let index = |frames: &str| {
            let text = format!("{{\"until_ms\": 3000, \"settled\": true, \"frames\": [{frames}]}}");
            std::fs::write(folder.path().join("frames.json"), text).unwrap();
            judge(folder.path())
        };
        let found = index(
            r#"{"at_ms": 500, "whole": false, "bytes": 9000, "error_px": null, "unoccluded_error_px": null, "file": "a.png"},
               {"at_ms": 1000, "whole": true, "bytes": 20000, "error_px": 8.5, "unoccluded_error_px": 2, "file": "b.png"},
               {"at_ms": 4000, "whole": true, "bytes": 30000, "error_px": 1, "unoccluded_error_px": 1, "file": "b.png"}"#,
        )
        .unwrap();
        let FirstSecondsError { blank_flip, flip_s, .. } = found.first_seconds;
        let bright = found.frames[0].error.flip;
        assert!(bright > 0.01 && blank_flip > bright && found.frames[1].error.flip == 0.0, "{found:?}");
        assert!((flip_s - 0.5 * blank_flip - 0.5 * bright).abs() < 1e-5, "{found:?}");
        let said = found.frames.iter().map(ToString::to_string).collect::<Vec<_>>();
        assert!(
            said[0].contains(" 9.0 kB: FLIP 0.") && said[0].ends_with(", not all of the first frame"),
            "{said:?}"
        );
        assert!(said[1].contains("SSIM 1.000, equal, screen error 8.5 px, where seen 2.0 px"), "{said:?}");
        let none = index("").unwrap_err().to_string();
        assert!(none.contains("no frame was shown"), "{none}");
        let lost = index(
            r#"{"at_ms": 1, "whole": true, "bytes": 1, "error_px": null, "unoccluded_error_px": null,
                "file": "../../c.png"}"#,
        )
        .unwrap_err()
        .to_string();
        assert!(lost.contains("c.png: no picture"), "{lost}");
    }
}
