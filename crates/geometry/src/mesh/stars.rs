//! Vertex stars as linked lists through the corners of faces: constant memory per corner, cheap
//! insertion, removal in the length of one star.

use std::ops::Range;

use crate::entropy::steps;
use crate::mesh::shorten::shorten;

/// Marks the end of a list.
pub(crate) const END: u32 = u32::MAX;

/// For each vertex, the corners (`face × 3 + k`) of the faces around it, in no particular order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stars {
    head: Vec<u32>,
    next: Vec<u32>,
}

impl Stars {
    pub(crate) fn new(vertices: usize, faces: usize) -> Self {
        Self { head: vec![END; vertices], next: vec![END; faces * 3] }
    }

    /// Grows to at least this many vertices and faces.
    pub(crate) fn grow(&mut self, vertices: usize, faces: usize) {
        if self.head.len() < vertices {
            self.head.resize(vertices, END);
        }
        if self.next.len() < faces * 3 {
            self.next.resize(faces * 3, END);
        }
    }

    /// Shrinks to this many vertices and faces; the others must have no corners.
    pub(crate) fn shorten(&mut self, vertices: usize, faces: usize) {
        shorten(&mut self.head, vertices);
        shorten(&mut self.next, faces * 3);
    }

    /// Moves the stars of a range of vertices to those from `to` on.
    pub(crate) fn move_heads(&mut self, from: Range<usize>, to: usize) {
        self.head.copy_within(from, to);
    }

    /// Gives a corner of a star another number, which no star has; its place in the list stays.
    pub(crate) fn rename(&mut self, vertex: u32, corner: u32, new: u32) {
        self.next[new as usize] = self.next[corner as usize];
        if self.head[vertex as usize] == corner {
            self.head[vertex as usize] = new;
            return;
        }
        let mut at = self.head[vertex as usize];
        while at != END {
            let next = self.next[at as usize];
            if next == corner {
                self.next[at as usize] = new;
                return;
            }
            at = next;
        }
    }

    pub(crate) fn insert(&mut self, vertex: u32, corner: u32) {
        self.next[corner as usize] = self.head[vertex as usize];
        self.head[vertex as usize] = corner;
    }

    /// Removes a corner from a star; returns whether it was there.
    pub(crate) fn remove(&mut self, vertex: u32, corner: u32) -> bool {
        let after = self.next[corner as usize];
        let mut at = self.head[vertex as usize];
        if at == corner {
            self.head[vertex as usize] = after;
            return true;
        }
        while at != END {
            let next = self.next[at as usize];
            if next == corner {
                self.next[at as usize] = after;
                return true;
            }
            at = next;
        }
        false
    }

    /// Empties a vertex's star (its corners must be inserted elsewhere or dropped by the caller).
    pub(crate) fn clear(&mut self, vertex: u32) {
        self.head[vertex as usize] = END;
    }

    pub(crate) fn is_empty(&self, vertex: u32) -> bool {
        self.head[vertex as usize] == END
    }

    pub(crate) fn corners(&self, vertex: u32) -> Corners<'_> {
        Corners { stars: self, at: self.head[vertex as usize] }
    }

    pub(crate) fn bytes(&self) -> usize {
        (self.head.capacity() + self.next.capacity()) * 4
    }
}

/// Iterates over the corners at a vertex.
pub(crate) struct Corners<'a> {
    stars: &'a Stars,
    at: u32,
}

impl Iterator for Corners<'_> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        if self.at == END {
            return None;
        }
        let corner = self.at;
        self.at = self.stars.next[corner as usize];
        steps::take(1);
        Some(corner)
    }
}
