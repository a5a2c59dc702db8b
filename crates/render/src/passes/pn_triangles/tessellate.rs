//! Tessellation on the CPU for one view: the reference for patches, not for real-time drawing.

use glam::DVec3;
use lodestream_scene::placement::Placement;

use super::settings::PnTriangles;
use crate::cpu_reference::pn_triangles::{Corner, Patch};
use crate::resources::gpu::{Gpu, RenderError};
use crate::resources::vertex::{HostMesh, PackedVertex, pack_normal};
use crate::scene::asset::AssetGpu;

impl PnTriangles {
    /// Tessellates an asset's first material as finely as a view of an instance needs; `scale_px` is the number of
    /// pixels per unit length at distance 1. Reads the mesh back and waits for the device. Vertices are shared within
    /// a triangle only, and do not morph.
    ///
    /// # Errors
    /// Errors of the graphics device.
    pub fn tessellated(
        &self,
        gpu: &Gpu,
        asset: &AssetGpu,
        (placement, eye, scale_px): (&Placement, DVec3, f64),
    ) -> Result<HostMesh, RenderError> {
        let (vertices, faces) = asset.read(gpu)?;
        // In asset space, where ratios of distances and lengths are unchanged.
        let offset =
            placement.orientation().as_dquat().inverse() * (eye - DVec3::from(placement.translation));
        let eye = offset / f64::from(placement.scale) - asset.origin();
        let (most, error) = (self.most_step(), f64::from(self.error()));
        let mut mesh = HostMesh::default();
        for face in faces {
            let [Some(a), Some(b), Some(c)] = face.map(|i| vertices.get(i as usize)) else { continue };
            let patch = Patch { corners: [a, b, c].map(corner) };
            let (points, triangles) = Patch::grid(patch.steps(eye, scale_px, error, most));
            let first = mesh.0.len() as u32;
            mesh.0.extend(points.iter().map(|w| vertex(&patch, [a, b, c], *w)));
            mesh.1.extend(triangles.iter().map(|t| t.map(|i| first + i as u32)));
        }
        Ok(mesh)
    }
}

fn corner(vertex: &PackedVertex) -> Corner {
    let [x, y, z, smooth] = vertex.normal;
    Corner {
        position: DVec3::from(vertex.position.map(f64::from)),
        normal: DVec3::from([x, y, z].map(f64::from)) / 32767.0,
        bends: smooth != 0,
    }
}

fn vertex(patch: &Patch, corners: [&PackedVertex; 3], w: [f64; 3]) -> PackedVertex {
    let position = patch.position(w).as_vec3().to_array();
    let mean = |of: fn(&PackedVertex) -> f64| -> f64 { corners.iter().zip(w).map(|(v, w)| of(v) * w).sum() };
    let uv = [mean(|v| f64::from(v.uv[0])) as f32, mean(|v| f64::from(v.uv[1])) as f32];
    PackedVertex {
        position,
        morph_from: position,
        normal: pack_normal(patch.normal(w).normalize_or_zero().as_vec3().to_array()),
        uv,
        ..*corners[0]
    }
}
