//! What a part of a mesh calls its vertices, wedges and faces, and what the whole does.

use crate::collapse::NO_VERTEX;
use crate::mesh::id_set::IdSet;
use crate::mesh::wedges::Wedges;
use crate::mesh::{Face, QuantisedMesh, Wedge};
use crate::simplify::hierarchy::{Bounds, RegionChunk};

/// The whole's ids by a part's.
#[derive(Debug)]
pub(crate) struct Names {
    /// Ascending.
    vertices: Vec<u32>,
    /// Ascending, then those of [`Self::also`].
    wedges: Vec<u32>,
    /// Ascending.
    faces: Vec<u32>,
    /// The whole's id of the first wedge that the part's collapses add.
    first_added: u32,
}

impl Names {
    pub(crate) fn vertex(&self, vertex: u32) -> u32 {
        self.vertices[vertex as usize]
    }

    pub(crate) fn wedge(&self, wedge: u32) -> u32 {
        match self.wedges.get(wedge as usize) {
            Some(&wedge) => wedge,
            None => wedge - self.wedges.len() as u32 + self.first_added,
        }
    }

    pub(crate) fn face(&self, face: u32) -> u32 {
        self.faces[face as usize]
    }

    /// The whole's ids of all vertices, ascending.
    pub(crate) fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// A wedge of the part as the whole has it.
    pub(crate) fn of_whole(&self, wedge: Wedge) -> Wedge {
        Wedge { vertex: self.vertex(wedge.vertex), ..wedge }
    }

    /// Wedges of the whole that no face of the part has yet are the part's, too.
    pub(super) fn also(&mut self, wedges: impl Iterator<Item = u32>) {
        self.wedges.extend(wedges);
    }

    /// How many wedges the part has before its own collapses add any.
    pub(crate) fn wedge_count(&self) -> usize {
        self.wedges.len()
    }

    /// What became of a region of the part, as the whole has it.
    pub(crate) fn rename(&self, chunk: &mut RegionChunk) {
        rename(chunk, &|v| self.vertex(v), &|w| self.wedge(w), &|f| self.face(f));
    }
}

/// The part's ids by the whole's; [`NOTHING`] for what the part does not have.
pub(super) struct Numbers {
    vertices: IdSet,
    wedges: IdSet,
    faces: IdSet,
    /// Wedges behind those, by their ids, ascending.
    also: Vec<u32>,
}

/// No id.
const NOTHING: u32 = u32::MAX;

impl Numbers {
    /// Of a part with `own` wedges of its own, of a whole with so many.
    pub(super) fn new(names: &Names, own: usize, whole: Bounds) -> Self {
        let set = |bound: usize, ids: &[u32]| IdSet::new(bound, ids.iter().copied());
        Self {
            vertices: set(whole.vertices, &names.vertices),
            wedges: set(whole.wedges, &names.wedges[..own]),
            faces: set(whole.faces, &names.faces),
            also: names.wedges[own..].to_vec(),
        }
    }

    pub(super) fn vertex(&self, vertex: u32) -> Option<u32> {
        self.vertices.number(vertex)
    }

    pub(super) fn has_wedge(&self, wedge: u32) -> bool {
        self.wedges.number(wedge).is_some()
    }

    /// What became of a region of the whole, as the part has it.
    pub(super) fn rename(&self, chunk: &mut RegionChunk) {
        let of = |set: &IdSet, id: u32| set.number(id).unwrap_or(NOTHING);
        let wedge = |w: u32| {
            let also = || self.also.binary_search(&w).map_or(NOTHING, |at| (self.wedges.len() + at) as u32);
            self.wedges.number(w).unwrap_or_else(also)
        };
        rename(chunk, &|v| of(&self.vertices, v), &wedge, &|f| of(&self.faces, f));
    }
}

/// Gives all that a chunk names other ids.
fn rename(
    chunk: &mut RegionChunk,
    vertex: &dyn Fn(u32) -> u32,
    wedge: &dyn Fn(u32) -> u32,
    face: &dyn Fn(u32) -> u32,
) {
    let RegionChunk { records, faces, interior, moves, .. } = chunk;
    for collapse in &mut records.collapses {
        collapse.removed = vertex(collapse.removed);
        if collapse.target != NO_VERTEX {
            collapse.target = vertex(collapse.target);
        }
    }
    for moved in &mut records.moved {
        moved.face = face(moved.face);
        moved.from = wedge(moved.from);
        moved.to = wedge(moved.to);
    }
    for removed in &mut records.removed {
        *removed = removed.with_ids(face, vertex);
    }
    records.removed_wedges.iter_mut().flatten().chain(&mut records.added_wedges).for_each(|w| *w = wedge(*w));
    faces.iter_mut().for_each(|f| *f = face(*f));
    interior.iter_mut().for_each(|v| *v = vertex(*v));
    moves.iter_mut().for_each(|placed| placed.vertex = vertex(placed.vertex));
}

/// The part of a mesh that some of its faces are. `corners` tells the wedges of the face at a place of the list, `wedges`
/// all that there are: the mesh's, and those that collapses have added so far.
pub(crate) fn part(
    whole: &QuantisedMesh,
    wedges: &Wedges<'_>,
    faces: &[u32],
    corners: &dyn Fn(usize) -> [u32; 3],
) -> (QuantisedMesh, Names) {
    let wedge = |w: u32| wedges.get(w);
    let used = IdSet::new(wedges.len(), (0..faces.len()).flat_map(corners));
    let vertices = IdSet::new(whole.positions.len(), used.iter().map(|w| wedge(w).vertex));
    // All that is asked for was put in.
    let number = |set: &IdSet, id: u32| set.number(id).unwrap_or_default();
    let mesh = QuantisedMesh {
        grid: whole.grid,
        uv_grid: whole.uv_grid,
        positions: vertices.iter().map(|v| whole.positions[v as usize]).collect(),
        wedges: used
            .iter()
            .map(|w| {
                let wedge = wedge(w);
                Wedge { vertex: number(&vertices, wedge.vertex), ..wedge }
            })
            .collect(),
        faces: faces
            .iter()
            .enumerate()
            .map(|(at, &face)| Face {
                wedges: corners(at).map(|w| number(&used, w)),
                material: whole.faces[face as usize].material,
            })
            .collect(),
    };
    let names = Names {
        vertices: vertices.iter().collect(),
        wedges: used.iter().collect(),
        faces: faces.to_vec(),
        first_added: wedges.len() as u32,
    };
    (mesh, names)
}
