//! Pictures that a key writes and the window does not show: of another size, or with a transparent background. They are
//! drawn once what their camera sees is as fine as their size asks for.

use std::time::{Duration, Instant};

use image::RgbaImage;
use lodestream_render::{Pose, Settings};

use super::Running;
use super::pending_picture::PendingPicture;
use crate::args::Args;
use crate::matte;

/// Longest time that a picture waits for terrain tiles once its meshes are there; the window stands meanwhile.
const MAX_TILES_TIME: Duration = Duration::from_secs(10);
/// Interval of checks for finished terrain tiles.
const TILES_INTERVAL: Duration = Duration::from_millis(20);

impl Running {
    /// Begins a picture of the present view, if it is another than that of the window; returns whether it is.
    ///
    /// # Errors
    /// Nothing that is shown yet; a size beyond the device's limit.
    pub(super) fn begin_picture(&mut self, args: &Args) -> anyhow::Result<bool> {
        let size = args.picture_size.map_or(self.painter.size(), |size| size.0);
        if size == self.painter.size() && !args.transparent {
            return Ok(false);
        }
        let controller = self.controller.filter(|_| self.shown.has_begun());
        let Some(controller) = controller else { anyhow::bail!("nothing is shown yet") };
        let most = self.painter.gpu.device.limits().max_texture_dimension_2d;
        anyhow::ensure!(
            size.iter().all(|side| *side <= most),
            "{}x{} is larger than the device allows, {most} on a side: choose a smaller --picture-size",
            size[0],
            size[1]
        );
        let mut view = controller.view(size, self.choices.target_px);
        view.eye[1] -= self.rise;
        // What is frozen gets no finer.
        self.picture = Some(PendingPicture::new(controller.pose(), view, self.choices.frozen));
        self.notify_user(format!("a picture of {}x{} is being made", size[0], size[1]));
        Ok(true)
    }

    /// Writes the picture that is waited for once all of it has arrived.
    pub(super) fn advance_picture(&mut self, args: &Args) {
        let Some(picture) = &mut self.picture else { return };
        // Frames go on meanwhile: they take what arrives.
        self.dirty = true;
        picture.arrived |= self.choices.frozen;
        if !picture.arrived {
            picture.follow(self.streaming.as_ref());
            return;
        }
        if self.scene.waiting() > 0 {
            return;
        }
        let Some(PendingPicture { camera, view, .. }) = self.picture.take() else { return };
        let drawn = self.draw_apart(args, &camera, view.viewport_px);
        self.save_picture(drawn);
        self.scene_changed();
    }

    fn draw_apart(&mut self, args: &Args, camera: &Pose, size: [u32; 2]) -> anyhow::Result<RgbaImage> {
        let begun = Instant::now();
        let [width, height] = size;
        loop {
            let (px, shadows) = (self.choices.target_px, self.settings.shadows);
            self.scene.prepare_ground(&self.painter.gpu, camera, (width, height), px, shadows)?;
            if self.scene.missing_tiles() == 0 || begun.elapsed() > MAX_TILES_TIME {
                break;
            }
            std::thread::sleep(TILES_INTERVAL);
        }
        let (scene, painter, camera) = (&self.scene, &mut self.painter, *camera);
        let mut drawn = |settings: &Settings| {
            // At this time all morphs are over.
            painter
                .draw_apart(size, |draw| scene.with_frame(camera, *settings, f32::MAX, |frame| draw(frame)))
        };
        if args.transparent { matte::drawn(&self.settings, drawn) } else { drawn(&self.settings) }
    }
}
