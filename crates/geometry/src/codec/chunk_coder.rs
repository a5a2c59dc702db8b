//! What codes a chunk: one walk serves both directions ([`crate::entropy::range_coder::Coder`]), so what an encoder
//! says and what a decoder hears cannot drift apart.
//!
//! The walk is told file by file: `chunk` (vertices without faces, the region, which vertices split), `moves`,
//! `split`, `position`, `wedges`.

use std::marker::PhantomData;

use crate::codec::local::Local;
use crate::codec::memory::Memory;
use crate::codec::plan::Guide;
use crate::codec::residual::Recent;
use crate::codec::scratch::Scratch;
use crate::codec::uv_map::UvMaps;
use crate::entropy::Codec;
use crate::entropy::range_coder::Coder;
use crate::error::DecodeError;
use crate::refine::{ActiveMesh, ChunkDelta};

/// How fine the positions are that a chunk brings.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resolution {
    /// Bits per axis of the asset's grid.
    pub(crate) bits: u8,
    /// How many of the lowest bits the chunk's grid leaves out, at most.
    pub(crate) shift: u8,
}

/// What an encoder wants to say; a decoder has none, which is known where it is compiled: there nothing asks.
pub(crate) struct EncoderTarget<'a, C> {
    guide: Option<Guide<'a>>,
    coder: PhantomData<C>,
}

impl<'a, C: Coder> EncoderTarget<'a, C> {
    fn new(guide: Option<Guide<'a>>) -> Self {
        Self { guide, coder: PhantomData }
    }

    #[inline(always)]
    pub(crate) fn as_ref(&self) -> Option<&Guide<'a>> {
        if C::READS { None } else { self.guide.as_ref() }
    }

    #[inline(always)]
    pub(crate) fn as_mut(&mut self) -> Option<&mut Guide<'a>> {
        if C::READS { None } else { self.guide.as_mut() }
    }

    pub(crate) fn into_inner(self) -> Option<Guide<'a>> {
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
    /// The region as far as it is known, and what was added to it.
    pub(crate) local: Local<'m>,
    /// How the last residuals compared with what was expected: of positions, and of texture coordinates.
    pub(crate) recent: Recent,
    pub(crate) recent_uv: Recent,
    /// How textures are projected, under [`Codec::AxisAligned`].
    pub(crate) uv_maps: UvMaps,
    pub(crate) scratch: Scratch,
}

impl<'a, 'm, C: Coder> ChunkCoder<'a, 'm, C> {
    /// For an encoder, of what `guide` wants.
    pub(crate) fn saying(coder: &'a mut C, mesh: &'m ActiveMesh, chunk: u32, guide: Guide<'a>) -> Self {
        let shift = guide.source.shift;
        Self {
            guide: EncoderTarget::new(Some(guide)),
            ..Self::hearing(coder, mesh, chunk, shift, &mut Memory::default())
        }
    }

    /// For a decoder, of a chunk whose grid leaves out `shift` bits. What it takes of `memory` is given back by
    /// [`Self::heard`].
    pub(crate) fn hearing(
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
            recent_uv: Recent::default(),
            uv_maps: UvMaps::default(),
            scratch: std::mem::take(&mut memory.scratch),
        }
    }

    /// What was heard, if all of it was; gives the memory back.
    pub(crate) fn heard<T>(
        self,
        heard: Result<T, DecodeError>,
        parents: Vec<u32>,
        memory: &mut Memory,
    ) -> Result<ChunkDelta, DecodeError> {
        // Where it broke off, new faces may lack their wedges.
        let delta = heard.map(|_| self.local.delta(self.chunk, parents));
        memory.local = self.local.memory();
        memory.scratch = self.scratch;
        delta
    }

    /// Whether nobody says what is wanted, so that what was announced must be held to.
    pub(crate) fn decodes(&self) -> bool {
        self.guide.as_ref().is_none()
    }

    /// Whether what is built is expected: flats along the axes, textures as projected from them.
    #[inline]
    pub(crate) fn axis_aligned(&self) -> bool {
        self.mesh.codec == Codec::AxisAligned
    }

    /// Materials that faces may name.
    pub(crate) fn materials(&self) -> u16 {
        self.mesh.material_count()
    }
}
