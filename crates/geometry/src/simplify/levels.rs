//! Finished levels and the remaining mesh: the output of simplification for the encoder.

use crate::checkpoint::{CheckpointError, CheckpointStore, Piece};
use crate::collapse::{Placed, Records};
use crate::error::MeshError;
use crate::mesh::QuantisedMesh;
use crate::mesh::id_set::IdSet;
use crate::mesh::wedges::Wedges;
use crate::simplify::blocks::end::BlockEnd;
use crate::simplify::blocks::merged::Merged;
use crate::simplify::blocks::names::Names;
use crate::simplify::deviation::Deviation;
use crate::simplify::hierarchy::{Bounds, RegionChunk};
use crate::simplify::live::Live;
use crate::simplify::packed::{pack, unpack};
use crate::simplify::resume::{End, Outcome, perform, wrong_mesh_error};

/// Chunks that are stored and encoded together: enough for any number of threads, a few megabytes.
const PIECE_CHUNKS: usize = 64;

/// A mesh reduced to its base, with the levels in between.
pub(crate) struct Simplified<'a> {
    /// Levels, finest first.
    pub(crate) levels: Levels<'a>,
    /// The remaining mesh; with its own ids if it was simplified in blocks.
    pub(crate) live: Live<'a>,
    /// The mesh's wedges, and those added by collapses.
    pub(crate) wedges: Wedges<'a>,
    merged: Option<&'a Merged>,
    mesh: &'a QuantisedMesh,
    /// Maps the mesh's ids to the remaining mesh's, if they differ.
    numbers: IdSet,
    /// Error of regions that vanished or were dropped without a chunk.
    pub(crate) stray_error: f64,
    /// Shift (low bits left out) of the grid of each level's chunks, and then of the base mesh.
    pub(crate) shifts: Vec<u8>,
}

impl<'a> Simplified<'a> {
    pub(super) fn new(
        mesh: &'a QuantisedMesh,
        merged: Option<&'a Merged>,
        levels: Levels<'a>,
        mut live: Live<'a>,
        stray_error: f64,
        shifts: Vec<u8>,
    ) -> Self {
        let (mut wedges, mut numbers) = (Wedges::new(&mesh.wedges), IdSet::default());
        match merged {
            None => wedges = std::mem::replace(&mut live.wedges, wedges),
            Some(Merged { names, added, .. }) => {
                let late =
                    live.wedges.added_from(names.wedge_count()).iter().map(|&wedge| names.of_whole(wedge));
                added.iter().copied().chain(late).for_each(|wedge| _ = wedges.push(wedge));
                numbers = IdSet::new(mesh.positions.len(), names.vertices().iter().copied());
            }
        }
        Self { levels, live, wedges, merged, mesh, numbers, stray_error, shifts }
    }

    /// Position of a vertex; the last one if it was removed.
    pub(crate) fn placed(&self, vertex: u32) -> Placed {
        match (self.merged, self.numbers.number(vertex)) {
            (None, _) => self.live.placed(vertex),
            (Some(_), Some(own)) => Placed { vertex, ..self.live.placed(own) },
            // Blocks do not move vertices.
            (Some(_), None) => Placed { vertex, cell: self.mesh.positions[vertex as usize], shift: 0 },
        }
    }

    /// The remaining faces, ascending by the remaining mesh's ids: each with the input's id and wedges.
    pub(crate) fn faces(&self) -> Vec<(u32, [u32; 3])> {
        let live = &self.live;
        let left = live.faces.iter().map(|&f| (f, live.face_wedges[f as usize]));
        match self.merged {
            None => left.collect(),
            Some(Merged { names, .. }) => {
                left.map(|(f, w)| (names.face(f), w.map(|w| names.wedge(w)))).collect()
            }
        }
    }

    /// Frees what only the base mesh needs; vertex positions and wedges stay.
    pub(crate) fn forget_faces(&mut self) {
        self.live.forget_faces();
    }
}

