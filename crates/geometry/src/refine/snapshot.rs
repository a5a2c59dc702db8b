//! The state of a mesh in canonical ids: equal for equal cuts, independent of the order of application.

use crate::mesh::skin::Skin;
use crate::mesh::{Attributes, Face, QuantisedMesh, Wedge};
use crate::numbers::id32;
use crate::refine::active::ActiveMesh;
use crate::refine::delta::Id;

/// Complete state of a refined mesh, sorted by id.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Snapshot {
    /// Vertices: id, position, part.
    pub vertices: Vec<(Id, [i32; 3], u32)>,
    /// Skins of the vertices; empty if there are none.
    pub skins: Vec<Skin>,
    /// Wedges: id, vertex, attributes.
    pub wedges: Vec<(Id, Id, Attributes)>,
    /// Faces: id, wedges, material.
    pub faces: Vec<(Id, [Id; 3], u16)>,
}

impl ActiveMesh {
    /// The state in canonical ids.
    #[must_use]
    pub fn snapshot(&self) -> Snapshot {
        let mut snapshot = Snapshot::default();
        for (owner, applied) in self.applied.iter() {
            let id = |start: u32, slot: u32| Id { owner, index: slot - start };
            for slot in applied.vertices.clone() {
                let position = self.positions[slot as usize];
                snapshot.vertices.push((id(applied.vertices.start, slot), position, self.part(slot)));
                snapshot.skins.extend(self.skin(slot));
            }
            for slot in applied.wedges.clone() {
                let wedge = self.wedges[slot as usize];
                snapshot.wedges.push((
                    id(applied.wedges.start, slot),
                    self.vertex_id(wedge.vertex),
                    wedge.attributes,
                ));
            }
            for slot in applied.faces.clone() {
                snapshot.faces.push((
                    id(applied.faces.start, slot),
                    self.faces[slot as usize].map(|w| self.wedge_id(w)),
                    self.materials[slot as usize],
                ));
            }
        }
        snapshot
    }

    /// The current mesh as a [`QuantisedMesh`]: unused wedges and vertices dropped, all elements renumbered in order
    /// of use.
    #[must_use]
    pub fn to_mesh(&self) -> QuantisedMesh {
        let mut mesh = QuantisedMesh {
            grid: self.grid,
            uv_grid: self.uv_grid,
            second_uv_grid: self.second_uv_grid,
            positions: Vec::new(),
            wedges: Vec::new(),
            faces: Vec::new(),
            parts: Vec::new(),
            skins: Vec::new(),
            poses: Vec::new(),
        };
        let mut vertex_new = vec![u32::MAX; self.positions.len()];
        let mut wedge_new = vec![u32::MAX; self.wedges.len()];
        for (_, applied) in self.applied.iter() {
            for slot in applied.faces.clone() {
                let wedges = self.faces[slot as usize].map(|w| {
                    let wedge = self.wedges[w as usize];
                    if vertex_new[wedge.vertex as usize] == u32::MAX {
                        vertex_new[wedge.vertex as usize] = id32(mesh.positions.len());
                        mesh.positions.push(self.positions[wedge.vertex as usize]);
                        mesh.parts.extend(self.parts.get(wedge.vertex as usize));
                        mesh.skins.extend(self.skin(wedge.vertex));
                    }
                    if wedge_new[w as usize] == u32::MAX {
                        wedge_new[w as usize] = id32(mesh.wedges.len());
                        mesh.wedges.push(Wedge { vertex: vertex_new[wedge.vertex as usize], ..wedge });
                    }
                    wedge_new[w as usize]
                });
                mesh.faces.push(Face { wedges, material: self.materials[slot as usize] });
            }
        }
        mesh
    }
}
