//! Pictures of a run at chosen instants, and their errors against the settled picture.
//!
//! At an instant, the shipped renderer draws the contents of the run's core. Virtual time stands still meanwhile, and
//! the run is not affected. New vertices are drawn at their final position, as a quarter of a second later, since the
//! progress of a morph depends on the moment of drawing rather than on the data that arrived.
//!
//! The reference of a picture is the run's settled picture if the camera is bit-identical. Otherwise (a camera that
//! moved, a run that did not settle) it is the settled picture of another viewer with a fixed camera at that pose, over
//! a link of 10 Gbit/s.

pub mod draw_trade;
pub mod frame_time;
pub mod gallery;
pub mod ink;
pub mod occlusion;
mod painter;
pub mod pn_cost;
pub mod pn_crowd;
pub mod pn_waiting;
pub mod reflections;
pub mod relief_methods;
pub mod relief_worth;
mod settled;
mod shot;
pub mod shown;
pub mod tangent_frames;
#[cfg(test)]
mod tests;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use image::RgbaImage;
use lodestream_render::{EMPTY_WINDOW, Gpu};
use lodestream_scenario::parallel::Draw;
use lodestream_scenario::picture::{FirstSecondsError, Picture};
use lodestream_scenario::plan::PictureSettings;
use lodestream_scenario::result::RunResult;
use lodestream_scenario::run::Run;
use lodestream_scenario::timeline::milliseconds;
use lodestream_scene::view::View;

use crate::image_error::image_error;
use painter::{Painter, Studio};
use shot::{Instant, Shot};

/// Name of the pictures' folder within a report's.
pub const FOLDER: &str = "pictures";

/// Opens the graphics device for a gallery.
///
/// # Errors
/// No graphics adapter; the message says what to install.
pub fn open_device() -> anyhow::Result<Gpu> {
    Gpu::headless().context("the plan asks for [pictures]")
}

/// The pictures of a plan's runs, stored in a temporary folder until the report is written.
#[derive(Debug)]
pub struct Gallery {
    studio: Studio,
    adapter: String,
    folder: tempfile::TempDir,
    output: PathBuf,
}

impl Gallery {
    /// A gallery in a report's folder, which is created if missing.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn new(gpu: Gpu, output: &Path) -> anyhow::Result<Self> {
        let fail = || format!("{}: cannot be written", output.display());
        std::fs::create_dir_all(output).with_context(fail)?;
        let folder = tempfile::Builder::new().prefix(".pictures-").tempdir_in(output).with_context(fail)?;
        Ok(Self { adapter: gpu.describe(), studio: Studio::new(gpu), folder, output: output.to_owned() })
    }

    /// Description of the graphics adapter.
    #[must_use]
    pub fn adapter(&self) -> &str {
        &self.adapter
    }

    /// The settled picture of a viewer with a fixed camera at a pose; `None` if it does not settle.
    fn settled_picture(
        &self,
        run: &Run<'_>,
        view: View,
        settings: &PictureSettings,
    ) -> anyhow::Result<Option<RgbaImage>> {
        let settings = PictureSettings { at_s: Vec::new(), ..settings.clone() };
        let mut painter = Painter::new(&self.studio, &settings)?;
        run.settle_at(view, &mut painter)?;
        let settled = painter.finish()?.into_iter().find(|shot| shot.instant == Instant::Settled);
        Ok(settled.map(|shot| Arc::unwrap_or_clone(shot.picture)))
    }

    /// Stores a picture of a run, unless it is stored already. `run` counts from 0 in the plan's order. Returns the
    /// file's name in a report.
    pub(super) fn keep(&self, run: usize, instant: Instant, picture: &RgbaImage) -> anyhow::Result<String> {
        let name = format!("run-{:04}-{}.png", run + 1, instant.to_string().replace(' ', "-"));
        let file = self.folder.path().join(&name);
        if !file.exists() {
            picture
                .save_with_format(&file, image::ImageFormat::Png)
                .with_context(|| format!("{}: cannot be written", file.display()))?;
        }
        Ok(format!("{FOLDER}/{name}"))
    }

    /// Moves the pictures into the report, replacing those of an earlier report.
    ///
    /// # Errors
    /// Errors of the file system.
    pub fn publish(self) -> std::io::Result<()> {
        remove_earlier(&self.output)?;
        let folder = self.output.join(FOLDER);
        std::fs::create_dir_all(&folder)?;
        for file in std::fs::read_dir(self.folder.path())? {
            let file = file?;
            std::fs::rename(file.path(), folder.join(file.file_name()))?;
        }
        Ok(())
    }
}

