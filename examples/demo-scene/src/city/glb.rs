//! Writes a GLB file: nodes with names, transformations and extras, and meshes of parts.
//!
//! One block of the city is one file, so a whole city needs the memory of one block. Numbers are written with the fewest
//! digits that give them back, as exporters in f64 do.

use std::fmt::Write as _;
use std::io::{self, Write as _};
use std::path::Path;

use glam::{DVec3, Vec3};

use super::materials;
use super::part::{Part, Surface};
use crate::maths::{cos_turns, sin_turns};

/// Place of a node relative to its parent: turned about y, then moved.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    pub(super) at: DVec3,
    pub(super) turns: f64,
}

impl Place {
    pub(super) fn at(at: DVec3) -> Self {
        Self { at, turns: 0.0 }
    }
}

/// Index of a node or mesh of the file.
pub(super) type Index = usize;

#[derive(Debug)]
struct Node {
    name: String,
    place: Place,
    mesh: Option<Index>,
    extras: String,
    children: Vec<Index>,
}

/// A file in the making. The first node is its root.
#[derive(Debug, Default)]
pub(super) struct Glb {
    nodes: Vec<Node>,
    meshes: Vec<String>,
    accessors: Vec<String>,
    /// Little-endian f32 triples, f32 triples, f32 pairs and u16 triples.
    positions: Vec<u8>,
    normals: Vec<u8>,
    uvs: Vec<u8>,
    indices: Vec<u8>,
    mesh_faces: Vec<usize>,
    /// Whether only parts are counted, and no mesh is made.
    is_count: bool,
    /// Nodes with a mesh.
    pub(super) parts: usize,
    /// Faces, each mesh counted as often as it is placed.
    pub(super) placed_faces: usize,
}

impl Glb {
    /// A file with a root node of this name.
    pub(super) fn new(root: &str) -> Self {
        let mut this = Self::default();
        this.push(None, root.to_owned(), Place::default(), None, String::new());
        this
    }

    /// Not a file, but the number of parts that a file would have: no mesh is made.
    pub(super) fn count() -> Self {
        Self { is_count: true, ..Self::new("count") }
    }

    fn push(
        &mut self,
        parent: Option<Index>,
        name: String,
        place: Place,
        mesh: Option<Index>,
        extras: String,
    ) -> Index {
        if self.is_count && parent.is_some() {
            return 0;
        }
        let index = self.nodes.len();
        self.nodes.push(Node { name, place, mesh, extras, children: Vec::new() });
        if let Some(parent) = parent {
            self.nodes[parent].children.push(index);
        }
        index
    }

    /// A node without a mesh. `extras` are the members of a JSON object.
    pub(super) fn group(
        &mut self,
        parent: Index,
        name: impl Into<String>,
        place: Place,
        extras: String,
    ) -> Index {
        self.push(Some(parent), name.into(), place, None, extras)
    }

    /// A part: a node with a mesh.
    pub(super) fn part(
        &mut self,
        parent: Index,
        name: impl Into<String>,
        place: Place,
        mesh: Index,
        extras: String,
    ) {
        self.parts += 1;
        self.placed_faces += self.mesh_faces.get(mesh).copied().unwrap_or_default();
        self.push(Some(parent), name.into(), place, Some(mesh), extras);
    }

    /// Faces of all meshes, each counted once.
    pub(super) fn distinct_faces(&self) -> usize {
        self.mesh_faces.iter().sum()
    }

    /// Number of meshes.
    pub(super) fn meshes(&self) -> usize {
        self.meshes.len()
    }

    /// A mesh that nodes may use.
    pub(super) fn mesh(&mut self, name: &str, make: impl FnOnce() -> Part) -> Index {
        if self.is_count {
            return 0;
        }
        let part = make();
        let mut primitives = Vec::new();
        for (&material, surface) in &part.surfaces {
            primitives.push(self.primitive(material, surface));
        }
        self.meshes.push(format!("{{\"name\":\"{name}\",\"primitives\":[{}]}}", primitives.join(",")));
        self.mesh_faces.push(part.faces());
        self.meshes.len() - 1
    }

