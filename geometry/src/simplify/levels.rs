//! Finished levels of a preparation, and what is left of the mesh: what simplification hands to the encoder.

use crate::collapse::Records;
use crate::error::MeshError;
use crate::simplify::deviation::Deviation;
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::live::Live;
use crate::simplify::packed::{pack, unpack};
use crate::simplify::resume::{End, Outcome, perform};
use crate::spill::{Piece, Spill, SpillError};

/// Chunks that are put away and encoded together: enough for any number of threads, a few megabytes.
const BLOCK_CHUNKS: usize = 64;

/// A mesh reduced to its base, and the way there.
pub(crate) struct Simplified<'a> {
    /// Levels, finest first.
    pub(crate) levels: Levels<'a>,
    /// What is left.
    pub(crate) live: Live<'a>,
    /// Error of regions that vanished or were dropped without a chunk of their own.
    pub(crate) stray_error: f64,
    /// How many bits the grids leave out that the levels' chunks bring vertices to; one more for the base mesh.
    pub(crate) shifts: Vec<u8>,
}

/// Finished levels, finest first, each a list of chunks that are put away in blocks: chunks that follow one another are
/// neighbours in space (`partition`).
pub(crate) struct Levels<'a> {
    spill: &'a dyn Spill,
    /// How many chunks each has.
    chunks: Vec<usize>,
}

impl<'a> Levels<'a> {
    pub(crate) fn new(spill: &'a dyn Spill) -> Self {
        Self { spill, chunks: Vec::new() }
    }

    /// Puts a level away that `live` is the end of.
    pub(crate) fn push(&mut self, mut chunks: Vec<RegionChunk>, live: &Live<'_>) -> Result<(), MeshError> {
        let level = self.chunks.len() as u32;
        self.chunks.push(chunks.len());
        let mut left = chunks.drain(..);
        for block in 0.. {
            let mut chunks: Vec<RegionChunk> = left.by_ref().take(BLOCK_CHUNKS).collect();
            for Records { removed, vanished, .. } in chunks.iter_mut().map(|chunk| &mut chunk.records) {
                *vanished = removed.iter().map(|r| live.face_wedges[r.face as usize]).collect();
            }
            if chunks.is_empty() {
                break;
            }
            self.spill.put(Piece { level, block }, pack(&chunks))?;
        }
        Ok(())
    }

    /// Closes the level that was put away last.
    pub(crate) fn close(&self, end: &End) -> Result<(), MeshError> {
        Ok(self.spill.put(Piece::end_of(self.chunks.len() as u32 - 1), end.pack())?)
    }

    /// Whether levels are to be closed.
    pub(crate) fn resumes(&self) -> bool {
        self.spill.lasts()
    }

    /// Does again the next level, if a preparation before this one has finished it; answers how it ended.
    pub(crate) fn redo(
        &mut self,
        live: &mut Live<'_>,
        deviation: &mut Deviation,
    ) -> Result<Option<Outcome>, MeshError> {
        if !self.spill.lasts() {
            return Ok(None);
        }
        let level = self.chunks.len();
        let Some(bytes) = self.spill.get(Piece::end_of(level as u32))? else { return Ok(None) };
        let Some(mut end) = End::unpack(&bytes).map_err(SpillError::new)? else { return Ok(None) };
        drop(bytes);
        let outcome = end.outcome;
        self.chunks.push(outcome.chunks);
        // A crash may have left some without others: then the level is done as if nothing were there.
        for block in 0..self.blocks(level) {
            if self.whole_block(level, block)?.is_none() {
                self.chunks.pop();
                return Ok(None);
            }
        }
        end.add_wedges(live)?;
        let mut moves = Vec::new();
        for block in 0..self.blocks(level) {
            moves.extend(perform(self.block(level, block)?, live)?);
        }
        end.close(&moves, live, deviation)?;
        Ok(Some(outcome))
    }

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.chunks.len()
    }

    /// How many chunks they have together.
    pub(crate) fn chunk_count(&self) -> usize {
        self.chunks.iter().sum()
    }

    /// How many blocks a level is in.
    pub(crate) fn blocks(&self, level: usize) -> usize {
        self.chunks[level].div_ceil(BLOCK_CHUNKS)
    }

    /// The chunks of a block.
    pub(crate) fn block(&self, level: usize, block: usize) -> Result<Vec<RegionChunk>, MeshError> {
        let gone = || SpillError::new(format!("block {block} of level {level} is gone"));
        Ok(self.whole_block(level, block)?.ok_or_else(gone)?)
    }

    /// The same, or `None` where it is not there or damaged.
    fn whole_block(&self, level: usize, block: usize) -> Result<Option<Vec<RegionChunk>>, MeshError> {
        let count = (self.chunks[level] - block * BLOCK_CHUNKS).min(BLOCK_CHUNKS);
        let piece = Piece { level: level as u32, block: block as u32 };
        Ok(self.spill.get(piece)?.and_then(|bytes| unpack(&bytes, count).ok()))
    }

    /// All chunks of all levels, finest first.
    #[cfg(test)]
    pub(crate) fn all(&self) -> Vec<RegionChunk> {
        let blocks = (0..self.count()).flat_map(|level| (0..self.blocks(level)).map(move |b| (level, b)));
        blocks.flat_map(|(level, block)| self.block(level, block).unwrap()).collect()
    }
}
