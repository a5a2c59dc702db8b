//! The state for coding one chunk, shared by encoder and decoder ([`crate::entropy::range_coder::Coder`]).
//!
//! Its methods are spread over files in the order of the format: `chunk` (vertices without faces, the region, split
//! flags), `moves`, `split`, `position`, `wedges`.

use std::marker::PhantomData;

use crate::codec::local::Local;
use crate::codec::memory::Memory;
use crate::codec::plan::SplitPlan;
use crate::codec::residual::Recent;
use crate::codec::scratch::Scratch;
use crate::codec::uv_map::UvMaps;
use crate::entropy::Codec;
use crate::entropy::range_coder::Coder;
use crate::error::DecodeError;
use crate::refine::{ActiveMesh, ChunkDelta};

/// Resolution of the positions that a chunk adds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resolution {
    /// Bits per axis of the asset's grid.
    pub(crate) bits: u8,
    /// Largest number of low bits that the chunk's grid leaves out.
    pub(crate) shift: u8,
}

/// The splits to encode; `None` in a decoder. For decoders this is known at compile time, so their code has no
/// branches for it.
pub(crate) struct EncoderTarget<'a, C> {
    guide: Option<SplitPlan<'a>>,
    coder: PhantomData<C>,
}

impl<'a, C: Coder> EncoderTarget<'a, C> {
    fn new(guide: Option<SplitPlan<'a>>) -> Self {
        Self { guide, coder: PhantomData }
    }

    #[inline(always)]
    pub(crate) fn as_ref(&self) -> Option<&SplitPlan<'a>> {
        if C::READS { None } else { self.guide.as_ref() }
    }

    #[inline(always)]
    pub(crate) fn as_mut(&mut self) -> Option<&mut SplitPlan<'a>> {
        if C::READS { None } else { self.guide.as_mut() }
    }

    pub(crate) fn into_inner(self) -> Option<SplitPlan<'a>> {
        self.guide
    }
}

/// Codes one chunk against a mesh to which its parents are applied.
pub(crate) struct ChunkCoder<'a, 'm, C> {
    /// Writes, reads or records symbols.
    pub(crate) coder: &'a mut C,
    pub(crate) mesh: &'m ActiveMesh,
    pub(crate) chunk: u32,
    pub(crate) resolution: Resolution,
    pub(crate) guide: EncoderTarget<'a, C>,
    /// The known part of the region, with the added elements.
    pub(crate) local: Local<'m>,
    /// Recent ratios of residuals to their expected sizes: of positions, and of both sets of texture coordinates.
    pub(crate) recent: Recent,
    pub(crate) recent_uv: [Recent; 2],
    /// Texture projections, with [`Codec::AxisAligned`].
    pub(crate) uv_maps: UvMaps,
    pub(crate) scratch: Scratch,
}

impl<'a, 'm, C: Coder> ChunkCoder<'a, 'm, C> {
    /// A coder that encodes `guide`.
    pub(crate) fn encoding(coder: &'a mut C, mesh: &'m ActiveMesh, chunk: u32, guide: SplitPlan<'a>) -> Self {
        let shift = guide.source.shift;
        Self {
            guide: EncoderTarget::new(Some(guide)),
            ..Self::decoding(coder, mesh, chunk, shift, &mut Memory::default())
        }
    }

    /// A coder that decodes a chunk whose grid leaves out `shift` bits. It takes buffers from `memory`, which
    /// [`Self::finish_decoding`] returns.
    pub(crate) fn decoding(
        coder: &'a mut C,
        mesh: &'m ActiveMesh,
        chunk: u32,
        shift: u8,
        memory: &mut Memory,
    ) -> Self {
        Self {
            coder,
            mesh,
            chunk,
            resolution: Resolution { bits: mesh.grid.bits, shift },
            guide: EncoderTarget::new(None),
            local: Local::new(mesh, chunk, std::mem::take(&mut memory.local)),
            recent: Recent::default(),
            recent_uv: Default::default(),
            uv_maps: UvMaps::default(),
            scratch: std::mem::take(&mut memory.scratch),
        }
    }

    /// The decoded delta, unless decoding failed; returns the buffers.
    pub(crate) fn finish_decoding<T>(
        self,
        finish_decoding: Result<T, DecodeError>,
        parents: Vec<u32>,
        memory: &mut Memory,
    ) -> Result<ChunkDelta, DecodeError> {
        // After a failure new faces may lack their wedges.
        let delta = finish_decoding.map(|_| self.local.delta(self.chunk, parents));
        memory.local = self.local.memory();
        memory.scratch = self.scratch;
        delta
    }

    /// Whether this is a decoder, which must enforce the sizes in the index.
    pub(crate) fn decodes(&self) -> bool {
        self.guide.as_ref().is_none()
    }

    /// Whether the codec expects axis-aligned geometry with projected textures.
    #[inline]
    pub(crate) fn axis_aligned(&self) -> bool {
        self.mesh.codec == Codec::AxisAligned
    }

    /// Number of materials.
    pub(crate) fn materials(&self) -> u16 {
        self.mesh.material_count()
    }
}
