//! Resuming a preparation at the last level that an interrupted run completed.
//!
//! The stored blocks of a level hold its collapses; a final piece ([`End`]) holds the rest. A level is restored by
//! applying its collapses, without the search and the measurements, which are nearly all of the work.

use crate::checkpoint::CheckpointError;
use crate::collapse::{Placed, Records};
use crate::entropy::bytes::Reader;
use crate::error::{DecodeError, MeshError};
use crate::mesh::Wedge;
use crate::mesh::vec3::{length, sub};
use crate::simplify::commit::CommitProgress;
use crate::simplify::deviation::Deviation;
use crate::simplify::hierarchy::{Bounds, RegionChunk};
use crate::simplify::live::Live;
use crate::simplify::packed::{halves, list, put, put_wedges, real, wedges};

/// Version of the layout of stored pieces.
const LAYOUT: u32 = 2;

/// Outcome of a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Outcome {
    /// Number of chunks.
    pub(crate) chunks: usize,
    /// Shift of the grid at its end.
    pub(crate) shift: u8,
    /// Whether it removed so little that no level follows.
    pub(crate) little: bool,
    pub(crate) last: bool,
    /// Number of collapses.
    pub(crate) removed: usize,
    /// Of all levels so far.
    pub(crate) stray_error: f64,
}

/// The piece that completes a level: its results beyond the chunks.
#[derive(Debug, PartialEq)]
pub(crate) struct End {
    pub(crate) outcome: Outcome,
    /// Wedges that its collapses added, in order.
    added: Vec<Wedge>,
    /// Positions of the vertices placed by its chunks, in the order of their moves.
    placed: Vec<Placed>,
    /// Per sample, the nearest face and its distance.
    attached: Vec<u32>,
    distance: Vec<f32>,
}

impl End {
    /// For a level that ends at `live`, given its chunks' moves and the number of wedges before.
    pub(crate) fn new<'a>(
        outcome: Outcome,
        moves: impl Iterator<Item = &'a Placed>,
        wedges: usize,
        live: &Live<'_>,
        deviation: &Deviation,
    ) -> Self {
        let (attached, distance) = deviation.places();
        Self {
            outcome,
            added: live.wedges.added_from(wedges).to_vec(),
            placed: moves.map(|m| live.placed(m.vertex)).collect(),
            attached: attached.to_vec(),
            distance: distance.to_vec(),
        }
    }

    pub(crate) fn pack(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(8 * self.attached.len() + 24 * self.placed.len() + 64);
        let Outcome { chunks, shift, little, last, removed, stray_error } = self.outcome;
        let [low, high] = halves(stray_error);
        let head =
            [LAYOUT, chunks as u32, shift.into(), little.into(), last.into(), removed as u32, low, high];
        put(&mut out, &head, |&x| [x]);
        put_wedges(&mut out, &self.added);
        put(&mut out, &self.placed, |p| {
            let [x, y, z] = p.cell.map(i32::cast_unsigned);
            [p.vertex, x, y, z, p.shift.into()]
        });
        put(&mut out, &self.attached, |&face| [face]);
        put(&mut out, &self.distance, |x| [x.to_bits()]);
        out
    }

    /// Parses the result of [`Self::pack`]; `None` if another version wrote it.
    ///
    /// # Errors
    /// If the bytes are damaged.
    pub(crate) fn unpack(bytes: &[u8]) -> Result<Option<Self>, DecodeError> {
        let mut r = Reader::new(bytes, "the end of a level");
        let head = list(&mut r, |[x]| x)?;
        let &[LAYOUT, chunks, shift, little, last, removed, low, high] = head.as_slice() else {
            return Ok(None);
        };
        let added = wedges(&mut r)?;
        let placed = list(&mut r, |[vertex, x, y, z, shift]| Placed {
            vertex,
            cell: [x, y, z].map(u32::cast_signed),
            shift: shift as u8,
        })?;
        let attached = list(&mut r, |[face]| face)?;
        let distance = list(&mut r, |[bits]| f32::from_bits(bits))?;
        let outcome = Outcome {
            chunks: chunks as usize,
            shift: shift as u8,
            little: little != 0,
            last: last != 0,
            removed: removed as usize,
            stray_error: real([low, high]),
        };
        Ok(Some(Self { outcome, added, placed, attached, distance }))
    }

    /// Adds the wedges that the restored collapses refer to.
    pub(crate) fn add_wedges(&mut self, live: &mut Live<'_>) -> Result<(), MeshError> {
        if self.added.iter().any(|wedge| wedge.vertex as usize >= live.positions.len()) {
            return Err(wrong_mesh_error());
        }
        self.added.drain(..).for_each(|wedge| live.restore_wedge(wedge));
        Ok(())
    }

    /// Restores the rest after the collapses are applied; `before` holds the original positions of its moves.
    pub(crate) fn close(
        self,
        before: &[Placed],
        live: &mut Live<'_>,
        deviation: &mut Deviation,
    ) -> Result<(), MeshError> {
        let same = |(a, b): (&Placed, &Placed)| a.vertex == b.vertex;
        let samples = deviation.sample_count();
        if before.len() != self.placed.len()
            || !before.iter().zip(&self.placed).all(same)
            || self.attached.len() != samples
            || self.distance.len() != samples
            || self.attached.iter().any(|&face| face as usize >= live.alive.len())
        {
            return Err(wrong_mesh_error());
        }
        for (was, is) in before.iter().zip(&self.placed) {
            let v = is.vertex as usize;
            live.positions[v] = live.position(is.cell);
            live.shifts[v] = is.shift;
            live.reach[v] += length(sub(live.positions[v], live.position(was.cell)));
        }
        live.settle();
        deviation.set_places(self.attached, self.distance);
        Ok(())
    }
}

/// Applies a block's collapses again, with the final wedge ids.
pub(crate) fn perform(chunks: Vec<RegionChunk>, live: &mut Live<'_>) -> Result<Vec<Placed>, MeshError> {
    let bounds =
        Bounds { vertices: live.positions.len(), faces: live.alive.len(), wedges: live.wedges.len() };
    let mut moves = Vec::new();
    for chunk in chunks {
        let fits = chunk.fits(bounds);
        let RegionChunk { records, moves: moved, .. } = chunk;
        let mut records = Records { first_added_wedge: u32::MAX, added_wedges: Vec::new(), ..records };
        records.collapses.iter_mut().for_each(|c| c.added_wedges_end = 0);
        if !fits {
            return Err(wrong_mesh_error());
        }
        let count = records.collapses.len();
        records.commit(live, &mut CommitProgress::default(), count, &mut |_| {});
        moves.extend(moved);
    }
    Ok(moves)
}

pub(super) fn wrong_mesh_error() -> MeshError {
    CheckpointError::new("a checkpoint belongs to another mesh; remove the checkpoint folder").into()
}