/// Finished levels, finest first: lists of chunks, stored in pieces. Consecutive chunks are neighbours in space
/// (`partition`).
pub(crate) struct Levels<'a> {
    checkpoint: &'a dyn CheckpointStore,
    /// Number of chunks in each piece, by level.
    pieces: Vec<Vec<u32>>,
    /// From this level on, stored chunks use ids that these names map to the input's.
    id_mapping: Option<(usize, &'a Names)>,
}

impl<'a> Levels<'a> {
    pub(crate) fn new(checkpoint: &'a dyn CheckpointStore) -> Self {
        Self { checkpoint, pieces: Vec::new(), id_mapping: None }
    }

    /// Starts a number of levels at once, for blocks.
    pub(crate) fn begin(&mut self, levels: usize) {
        self.pieces = vec![Vec::new(); levels];
    }

    /// Sets the id mapping for all later levels.
    pub(crate) fn rename_by(&mut self, names: Option<&'a Names>) {
        self.id_mapping = names.map(|names| (self.count(), names));
    }

    /// Stores a level; `live` is the mesh after it.
    pub(crate) fn push(&mut self, mut chunks: Vec<RegionChunk>, live: &Live<'_>) -> Result<(), MeshError> {
        record_removed_wedges(&mut chunks, live);
        self.pieces.push(Vec::new());
        self.append(self.pieces.len() - 1, chunks).map(|_| ())
    }

    /// Appends chunks to a level; returns the number of chunks in each new piece.
    pub(crate) fn append(
        &mut self,
        level: usize,
        mut chunks: Vec<RegionChunk>,
    ) -> Result<Vec<u32>, MeshError> {
        let mut made = Vec::new();
        let mut left = chunks.drain(..);
        loop {
            let chunks: Vec<RegionChunk> = left.by_ref().take(PIECE_CHUNKS).collect();
            if chunks.is_empty() {
                return Ok(made);
            }
            let block = self.pieces[level].len() as u32;
            self.checkpoint.put(Piece { level: level as u32, block }, pack(&chunks))?;
            self.pieces[level].push(chunks.len() as u32);
            made.push(chunks.len() as u32);
        }
    }

    /// Completes a block whose levels are stored.
    pub(crate) fn close_block(&self, block: usize, end: &BlockEnd) -> Result<(), MeshError> {
        if self.resumes() {
            self.checkpoint.put(Piece::end_of_block(block as u32), end.pack())?;
        }
        Ok(())
    }

    /// The rest of a block that an earlier run completed; `wedges` are those of the blocks before.
    pub(crate) fn restore_block(
        &mut self,
        block: usize,
        mesh: &QuantisedMesh,
        wedges: usize,
    ) -> Result<Option<BlockEnd>, MeshError> {
        if !self.resumes() {
            return Ok(None);
        }
        let Some(bytes) = self.checkpoint.get(Piece::end_of_block(block as u32))? else { return Ok(None) };
        let Some(end) = BlockEnd::unpack(&bytes).map_err(CheckpointError::new)? else { return Ok(None) };
        let bounds = Bounds {
            vertices: mesh.positions.len(),
            faces: mesh.faces.len(),
            wedges: wedges + end.added.len(),
        };
        if !end.fits(bounds, self.count()) {
            return Err(wrong_mesh_error());
        }
        let before: Vec<usize> = self.pieces.iter().map(Vec::len).collect();
        for (level, pieces) in self.pieces.iter_mut().zip(&end.pieces) {
            level.extend(pieces);
        }
        // A crash may have lost some pieces: then the block is computed again.
        for level in 0..self.count() {
            for piece in before[level]..self.blocks(level) {
                if let Some(chunks) = self.complete_piece(level, piece)? {
                    if !chunks.iter().all(|chunk| chunk.fits(bounds)) {
                        return Err(wrong_mesh_error());
                    }
                } else {
                    self.pieces.iter_mut().zip(&before).for_each(|(level, &count)| level.truncate(count));
                    return Ok(None);
                }
            }
        }
        Ok(Some(end))
    }

    /// Completes the level stored last.
    pub(crate) fn close(&self, end: &End) -> Result<(), MeshError> {
        Ok(self.checkpoint.put(Piece::end_of(self.pieces.len() as u32 - 1), end.pack())?)
    }

