//! Changes as JavaScript objects and typed arrays, for pages that draw by other means than `Viewer`. The package's
//! types (`web/npm/index.d.ts`) state what pages see; `web/npm/model.js` makes it from these objects.

use js_sys::{Array, Float32Array, Float64Array, Object, Uint8Array, Uint16Array, Uint32Array};
use lodestream_client::core::{Change, MeshChange, NewAsset, TextureChange, TexturePixels, Vertex};
use lodestream_scene::asset::{Alpha, Material, SecondUv, TextureInfo, TextureKind, Wrap};
use lodestream_scene::description::{Instance, SceneHeader};
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::view::View;
use wasm_bindgen::prelude::*;

use crate::stats::fields;
use crate::streamer::{STEP_BYTES, Streamer};
use crate::time;

/// Numbers of a view: eye (3), rotation (4), vertical field of view in radians, width, height, screen error in pixels.
const VIEW_NUMBERS: usize = 11;

#[wasm_bindgen]
impl Streamer {
    /// The next step of changes: `deltas`, an array of objects, and `transfer`, their buffers. The page must show all of
    /// a step or nothing of it. Costs a copy of each array. Terrain is left out.
    pub fn deltas(&mut self, now_ms: f64) -> Option<Object> {
        if !self.core.has_changes() {
            return None;
        }
        let mut transfer = Transfer(Array::new());
        let deltas: Array = self
            .core
            .take_changes(time(now_ms), STEP_BYTES)
            .iter()
            .filter_map(|change| delta(change, &mut transfer))
            .collect();
        Some(fields([("deltas", deltas.into()), ("transfer", transfer.0.into())]))
    }

    /// Sets the view from numbers: the eye, the rotation from view space (x right, y up, the view along −z) to the world
    /// as a unit quaternion x, y, z, w, the vertical field of view in radians, width and height in pixels, and the screen
    /// error to refine to, in pixels.
    ///
    /// # Errors
    /// Another count of numbers, or a number out of range.
    pub fn set_view_numbers(&mut self, now_ms: f64, numbers: &[f64]) -> Result<(), String> {
        let &[ex, ey, ez, x, y, z, w, fov_y, width, height, target_px] = numbers else {
            return Err(format!("a view has {VIEW_NUMBERS} numbers, not {}", numbers.len()));
        };
        // JavaScript numbers; sides saturate, and zero is refused.
        let view = View {
            eye: [ex, ey, ez],
            rotation: [x, y, z, w].map(|part| part as f32),
            fov_y: fov_y as f32,
            viewport_px: [width as u32, height as u32],
            target_px: target_px as f32,
        };
        view.check().map_err(|why| format!("view: {why}"))?;
        self.core.set_view(time(now_ms), view);
        Ok(())
    }
}

/// Buffers that the page gets without another copy.
struct Transfer(Array);

impl Transfer {
    fn floats(&mut self, numbers: &[f32]) -> JsValue {
        let array = Float32Array::from(numbers);
        self.0.push(&array.buffer());
        array.into()
    }

    fn doubles(&mut self, numbers: &[f64]) -> JsValue {
        let array = Float64Array::from(numbers);
        self.0.push(&array.buffer());
        array.into()
    }

    fn bytes(&mut self, numbers: &[u8]) -> JsValue {
        let array = Uint8Array::from(numbers);
        self.0.push(&array.buffer());
        array.into()
    }

    fn shorts(&mut self, numbers: &[u16]) -> JsValue {
        let array = Uint16Array::from(numbers);
        self.0.push(&array.buffer());
        array.into()
    }

    fn words(&mut self, numbers: &[u32]) -> JsValue {
        let array = Uint32Array::from(numbers);
        self.0.push(&array.buffer());
        array.into()
    }
}

/// The object of a change; none for terrain and animations.
fn delta(change: &Change, transfer: &mut Transfer) -> Option<JsValue> {
    let object = match change {
        Change::Scene(header) => scene(header),
        Change::PunctualLights { .. } | Change::HeightOverrides { .. } | Change::Animation { .. } => {
            return None;
        }
        Change::PunctualLightPage { page, punctual_lights } => fields([
            ("kind", "lights".into()),
            ("page", (*page).into()),
            ("lights", punctual_lights.iter().map(light).collect::<Array>().into()),
        ]),
        Change::Instances(list) => instances(list, transfer),
        Change::Proxies(list) => {
            let assets: Vec<u32> = list.iter().map(|proxy| proxy.asset).collect();
            fields([("kind", "proxies".into()), ("assets", transfer.words(&assets))])
        }
        Change::Cut(cut) => fields([
            ("kind", "cut".into()),
            ("proxies", transfer.words(&cut.proxies)),
            ("instances", cut.instances.into()),
            ("covered", transfer.words(cut.covered.as_flattened())),
        ]),
        Change::Asset(new) => asset(new),
        Change::Mesh(change) => mesh(change, transfer),
        Change::FirstFrame => fields([("kind", "firstframe".into())]),
        Change::Texture(change) => texture(change, transfer),
        Change::TileRemoved { asset, tile } => fields([
            ("kind", "tileRemoved".into()),
            ("asset", (*asset).into()),
            ("texture", tile.texture.into()),
            ("level", tile.level.into()),
            ("tile", tile.tile.into()),
        ]),
    };
    Some(object.into())
}