impl Draw for Gallery {
    fn drawn(&self, run: &Run<'_>, number: usize) -> anyhow::Result<RunResult> {
        let Some(settings) = &run.plan.pictures else { return run.result(None) };
        let mut painter = Painter::new(&self.studio, settings)?;
        let mut result = run.result(Some(&mut painter))?;
        let reference = |view| self.settled_picture(run, view, settings);
        let shots = painter.finish()?;
        let settled = shots.last().filter(|shot| shot.instant == Instant::Settled).cloned();
        result.pictures = with_errors(shots, self, number, reference)?;
        if let (Some(first), Some(settled)) = (settings.first, settled) {
            result.first_seconds = Some(first_seconds(first.until_s, &settled.picture, &result.pictures)?);
        }
        Ok(result)
    }
}

/// Compares each picture of a run with its reference and stores it. `reference_at` draws the settled picture of a pose;
/// it is called once per pose, and not for that of the run's own settled picture.
pub(super) fn with_errors(
    shots: Vec<Shot>,
    gallery: &Gallery,
    run: usize,
    reference_at: impl Fn(View) -> anyhow::Result<Option<RgbaImage>>,
) -> anyhow::Result<Vec<Picture>> {
    let mut references: Vec<(View, Option<Arc<RgbaImage>>)> = Vec::new();
    let Some(last) = shots.last().cloned() else { return Ok(Vec::new()) };
    if last.instant == Instant::Settled {
        references.push((last.view, Some(Arc::clone(&last.picture))));
    }
    let mut pictures = Vec::with_capacity(shots.len());
    for Shot { instant, at_ns, bytes, error_px, unoccluded_error_px, view, picture } in shots {
        let known = match references.iter().position(|(pose, _)| *pose == view) {
            Some(known) => known,
            None => {
                references.push((view, reference_at(view)?.map(Arc::new)));
                references.len() - 1
            }
        };
        let reference = references[known].1.as_ref();
        let of_the_end = Arc::ptr_eq(&picture, &last.picture);
        pictures.push(Picture {
            instant: instant.to_string(),
            at_ms: milliseconds(at_ns),
            bytes,
            error_px: error_px.map(rounded),
            unoccluded_error_px: unoccluded_error_px.map(rounded),
            error: reference.map(|reference| image_error(&picture, reference)).transpose()?,
            file: gallery.keep(run, if of_the_end { last.instant } else { instant }, &picture)?,
        });
    }
    Ok(pictures)
}

/// Rounds an error to four decimals.
fn rounded(px: f64) -> f64 {
    (px * 1e4).round() / 1e4
}

/// The empty window, before there is a scene, in the size of a picture.
fn blank(of: &RgbaImage) -> RgbaImage {
    let [r, g, b] = EMPTY_WINDOW;
    RgbaImage::from_pixel(of.width(), of.height(), image::Rgba([r, g, b, 255]))
}

/// The integrated error of the first seconds of a run with a fixed camera.
fn first_seconds(
    until_s: f64,
    settled: &RgbaImage,
    pictures: &[Picture],
) -> anyhow::Result<FirstSecondsError> {
    // Data that arrive before the first frame are not shown.
    let shown = pictures.iter().skip_while(|picture| picture.instant != Instant::FirstFrame.to_string());
    let errors: Vec<_> = shown.filter_map(|picture| Some((picture.at_ms / 1e3, picture.error?))).collect();
    Ok(FirstSecondsError::integrated(until_s, image_error(&blank(settled), settled)?, &errors))
}

/// Removes the pictures of an earlier report, and no other files.
pub(super) fn remove_earlier(output: &Path) -> std::io::Result<()> {
    let folder = output.join(FOLDER);
    let entries = match std::fs::read_dir(&folder) {
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    let ours = |name: &OsStr| {
        let stem = name.to_str().and_then(|name| name.strip_prefix("run-")?.strip_suffix(".png"));
        stem.is_some_and(|stem| stem.starts_with(|c: char| c.is_ascii_digit()))
    };
    for entry in entries {
        let entry = entry?;
        if ours(&entry.file_name()) {
            std::fs::remove_file(entry.path())?;
        }
    }
    // The folder stays if it contains other files.
    let _ = std::fs::remove_dir(&folder);
    Ok(())
}