    /// Whether levels can be resumed from the store.
    pub(crate) fn resumes(&self) -> bool {
        self.checkpoint.is_persistent()
    }

    /// Restores the next level if an earlier run completed it; returns its outcome.
    pub(crate) fn restore(
        &mut self,
        live: &mut Live<'_>,
        deviation: &mut Deviation,
    ) -> Result<Option<Outcome>, MeshError> {
        if !self.checkpoint.is_persistent() {
            return Ok(None);
        }
        let level = self.pieces.len();
        let Some(bytes) = self.checkpoint.get(Piece::end_of(level as u32))? else { return Ok(None) };
        let Some(mut end) = End::unpack(&bytes).map_err(CheckpointError::new)? else { return Ok(None) };
        drop(bytes);
        let outcome = end.outcome;
        let full = std::iter::repeat_n(PIECE_CHUNKS as u32, outcome.chunks / PIECE_CHUNKS);
        let rest = (outcome.chunks % PIECE_CHUNKS) as u32;
        self.pieces.push(full.chain((rest > 0).then_some(rest)).collect());
        // A crash may have lost some pieces: then the level is computed again.
        for block in 0..self.blocks(level) {
            if self.complete_piece(level, block)?.is_none() {
                self.pieces.pop();
                return Ok(None);
            }
        }
        end.add_wedges(live)?;
        let mut moves = Vec::new();
        for block in 0..self.blocks(level) {
            moves.extend(perform(self.piece(level, block)?, live)?);
        }
        end.close(&moves, live, deviation)?;
        Ok(Some(outcome))
    }

    /// Number of levels.
    pub(crate) fn count(&self) -> usize {
        self.pieces.len()
    }

    /// Number of chunks in all levels.
    pub(crate) fn chunk_count(&self) -> usize {
        self.pieces.iter().flatten().map(|&chunks| chunks as usize).sum()
    }

    /// Number of pieces of a level.
    pub(crate) fn blocks(&self, level: usize) -> usize {
        self.pieces[level].len()
    }

    /// The chunks of a piece, in the input's ids.
    pub(crate) fn block(&self, level: usize, block: usize) -> Result<Vec<RegionChunk>, MeshError> {
        let mut chunks = self.piece(level, block)?;
        if let Some((_, names)) = self.id_mapping.filter(|&(first, _)| level >= first) {
            chunks.iter_mut().for_each(|chunk| names.rename(chunk));
        }
        Ok(chunks)
    }

    /// The chunks of a piece as stored.
    fn piece(&self, level: usize, block: usize) -> Result<Vec<RegionChunk>, MeshError> {
        let gone = || {
            CheckpointError::new(format!(
                "block {block} of level {level} is missing from the checkpoint store"
            ))
        };
        Ok(self.complete_piece(level, block)?.ok_or_else(gone)?)
    }

    /// The chunks of a piece; `None` if it is missing or damaged.
    fn complete_piece(&self, level: usize, block: usize) -> Result<Option<Vec<RegionChunk>>, MeshError> {
        let count = self.pieces[level][block] as usize;
        let piece = Piece { level: level as u32, block: block as u32 };
        Ok(self.checkpoint.get(piece)?.and_then(|bytes| unpack(&bytes, count).ok()))
    }

    /// All chunks of all levels, finest first.
    #[cfg(test)]
    pub(crate) fn all(&self) -> Vec<RegionChunk> {
        let blocks = (0..self.count()).flat_map(|level| (0..self.blocks(level)).map(move |b| (level, b)));
        blocks.flat_map(|(level, block)| self.block(level, block).unwrap()).collect()
    }
}

/// Records the wedges of removed faces, which `live` holds only until the next level.
pub(crate) fn record_removed_wedges(chunks: &mut [RegionChunk], live: &Live<'_>) {
    for Records { removed, removed_wedges, .. } in chunks.iter_mut().map(|chunk| &mut chunk.records) {
        *removed_wedges = removed.iter().map(|r| live.face_wedges[r.face as usize]).collect();
    }
}
