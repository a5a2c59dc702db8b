//! Occlusion as a mean of frames while nothing changes.
//!
//! A pixel takes another of the 16 rotations in each frame, so that after as many it has had them all, and no blur is
//! needed. Whether anything has changed is told from what a frame is made of: camera, settings, light, the state of every
//! mesh and tile that is drawn, and whether vertices are on their way. Nothing is guessed from pictures.

use crate::frame::settings::Frame;
use crate::passes::occlusion::{AmbientOcclusion, OcclusionMethod, OcclusionNormals, STILL_FRAMES};
use crate::passes::temporal::PreviousFrame;

/// What one frame does of it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct AccumulationStep {
    /// How it is estimated.
    pub(crate) method: OcclusionMethod,
    /// About which normals.
    pub(crate) normals: OcclusionNormals,
    /// Of one pixel of each 2×2.
    pub(crate) half: bool,
    /// Its number among those that are added up, from 1 on; 0 where it stands alone.
    pub(crate) number: u32,
    /// All are added up: nothing is drawn.
    pub(crate) done: bool,
    /// Frames that are still lacking after this one.
    pub(crate) left: u32,
}

impl AccumulationStep {
    /// For the shaders, above bit 8 of the frame's flags: by how much rotations are turned on, and the frame's number.
    pub(crate) fn flags(self) -> u32 {
        // Odd, so that it comes round to every rotation; far, so that frames one after the other differ.
        let turned = self.number.wrapping_mul(7) % 16;
        turned << 8 | self.number << 12
    }
}

/// What is kept between frames.
#[derive(Debug, Default)]
pub(crate) struct Accumulation {
    past: Option<(PreviousFrame, (u32, u32))>,
    number: u32,
}

impl Accumulation {
    /// Begins a frame in pictures of `size`.
    pub(crate) fn begin(
        &mut self,
        frame: &Frame<'_>,
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
        let now = (PreviousFrame::of(frame), size);
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
