//! Id mappings between a part of a mesh and the complete mesh.

use crate::collapse::NO_VERTEX;
use crate::mesh::id_set::IdSet;
use crate::mesh::wedges::Wedges;
use crate::mesh::{Face, QuantisedMesh, Wedge};
use crate::simplify::hierarchy::{Bounds, RegionChunk};

/// Maps a part's ids to the complete mesh's.
#[derive(Debug)]
pub(crate) struct Names {
    /// Ascending.
    vertices: Vec<u32>,
    /// Ascending, then those added by [`Self::extend_wedges`].
    wedges: Vec<u32>,
    /// Ascending.
    faces: Vec<u32>,
    /// The complete mesh's id of the first wedge that the part's collapses add.
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

    /// The complete mesh's ids of all vertices, ascending.
    pub(crate) fn vertices(&self) -> &[u32] {
        &self.vertices
    }

    /// A wedge of the part with the complete mesh's vertex id.
    pub(crate) fn of_whole(&self, wedge: Wedge) -> Wedge {
        Wedge { vertex: self.vertex(wedge.vertex), ..wedge }
    }

    /// Adds wedges of the complete mesh that no face of the part uses yet.
    pub(super) fn extend_wedges(&mut self, wedges: impl Iterator<Item = u32>) {
        self.wedges.extend(wedges);
    }

    /// Number of wedges of the part before its own collapses.
    pub(crate) fn wedge_count(&self) -> usize {
        self.wedges.len()
    }

    /// Converts a chunk of the part to the complete mesh's ids.
    pub(crate) fn rename(&self, chunk: &mut RegionChunk) {
        rename(chunk, &|v| self.vertex(v), &|w| self.wedge(w), &|f| self.face(f));
    }
}

/// Maps the complete mesh's ids to a part's; [`NO_ID`] for elements outside the part.
pub(super) struct Numbers {
    vertices: IdSet,
    wedges: IdSet,
    faces: IdSet,
    /// Further wedges by id, ascending.
    extend_wedges: Vec<u32>,
}

/// No id.
const NO_ID: u32 = u32::MAX;

impl Numbers {
    /// For a part with `own` wedges, of a complete mesh with the given element counts.
    pub(super) fn new(names: &Names, own: usize, whole: Bounds) -> Self {
        let set = |bound: usize, ids: &[u32]| IdSet::new(bound, ids.iter().copied());
        Self {
            vertices: set(whole.vertices, &names.vertices),
            wedges: set(whole.wedges, &names.wedges[..own]),
            faces: set(whole.faces, &names.faces),
            extend_wedges: names.wedges[own..].to_vec(),
        }
    }

    pub(super) fn vertex(&self, vertex: u32) -> Option<u32> {
        self.vertices.number(vertex)
    }

    pub(super) fn has_wedge(&self, wedge: u32) -> bool {
        self.wedges.number(wedge).is_some()
    }

    /// Converts a chunk of the complete mesh to the part's ids.
    pub(super) fn rename(&self, chunk: &mut RegionChunk) {
        let of = |set: &IdSet, id: u32| set.number(id).unwrap_or(NO_ID);
        let wedge = |w: u32| {
            let extend_wedges =
                || self.extend_wedges.binary_search(&w).map_or(NO_ID, |at| (self.wedges.len() + at) as u32);
            self.wedges.number(w).unwrap_or_else(extend_wedges)
        };
        rename(chunk, &|v| of(&self.vertices, v), &wedge, &|f| of(&self.faces, f));
    }
}

/// Replaces all ids in a chunk.
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

/// The part of a mesh that consists of the given faces. `corners` returns the wedges of the face at an index of the
/// list; `wedges` are the mesh's with those added by collapses so far.
pub(crate) fn part(
    whole: &QuantisedMesh,
    wedges: &Wedges<'_>,
    faces: &[u32],
    corners: &dyn Fn(usize) -> [u32; 3],
) -> (QuantisedMesh, Names) {
    let wedge = |w: u32| wedges.get(w);
    let used = IdSet::new(wedges.len(), (0..faces.len()).flat_map(corners));
    let vertices = IdSet::new(whole.positions.len(), used.iter().map(|w| wedge(w).vertex));
    // Every id requested below is in the set.
    let number = |set: &IdSet, id: u32| set.number(id).unwrap_or_default();
    let mesh = QuantisedMesh {
        grid: whole.grid,
        uv_grid: whole.uv_grid,
        second_uv_grid: whole.second_uv_grid,
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
        // Simplification keeps vertices within their parts without knowing them.
        parts: Vec::new(),
        skins: if whole.skins.is_empty() {
            Vec::new()
        } else {
            vertices.iter().map(|v| whole.skins[v as usize]).collect()
        },
        poses: whole.poses.clone(),
    };
    let names = Names {
        vertices: vertices.iter().collect(),
        wedges: used.iter().collect(),
        faces: faces.to_vec(),
        first_added: wedges.len() as u32,
    };
    (mesh, names)
}
