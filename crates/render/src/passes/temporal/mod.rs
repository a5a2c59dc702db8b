//! Temporal anti-aliasing: subpixel jitter, reprojection and the accumulated history.

mod previous_frame;
mod resolve;

use std::collections::BTreeMap;
use std::sync::{Arc, OnceLock};

use glam::Mat4;

use crate::frame::batch::Batch;
use crate::frame::camera::{clip_from_view, view_from_world};
use crate::frame::draw::{DrawList, finite};
use crate::frame::placed::PlacedInstances;
use crate::frame::settings::Frame;
use crate::frame::timing::PassEncoder;
use crate::resources::buffer::GrowingBuffer;
use crate::resources::descriptors::texture_bytes;
use crate::resources::gpu::{Gpu, RenderError};
use crate::scene::placement::InstanceRaw;

pub(crate) use previous_frame::PreviousFrame;
pub(crate) use resolve::Resolve;

/// Frames that the history counts for while things move.
const MOVING: f32 = 6.0;
/// Frames that the history counts for in the first still frame: the history of a moving picture is imprecise.
const STOPPED: f32 = 2.0;
/// Most frames averaged in a still picture, and number of jitter positions.
const STANDING: f32 = 64.0;

/// Temporal anti-aliasing in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TemporalStep {
    /// Jitter from pixel centres, in pixels.
    pub(crate) jitter: [f32; 2],
    /// Matrix to the previous clip space, without jitter, from positions relative to this frame's eye.
    pub(crate) before: Mat4,
    /// Time of the frame before.
    pub(crate) before_s: f32,
    /// Most frames that the history counts for; 0 without one.
    pub(crate) history: f32,
    /// Whether nothing has changed since the previous frame.
    pub(crate) still: bool,
    /// Height of the eye over water, 0 without, and the water's extinction of green light per world unit.
    pub(crate) water: [f32; 2],
}

impl TemporalStep {
    /// No jitter and no history.
    pub(crate) const NONE: Self = Self {
        jitter: [0.0; 2],
        before: Mat4::IDENTITY,
        before_s: 0.0,
        history: 0.0,
        still: false,
        water: [0.0; 2],
    };

    /// Applies the jitter to a projection.
    pub(crate) fn jittered(&self, mut projection: Mat4, (width, height): (u32, u32)) -> [[f32; 4]; 4] {
        // In clip space w is −z, so this shifts all depths equally.
        projection.z_axis.x += 2.0 * self.jitter[0] / width as f32;
        projection.z_axis.y -= 2.0 * self.jitter[1] / height as f32;
        projection.to_cols_array_2d()
    }
}

/// State kept between frames.
#[derive(Debug)]
pub(crate) struct Temporal {
    resolve: Arc<OnceLock<Resolve>>,
    /// Previous and current history.
    histories: Option<[wgpu::Texture; 2]>,
    past: Option<PreviousFrame>,
    /// Number of frames, and of consecutive equal ones.
    frames: u32,
    still_frames: u32,
    #[cfg(test)]
    step: TemporalStep,
    /// Previous instances, in the order of [`DrawList::instances`].
    before: GrowingBuffer<InstanceRaw>,
    /// Additional usages of that buffer.
    usage: wgpu::BufferUsages,
}

impl Temporal {
    /// `resolve` is the lazily compiled resolve pass; `usage` are additional usages of instance buffers.
    pub(crate) fn new(resolve: Arc<OnceLock<Resolve>>, usage: wgpu::BufferUsages) -> Self {
        Self {
            resolve,
            histories: None,
            past: None,
            frames: 0,
            still_frames: 0,
            #[cfg(test)]
            step: TemporalStep::NONE,
            before: GrowingBuffer::new("instances before", wgpu::BufferUsages::VERTEX | usage),
            usage,
        }
    }

    /// Discards the history.
    pub(crate) fn forget(&mut self) {
        *self = Self::new(Arc::clone(&self.resolve), self.usage);
    }

