//! Numbers assigned to elements in coding order, in a chunk or a base mesh; used by encoders only.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use crate::numbers::id32;

/// Multiplicative hashing of the builder's ids (Knuth, TAOCP 3, §6.4): keys are small, distinct and trusted.
#[derive(Default)]
pub(crate) struct BuilderHasher(u64);

impl Hasher for BuilderHasher {
    fn finish(&self) -> u64 {
        self.0
    }
    fn write(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.write_u32(u32::from(b));
        }
    }
    fn write_u32(&mut self, key: u32) {
        self.0 = (self.0 ^ u64::from(key)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
    }
}

pub(crate) type BuilderMap<T> = HashMap<u32, T, BuildHasherDefault<BuilderHasher>>;

/// Builder's ids of the coded elements by number, and numbers by builder's id.
#[derive(Default)]
pub(crate) struct Numbering {
    pub(crate) vertices: Vec<u32>,
    pub(crate) wedges: Vec<u32>,
    pub(crate) faces: Vec<u32>,
    pub(crate) local_vertex: BuilderMap<u32>,
    pub(crate) local_wedge: BuilderMap<u32>,
}

impl Numbering {
    /// Assigns the next number to a vertex.
    pub(crate) fn vertex(&mut self, builder: u32) {
        self.local_vertex.insert(builder, id32(self.vertices.len()));
        self.vertices.push(builder);
    }

    /// Assigns the next number to a wedge.
    pub(crate) fn wedge(&mut self, builder: u32) {
        self.local_wedge.insert(builder, id32(self.wedges.len()));
        self.wedges.push(builder);
    }
}
