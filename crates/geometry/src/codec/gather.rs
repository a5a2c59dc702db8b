//! Gathering of a chunk's region from the mesh.

use crate::codec::gather_buffers::{GatherBuffers, IncidentFace};
use crate::codec::local::{ExistingFace, Local, LocalFace, MAX_LOCAL_FACES, NONE};
use crate::error::DecodeError;
use crate::mesh::corner;
use crate::mesh::vec3::{length, triangle_normal};
use crate::numbers::id32;

impl Local<'_> {
    /// Gathers the interior vertices that are reachable from `seed`, with their stars. `interior(slot, context)`
    /// codes whether a vertex is interior.
    pub(crate) fn explore(
        &mut self,
        seed: u32,
        interior: &mut dyn FnMut(u32, usize) -> bool,
    ) -> Result<(), DecodeError> {
        self.check_unknown(seed)?;
        let GatherBuffers { mut queue, incident_faces: mut incident } =
            std::mem::take(&mut self.gather_buffers);
        queue.clear();
        queue.push((self.old_vertex(seed, true), seed));
        let mut at = 0;
        while let Some(&(v, slot)) = queue.get(at) {
            at += 1;
            incident.clear();
            for corner in self.mesh.stars.corners(slot) {
                self.collect(v, corner, &mut incident);
            }
            // The newest face of a star comes first, so reversing almost sorts it.
            incident.reverse();
            // Sort by id, as one number; ids are unique per face.
            incident.sort_unstable_by_key(|f| u64::from(f.id.owner) << 32 | u64::from(f.id.index));
            incident.dedup_by_key(|f| f.face);
            if self.faces.len() + incident.len() > MAX_LOCAL_FACES {
                return Err(DecodeError::new(
                    "chunk",
                    format!("its region has over {MAX_LOCAL_FACES} faces"),
                ));
            }
            for face in &incident {
                self.gather(face, &mut queue, interior);
            }
        }
        self.gather_buffers = GatherBuffers { queue, incident_faces: incident };
        Ok(())
    }

    /// Adds an outline vertex without its star.
    pub(crate) fn add_outline_vertex(&mut self, slot: u32) -> Result<(), DecodeError> {
        self.check_unknown(slot)?;
        if self.vertices.len() > 3 * MAX_LOCAL_FACES {
            return Err(DecodeError::new("chunk", "too many seeds"));
        }
        self.old_vertex(slot, false);
        Ok(())
    }

    fn check_unknown(&self, seed: u32) -> Result<(), DecodeError> {
        match self.vertex_at.get(seed) {
            Some(_) => Err(DecodeError::new("chunk", "a seed vertex is given twice")),
            None => Ok(()),
        }
    }

    /// Collects the face of a corner at interior vertex `v`, unless it was gathered with an earlier vertex's star.
    #[inline]
    fn collect(&mut self, v: u32, corner: u32, incident: &mut Vec<IncidentFace>) {
        let (face, k) = (corner::face_of(corner), corner::side_of(corner));
        let vertices = self.mesh.faces[face as usize].map(|wedge| self.mesh.wedges[wedge as usize].vertex);
        let [b, c] = [corner::next(k), corner::previous(k)];
        let mut corners = [v; 3];
        corners[b] = self.vertex_at.get(vertices[b]).unwrap_or(NONE);
        corners[c] = self.vertex_at.get(vertices[c]).unwrap_or(NONE);
        let came = |c: u32| (c < v) & self.vertices.get(c as usize).is_some_and(|vertex| vertex.interior);
        let came = came(corners[b]) | came(corners[c]);
        let id = self.owners.id_of_face(self.mesh.face_owner[face as usize], face);
        // Branch-free, since the condition is unpredictable.
        incident.push(IncidentFace { id, face, vertices, corners });
        incident.truncate(incident.len() - usize::from(came));
    }

    fn gather(
        &mut self,
        incident: &IncidentFace,
        queue: &mut Vec<(u32, u32)>,
        interior: &mut dyn FnMut(u32, usize) -> bool,
    ) {
        let IncidentFace { id, face, vertices, mut corners } = *incident;
        let slots = self.mesh.faces[face as usize];
        for k in 0..3 {
            // An earlier face may have added it meanwhile.
            if corners[k] == NONE {
                corners[k] = self.vertex_at.get(vertices[k]).unwrap_or(NONE);
            }
        }
        let mut wedges = [0; 3];
        for k in 0..3 {
            if corners[k] == NONE {
                let inside = interior(vertices[k], self.interior_context(&corners, k));
                let new = self.old_vertex(vertices[k], inside);
                if inside {
                    queue.push((new, vertices[k]));
                }
                // A face that repeats a vertex has the same number at both corners.
                for at in 0..3 {
                    if vertices[at] == vertices[k] {
                        corners[at] = new;
                    }
                }
            }
            wedges[k] = self.old_wedge(slots[k], corners[k]);
        }
        let [a, b, c] = corners.map(|v| self.position(v));
        let area = length(triangle_normal(a, b, c));
        self.gathered.push(ExistingFace { id, wedges });
        self.push_face(LocalFace { corners, wedges }, area, self.mesh.materials[face as usize]);
    }

    /// Context of whether a corner is interior, 0 to 8, by the other two corners: unknown, outside or inside each.
    fn interior_context(&self, corners: &[u32; 3], k: usize) -> usize {
        let mut context = 0;
        for other in [corner::next(k), corner::previous(k)] {
            let known = self.vertices.get(corners[other] as usize);
            context = context * 3 + known.map_or(0, |v| 1 + usize::from(v.interior));
        }
        context
    }

    fn old_vertex(&mut self, slot: u32, interior: bool) -> u32 {
        let (mesh, at) = (self.mesh, slot as usize);
        self.vertex_at.insert(slot, id32(self.vertices.len()));
        let id = self.owners.id_of_vertex(mesh.vertex_owner[at], slot);
        self.push_vertex(id, mesh.positions[at].map(f64::from), interior, mesh.vertex_shift[at])
    }

    fn old_wedge(&mut self, slot: u32, vertex: u32) -> u32 {
        // Most vertices have one wedge, so only further ones use the map.
        let first = self.wedge_ends[vertex as usize][0];
        if first != NONE {
            if self.wedges[first as usize].slot == slot {
                return first;
            }
            if let Some(known) = self.wedge_at.get(slot) {
                return known;
            }
            self.wedge_at.insert(slot, id32(self.wedges.len()));
        }
        let id = self.owners.id_of_wedge(self.mesh.wedge_owner[slot as usize], slot);
        self.push_wedge(id, slot, vertex, self.mesh.wedges[slot as usize].attributes)
    }
}
