//! Meshes of more faces than are simplified at once: the finest levels spatial block after spatial block.
//!
//! A block is simplified like a mesh of its own, measured against its own part of the input, but for the vertices that it
//! shares with others, which stay. What is left of all blocks is a mesh as any other, only that it is not the input: it is
//! off by what the blocks' levels have cost where it lies, and that is added to every error that is measured against it
//! (the triangle inequality). So neither memory nor time depend on how many blocks there are. Out of core simplification by
//! blocks with outlines that stay until the next level is Cignoni et al., "External memory management and simplification of
//! huge meshes" (2003); here they stay for a few levels, of which the coarser, with all blocks in one, cut anew.

mod cut;
pub(crate) mod end;
pub(crate) mod merged;
pub(crate) mod names;

use crate::error::MeshError;
use crate::mesh::wedges::Wedges;
use crate::mesh::{QuantisedMesh, Wedge};
use crate::pool::MonitoredPool;
use crate::simplify::blocks::cut::Cut;

use crate::simplify::blocks::end::BlockEnd;
use crate::simplify::blocks::merged::Merged;
use crate::simplify::blocks::names::{Numbers, part};
use crate::simplify::deviation::Deviation;
use crate::simplify::extent::diagonal;
use crate::simplify::hierarchy::{Bounds, RegionChunk};
use crate::simplify::inherited::Inherited;
use crate::simplify::level::Fixed;
use crate::simplify::levels::{Levels, keep_vanished};
use crate::simplify::limit::Limit;
use crate::simplify::live::Live;
use crate::simplify::reduce::{Place, Reduction};
use crate::simplify::resume::perform;
use crate::simplify::settings::Settings;

/// Of a level's share, what a block's level reaches: vertices on outlines stay.
const REACHED: f64 = 0.9;
/// Most levels of blocks before what is left is measured against.
const MOST_LEVELS: usize = 8;
/// How many blocks' faces are left then, at most: fewer would come of smaller blocks, more of which are outlines that stay.
const LEFT_BLOCKS: f64 = 2.0;
/// Levels of blocks after that: what has been made of it since is known from the input.
const LEVELS_BEHIND: usize = 1;

/// Whether a mesh is simplified block after block.
pub(crate) fn in_blocks(mesh: &QuantisedMesh, settings: &Settings) -> bool {
    mesh.faces.len() > settings.block_faces
}

/// How many levels of blocks there are before what is left is measured against.
fn level_count(faces: usize, settings: &Settings) -> usize {
    let left = 1.0 - REACHED * settings.level_share;
    let enough = |&levels: &usize| {
        faces as f64 * left.powi(levels as i32) <= LEFT_BLOCKS * settings.block_faces as f64
    };
    (1..MOST_LEVELS).find(enough).unwrap_or(MOST_LEVELS)
}

/// Simplifies the finest levels of all blocks and puts them away.
pub(crate) fn simplify_blocks(
    mesh: &QuantisedMesh,
    settings: &Settings,
    pool: &mut MonitoredPool<'_>,
    levels: &mut Levels<'_>,
) -> Result<Merged, MeshError> {
    let whole =
        Whole { mesh, settings, levels: level_count(mesh.faces.len(), settings), diagonal: diagonal(mesh) };
    let cut = Cut::new(mesh, mesh.faces.len().div_ceil(settings.block_faces));
    let mut all = BlockEnd::default();
    let mut wedges = Wedges::new(&mesh.wedges);
    let mut done = 0;
    levels.begin(whole.levels + LEVELS_BEHIND);
    for number in 0..cut.count() {
        let faces = cut.faces(number);
        let end = match levels.redo_block(number, mesh, wedges.len())? {
            Some(end) => end,
            None => {
                let end = whole.simplify(&cut, number, &wedges, (done, pool), levels)?;
                levels.close_block(number, &end)?;
                end
            }
        };
        done += faces.len() - end.faces.len();
        pool.advance(done, 0);
        end.added.iter().for_each(|&wedge| _ = wedges.push(wedge));
        all.append(end);
    }
    Ok(whole.merge(all, &wedges))
}

/// The mesh that blocks are of.
struct Whole<'a> {
    mesh: &'a QuantisedMesh,
    settings: &'a Settings,
    /// Before what is left is measured against.
    levels: usize,
    /// In grid cells.
    diagonal: f64,
}