/// A small array of plain numbers.
fn list<T: Into<f64> + Copy>(numbers: &[T]) -> JsValue {
    numbers.iter().map(|&number| JsValue::from(number.into())).collect::<Array>().into()
}

fn scene(header: &SceneHeader) -> Object {
    let light = fields([
        ("direction", list(&header.light.direction)),
        ("color", list(&header.light.color)),
        ("ambient", list(&header.light.ambient)),
    ]);
    let camera = fields([
        ("eye", list(&header.camera.eye)),
        ("target", list(&header.camera.target)),
        ("up", list(&header.camera.up)),
        ("fov", f64::from(header.camera.fov_y).to_degrees().into()),
    ]);
    fields([
        ("kind", "scene".into()),
        ("name", header.name.as_str().into()),
        ("light", light.into()),
        ("background", list(&header.background)),
        ("camera", camera.into()),
        ("assetCount", header.asset_count.into()),
        ("instanceCount", header.instance_count.into()),
        ("hasTerrain", header.terrain.is_some().into()),
    ])
}

fn light(light: &PunctualLight) -> JsValue {
    let spot = light.spot.map_or(JsValue::NULL, |spot| {
        fields([
            ("direction", list(&spot.direction)),
            ("inner", spot.inner.into()),
            ("outer", spot.outer.into()),
        ])
        .into()
    });
    fields([
        ("position", list(&light.position)),
        ("intensity", list(&light.intensity)),
        ("range", light.range.into()),
        ("spot", spot),
    ])
    .into()
}

fn instances(list: &[Instance], transfer: &mut Transfer) -> Object {
    let assets: Vec<u32> = list.iter().map(|instance| instance.asset).collect();
    let translations: Vec<f64> = list.iter().flat_map(|instance| instance.placement.translation).collect();
    let rotations: Vec<f32> =
        list.iter().flat_map(|instance| instance.placement.orientation().to_array()).collect();
    let scales: Vec<f32> = list.iter().map(|instance| instance.placement.scale).collect();
    fields([
        ("kind", "instances".into()),
        ("assets", transfer.words(&assets)),
        ("translations", transfer.doubles(&translations)),
        ("rotations", transfer.floats(&rotations)),
        ("scales", transfer.floats(&scales)),
    ])
}

fn asset(new: &NewAsset) -> Object {
    let shared = new.shared.iter().map(|shared| {
        let of = [f64::from(shared.asset), f64::from(shared.of)];
        JsValue::from(fields([("texture", shared.texture.into()), ("of", list(&of))]))
    });
    fields([
        ("kind", "asset".into()),
        ("asset", new.asset.into()),
        ("origin", list(&new.origin)),
        ("center", list(&new.center)),
        ("radius", new.radius.into()),
        ("materials", new.materials.iter().map(material).collect::<Array>().into()),
        ("textures", new.textures.iter().map(texture_info).collect::<Array>().into()),
        ("shared", shared.collect::<Array>().into()),
    ])
}

fn material(material: &Material) -> JsValue {
    let texture = |texture: Option<u16>| texture.map_or(JsValue::NULL, JsValue::from);
    let wrap = |wrap: Wrap| match wrap {
        Wrap::Repeat => JsValue::from("repeat"),
        Wrap::Clamp => "clamp".into(),
        Wrap::Mirror => "mirror".into(),
    };
    let [red, green, blue, _] = material.base_color;
    let (alpha, cutoff) = match material.alpha {
        Alpha::Opaque => ("opaque", 0.0),
        Alpha::Mask(cutoff) => ("mask", cutoff),
        Alpha::Blend => ("blend", 0.0),
    };
    fields([
        ("name", material.name.as_str().into()),
        ("baseColor", list(&[red, green, blue, material.plain_opacity()])),
        ("roughness", material.roughness.into()),
        ("metallic", material.metallic.into()),
        ("emission", list(&material.emission)),
        ("alphaMode", alpha.into()),
        ("alphaCutoff", cutoff.into()),
        ("unlit", material.unlit.into()),
        ("flat", material.flat.into()),
        ("wrap", material.wrap.map(wrap).iter().collect::<Array>().into()),
        ("baseColorTexture", texture(material.base_color_texture)),
        ("surfaceTexture", texture(material.surface_texture)),
        ("occlusionTexture", texture(material.occlusion_texture)),
        ("normalTexture", texture(material.normal_texture)),
        ("normalScale", material.normal_scale.into()),
        ("emissionTexture", texture(material.emission_texture)),
        ("heightTexture", texture(material.height_texture)),
        ("reliefDepth", material.relief_depth.into()),
        ("secondUv", second_uv(material)),
    ])
    .into()
}

