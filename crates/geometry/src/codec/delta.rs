//! The delta that results from decoding a chunk.

use crate::codec::local::{Local, LocalFace, LocalWedge};
use crate::numbers::truncated;
use crate::refine::{ChunkDelta, NewFace, NewVertex, NewWedge, Origin, Repoint};

impl Local<'_> {
    /// The chunk's changes, in canonical ids.
    pub(crate) fn delta(&self, chunk: u32, parents: Vec<u32>) -> ChunkDelta {
        let mut moves = self.moves.clone();
        moves.sort_unstable_by_key(|m| m.vertex);
        let wedge_id = |w: u32| self.wedges[w as usize].id;
        let new_wedges = &self.wedges[self.wedges.len() - self.new_wedges as usize..];
        let (old, new_faces) = self.faces.split_at(self.gathered.len());
        let vertex = |(i, &(v, parent)): (usize, &(u32, Option<u32>))| NewVertex {
            position: self.position(v).map(truncated),
            shift: self.vertices[v as usize].shift,
            skin: self.new_skins.get(i).copied().unwrap_or_default(),
            origin: match parent {
                Some(parent) => Origin::Split(self.vertex_id(parent)),
                None => Origin::Part(self.isolated_parts.get(i).copied().unwrap_or(0)),
            },
        };
        let wedge = |w: &LocalWedge| NewWedge { vertex: self.vertex_id(w.vertex), attributes: w.attributes };
        let face = |(f, &material): (&LocalFace, &u16)| NewFace { wedges: f.wedges.map(wedge_id), material };
        let mut repoints = Vec::with_capacity(2 * self.new_vertices.len());
        for (face, before) in old.iter().zip(&self.gathered) {
            for k in (0..3).filter(|&k| face.wedges[k] != before.wedges[k]) {
                let (from, to) = (wedge_id(before.wedges[k]), wedge_id(face.wedges[k]));
                repoints.push(Repoint { face: before.id, corner: u8::try_from(k).unwrap_or(0), from, to });
            }
        }
        ChunkDelta {
            chunk,
            truncation: None,
            parents,
            moves,
            vertices: self.new_vertices.iter().enumerate().map(vertex).collect(),
            wedges: new_wedges.iter().map(wedge).collect(),
            faces: new_faces.iter().zip(&self.materials[old.len()..]).map(face).collect(),
            repoints,
        }
    }
}
