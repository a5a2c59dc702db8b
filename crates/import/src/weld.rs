//! Vertex welding: equal values share one index, whatever indices the file gives them.

use std::collections::HashMap;

use lodestream_geometry::mesh::{NONE, SourceMesh};

/// A mesh that is welded while it grows. The caller checks that counts fit `u32`.
#[derive(Debug, Default)]
pub(crate) struct Weld {
    pub(crate) mesh: SourceMesh,
    positions: HashMap<[u64; 3], u32>,
    uvs: HashMap<[u32; 2], u32>,
    normals: HashMap<[u32; 3], u32>,
    colors: HashMap<[u8; 4], u32>,
}

impl Weld {
    pub(crate) fn position(&mut self, value: [f64; 3]) -> u32 {
        // Adding 0 turns −0 into 0, so that they weld.
        let value = value.map(|x| x + 0.0);
        let positions = &mut self.mesh.positions;
        *self.positions.entry(value.map(f64::to_bits)).or_insert_with(|| push(positions, value))
    }

    pub(crate) fn uv(&mut self, value: [f32; 2]) -> u32 {
        let value = value.map(|x| x + 0.0);
        let uvs = &mut self.mesh.uvs;
        *self.uvs.entry(value.map(f32::to_bits)).or_insert_with(|| push(uvs, value))
    }

    pub(crate) fn color(&mut self, value: [u8; 4]) -> u32 {
        let colors = &mut self.mesh.colors;
        *self.colors.entry(value).or_insert_with(|| push(colors, value))
    }

    /// Adds a normal, normalised; [`NONE`] for a zero vector.
    pub(crate) fn normal(&mut self, value: [f64; 3]) -> u32 {
        let length = value.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length < f64::MIN_POSITIVE {
            return NONE;
        }
        let value = value.map(|x| (x / length) as f32 + 0.0);
        let normals = &mut self.mesh.normals;
        *self.normals.entry(value.map(f32::to_bits)).or_insert_with(|| push(normals, value))
    }
}

/// Appends a value and returns its index.
fn push<T>(values: &mut Vec<T>, value: T) -> u32 {
    values.push(value);
    (values.len() - 1) as u32
}
