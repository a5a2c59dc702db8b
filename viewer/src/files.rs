//! Output files. They are written atomically: a reader never sees half a file.

use std::io;
use std::path::Path;

use anyhow::Context as _;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _, RgbaImage};
use lodestream_compress::whole_file::write_atomically;
use serde::Serialize;

/// Writes statistics as indented JSON.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let mut json = serde_json::to_string_pretty(value)?;
    json.push('\n');
    write_atomically(path, |out| out.write_all(json.as_bytes())).with_context(|| cannot_write(path))
}

/// Writes a picture as PNG.
pub(crate) fn write_png(path: &Path, picture: &RgbaImage) -> anyhow::Result<()> {
    let (width, height) = picture.dimensions();
    write_atomically(path, |out| {
        PngEncoder::new(out)
            .write_image(picture, width, height, ExtendedColorType::Rgba8)
            .map_err(io::Error::other)
    })
    .with_context(|| cannot_write(path))
}

/// Error context for a file or folder that cannot be written.
pub(crate) fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_failed_write_leaves_the_previous_file() {
        struct Broken;
        impl Serialize for Broken {
            fn serialize<S: serde::Serializer>(&self, _: S) -> Result<S::Ok, S::Error> {
                Err(serde::ser::Error::custom("no figures"))
            }
        }
        let folder = tempfile::tempdir().unwrap();
        let (stats, picture) = (folder.path().join("stats.json"), folder.path().join("picture.png"));
        write_json(&stats, &[1, 2]).unwrap();
        assert!(write_json(&stats, &Broken).is_err());
        assert_eq!(fs::read_to_string(&stats).unwrap(), "[\n  1,\n  2\n]\n");
        let shown = RgbaImage::from_pixel(3, 2, image::Rgba([1, 2, 3, 255]));
        write_png(&picture, &shown).unwrap();
        // PNG has no pictures without pixels.
        assert!(write_png(&picture, &RgbaImage::new(0, 0)).is_err());
        assert!(image::open(&picture).unwrap().into_rgba8() == shown);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing else is left");
    }

    /// A write replaces the file under the name, not its bytes.
    #[cfg(unix)]
    #[test]
    fn a_reader_that_opened_the_file_before_a_write_reads_the_previous_file() {
        use std::io::Read as _;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stats.json");
        write_json(&path, &"before").unwrap();
        let mut reader = fs::File::open(&path).unwrap();
        write_json(&path, &"after").unwrap();
        let mut text = String::new();
        reader.read_to_string(&mut text).unwrap();
        assert_eq!(text, "\"before\"\n");
        let missing = write_json(&folder.path().join("no/stats.json"), &1).unwrap_err();
        assert!(
            missing.to_string().contains("cannot write") && missing.to_string().contains("no/stats.json")
        );
    }
}
