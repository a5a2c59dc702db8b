//! Accumulation of ambient occlusion over frames while nothing changes.
//!
//! Each frame uses another of the 16 rotations of the samples, so that after 16 frames every pixel has used all and no
//! blur is needed. Changes are detected from the frame's input: camera, settings, light, the state of every drawn mesh
//! and tile, and whether vertices morph. Nothing is inferred from pictures.

use crate::frame::placed::PlacedInstances;
use crate::frame::settings::Frame;
use crate::passes::occlusion::{AmbientOcclusion, OcclusionMethod, OcclusionNormals, STILL_FRAMES};
use crate::passes::temporal::PreviousFrame;

/// Accumulation in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct AccumulationStep {
    /// Estimator.
    pub(crate) method: OcclusionMethod,
    /// Source of normals.
    pub(crate) normals: OcclusionNormals,
    /// At half resolution.
    pub(crate) half: bool,
    /// Number of the frame within the mean, from 1; 0 if it is not accumulated.
    pub(crate) number: u32,
    /// The mean is complete: nothing is drawn.
    pub(crate) done: bool,
    /// Frames still missing after this one.
    pub(crate) left: u32,
}

impl AccumulationStep {
    /// For shaders, from bit 8 of the frame's flags: offset of the rotations and number of the frame.
    pub(crate) fn flags(self) -> u32 {
        // Odd, so that all rotations occur; large, so that consecutive frames differ.
        let turned = self.number.wrapping_mul(7) % 16;
        turned << 8 | self.number << 12
    }
}

/// State kept between frames.
#[derive(Debug, Default)]
pub(crate) struct Accumulation {
    past: Option<(PreviousFrame, (u32, u32))>,
    number: u32,
}

impl Accumulation {
    /// Begins a frame in pictures of `size`.
    pub(crate) fn begin(
        &mut self,
        (frame, placed): (&Frame<'_>, &PlacedInstances),
        occlusion: Option<AmbientOcclusion>,
        size: (u32, u32),
    ) -> AccumulationStep {
        let AmbientOcclusion { method, normals, half, still, .. } = occlusion.unwrap_or_default();
        let half = half && !method.is_layered();
        let alone = |left| AccumulationStep { method, normals, half, number: 0, done: false, left };
        let Some(still) = still.filter(|_| occlusion.is_some()) else {
            *self = Self::default();
            return alone(0);
        };
        let now = (PreviousFrame::of(frame, placed), size);
        let same = self.past.as_ref().is_some_and(|(past, before)| past.is(&now.0) && *before == size);
        self.past = Some(now);
        if !same {
            self.number = 0;
            return alone(STILL_FRAMES);
        }
        let done = self.number == STILL_FRAMES;
        self.number = (self.number + 1).min(STILL_FRAMES);
        let left = STILL_FRAMES - self.number;
        AccumulationStep { method: still, normals, half: false, number: self.number, done, left }
    }
}
