//! The wall of stones and the models that represent it.
//!
//! It covers a square of the plane z = 0 and faces +z; its texture repeats twice along each side. Height maps have 8
//! bits, so that all methods have the same heights.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use glam::{DVec2, DVec3};
use image::{ImageBuffer, Luma, Rgb};
use lodestream_render::cpu_reference::relief::{ReliefMap, height_maps};
use lodestream_render::cpu_reference::tone;
use lodestream_scene::description::Camera;

/// Length of the wall's sides, in metres.
pub(super) const SIDE_M: f64 = 2.0;
/// Repeats of the texture along a side; one is a metre wide.
pub(super) const REPEATS: usize = 2;
/// Depth of the relief, in metres and in texture widths.
pub(super) const DEPTH: f64 = 0.05;
/// Perceptual roughness of the stones.
pub(super) const ROUGHNESS: f64 = 0.9;

/// How a wall is sent and drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WallMethod {
    /// A plane with the colours only.
    Plane,
    /// A plane with colours and height map, and relief mapping.
    Relief,
    /// The same with self-shadowing of the heights.
    ReliefShadows,
    /// The same with relaxed cones.
    Cones,
    /// The same with a quadtree of maximum heights.
    Quadtree,
    /// The surface between texel centres as a mesh, with the colours.
    Mesh,
    /// The mesh of one repeat of the texture, instanced four times.
    TiledMesh,
}

impl WallMethod {
    /// All methods.
    pub const ALL: [Self; 7] = [
        Self::Plane,
        Self::Relief,
        Self::ReliefShadows,
        Self::Cones,
        Self::Quadtree,
        Self::Mesh,
        Self::TiledMesh,
    ];

    /// Name in tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Relief => "plane and height map",
            Self::ReliefShadows => "the same with its shadows",
            Self::Cones => "the same by relaxed cones",
            Self::Quadtree => "the same by a quadtree",
            Self::Mesh => "mesh",
            Self::TiledMesh => "mesh of a tile, four times",
        }
    }

    /// Whether it has a height map.
    pub(super) fn has_heights(self) -> bool {
        self.file() == Self::Relief.file()
    }

    fn file(self) -> &'static str {
        match self {
            Self::Plane => "plane",
            Self::Relief | Self::ReliefShadows | Self::Cones | Self::Quadtree => "relief",
            Self::Mesh => "mesh",
            Self::TiledMesh => "tile",
        }
    }
}

/// Heights and colours of one repeat.
#[derive(Clone, Debug)]
pub(super) struct Wall {
    pub(super) name: &'static str,
    heights: ReliefMap,
    /// sRGB, rows from the top.
    colours: Vec<[u8; 3]>,
}

/// Surface data at a place of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub(super) at: DVec3,
    pub(super) normal: DVec3,
    /// Linear.
    pub(super) albedo: [f64; 3],
}

impl Wall {
    /// Walls of generated height maps with `texels` texels along a side.
    pub(super) fn all(texels: usize) -> [Self; 2] {
        [Self::new("brick", &height_maps::bricks(texels)), Self::new("cobble", &height_maps::cobble(texels))]
    }

    fn new(name: &'static str, heights: &ReliefMap) -> Self {
        let byte = |value: f64| (value.clamp(0.0, 1.0) * 255.0).round();
        let texels: Vec<f64> = heights.texels.iter().map(|height| byte(*height) / 255.0).collect();
        let stains = height_maps::noise(heights.width);
        // From mortar in the joints to stone.
        let colour = |(height, stain): (&f64, &f64)| {
            let stone = height * height * (3.0 - 2.0 * height);
            let mixed = [(0.60, 0.62), (0.57, 0.33), (0.52, 0.25)].map(|(a, b)| a + (b - a) * stone);
            mixed.map(|c| byte(c * (0.75 + 0.5 * stain)) as u8)
        };
        let colours = texels.iter().zip(&stains.texels).map(colour).collect();
        Self { name, heights: ReliefMap { texels, ..*heights }, colours }
    }

    /// Texels along a side of the map.
    pub(super) fn texels(&self) -> usize {
        self.heights.width
    }

