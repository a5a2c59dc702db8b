//! Simplification of large meshes: the finest levels are made one spatial block after the other.
//!
//! A block is simplified like a separate mesh, measured against its part of the input; vertices shared with other
//! blocks stay. The merged result deviates from the input by the errors of the blocks' levels, which are added to
//! every error measured against it (triangle inequality). So memory does not depend on the number of blocks. After
//! Cignoni et al., "External memory management and simplification of huge meshes" (2003), where block outlines stay
//! until the next level; here they stay for a few levels, and the coarser levels partition the merged mesh anew.

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
use crate::simplify::levels::{Levels, record_removed_wedges};
use crate::simplify::limit::Limit;
use crate::simplify::live::Live;
use crate::simplify::reduce::{LevelParameters, Reduction};
use crate::simplify::resume::perform;
use crate::simplify::settings::Settings;

/// Share of its target that a block's level reaches, since outline vertices stay.
const REACHED_SHARE: f64 = 0.9;
/// Most levels of blocks before merging.
const MAX_LEVELS: usize = 8;
/// The faces that remain then, at most, in units of blocks: fewer would need smaller blocks, with more locked
/// outlines.
const LEFT_BLOCKS: f64 = 2.0;
/// Levels of blocks after the merged mesh, measured against the input.
const LEVELS_AFTER_MERGE: usize = 1;

/// Whether a mesh is simplified in blocks.
pub(crate) fn in_blocks(mesh: &QuantisedMesh, settings: &Settings) -> bool {
    mesh.faces.len() > settings.block_faces
}

/// Number of levels of blocks before merging.
fn level_count(faces: usize, settings: &Settings) -> usize {
    let left = 1.0 - REACHED_SHARE * settings.level_share;
    let enough = |&levels: &usize| {
        faces as f64 * left.powi(levels as i32) <= LEFT_BLOCKS * settings.block_faces as f64
    };
    (1..MAX_LEVELS).find(enough).unwrap_or(MAX_LEVELS)
}

/// Simplifies the finest levels of all blocks and stores them.
pub(crate) fn simplify_blocks(
    mesh: &QuantisedMesh,
    settings: &Settings,
    pool: &mut MonitoredPool<'_>,
    levels: &mut Levels<'_>,
) -> Result<Merged, MeshError> {
    let whole = CompleteMesh {
        mesh,
        settings,
        levels: level_count(mesh.faces.len(), settings),
        diagonal: diagonal(mesh),
    };
    let cut = Cut::new(mesh, mesh.faces.len().div_ceil(settings.block_faces));
    let mut all = BlockEnd::default();
    let mut wedges = Wedges::new(&mesh.wedges);
    let mut done = 0;
    levels.begin(whole.levels + LEVELS_AFTER_MERGE);
    for number in 0..cut.count() {
        let faces = cut.faces(number);
        let end = match levels.restore_block(number, mesh, wedges.len())? {
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

/// The complete mesh, which is cut into blocks.
struct CompleteMesh<'a> {
    mesh: &'a QuantisedMesh,
    settings: &'a Settings,
    /// Number of levels before merging.
    levels: usize,
    /// In grid cells.
    diagonal: f64,
}

impl CompleteMesh<'_> {
    /// Simplifies a block and stores its levels; `wedges` are those so far, `done` the number of removed faces.
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
        let mut deviation = Deviation::new(&live, pool)?;
        let limit = Limit::new(&live, settings.base_error * diagonal, diagonal);
        // Corners of large, thin components are locked only after the blocks: finding them needs the complete mesh,
        // and fine levels keep corners to within their small errors.
        let reduction = Reduction { settings, limit: &limit, fixed: Fixed { held: &[], locked: &locked } };
        let mut end = BlockEnd::default();
        // Per face, the errors of the last chunk that contained it.
        let mut errors = vec![[0.0_f32; 2]; block.faces.len()];
        for number in 0..self.levels + LEVELS_AFTER_MERGE {
            if number == self.levels {
                let left = || live.faces.iter().map(|&f| f as usize);
                end.faces = live.faces.iter().map(|&f| names.face(f)).collect();
                end.corners = left().map(|f| live.face_wedges[f].map(|w| names.wedge(w))).collect();
                end.errors = left().map(|f| errors[f]).collect();
            }
            let count = (live.faces.len() / settings.region_faces).max(1);
            let place = LevelParameters { number, count, last: false, shift: 0, coarse_grid: 0.0, done };
            let mut level = reduction.level(&mut live, &mut deviation, place, &mut end.stray_error, pool)?;
            for chunk in &level.chunks {
                let own = [chunk.error, chunk.attribute_error].map(round_up);
                chunk.faces.iter().for_each(|&face| errors[face as usize] = own);
            }
            record_removed_wedges(&mut level.chunks, &live);
            level.chunks.iter_mut().for_each(|chunk: &mut RegionChunk| names.rename(chunk));
            end.pieces.push(levels.append(number, level.chunks)?);
        }
        end.added = live.wedges.added_from(block.wedges.len()).iter().map(|&w| names.of_whole(w)).collect();
        Ok(end)
    }

    /// Merges the remaining meshes of all blocks.
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
        // Added wedges without a face: some will get one in the last levels.
        let numbers = Numbers::new(&names, mesh.wedges.len(), self.bounds(wedges));
        let first = self.mesh.wedges.len() as u32;
        let (late, also): (Vec<u32>, Vec<Wedge>) = (first..)
            .zip(&added)
            .filter(|&(id, _)| !numbers.has_wedge(id))
            .filter_map(|(id, &wedge)| Some((id, Wedge { vertex: numbers.vertex(wedge.vertex)?, ..wedge })))
            .unzip();
        names.extend_wedges(late.into_iter());
        Merged { mesh, names, inherited, also, levels: self.levels, added, stray_error }
    }

    fn bounds(&self, wedges: &Wedges<'_>) -> Bounds {
        let (vertices, faces) = (self.mesh.positions.len(), self.mesh.faces.len());
        Bounds { vertices, faces, wedges: wedges.len() }
    }
}

/// Applies the last levels of blocks to `live`, the merged mesh of `whole`.
pub(crate) fn apply_last_levels(
    merged: &Merged,
    whole: &QuantisedMesh,
    live: &mut Live<'_>,
    levels: &Levels<'_>,
) -> Result<(), MeshError> {
    merged.also.iter().for_each(|&wedge| live.restore_wedge(wedge));
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

/// The nearest f32 not below `x`.
fn round_up(x: f64) -> f32 {
    (x * (1.0 + 1e-6)) as f32
}
