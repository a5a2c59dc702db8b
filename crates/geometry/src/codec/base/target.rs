//! The mesh that an encoder encodes.

use std::collections::HashMap;

use crate::codec::base::mesh::BaseMesh;
use crate::codec::numbering::Numbering;
use crate::mesh::Attributes;
use crate::mesh::corner;
use crate::mesh::skin::Skin;
use crate::numbers::id32;

/// The mesh to encode, with the numbers assigned in traversal order.
pub(super) struct TargetMesh<'a> {
    mesh: &'a BaseMesh,
    /// Faces by directed edge (vertices of `mesh`), as (face, corner that starts the edge).
    edges: HashMap<(u32, u32), Vec<(u32, u8)>>,
    done: Vec<bool>,
    next_seed: usize,
    pub(super) names: Numbering,
}

impl<'a> TargetMesh<'a> {
    pub(super) fn new(mesh: &'a BaseMesh) -> Self {
        let mut edges: HashMap<(u32, u32), Vec<(u32, u8)>> = HashMap::new();
        for (f, face) in mesh.faces.iter().enumerate() {
            let v = face.wedges.map(|w| mesh.wedges[w as usize].vertex);
            for (k, corner) in (0..3).zip(0_u8..) {
                edges.entry((v[k], v[corner::next(k)])).or_default().push((id32(f), corner));
            }
        }
        Self { mesh, edges, done: vec![false; mesh.faces.len()], next_seed: 0, names: Numbering::default() }
    }

    /// The next face at a gate, with its wedges starting at the gate's edge.
    pub(super) fn at_gate(&mut self, a: u32, b: u32) -> Option<(u32, [u32; 3])> {
        let edge = (self.names.vertices[a as usize], self.names.vertices[b as usize]);
        let (face, k) = *self.edges.get(&edge)?.iter().find(|(f, _)| !self.done[*f as usize])?;
        Some(self.take(face, usize::from(k)))
    }

    /// The next face that no gate reached.
    pub(super) fn seed(&mut self) -> Option<(u32, [u32; 3])> {
        while self.next_seed < self.done.len() && self.done[self.next_seed] {
            self.next_seed += 1;
        }
        (self.next_seed < self.done.len()).then(|| self.take(id32(self.next_seed), 0))
    }

    fn take(&mut self, face: u32, k: usize) -> (u32, [u32; 3]) {
        self.done[face as usize] = true;
        let w = self.mesh.faces[face as usize].wedges;
        (face, [w[k], w[corner::next(k)], w[corner::previous(k)]])
    }

    fn vertex_of(&self, wedge: u32) -> u32 {
        self.mesh.wedges[wedge as usize].vertex
    }

    /// The number of a wedge's vertex, if it has been encoded.
    pub(super) fn vertex_number(&self, wedge: u32) -> Option<u32> {
        self.names.local_vertex.get(&self.vertex_of(wedge)).copied()
    }

    /// The number of a wedge, if it has been encoded.
    pub(super) fn wedge_number(&self, wedge: u32) -> Option<u32> {
        self.names.local_wedge.get(&wedge).copied()
    }

    pub(super) fn position(&self, wedge: u32) -> [i32; 3] {
        self.mesh.positions[self.vertex_of(wedge) as usize]
    }

    pub(super) fn attributes(&self, wedge: u32) -> Attributes {
        self.mesh.wedges[wedge as usize].attributes
    }

    pub(super) fn material(&self, face: u32) -> u16 {
        self.mesh.faces[face as usize].material
    }

    /// The part of a wedge's vertex.
    pub(super) fn part(&self, wedge: u32) -> u32 {
        self.mesh.parts.get(self.vertex_of(wedge) as usize).copied().unwrap_or(0)
    }

    /// The skin of a wedge's vertex.
    pub(super) fn skin(&self, wedge: u32) -> Skin {
        self.mesh.skins.get(self.vertex_of(wedge) as usize).copied().unwrap_or_default()
    }

    /// Assigns the next number to a wedge's vertex.
    pub(super) fn number_vertex(&mut self, wedge: u32) {
        self.names.vertex(self.vertex_of(wedge));
    }
}