    /// The surface below a place of the plane, given in metres from the wall's centre.
    pub(super) fn place(&self, [x, y]: [f64; 2]) -> Place {
        let uv = DVec2::new(x + 0.5 * SIDE_M, 0.5 * SIDE_M - y) * (REPEATS as f64 / SIDE_M);
        let height = |du: f64, dv: f64| self.heights.sample([uv.x + du, uv.y + dv]);
        // Central differences over a texel, as in the shader. A texture is a metre wide, v runs down.
        let texel = 1.0 / self.texels() as f64;
        let slope = |du: f64, dv: f64| (height(du, dv) - height(-du, -dv)) / (2.0 * texel);
        let normal = DVec3::new(-DEPTH * slope(texel, 0.0), DEPTH * slope(0.0, texel), 1.0);
        Place {
            at: DVec3::new(x, y, DEPTH * (height(0.0, 0.0) - 1.0)),
            normal: normal.normalize(),
            albedo: self.albedo(uv),
        }
    }

    /// Colour interpolated between texel centres, linear.
    fn albedo(&self, uv: DVec2) -> [f64; 3] {
        let size = self.texels();
        let at = uv * size as f64 - 0.5;
        let (floor, share) = (at.floor(), at - at.floor());
        let texel = |dx: i64, dy: i64| {
            let [x, y] =
                [floor.x as i64 + dx, floor.y as i64 + dy].map(|k| k.rem_euclid(size as i64) as usize);
            self.colours[y * size + x].map(|c| tone::decode_srgb(f64::from(c) / 255.0))
        };
        let corners = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
        std::array::from_fn(|c| {
            let [a, b, d, e] = corners.map(|corner| corner[c]);
            let (top, bottom) = (a + (b - a) * share.x, d + (e - d) * share.x);
            top + (bottom - top) * share.y
        })
    }

    /// Grid lines along a side of `repeats` repeats, in metres from its centre: the edges, and `parts` lines per texel,
    /// the first of which passes through its centre.
    pub(super) fn lines(&self, repeats: usize, parts: usize) -> Vec<f64> {
        let (half, texel) = (0.5 * repeats as f64, 1.0 / self.texels() as f64);
        let last = repeats as f64 - 0.5 * texel;
        let inner = (0..).map(|i| (0.5 + f64::from(i) / parts as f64) * texel);
        let inner = inner.take_while(move |at| *at <= last + 1e-9);
        std::iter::once(0.0).chain(inner).chain([repeats as f64]).map(|at| at - half).collect()
    }

    /// Writes the models and the scene of a method into a folder, with a camera; returns the scene's file.
    pub(super) fn write(&self, way: WallMethod, folder: &Path, camera: &Camera) -> anyhow::Result<PathBuf> {
        let fail = || format!("{}: cannot be written", folder.display());
        let size = self.texels() as u32;
        let colour = |x: u32, y: u32| Rgb(self.colours[(y * size + x) as usize]);
        ImageBuffer::from_fn(size, size, colour).save(folder.join("colour.png")).with_context(fail)?;
        let height =
            |x: u32, y: u32| Luma([(self.heights.texels[(y * size + x) as usize] * 255.0).round() as u8]);
        ImageBuffer::from_fn(size, size, height).save(folder.join("height.png")).with_context(fail)?;
        let name = way.file();
        let disp = if way.has_heights() { "disp height.png\n" } else { "" };
        let material = format!("newmtl wall\nKd 1 1 1\nPr {ROUGHNESS}\nmap_Kd colour.png\n{disp}");
        std::fs::write(folder.join(format!("{name}.mtl")), material).with_context(fail)?;
        let mesh = match way {
            WallMethod::Mesh => obj(name, &self.lines(REPEATS, 1), REPEATS, |x, y| {
                let place = self.place([x, y]);
                (place.at, place.normal)
            }),
            // Its centre is half a texture away from the wall's, which has two along a side.
            WallMethod::TiledMesh => obj(name, &self.lines(1, 1), 1, |x, y| {
                let place = self.place([x - 0.5, y - 0.5]);
                (place.at + DVec3::new(0.5, 0.5, 0.0), place.normal)
            }),
            _ => obj(name, &[-0.5 * SIDE_M, 0.5 * SIDE_M], REPEATS, |x, y| (DVec3::new(x, y, 0.0), DVec3::Z)),
        };
        std::fs::write(folder.join(format!("{name}.obj")), mesh).with_context(fail)?;
        let depth = if way.has_heights() { format!("relief_depth = {DEPTH}\n") } else { String::new() };
        let mut scene = format!("[[asset]]\nname = \"wall\"\nfile = \"{name}.obj\"\n{depth}");
        let places: &[[f64; 2]] = match way {
            WallMethod::TiledMesh => &[[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]],
            _ => &[[0.0; 2]],
        };
        for [x, y] in places {
            // Writing to a string cannot fail.
            let _ = write!(scene, "[[instance]]\nasset = \"wall\"\ntranslation = [{x:?}, {y:?}, 0.0]\n");
        }
        let Camera { eye, target, fov_y, .. } = camera;
        let degrees = fov_y.to_degrees();
        let _ = write!(scene, "[camera]\neye = {eye:?}\ntarget = {target:?}\nfov_y_degrees = {degrees:?}\n");
        let file = folder.join(format!("{name}.toml"));
        std::fs::write(&file, scene).with_context(fail)?;
        Ok(file)
    }
}

