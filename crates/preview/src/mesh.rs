//! One mesh as arrays: quantised vertices, and faces by material with one colour each.

use std::collections::{BTreeMap, BTreeSet};

use glam::Vec3;
use lodestream_geometry::refine::RenderVertex;
use lodestream_scene::asset::{Alpha, AssetDescription, Material};
use serde_json::{Value, json};

use crate::refine::Refined;
use crate::streams::Streams;

/// Steps of a coordinate over the mesh's longest side.
const STEPS: f32 = 4095.0;
/// Vertices to a position from which a mesh is flat: most of its edges are creases, and positions alone take half the
/// bytes.
const MIN_SPLIT: f64 = 1.6;
/// Opacity below which blended faces are left out: a preview does not blend.
const MIN_OPACITY: f32 = 0.5;

/// A mesh in a preview.
#[derive(Debug)]
pub(crate) struct PreviewMesh {
    vertices: Vec<RenderVertex>,
    /// Whether faces are shaded by their own normals, and vertices have none.
    flat: bool,
    /// Whether vertices have colours.
    colored: bool,
    groups: Vec<Group>,
    /// Position of (0, 0, 0) of the vertices' coordinates, in the asset's units.
    origin: [f64; 3],
}

/// The faces of one material.
#[derive(Debug)]
struct Group {
    /// The material's look, for the script.
    look: Value,
    /// Three to a face.
    corners: Vec<u16>,
}

/// Vertices in the order of their first corners.
#[derive(Default)]
struct Numbered {
    numbers: BTreeMap<[u32; 3], u16>,
    vertices: Vec<RenderVertex>,
}

impl Numbered {
    fn number(&mut self, key: [u32; 3], vertex: &RenderVertex) -> Option<u16> {
        if let Some(known) = self.numbers.get(&key) {
            return Some(*known);
        }
        let next = u16::try_from(self.vertices.len()).ok()?;
        self.vertices.push(*vertex);
        self.numbers.insert(key, next);
        Some(next)
    }
}

impl PreviewMesh {
    /// `None` for meshes without visible faces, or with more vertices than 16 bits can number.
    pub(crate) fn new(refined: &Refined) -> Option<Self> {
        let Refined { mesh, description, .. } = refined;
        let plain = Material::default();
        let mut groups = Vec::new();
        for material in 0..mesh.material_count() {
            let look = description.materials.get(usize::from(material)).unwrap_or(&plain);
            if matches!(look.alpha, Alpha::Blend) && look.plain_opacity() < MIN_OPACITY {
                continue;
            }
            // Slots without a face have equal corners.
            let faces = mesh.indices(material).iter().filter(|[a, b, c]| a != b && b != c && c != a);
            let faces: Vec<[u32; 3]> = faces.copied().collect();
            if !faces.is_empty() {
                groups.push((look_of(look, description), faces));
            }
        }
        let slots: BTreeSet<u32> =
            groups.iter().flat_map(|(_, faces)| faces.as_flattened()).copied().collect();
        let vertices: BTreeMap<u32, RenderVertex> =
            slots.into_iter().map(|slot| (slot, mesh.render_vertex(slot))).collect();
        let colored = vertices.values().any(|vertex| vertex.color[..3] != [255; 3]);
        let place = |vertex: &RenderVertex| vertex.position.map(f32::to_bits);
        let places: BTreeSet<[u32; 3]> = vertices.values().map(place).collect();
        let flat = !colored && vertices.len() as f64 > MIN_SPLIT * places.len() as f64;
        let mut numbered = Numbered::default();
        let groups = groups.into_iter().map(|(look, faces)| {
            let number = |slot: &u32| {
                let vertex = vertices.get(slot)?;
                let key = if flat { place(vertex) } else { [*slot, 0, 0] };
                numbered.number(key, vertex)
            };
            let corners = faces.as_flattened().iter().map(number).collect::<Option<_>>()?;
            Some(Group { look, corners })
        });
        let groups = groups.collect::<Option<Vec<_>>>()?;
        let vertices = numbered.vertices;
        (!groups.is_empty()).then_some(Self { vertices, flat, colored, groups, origin: refined.origin })
    }

    /// Writes the arrays: x, y, z, octahedral normals (8 bits each) unless it is flat, red, green, blue unless all are white, then the
    /// corners of the faces. The description says how many there are and what they mean.
    pub(crate) fn write(&self, streams: &mut Streams) -> Value {
        let positions = || self.vertices.iter().map(|vertex| Vec3::from(vertex.position));
        let low = positions().reduce(Vec3::min).unwrap_or_default();
        let high = positions().reduce(Vec3::max).unwrap_or_default();
        let step = ((high - low).max_element() / STEPS).max(f32::MIN_POSITIVE);
        for axis in 0..3 {
            streams.differences(positions().map(|at| number((at[axis] - low[axis]) / step)));
        }
        let normals: Vec<[u16; 2]> = self.vertices.iter().map(|vertex| octahedral(vertex.normal)).collect();
        for axis in 0..if self.flat { 0 } else { 2 } {
            streams.differences(normals.iter().map(|normal| normal[axis]));
        }
        for channel in 0..if self.colored { 3 } else { 0 } {
            streams.differences(self.vertices.iter().map(|vertex| vertex.color[channel].into()));
        }
        let mut next = 0;
        for group in &self.groups {
            streams.corners(&group.corners, &mut next);
        }
        let start: Vec<f64> = (0..3).map(|axis| self.origin[axis] + f64::from(low[axis])).collect();
        let groups =
            self.groups.iter().map(|group| json!({ "faces": group.corners.len() / 3, "look": group.look }));
        json!({
            "vertices": self.vertices.len(),
            "start": start,
            "step": step,
            "flat": self.flat,
            "colored": self.colored,
            "groups": groups.collect::<Vec<_>>(),
        })
    }
}

/// Colour and emission of a material, linear RGB, and the mean colours of their textures, sRGB.
fn look_of(material: &Material, description: &AssetDescription) -> Value {
    let mean = |texture: Option<u16>| description.textures.get(usize::from(texture?))?.mean;
    let [r, g, b, _] = material.base_color.map(short);
    json!({
        "color": [r, g, b],
        "texture": mean(material.base_color_texture),
        "emission": material.emits().then(|| material.emission.map(short)),
        "emission_texture": mean(material.emission_texture),
        "unlit": material.unlit,
        "flat": material.flat,
    })
}

/// Octahedral normal in 8 bits each (Meyer et al., "On Floating-Point Normal Vectors", 2010).
fn octahedral(normal: [f32; 3]) -> [u16; 2] {
    let n = Vec3::from(normal);
    let sum = n.x.abs() + n.y.abs() + n.z.abs();
    if sum <= 0.0 {
        return [128, 255];
    }
    let (x, y) = (n.x / sum, n.y / sum);
    let sign = |value: f32| if value < 0.0 { -1.0 } else { 1.0 };
    let (x, y) = if n.z < 0.0 { ((1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)) } else { (x, y) };
    [x, y].map(|part| number((part * 0.5 + 0.5) * 255.0))
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded and clamped")]
fn number(value: f32) -> u16 {
    value.round().clamp(0.0, 65_535.0) as u16
}

/// Three decimals, for fewer digits.
fn short(value: f32) -> f64 {
    (f64::from(value) * 1e3).round() / 1e3
}
