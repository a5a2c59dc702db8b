//! Barycentric grids of 1, 2, 4, … 64 segments per edge, in one vertex and one index list.

use wgpu::util::DeviceExt;

use crate::resources::gpu::Gpu;

/// Number of grids.
pub(super) const STEPS: u32 = 7;

/// Layout of the grid vertices: barycentric coordinates towards the second and third corner, in segments, and the
/// grid's level.
pub(super) static GRID_VERTICES: [Option<wgpu::VertexBufferLayout<'_>>; 1] =
    [Some(wgpu::VertexBufferLayout {
        array_stride: 4,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &wgpu::vertex_attr_array![0 => Uint8x4],
    })];

/// The grids in GPU memory.
#[derive(Debug)]
pub(super) struct Grids {
    pub(super) vertices: wgpu::Buffer,
    pub(super) indices: wgpu::Buffer,
}

impl Grids {
    pub(super) fn new(gpu: &Gpu) -> Self {
        let (vertices, indices) = grids();
        let buffer = |label, contents: &[u8], usage| {
            gpu.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
                label: Some(label),
                contents,
                usage,
            })
        };
        Self {
            vertices: buffer("grids", bytemuck::cast_slice(&vertices), wgpu::BufferUsages::VERTEX),
            indices: buffer("grids", bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX),
        }
    }
}

/// Vertices and triangles of all grids, with the winding of the corners.
fn grids() -> (Vec<[u8; 4]>, Vec<[u16; 3]>) {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for step in 0..STEPS as u8 {
        let (first, pieces) = (vertices.len() as u16, 1_u16 << step);
        for c in 0..=pieces {
            vertices.extend((0..=pieces - c).map(|b| [b as u8, c as u8, step, 0]));
        }
        // Each row is shorter by one.
        let at = |b: u16, c: u16| first + c * (pieces + 1) - c * c.saturating_sub(1) / 2 + b;
        for c in 0..pieces {
            for b in 0..pieces - c {
                triangles.push([at(b, c), at(b + 1, c), at(b, c + 1)]);
                if b + c + 1 < pieces {
                    triangles.push([at(b + 1, c), at(b + 1, c + 1), at(b, c + 1)]);
                }
            }
        }
    }
    (vertices, triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_cover_their_triangle_once_and_turn_as_it_does() {
        let (vertices, triangles) = grids();
        let mut rest = triangles.as_slice();
        for step in 0..STEPS {
            let pieces = 1_i32 << step;
            // Offsets as in `cs_arrange` of pn_list.wgsl.
            let first = pieces * pieces - 1;
            assert_eq!(rest.len() as i32, (triangles.len() as i32) - first / 3);
            let (of_grid, others) = rest.split_at((pieces * pieces) as usize);
            rest = others;
            for triangle in of_grid {
                let [p, q, r] = triangle.map(|i| vertices[usize::from(i)]);
                assert!([p, q, r].iter().all(|v| u32::from(v[2]) == step));
                let off = |v: [u8; 4], k: usize| i32::from(v[k]) - i32::from(p[k]);
                // Each triangle has unit area, so together they cover the patch.
                assert_eq!(off(q, 0) * off(r, 1) - off(q, 1) * off(r, 0), 1);
                assert!([p, q, r].iter().all(|v| i32::from(v[0]) + i32::from(v[1]) <= pieces));
            }
        }
        assert!(rest.is_empty());
    }
}