    /// Begins a frame of `size` pixels; `jittered` unless only motion is needed. Returns the step and the batches that
    /// move, and uploads their previous instances.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] for more instances than the device can hold.
    pub(crate) fn begin<'a>(
        &mut self,
        gpu: &Gpu,
        (frame, list, placed): (&Frame<'a>, &DrawList<'a>, &PlacedInstances),
        size: (u32, u32),
        (jittered, water): (bool, [f32; 2]),
    ) -> Result<(TemporalStep, Vec<Batch<'a>>), RenderError> {
        let resolve = self.resolve.get_or_init(|| Resolve::new(gpu));
        match &mut self.histories {
            Some(histories) if (histories[0].width(), histories[0].height()) == size => histories.swap(0, 1),
            histories => {
                *histories = Some([(); 2].map(|()| resolve.history(gpu, size)));
                self.past = None;
            }
        }
        let now = PreviousFrame::of(frame, placed);
        let past = self.past.take();
        let still = past.as_ref().is_some_and(|past| past.is(&now));
        self.still_frames = if still { self.still_frames + 1 } else { 1 };
        self.frames = if past.is_some() { self.frames.wrapping_add(1) } else { 0 };
        let history = match (&past, still) {
            (None, _) => 0.0,
            (_, false) => MOVING,
            (_, true) if self.still_frames == 2 => STOPPED,
            (_, true) => STANDING,
        };
        let before_s = past.as_ref().map_or(frame.time_s, |past| past.time_s);
        let moves = past.as_ref().filter(|_| !still).map(|past| moves(frame, list, placed, past));
        let (moving, before) = moves.unwrap_or_default();
        if !moving.is_empty() {
            self.before.write(gpu, 0, &before)?;
        }
        let camera = past.as_ref().map_or(frame.camera, |past| *past.camera());
        let step = TemporalStep {
            jitter: if jittered { point(self.frames) } else { [0.0; 2] },
            before: clip_from_view(&camera, frame.settings.near, size)
                * view_from_world(&camera)
                * Mat4::from_translation((frame.camera.eye - camera.eye).as_vec3()),
            before_s,
            history,
            still,
            water,
        };
        #[cfg(test)]
        {
            self.step = step;
        }
        self.past = Some(now);
        Ok((step, moving))
    }

    /// Step of the last frame.
    #[cfg(test)]
    pub(crate) fn step(&self) -> TemporalStep {
        self.step
    }

    /// Number of consecutive equal frames.
    pub(crate) fn still_frames(&self) -> u32 {
        self.still_frames
    }

    /// Previous instances, in the order of [`DrawList::instances`]; only of moving objects.
    pub(crate) fn before(&self) -> Option<&wgpu::Buffer> {
        self.before.buffer()
    }

    /// The current history.
    pub(crate) fn history(&self) -> Option<&wgpu::Texture> {
        self.histories.as_ref().map(|[_, new]| new)
    }

    /// Memory of the histories, in bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.histories.iter().flatten().map(texture_bytes).sum()
    }

    /// Blends radiance into the history, using depth and, if objects move, motion.
    pub(crate) fn resolve(
        &self,
        gpu: &Gpu,
        encoder: &mut PassEncoder<'_>,
        frame: &wgpu::Buffer,
        (radiance, depth, motion): (&wgpu::TextureView, &wgpu::TextureView, Option<&wgpu::TextureView>),
    ) {
        if let (Some(resolve), Some([old, new])) = (self.resolve.get(), &self.histories) {
            resolve.record(gpu, encoder, frame, (radiance, depth, motion), [old, new]);
        }
    }
}

/// Jitter of a frame: the Halton sequence in bases 2 and 3 (Halton 1960).
fn point(frame: u32) -> [f32; 2] {
    let inverse = |base: u32| {
        let (mut left, mut digit, mut sum) = (frame % STANDING as u32 + 1, 1.0, 0.0);
        while left > 0 {
            digit /= base as f32;
            sum += digit * (left % base) as f32;
            left /= base;
        }
        sum
    };
    [inverse(2) - 0.5, inverse(3) - 0.5]
}

/// Batches that have moved since `past`, and, if there are some, previous positions of all instances relative to this
/// frame's eye.
fn moves<'a>(
    frame: &Frame<'a>,
    list: &DrawList<'a>,
    placed: &PlacedInstances,
    past: &PreviousFrame,
) -> (Vec<Batch<'a>>, Vec<InstanceRaw>) {
    let mut before = Vec::new();
    let mut moving = Vec::new();
    // Instances of an asset are numbered across its drawables.
    let mut counts: BTreeMap<u64, usize> = BTreeMap::new();
    let mut firsts = Vec::new();
    if !placed.before().is_empty() || !placed.part_states_before().is_empty() {
        before.clone_from(&list.instances);
        firsts.extend(frame.drawables.iter().map(|drawable| {
            let count = counts.entry(drawable.asset.number()).or_default();
            let first = *count;
            *count += drawable.instances.len();
            first
        }));
    }
    for batch in &list.batches {
        let asset = batch.asset();
        let own = placed.drawable(batch.drawable());
        let mut moved = own.is_some_and(|own| own.is_moving(past.time_s, frame.settings.morph_s));
        if !moved && before.is_empty() {
            continue;
        }
        // If their number has changed, instances cannot be matched.
        let were = placed
            .before()
            .get(&asset.number())
            .filter(|were| counts.get(&asset.number()) == Some(&were.len()));
        let states = placed.part_states_before().get(&asset.number());
        if were.is_some() || states.is_some() {
            for (slot, place) in list.placed(batch) {
                let raw = were.map_or(before[slot], |were| {
                    let was = &were[firsts[batch.drawable()] + place];
                    InstanceRaw::new(was, asset.origin(), frame.camera.eye)
                });
                let states =
                    states.map_or(before[slot].states, |version| asset.part_states_before(place, *version));
                let raw = raw.with_states(states);
                if let Some(raw) = finite(raw).filter(|raw| *raw != before[slot]) {
                    before[slot] = raw;
                    moved = true;
                }
            }
        }
        if moved {
            moving.push(*batch);
        }
    }
    if before.is_empty() && !moving.is_empty() {
        before.clone_from(&list.instances);
    }
    (moving, before)
}