impl Whole<'_> {
    /// Simplifies a block and puts its levels away; `wedges` are those so far, `done` the faces that are gone.
    fn simplify(
        &self,
        cut: &Cut,
        number: usize,
        wedges: &Wedges<'_>,
        (done, pool): (usize, &mut MonitoredPool<'_>),
        levels: &mut Levels<'_>,
    ) -> Result<BlockEnd, MeshError> {
        let &Self { mesh, settings, diagonal, .. } = self;
        let faces = cut.faces(number);
        let (block, names) = part(mesh, wedges, faces, &|at| mesh.faces[faces[at] as usize].wedges);
        let locked: Vec<bool> = names.vertices().iter().map(|&v| cut.is_shared(v)).collect();
        let mut live = Live::new(&block, settings.codec);
        let mut deviation = Deviation::new(&live, block.uv_grid, pool)?;
        let limit = Limit::new(&live, settings.base_error * diagonal, diagonal);
        // Corners of large, thin parts are held from the first level behind blocks on: which parts those are only the whole
        // mesh tells, and fine levels leave their corners to within their small errors.
        let reduction = Reduction { settings, limit: &limit, fixed: Fixed { held: &[], locked: &locked } };
        let mut end = BlockEnd::default();
        // By face, the errors of the last chunk that held it: of what is left around it.
        let mut errors = vec![[0.0_f32; 2]; block.faces.len()];
        for number in 0..self.levels + LEVELS_BEHIND {
            if number == self.levels {
                let left = || live.faces.iter().map(|&f| f as usize);
                end.faces = live.faces.iter().map(|&f| names.face(f)).collect();
                end.corners = left().map(|f| live.face_wedges[f].map(|w| names.wedge(w))).collect();
                end.errors = left().map(|f| errors[f]).collect();
            }
            let count = (live.faces.len() / settings.region_faces).max(1);
            let place = Place { number, count, last: false, shift: 0, coarse_grid: 0.0, done };
            let mut level = reduction.level(&mut live, &mut deviation, place, &mut end.stray_error, pool)?;
            for chunk in &level.chunks {
                let own = [chunk.error, chunk.attribute_error].map(round_up);
                chunk.faces.iter().for_each(|&face| errors[face as usize] = own);
            }
            keep_vanished(&mut level.chunks, &live);
            level.chunks.iter_mut().for_each(|chunk: &mut RegionChunk| names.rename(chunk));
            end.pieces.push(levels.append(number, level.chunks)?);
        }
        end.added = live.wedges.added_from(block.wedges.len()).iter().map(|&w| names.of_whole(w)).collect();
        Ok(end)
    }

    /// What is left of all blocks.
    fn merge(&self, all: BlockEnd, wedges: &Wedges<'_>) -> Merged {
        let BlockEnd { faces, corners, errors, added, stray_error, .. } = all;
        let mut order: Vec<u32> = (0..faces.len() as u32).collect();
        order.sort_unstable_by_key(|&at| faces[at as usize]);
        let sorted: Vec<u32> = order.iter().map(|&at| faces[at as usize]).collect();
        let (mesh, mut names) = part(self.mesh, wedges, &sorted, &|at| corners[order[at] as usize]);
        let mut inherited = Inherited {
            geometric: vec![0.0; mesh.positions.len()],
            attributes: vec![0.0; mesh.positions.len()],
        };
        for (face, &at) in mesh.faces.iter().zip(&order) {
            let [geometric, attributes] = errors[at as usize];
            for v in face.wedges.map(|w| mesh.wedges[w as usize].vertex as usize) {
                inherited.geometric[v] = inherited.geometric[v].max(geometric);
                inherited.attributes[v] = inherited.attributes[v].max(attributes);
            }
        }
        // Those that were added and that no face has: some will be, by the last levels.
        let numbers = Numbers::new(&names, mesh.wedges.len(), self.bounds(wedges));
        let first = self.mesh.wedges.len() as u32;
        let (late, also): (Vec<u32>, Vec<Wedge>) = (first..)
            .zip(&added)
            .filter(|&(id, _)| !numbers.has_wedge(id))
            .filter_map(|(id, &wedge)| Some((id, Wedge { vertex: numbers.vertex(wedge.vertex)?, ..wedge })))
            .unzip();
        names.also(late.into_iter());
        Merged { mesh, names, inherited, also, levels: self.levels, added, stray_error }
    }

    fn bounds(&self, wedges: &Wedges<'_>) -> Bounds {
        let (vertices, faces) = (self.mesh.positions.len(), self.mesh.faces.len());
        Bounds { vertices, faces, wedges: wedges.len() }
    }
}

/// Takes what is left to where the last levels of blocks have left it: `live` is the mesh itself, of
/// `whole`.
pub(crate) fn catch_up(
    merged: &Merged,
    whole: &QuantisedMesh,
    live: &mut Live<'_>,
    levels: &Levels<'_>,
) -> Result<(), MeshError> {
    merged.also.iter().for_each(|&wedge| live.keep_again(wedge));
    let bounds = Bounds {
        vertices: whole.positions.len(),
        faces: whole.faces.len(),
        wedges: whole.wedges.len() + merged.added.len(),
    };
    let numbers = Numbers::new(&merged.names, merged.mesh.wedges.len(), bounds);
    for level in merged.levels..levels.count() {
        for piece in 0..levels.blocks(level) {
            let mut chunks = levels.block(level, piece)?;
            chunks.iter_mut().for_each(|chunk| numbers.rename(chunk));
            perform(chunks, live)?;
        }
    }
    live.settle();
    Ok(())
}

/// A float not below `x`.
fn round_up(x: f64) -> f32 {
    (x * (1.0 + 1e-6)) as f32
}
