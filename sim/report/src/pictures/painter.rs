//! Draws the contents of a run's core with the shipped renderer, headless.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use anyhow::Context as _;
use image::RgbaImage;
use lodestream_client::core::ClientCore;
use lodestream_protocol::Time;
use lodestream_render::rays::Rays;
use lodestream_render::{
    AntiAliasing, AssetGpu, Counters, Environment, Frame, Gpu, Headless, PassId, PnTriangles, RenderError,
    SceneView, Settings,
};
use lodestream_scenario::observer::Observer;
use lodestream_scenario::plan::PictureSettings;
use lodestream_scenario::timeline::Sample;
use lodestream_scene::view::View;

use super::shot::{Instant, Shot};

/// Decoded textures that may wait in the core between two pictures.
const MAX_WAITING_BYTES: usize = 16 << 20;

/// A time after the end of every morph.
const AFTER_ALL_MORPHS_S: f32 = f32::MAX;

/// The graphics device shared by all runs. One draws at a time, since a thread that waits for the device may receive
/// results of another's frame.
#[derive(Debug)]
pub(crate) struct Studio {
    gpu: Mutex<Gpu>,
}

impl Studio {
    pub(super) fn new(gpu: Gpu) -> Self {
        Self { gpu: Mutex::new(gpu) }
    }

    fn exclusively<R>(&self, draw: impl FnOnce(&Gpu) -> R) -> R {
        draw(&self.gpu.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Takes the pictures of one run.
#[derive(Debug)]
pub(crate) struct Painter<'a> {
    studio: &'a Studio,
    headless: Headless,
    scene: SceneView,
    patches: Option<PnTriangles>,
    first_frame_due: bool,
    due: VecDeque<f64>,
    shots: Vec<Shot>,
    failed: Option<RenderError>,
}

impl<'a> Painter<'a> {
    /// Opens a picture of the plan's size.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(crate) fn new(studio: &'a Studio, settings: &PictureSettings) -> Result<Self, RenderError> {
        let [width, height] = settings.size_px;
        let headless = studio.exclusively(|gpu| Headless::new(gpu.clone(), width, height))?;
        Ok(Self {
            studio,
            headless,
            scene: SceneView::new(),
            patches: None,
            first_frame_due: true,
            due: settings.at_s.iter().copied().collect(),
            shots: Vec::new(),
            failed: None,
        })
    }

    /// Draws curved triangles from now on.
    pub(super) fn curved(self, patches: Option<PnTriangles>) -> Self {
        Self { patches, ..self }
    }

    /// Passes a frame with only the scene's first mesh to `draw`.
    ///
    /// # Errors
    /// A scene without a mesh, and errors of `draw`.
    pub(super) fn with_mesh<R>(
        &mut self,
        view: &View,
        settings: Settings,
        draw: impl FnOnce(&mut Headless, Frame<'_>, &AssetGpu) -> anyhow::Result<R>,
    ) -> anyhow::Result<R> {
        let Self { studio, headless, scene, .. } = self;
        studio.exclusively(|_| {
            scene.with_frame(view.pose(), settings, AFTER_ALL_MORPHS_S, |frame| {
                let mesh = frame.drawables.first().context("the scene has no mesh")?.asset;
                draw(headless, Frame { drawables: &[], terrain: None, water: None, ..*frame }, mesh)
            })
        })
    }

    /// The pictures in the order of time, except that the run's last picture comes last.
    ///
    /// # Errors
    /// The first error while drawing.
    pub(crate) fn finish(self) -> Result<Vec<Shot>, RenderError> {
        self.failed.map_or(Ok(self.shots), Err)
    }

    /// Returns the first error while drawing, once.
    ///
    /// # Errors
    /// That error.
    pub(super) fn check(&mut self) -> Result<(), RenderError> {
        self.failed.take().map_or(Ok(()), Err)
    }

    /// The camera of the settled picture, if the run settled.
    pub(super) fn settled_view(&self) -> Option<View> {
        self.shots.last().filter(|shot| shot.instant == Instant::Settled).map(|shot| shot.view)
    }

    /// Draws the run's final state, any number of times, and waits for the device. Returns the frame's counters.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(super) fn frame(&mut self, view: &View, settings: Settings) -> Result<Counters, RenderError> {
        let Self { studio, headless, scene, .. } = self;
        studio.exclusively(|_| frame(headless, scene, view, settings))
    }

    /// The same in another environment, without exposure.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(super) fn frame_in(
        &mut self,
        view: &View,
        settings: Settings,
        environment: Environment,
    ) -> Result<Counters, RenderError> {
        let Self { studio, headless, scene, .. } = self;
        let draw = |frame: &Frame<'_>| headless.frame(&Frame { environment, sky: None, settings, ..*frame });
        studio.exclusively(|_| scene.with_frame(view.pose(), settings, AFTER_ALL_MORPHS_S, draw))
    }

