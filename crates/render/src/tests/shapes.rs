//! Small meshes and materials for pictures.

use glam::DVec3;

use crate::cpu_reference::relief::ReliefMap;
use crate::cpu_reference::relief::height_maps::bricks;
use crate::{AssetGpu, Headless, Material, PackedVertex, Placement, TextureData, TextureKind, TextureShape};

/// Vertices and faces.
pub(super) type Mesh = (Vec<PackedVertex>, Vec<[u32; 3]>);

/// A quad from `corner` along two edges; seen from outside, `u × v` points at the viewer.
pub(super) fn quad(corner: [f32; 3], u: [f32; 3], v: [f32; 3], repeat: f32) -> Mesh {
    let (c, u, v) = (glam::Vec3::from(corner), glam::Vec3::from(u), glam::Vec3::from(v));
    let n = u.cross(v).normalize().to_array();
    let at = |s: f32, t: f32| PackedVertex::new((c + u * s + v * t).to_array(), n, [s * repeat, t * repeat]);
    (vec![at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)], vec![[0, 1, 2], [0, 2, 3]])
}

pub(super) fn join(parts: &[Mesh]) -> Mesh {
    let mut all = Mesh::default();
    for (vertices, faces) in parts {
        let base = all.0.len() as u32;
        all.0.extend(vertices);
        all.1.extend(faces.iter().map(|f| f.map(|i| i + base)));
    }
    all
}

/// A cube of edge 1 about zero, faces outwards.
pub(super) fn cube() -> Mesh {
    let h = 0.5;
    join(&[
        quad([-h, -h, h], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0),
        quad([h, -h, -h], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1.0),
        quad([h, -h, h], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0], 1.0),
        quad([-h, -h, -h], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0], 1.0),
        quad([-h, h, h], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], 1.0),
        quad([-h, -h, -h], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], 1.0),
    ])
}

/// A sphere of radius ½ about zero.
pub(super) fn sphere(rings: u32) -> Mesh {
    let columns = rings * 2;
    let mut vertices = Vec::new();
    for j in 0..=rings {
        for i in 0..=columns {
            let (s, t) = (i as f32 / columns as f32, j as f32 / rings as f32);
            let (sin, cos) = (std::f32::consts::TAU * s).sin_cos();
            let (ring, y) = (std::f32::consts::PI * t).sin_cos();
            let n = [ring * cos, -y, -ring * sin];
            vertices.push(PackedVertex::new(n.map(|x| x * 0.5), n, [s * 4.0, t * 2.0]));
        }
    }
    let at = |i, j| j * (columns + 1) + i;
    let cells = (0..rings).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let faces = cells.flat_map(|(i, j)| {
        [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
    });
    (vertices, faces.collect())
}

/// An asset of one mesh and one material.
/// A base colour without transparency.
pub(super) fn opaque([r, g, b]: [f32; 3]) -> [f32; 4] {
    [r, g, b, 1.0]
}

pub(super) fn asset(h: &Headless, mesh: &Mesh, material: Material) -> AssetGpu {
    let mut asset = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[material], &[]);
    fill(h, &mut asset, mesh);
    asset
}

pub(super) fn fill(h: &Headless, asset: &mut AssetGpu, mesh: &Mesh) {
    asset.update_vertices(h.gpu(), 0, &mesh.0).unwrap();
    asset.update_indices(h.gpu(), 0, 0, &mesh.1).unwrap();
}

/// All mip levels of a height map, halved by averaging, as 16-bit samples, coarsest first.
pub(super) fn mips16(map: &ReliefMap) -> Vec<Vec<u16>> {
    let mut levels = vec![map.clone()];
    while levels.last().is_some_and(|l| l.width > 1) {
        let l = levels.last().unwrap();
        let size = l.width / 2;
        let texels = (0..size * size).map(|i| {
            let (x, y) = (i % size * 2, i / size * 2);
            [(0, 0), (1, 0), (0, 1), (1, 1)]
                .iter()
                .map(|(a, b)| l.texels[(y + b) * l.width + x + a])
                .sum::<f64>()
                / 4.0
        });
        let next = ReliefMap { width: size, height: size, texels: texels.collect() };
        levels.push(next);
    }
    levels.iter().rev().map(|l| l.texels.iter().map(|h| (h * 65535.0).round() as u16).collect()).collect()
}

/// An asset with a brick height map and a matching colour texture; `depth` in texture widths.
pub(super) fn brick_asset(h: &Headless, mesh: &Mesh, depth: f32) -> AssetGpu {
    const SIZE: usize = 128;
    let map = bricks(SIZE);
    let heights = mips16(&map);
    let shape = |kind| TextureShape::full(SIZE as u32, SIZE as u32, kind);
    let material = Material {
        relief_depth: depth,
        base_color_texture: Some(0),
        height_texture: Some(1),
        base_color: [1.0; 4],
        roughness: 0.85,
        ..Material::default()
    };
    let mut asset = h.renderer().create_asset(
        h.gpu(),
        DVec3::ZERO,
        &[material],
        &[shape(TextureKind::Color), shape(TextureKind::Height)],
    );
    fill(h, &mut asset, mesh);
    for (level, heights) in heights.iter().enumerate() {
        let colour: Vec<u8> = heights
            .iter()
            .flat_map(|height| {
                let t = f32::from(*height) / 65535.0;
                let mix = |joint: f32, brick: f32| (joint + (brick - joint) * t) as u8;
                [mix(150.0, 172.0), mix(146.0, 92.0), mix(138.0, 70.0), 255]
            })
            .collect();
        asset.update_texture(h.gpu(), 0, level as u32, TextureData::Rgba8(&colour)).unwrap();
        asset.update_texture(h.gpu(), 1, level as u32, TextureData::R16(heights)).unwrap();
    }
    asset
}

/// An instance at a place, scaled.
pub(super) fn at(x: f64, y: f64, z: f64, scale: f64) -> Placement {
    Placement { scale: scale as f32, ..Placement::at([x, y, z]) }
}

/// A level square, 20 km wide, at height 0.
pub(super) fn flat_ground(h: &Headless) -> AssetGpu {
    asset(h, &quad([-1e4, 0.0, 1e4], [2e4, 0.0, 0.0], [0.0, 0.0, -2e4], 1.0), Material::default())
}