    fn primitive(&mut self, material: usize, surface: &Surface) -> String {
        let count = surface.positions.len();
        let narrow: Vec<Vec3> = surface.positions.iter().map(|at| at.as_vec3()).collect();
        let low = narrow.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let high = narrow.iter().copied().reduce(Vec3::max).unwrap_or_default();
        // Accessors name views by the order in which `write` lists them.
        let first = self.accessors.len();
        self.accessors.push(format!(
            "{{\"bufferView\":0,\"byteOffset\":{},\"componentType\":5126,\"count\":{count},\"type\":\"VEC3\",\
             \"min\":[{},{},{}],\"max\":[{},{},{}]}}",
            self.positions.len(),
            low.x,
            low.y,
            low.z,
            high.x,
            high.y,
            high.z
        ));
        put(&mut self.positions, narrow.iter().flat_map(Vec3::to_array));
        self.accessors.push(format!(
            "{{\"bufferView\":1,\"byteOffset\":{},\"componentType\":5126,\"count\":{count},\"type\":\"VEC3\"}}",
            self.normals.len()
        ));
        put(&mut self.normals, surface.normals.iter().flat_map(|normal| normal.as_vec3().to_array()));
        let mut attributes = format!("\"POSITION\":{first},\"NORMAL\":{}", first + 1);
        if materials::is_textured(material) {
            let _ = write!(attributes, ",\"TEXCOORD_0\":{}", self.accessors.len());
            self.accessors.push(format!(
                "{{\"bufferView\":2,\"byteOffset\":{},\"componentType\":5126,\"count\":{count},\"type\":\"VEC2\"}}",
                self.uvs.len()
            ));
            put(&mut self.uvs, surface.uvs.iter().flat_map(|uv| [uv.x as f32, 1.0 - uv.y as f32]));
        }
        let indices = self.accessors.len();
        self.accessors.push(format!(
            "{{\"bufferView\":3,\"byteOffset\":{},\"componentType\":5123,\"count\":{},\"type\":\"SCALAR\"}}",
            self.indices.len(),
            3 * surface.faces.len()
        ));
        self.indices.extend(surface.faces.iter().flatten().flat_map(|index| index.to_le_bytes()));
        format!("{{\"attributes\":{{{attributes}}},\"indices\":{indices},\"material\":{material}}}")
    }

    /// Writes the file and returns its size in bytes.
    pub(super) fn write(mut self, path: &Path) -> io::Result<u64> {
        // An empty view would be invalid, so those that nothing uses have one element.
        for (bytes, least) in
            [(&mut self.positions, 12), (&mut self.normals, 12), (&mut self.uvs, 8), (&mut self.indices, 4)]
        {
            let length = bytes.len().max(least).next_multiple_of(4);
            bytes.resize(length, 0);
        }
        let views = [&self.positions, &self.normals, &self.uvs, &self.indices];
        let json = self.json(views.map(Vec::len));
        let binary: usize = views.iter().map(|view| view.len()).sum();
        let text = json.len().next_multiple_of(4);
        let total = 12 + 8 + text + 8 + binary;
        let refused = || io::Error::other("a GLB file may have at most 4 GiB");
        let word = |value: usize| u32::try_from(value).map(u32::to_le_bytes).map_err(|_| refused());
        let mut out = io::BufWriter::new(std::fs::File::create(path)?);
        out.write_all(b"glTF")?;
        out.write_all(&word(2)?)?;
        out.write_all(&word(total)?)?;
        out.write_all(&word(text)?)?;
        out.write_all(b"JSON")?;
        out.write_all(json.as_bytes())?;
        out.write_all(&b"   "[..text - json.len()])?;
        out.write_all(&word(binary)?)?;
        out.write_all(b"BIN\0")?;
        for view in views {
            out.write_all(view)?;
        }
        out.flush()?;
        Ok(total as u64)
    }

    fn json(&self, views: [usize; 4]) -> String {
        let mut offset = 0;
        let views: Vec<String> = views
            .iter()
            .map(|&length| {
                offset += length;
                format!("{{\"buffer\":0,\"byteOffset\":{},\"byteLength\":{length}}}", offset - length)
            })
            .collect();
        let nodes: Vec<String> = self.nodes.iter().map(Node::json).collect();
        format!(
            "{{\"asset\":{{\"version\":\"2.0\",\"generator\":\"lodestream-demo-scene\"}},\"scene\":0,\
             \"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{}],\"meshes\":[{}],\"accessors\":[{}],\"bufferViews\":[{}],\
             \"buffers\":[{{\"byteLength\":{offset}}}],{}}}",
            nodes.join(","),
            self.meshes.join(","),
            self.accessors.join(","),
            views.join(","),
            materials::json()
        )
    }
}

impl Node {
    fn json(&self) -> String {
        let mut text = format!("{{\"name\":\"{}\"", self.name);
        let at = self.place.at;
        // Writing to a String cannot fail.
        if at != DVec3::ZERO {
            let _ = write!(text, ",\"translation\":[{},{},{}]", at.x, at.y, at.z);
        }
        if self.place.turns != 0.0 {
            let half = self.place.turns * 0.5;
            let _ = write!(text, ",\"rotation\":[0,{},0,{}]", sin_turns(half), cos_turns(half));
        }
        if let Some(mesh) = self.mesh {
            let _ = write!(text, ",\"mesh\":{mesh}");
        }
        if !self.extras.is_empty() {
            let _ = write!(text, ",\"extras\":{{{}}}", self.extras);
        }
        if !self.children.is_empty() {
            let children: Vec<String> = self.children.iter().map(Index::to_string).collect();
            let _ = write!(text, ",\"children\":[{}]", children.join(","));
        }
        text.push('}');
        text
    }
}

fn put(bytes: &mut Vec<u8>, numbers: impl Iterator<Item = f32>) {
    bytes.extend(numbers.flat_map(f32::to_le_bytes));
}