/// A grid over a square of `repeats` textures, as OBJ, with vertices at the crossings of the lines.
fn obj(name: &str, lines: &[f64], repeats: usize, vertex: impl Fn(f64, f64) -> (DVec3, DVec3)) -> String {
    let mut text = format!("mtllib {name}.mtl\nusemtl wall\n");
    let half = 0.5 * repeats as f64;
    for (y, x) in lines.iter().flat_map(|y| lines.iter().map(move |x| (*y, *x))) {
        let (at, n) = vertex(x, y);
        let _ = writeln!(text, "v {:.6} {:.6} {:.6}", at.x, at.y, at.z);
        let _ = writeln!(text, "vt {:.7} {:.7}\nvn {:.4} {:.4} {:.4}", x + half, y + half, n.x, n.y, n.z);
    }
    for [a, b, c] in faces(lines.len()) {
        let [a, b, c] = [a + 1, b + 1, c + 1];
        let _ = writeln!(text, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}");
    }
    text
}

/// Triangles of a grid of `side`² vertices, facing +z.
pub(super) fn faces(side: usize) -> impl Iterator<Item = [u32; 3]> {
    let cells = side.saturating_sub(1);
    (0..cells * cells).flat_map(move |i| {
        let at = |dx: usize, dy: usize| ((i / cells + dy) * side + i % cells + dx) as u32;
        [[at(0, 0), at(1, 0), at(1, 1)], [at(0, 0), at(1, 1), at(0, 1)]]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_go_through_the_middles_of_texels_and_end_at_the_edges() {
        let [wall, _] = Wall::all(8);
        let lines = wall.lines(REPEATS, 1);
        assert_eq!((lines.len(), lines[0], lines[17]), (18, -1.0, 1.0));
        assert!((lines[1] + 1.0 - 0.0625).abs() < 1e-12 && (lines[16] - 1.0 + 0.0625).abs() < 1e-12);
        let fine = wall.lines(1, 2);
        assert_eq!(fine.len(), 17, "two a texel but in the halves at the edges");
        assert!(fine.windows(2).all(|pair| pair[1] > pair[0]));
    }

    #[test]
    fn tiles_cover_the_wall_and_the_surface_interpolates_its_texels() {
        let [wall, cobble] = Wall::all(16);
        for wall in [&wall, &cobble] {
            // Texel (3, 5) of the map, 5 down from the top.
            let [x, y] = [-1.0 + 3.5 / 16.0, 1.0 - 5.5 / 16.0];
            let place = wall.place([x, y]);
            let height = wall.heights.texels[5 * 16 + 3];
            assert!((place.at.z - DEPTH * (height - 1.0)).abs() < 1e-12);
            let tone = tone::decode_srgb(f64::from(wall.colours[5 * 16 + 3][0]) / 255.0);
            assert!((place.albedo[0] - tone).abs() < 1e-12);
            let [here, there] = [[x, y], [x + 1.0, y - 1.0]].map(|at| wall.place(at));
            assert!((here.at.z - there.at.z).abs() < 1e-12 && here.normal.distance(there.normal) < 1e-9);
        }
        let folder = tempfile::tempdir().unwrap();
        for way in WallMethod::ALL {
            let camera = Camera { eye: [0.0, 0.0, 2.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 0.9 };
            let file = wall.write(way, folder.path(), &camera).unwrap();
            assert!(file.exists() && file.with_extension("obj").exists(), "{}", way.name());
        }
        let heights = image::open(folder.path().join("height.png")).unwrap().into_luma8();
        assert!(heights.pixels().zip(&wall.heights.texels).all(|(p, h)| f64::from(p[0]) / 255.0 == *h));
    }
}
