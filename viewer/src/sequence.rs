//! Several pictures of one run: from around the target, or along a path of cameras.

use std::ffi::OsString;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use lodestream_scene::description::Camera;
use lodestream_viewing::CameraController;

use crate::args::{Args, CameraArg};

/// Longest file of cameras that is read, in bytes.
const MAX_BYTES: u64 = 16 << 20;
/// Most pictures of a run.
const MOST: usize = 100_000;

/// The cameras of a run's pictures, from `start`; `None` for a single picture.
///
/// # Errors
/// A path that cannot be read, or has something else than cameras, or too many.
pub(crate) fn cameras(args: &Args, start: Camera) -> anyhow::Result<Option<Vec<Camera>>> {
    if let Some(count) = args.turntable {
        let around = |number| {
            let mut controller = CameraController::new(start);
            controller.circle(std::f64::consts::TAU * f64::from(number) / f64::from(count.get()));
            controller.camera()
        };
        return Ok(Some((0..count.get()).map(around).collect()));
    }
    args.camera_path
        .as_deref()
        .map(|file| read(file).with_context(|| format!("--camera-path {}", file.display())))
        .transpose()
}

/// The cameras in a file, one a line as `--camera` has them. Empty lines and lines that begin with # are left out.
fn read(file: &Path) -> anyhow::Result<Vec<Camera>> {
    let mut text = String::new();
    let length = std::fs::File::open(file)?.take(MAX_BYTES + 1).read_to_string(&mut text)?;
    if length as u64 > MAX_BYTES {
        bail!("it has more than {MAX_BYTES} bytes");
    }
    let lines =
        (1..).zip(text.lines().map(str::trim)).filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let mut cameras = Vec::new();
    for (number, line) in lines {
        let camera: CameraArg = line.parse().map_err(|why| anyhow::anyhow!("line {number}: {why}"))?;
        cameras.push(camera.0);
    }
    match cameras.len() {
        0 => bail!("it has no camera: write one a line, as --camera has them"),
        1..=MOST => Ok(cameras),
        more => bail!("it has {more} cameras, of at most {MOST}: use several files"),
    }
}

/// The file of a picture: `name-0001.png` and so on for `name.png`, from 1.
pub(crate) fn numbered(file: &Path, number: usize) -> PathBuf {
    let mut name: OsString = file.file_stem().unwrap_or_default().to_owned();
    name.push(format!("-{number:04}"));
    if let Some(extension) = file.extension() {
        name.push(".");
        name.push(extension);
    }
    file.with_file_name(name)
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;
    use glam::DVec3;

    use super::*;

    fn args(more: &[&str]) -> Args {
        let usual = ["viewer", "ws://h:1", "--headless", "--output", "x.png"];
        Args::parse_from([&usual[..], more].concat())
    }

    #[test]
    fn a_turntable_goes_once_around_the_target() {
        let start = Camera { eye: [0.0, 3.0, 10.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        let all = cameras(&args(&["--turntable", "4"]), start).unwrap().unwrap();
        let eyes: Vec<DVec3> = all.iter().map(|camera| camera.eye.into()).collect();
        for (eye, wanted) in eyes.iter().zip([[0.0, 3.0, 10.0], [10.0, 3.0, 0.0], [0.0, 3.0, -10.0]]) {
            assert!((*eye - DVec3::from(wanted)).length() < 1e-9, "{eye}");
        }
        assert_eq!((all.len(), cameras(&args(&[]), start).unwrap()), (4, None));
    }

    #[test]
    fn a_path_has_a_camera_a_line_and_errors_name_the_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("path.txt");
        std::fs::write(&file, "# two\neye=1,0,0;target=0,0,0\n\neye=2,0,0;target=0,0,0;fov=30\n").unwrap();
        let more = ["--camera-path", file.to_str().unwrap()];
        let start = Camera { eye: [1.0; 3], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
        let all = cameras(&args(&more), start).unwrap().unwrap();
        assert_eq!(all.iter().map(|camera| camera.eye[0]).collect::<Vec<_>>(), [1.0, 2.0]);
        for (text, why) in [("eye=1,0,0;target=0,0,0\neye=1\n", "line 2"), ("# none\n", "no camera")] {
            std::fs::write(&file, text).unwrap();
            let error = format!("{:#}", cameras(&args(&more), start).unwrap_err());
            assert!(error.contains(why) && error.contains("path.txt"), "{error}");
        }
        assert_eq!(numbered(Path::new("a/b.c.png"), 12), Path::new("a/b.c-0012.png"));
        assert_eq!(numbered(Path::new("b"), 3), Path::new("b-0003"));
    }
}