/// Names of the textures that use the second set of texture coordinates.
fn second_uv(material: &Material) -> JsValue {
    let SecondUv { color, surface, normal, emission } = material.second_uv;
    let occlusion = material.occlusion_texture.is_some() && !surface;
    let names = [
        (color, "baseColorTexture"),
        (surface, "surfaceTexture"),
        (occlusion, "occlusionTexture"),
        (normal, "normalTexture"),
        (emission, "emissionTexture"),
    ];
    let used = names.into_iter().filter(|(used, _)| *used).map(|(_, name)| JsValue::from(name));
    used.collect::<Array>().into()
}

fn texture_info(info: &TextureInfo) -> JsValue {
    let kind = match info.kind {
        TextureKind::Color => "color",
        TextureKind::Height => "height",
        TextureKind::Normal => "normal",
        TextureKind::Surface => "surface",
    };
    let levels = info
        .levels
        .iter()
        .map(|level| JsValue::from(fields([("width", level.width.into()), ("height", level.height.into())])));
    fields([
        ("kind", kind.into()),
        ("width", info.width.into()),
        ("height", info.height.into()),
        ("mean", info.mean.map_or(JsValue::NULL, |mean| list(&mean))),
        ("levels", levels.collect::<Array>().into()),
    ])
    .into()
}

fn mesh(change: &MeshChange, transfer: &mut Transfer) -> Object {
    let vertices = change.vertices.iter().map(|(first, run)| JsValue::from(vertices(*first, run, transfer)));
    let vertices: Array = vertices.collect();
    let faces = change.indices.iter().map(|run| {
        let indices = transfer.words(run.faces.as_flattened());
        JsValue::from(fields([
            ("material", run.material.into()),
            ("first", run.first.into()),
            ("indices", indices),
        ]))
    });
    let faces: Array = faces.collect();
    fields([
        ("kind", "mesh".into()),
        ("asset", change.asset.into()),
        ("vertices", vertices.into()),
        ("faces", faces.into()),
        ("vertexCount", change.vertex_slots.into()),
        (
            "faceCounts",
            change.index_slots.iter().map(|&count| JsValue::from(count)).collect::<Array>().into(),
        ),
    ])
}

fn vertices(first: u32, run: &[Vertex], transfer: &mut Transfer) -> Object {
    let positions: Vec<f32> = run.iter().flat_map(|vertex| vertex.data.position).collect();
    let normals: Vec<f32> = run.iter().flat_map(|vertex| vertex.data.normal).collect();
    let uvs: Vec<f32> = run.iter().flat_map(|vertex| vertex.data.uv).collect();
    let second_uvs: Vec<f32> = run.iter().flat_map(|vertex| vertex.data.second_uv).collect();
    let second_uvs = match second_uvs.iter().any(|x| *x != 0.0) {
        true => transfer.floats(&second_uvs),
        false => JsValue::NULL,
    };
    let colors: Vec<u16> = run.iter().flat_map(|vertex| linear(vertex.data.color)).collect();
    let parts: Vec<u32> = run.iter().map(|vertex| vertex.data.part).collect();
    fields([
        ("first", first.into()),
        ("positions", transfer.floats(&positions)),
        ("normals", transfer.floats(&normals)),
        ("uvs", transfer.floats(&uvs)),
        ("secondUvs", second_uvs),
        ("colors", transfer.shorts(&colors)),
        ("parts", transfer.words(&parts)),
    ])
}

/// An sRGB colour with opacity as linear values of which 65,535 is 1 (IEC 61966-2-1).
fn linear([r, g, b, a]: [u8; 4]) -> [u16; 4] {
    let linear = |value: u8| {
        let value = f32::from(value) / 255.0;
        let light = if value <= 0.040_45 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
        // In 0..=1.
        (light * 65_535.0).round() as u16
    };
    [linear(r), linear(g), linear(b), u16::from(a) * 257]
}

fn texture(change: &TextureChange, transfer: &mut Transfer) -> Object {
    let (format, texels) = match &*change.pixels {
        TexturePixels::Rgba8(bytes) => ("rgba8", transfer.bytes(bytes)),
        TexturePixels::R8(bytes) => ("r8", transfer.bytes(bytes)),
        TexturePixels::R16(texels) => ("r16", transfer.shorts(texels)),
        // The core decodes levels for such pages.
        TexturePixels::File { file, .. } => ("file", transfer.bytes(file)),
        TexturePixels::Held { .. } => ("held", JsValue::NULL),
    };
    fields([
        ("kind", "texture".into()),
        ("asset", change.asset.into()),
        ("texture", change.texture.into()),
        ("level", change.level.into()),
        ("tile", change.tile.map_or(JsValue::NULL, JsValue::from)),
        ("format", format.into()),
        ("texels", texels),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_become_linear() {
        assert_eq!(linear([0, 255, 128, 255]), [0, 65_535, 14_146, 65_535]);
        assert_eq!(linear([10, 1, 0, 1]), [199, 20, 0, 257]);
    }
}