    /// The last frame's picture.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(super) fn picture(&self) -> Result<RgbaImage, RenderError> {
        self.studio.exclusively(|_| self.headless.picture())
    }

    /// Reversed depth of the last frame, [`Settings::near`] over view depth; 0 without a surface.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(super) fn depth(&self) -> Result<Vec<f32>, RenderError> {
        self.studio.exclusively(|_| self.headless.depth())
    }

    /// A ray caster for what the last frame drew.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(super) fn rays(&self, view: &View) -> Result<Rays, RenderError> {
        self.studio.exclusively(|gpu| {
            let frame = |frame: &Frame<'_>| Rays::of_frame(gpu, frame);
            self.scene.with_frame(view.pose(), Settings::default(), AFTER_ALL_MORPHS_S, frame)
        })
    }

    /// Draws a frame and returns the device times of some passes in milliseconds; 0 for passes that did not run.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub(super) fn pass_ms<const N: usize>(
        &mut self,
        view: &View,
        settings: Settings,
        passes: [PassId; N],
    ) -> Result<[f64; N], RenderError> {
        // Of this frame only.
        self.headless.time_passes(false);
        self.headless.time_passes(true);
        self.frame(view, settings)?;
        let timings = self.headless.timings();
        let taken = |pass: PassId| {
            let time = timings.passes.iter().find(|time| time.pass == pass).and_then(|time| time.gpu);
            time.map_or(0.0, |time| time.as_secs_f64() * 1e3)
        };
        let taken = passes.map(taken);
        self.headless.time_passes(false);
        Ok(taken)
    }

    /// Screen error of the last frame's terrain; `None` without terrain.
    pub(super) fn ground_px(&self) -> Option<f64> {
        self.scene.ground_px()
    }

    fn note<T>(&mut self, result: Result<T, RenderError>) -> Option<T> {
        result.map_err(|why| self.failed.get_or_insert(why)).ok()
    }

    fn shoot(&mut self, core: &mut ClientCore, instant: Instant, seen: Sample) {
        // Before the scene is known there is no camera.
        let Some(view) = core.view().filter(|_| core.scene().is_some() && self.failed.is_none()) else {
            return;
        };
        let picture = self.studio.exclusively(|gpu| {
            upload(&mut self.scene, core, gpu, &self.headless)?;
            draw(&mut self.headless, &mut self.scene, &view, self.patches)
        });
        let Sample { at_ns, bytes, error_px, unoccluded_error_px } = seen;
        if let Some(picture) = self.note(picture) {
            let picture = picture.into();
            self.shots.push(Shot { instant, at_ns, bytes, error_px, unoccluded_error_px, view, picture });
        }
    }
}

impl Observer for Painter<'_> {
    /// Takes the pictures due before `now`, with the core as it is.
    fn before(&mut self, now: Time, core: &mut ClientCore, last: Sample) {
        while let Some(&at_s) = self.due.front()
            && nanoseconds(at_s) < now.as_ns()
        {
            self.due.pop_front();
            self.shoot(core, Instant::At(at_s), Sample { at_ns: nanoseconds(at_s), ..last });
        }
    }

    fn after(&mut self, core: &mut ClientCore, now: Sample) {
        if self.first_frame_due && core.milestones().first_frame.is_some() {
            self.first_frame_due = false;
            self.shoot(core, Instant::FirstFrame, now);
        } else if core.waiting_bytes() > MAX_WAITING_BYTES {
            // Texels are large; they belong on the device.
            let uploaded = self.studio.exclusively(|gpu| upload(&mut self.scene, core, gpu, &self.headless));
            self.note(uploaded);
        }
    }

    /// Takes the pictures still due before the end, and if the run is settled, later ones: all show the last picture.
    fn end(&mut self, core: &mut ClientCore, last: Sample, settled: bool) {
        self.shoot(core, if settled { Instant::Settled } else { Instant::End }, last);
        let Some(shot) = self.shots.pop() else { return };
        for at_s in std::mem::take(&mut self.due) {
            let at_ns = nanoseconds(at_s);
            if settled || at_ns <= last.at_ns {
                self.shots.push(Shot { instant: Instant::At(at_s), at_ns, ..shot.clone() });
            }
        }
        self.shots.push(shot);
    }
}

fn nanoseconds(seconds: f64) -> u64 {
    (seconds * 1e9).round() as u64
}

/// Uploads all changes of the core.
fn upload(
    scene: &mut SceneView,
    core: &mut ClientCore,
    gpu: &Gpu,
    headless: &Headless,
) -> Result<(), RenderError> {
    scene.push(core.take_changes(Time::ZERO, usize::MAX));
    scene.upload(gpu, headless.renderer(), usize::MAX, 0.0)?;
    Ok(())
}

fn draw(
    headless: &mut Headless,
    scene: &mut SceneView,
    view: &View,
    pn_triangles: Option<PnTriangles>,
) -> Result<RgbaImage, RenderError> {
    // Only the surfaces that have arrived are judged: shadows would count some of them twice, and anti-aliasing hides
    // differences.
    frame(
        headless,
        scene,
        view,
        Settings {
            shadows: None,
            anti_aliasing: AntiAliasing::None,
            dither: false,
            anisotropy: 1,
            pn_triangles,
            ..Settings::default()
        },
    )?;
    headless.picture()
}

fn frame(
    headless: &mut Headless,
    scene: &mut SceneView,
    view: &View,
    settings: Settings,
) -> Result<Counters, RenderError> {
    let camera = view.pose();
    scene.prepare_ground(headless.gpu(), &camera, headless.size(), view.target_px, settings.shadows)?;
    scene.with_frame(camera, settings, AFTER_ALL_MORPHS_S, |frame| headless.frame(frame))
}
