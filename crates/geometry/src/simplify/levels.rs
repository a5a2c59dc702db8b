//! Finished levels of a preparation, and what is left of the mesh: what simplification hands to the encoder.

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
use crate::simplify::resume::{End, Outcome, not_of_this_mesh, perform};

/// Chunks that are put away and encoded together: enough for any number of threads, a few megabytes.
const PIECE_CHUNKS: usize = 64;

/// A mesh reduced to its base, and the way there.
pub(crate) struct Simplified<'a> {
    /// Levels, finest first.
    pub(crate) levels: Levels<'a>,
    /// What is left, by ids of its own where it was simplified in blocks.
    pub(crate) live: Live<'a>,
    /// The mesh's wedges, and those that collapses added.
    pub(crate) wedges: Wedges<'a>,
    merged: Option<&'a Merged>,
    mesh: &'a QuantisedMesh,
    /// By the ids of what is left, where these are not the mesh's.
    numbers: IdSet,
    /// Error of regions that vanished or were dropped without a chunk of their own.
    pub(crate) stray_error: f64,
    /// How many bits the grids leave out that the levels' chunks bring vertices to; one more for the base mesh.
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

    /// Where a vertex is; where it was last, if it is gone.
    pub(crate) fn placed(&self, vertex: u32) -> Placed {
        match (self.merged, self.numbers.number(vertex)) {
            (None, _) => self.live.placed(vertex),
            (Some(_), Some(own)) => Placed { vertex, ..self.live.placed(own) },
            // Blocks move nothing.
            (Some(_), None) => Placed { vertex, cell: self.mesh.positions[vertex as usize], shift: 0 },
        }
    }

    /// The faces that are left, ascending by ids of what is left: each with its id and its wedges, as the mesh has them.
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

    /// Lets go of what only the base mesh needs: where vertices are, and wedges, stay.
    pub(crate) fn forget_faces(&mut self) {
        self.live.forget_faces();
    }
}

/// Finished levels, finest first, each a list of chunks that are put away in pieces: chunks that follow one another are
/// neighbours in space (`partition`).
pub(crate) struct Levels<'a> {
    checkpoint: &'a dyn CheckpointStore,
    /// By level, how many chunks each of its pieces has.
    pieces: Vec<Vec<u32>>,
    /// From this level on, chunks are put away by ids that these names turn into the mesh's.
    renamed: Option<(usize, &'a Names)>,
}

impl<'a> Levels<'a> {
    pub(crate) fn new(checkpoint: &'a dyn CheckpointStore) -> Self {
        Self { checkpoint, pieces: Vec::new(), renamed: None }
    }

    /// Begins so many levels at the same time, of blocks.
    pub(crate) fn begin(&mut self, levels: usize) {
        self.pieces = vec![Vec::new(); levels];
    }

    /// All levels to come are of a mesh with ids of its own.
    pub(crate) fn rename_by(&mut self, names: Option<&'a Names>) {
        self.renamed = names.map(|names| (self.count(), names));
    }

    /// Puts a level away that `live` is the end of.
    pub(crate) fn push(&mut self, mut chunks: Vec<RegionChunk>, live: &Live<'_>) -> Result<(), MeshError> {
        keep_vanished(&mut chunks, live);
        self.pieces.push(Vec::new());
        self.append(self.pieces.len() - 1, chunks).map(|_| ())
    }

    /// Puts chunks away behind those that a level has; answers how many chunks each piece has that was made of them.
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

    /// Closes a block whose levels are put away.
    pub(crate) fn close_block(&self, block: usize, end: &BlockEnd) -> Result<(), MeshError> {
        if self.resumes() {
            self.checkpoint.put(Piece::end_of_block(block as u32), end.pack())?;
        }
        Ok(())
    }

    /// What is left of a block, if a preparation before this one has finished it; `wedges` are those of the blocks before.
    pub(crate) fn redo_block(
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
            return Err(not_of_this_mesh());
        }
        let before: Vec<usize> = self.pieces.iter().map(Vec::len).collect();
        for (level, pieces) in self.pieces.iter_mut().zip(&end.pieces) {
            level.extend(pieces);
        }
        // A crash may have left some without others: then the block is done as if nothing were there.
        for level in 0..self.count() {
            for piece in before[level]..self.blocks(level) {
                if let Some(chunks) = self.whole_block(level, piece)? {
                    if !chunks.iter().all(|chunk| chunk.fits(bounds)) {
                        return Err(not_of_this_mesh());
                    }
                } else {
                    self.pieces.iter_mut().zip(&before).for_each(|(level, &count)| level.truncate(count));
                    return Ok(None);
                }
            }
        }
        Ok(Some(end))
    }

    /// Closes the level that was put away last.
    pub(crate) fn close(&self, end: &End) -> Result<(), MeshError> {
        Ok(self.checkpoint.put(Piece::end_of(self.pieces.len() as u32 - 1), end.pack())?)
    }

    /// Whether levels are to be closed.
    pub(crate) fn resumes(&self) -> bool {
        self.checkpoint.is_persistent()
    }

    /// Does again the next level, if a preparation before this one has finished it; answers how it ended.
    pub(crate) fn redo(
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
        // A crash may have left some without others: then the level is done as if nothing were there.
        for block in 0..self.blocks(level) {
            if self.whole_block(level, block)?.is_none() {
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

    /// How many there are.
    pub(crate) fn count(&self) -> usize {
        self.pieces.len()
    }

    /// How many chunks they have together.
    pub(crate) fn chunk_count(&self) -> usize {
        self.pieces.iter().flatten().map(|&chunks| chunks as usize).sum()
    }

    /// How many pieces a level is in.
    pub(crate) fn blocks(&self, level: usize) -> usize {
        self.pieces[level].len()
    }

    /// The chunks of a piece, by the mesh's ids.
    pub(crate) fn block(&self, level: usize, block: usize) -> Result<Vec<RegionChunk>, MeshError> {
        let mut chunks = self.piece(level, block)?;
        if let Some((_, names)) = self.renamed.filter(|&(first, _)| level >= first) {
            chunks.iter_mut().for_each(|chunk| names.rename(chunk));
        }
        Ok(chunks)
    }

    /// The chunks of a piece as they were put away.
    fn piece(&self, level: usize, block: usize) -> Result<Vec<RegionChunk>, MeshError> {
        let gone = || CheckpointError::new(format!("block {block} of level {level} is gone"));
        Ok(self.whole_block(level, block)?.ok_or_else(gone)?)
    }

    /// The same, or `None` where it is not there or damaged.
    fn whole_block(&self, level: usize, block: usize) -> Result<Option<Vec<RegionChunk>>, MeshError> {
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

/// Notes the wedges of faces that removed_wedges, which `live` knows as long as they are not put away.
pub(crate) fn keep_vanished(chunks: &mut [RegionChunk], live: &Live<'_>) {
    for Records { removed, removed_wedges, .. } in chunks.iter_mut().map(|chunk| &mut chunk.records) {
        *removed_wedges = removed.iter().map(|r| live.face_wedges[r.face as usize]).collect();
    }
}
