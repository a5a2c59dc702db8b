//! Pictures of the window that a key writes.

use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use image::RgbaImage;

use crate::files::{cannot_write, write_png};

/// Most pictures in a folder.
const MOST: u32 = 9_999;

/// Writes a picture into a folder as `lodestream-NNN.png`, with the first number that no file has; returns its path.
/// No file is replaced.
///
/// # Errors
/// A folder that cannot be written into, or in which all numbers are taken.
pub(super) fn write(folder: &Path, picture: &RgbaImage) -> anyhow::Result<PathBuf> {
    for number in 1..=MOST {
        let path = folder.join(format!("lodestream-{number:03}.png"));
        // The name is reserved by an empty file, which the picture then replaces.
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(_) => {}
            Err(why) if why.kind() == ErrorKind::AlreadyExists => continue,
            Err(why) => return Err(why).with_context(|| cannot_write(&path)),
        }
        return match write_png(&path, picture) {
            Ok(()) => Ok(path),
            Err(why) => {
                // The first error is the one to report.
                let _ = fs::remove_file(&path);
                Err(why)
            }
        };
    }
    anyhow::bail!("{} has {MOST} pictures already: move some away", folder.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_numbered_and_replace_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::write(path("lodestream-002.png"), "mine").unwrap();
        let shown = |red| RgbaImage::from_pixel(3, 2, image::Rgba([red, 2, 3, 255]));
        assert_eq!(write(folder.path(), &shown(1)).unwrap(), path("lodestream-001.png"));
        assert_eq!(write(folder.path(), &shown(9)).unwrap(), path("lodestream-003.png"));
        for (name, red) in [("lodestream-001.png", 1), ("lodestream-003.png", 9)] {
            assert!(image::open(path(name)).unwrap().into_rgba8() == shown(red));
        }
        assert_eq!(fs::read(path("lodestream-002.png")).unwrap(), b"mine");
        // PNG has no pictures without pixels.
        assert!(write(folder.path(), &RgbaImage::new(0, 0)).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "a failure leaves no empty file");
        let missing = write(&path("no"), &shown(1)).unwrap_err().to_string();
        assert!(missing.contains("cannot write") && missing.contains("lodestream-001.png"), "{missing}");
    }
}
