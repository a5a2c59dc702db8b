//! The files that a run leaves. Each is whole or absent: who waits for one never reads half of it.

use std::io;
use std::path::Path;

use anyhow::Context as _;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _, RgbaImage};
use lodestream_compress::whole_file::write_atomically;
use serde::Serialize;

/// Writes figures as JSON, for people too.
pub(crate) fn write_json(path: &Path, figures: &impl Serialize) -> anyhow::Result<()> {
    let mut json = serde_json::to_string_pretty(figures)?;
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

/// What went wrong with a file or folder.
pub(crate) fn cannot_write(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_fails_half_way_leaves_the_file_of_the_run_before() {
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
        // A picture without pixels is none that PNG has.
        assert!(write_png(&picture, &RgbaImage::new(0, 0)).is_err());
        assert!(image::open(&picture).unwrap().into_rgba8() == shown);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing else is left");
    }

    /// A reader that opens the file at any time finds a whole one: the name changes files, not bytes.
    #[cfg(unix)]
    #[test]
    fn who_reads_while_it_is_written_reads_the_file_before() {
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
