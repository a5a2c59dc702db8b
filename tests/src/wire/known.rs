//! The expected contents of a recorded session, in the names and shapes that docs/protocol/reader.py prints.

use std::collections::BTreeMap;

use bytes::Bytes;
use lodestream_compress::decode_base;
use lodestream_geometry::base::Base;
use lodestream_protocol::frame::{BlobPiece, Frame, FrameReader, ServerFrame};
use lodestream_protocol::message::{ClientMessage, Hello, Refused, ServerMessage, Want, Welcome};
use lodestream_protocol::stream::{BLOB_STREAM, BlobStreamReader};
use lodestream_scene::animation::{
    AnimatedModel, AnimatedNode, AnimatedPart, AnimatedSkin, Channel, Clip, Rest, SkinJoint,
};
use lodestream_scene::asset::{
    Alpha, AssetDescription, Material, TextureFormat, TextureInfo, TextureKind, Wrap,
};
use lodestream_scene::blob::{PartBlob, PunctualLightBlob, TerrainBlob};
use lodestream_scene::description::{AssetEntry, Instance, SceneHeader, ScenePage};
use lodestream_scene::parts::{PartTable, decode_directory as decode_parts, decode_record};
use lodestream_scene::placement::Placement;
use lodestream_scene::proxy::Proxy;
use lodestream_scene::punctual_lights::{
    First, PunctualLight, PunctualLightPageEntry, PunctualLights, decode_directory as decode_punctual_lights,
    decode_page,
};
use lodestream_scene::terrain::{TerrainEntry, decode_directory};
use lodestream_scene::{BlobId, BlobPart, Tile, View};
use lodestream_terrain::{Distribution, Mode, Shape, Stamp};
use serde_json::{Value, json};

use super::record::{Recording, hex};

/// Consecutive bytes of a blob.
struct Run {
    id: BlobId,
    offset: u32,
    end: u32,
    total: u32,
    bytes: Vec<u8>,
}

/// Messages and blobs from the server.
#[derive(Default)]
pub(super) struct Expected {
    pub(super) messages: Vec<ServerMessage>,
    runs: Vec<Run>,
    begun: BTreeMap<BlobId, Run>,
}

impl Expected {
    /// Reads the server's side of a recording with the project's own readers.
    pub(super) fn of(recording: &Recording) -> Self {
        let mut this = Self::default();
        match recording {
            Recording::Quic(streams) => {
                for (_, _, bytes) in streams.iter().filter(|(from, _, _)| *from == "server") {
                    let rest = Bytes::copy_from_slice(&bytes[1..]);
                    if bytes[0] == BLOB_STREAM {
                        BlobStreamReader::new()
                            .push(rest)
                            .unwrap()
                            .into_iter()
                            .for_each(|piece| this.piece(piece));
                        continue;
                    }
                    let mut frames = FrameReader::new();
                    frames.push(&rest);
                    while let Some(frame) = frames.next_frame().unwrap() {
                        this.frame(frame);
                    }
                }
            }
            Recording::WebSocket { from_server, .. } => {
                for message in messages(from_server) {
                    this.frame(Frame::parse(message).unwrap());
                }
            }
        }
        assert!(this.begun.is_empty(), "a blob was recorded in part");
        this
    }

    fn frame(&mut self, frame: Frame) {
        match frame.into_server_frame().unwrap().unwrap() {
            ServerFrame::Message(message) => self.messages.push(message),
            ServerFrame::Piece(piece) => self.piece(piece),
        }
    }

    fn piece(&mut self, piece: BlobPiece) {
        let BlobPiece { id, offset, end, total, .. } = piece;
        let run = self.begun.entry(id).or_insert(Run { id, offset, end, total, bytes: Vec::new() });
        run.bytes.extend_from_slice(&piece.bytes);
        if piece.is_last() {
            self.runs.extend(self.begun.remove(&id));
        }
    }

    /// All messages and blobs as JSON.
    pub(super) fn json(&self, said: &[Vec<ClientMessage>]) -> Value {
        json!({
            "client": said.iter().flatten().map(client_message).collect::<Vec<_>>(),
            "server": self.messages.iter().map(server_message).collect::<Vec<_>>(),
            "blobs": self.runs.iter().map(|run| self.run(run)).collect::<Vec<_>>(),
        })
    }

    fn run(&self, run: &Run) -> Value {
        let Run { id, offset, end, total, bytes } = run;
        let mut value =
            json!({"id": blob_id(*id), "offset": offset, "end": end, "total": total, "bytes": hex(bytes)});
        let compressed = bytes.starts_with(&[0x28, 0xb5, 0x2f, 0xfd]);
        if id.part() == Some(BlobPart::Base) && !compressed {
            value["contents"] = base(&decode_base(bytes).unwrap());
        }
        if let BlobId::Terrain(TerrainBlob::DirectoryPage(_)) = id {
            let count = self.messages.iter().find_map(|message| match message {
                ServerMessage::Welcome(welcome) => {
                    welcome.scene.terrain.as_ref().map(|terrain| terrain.patches)
                }
                _ => None,
            });
            let listed = decode_directory(bytes, count.unwrap()).unwrap();
            value["contents"] = listed.iter().map(|p| json!([p.x, p.y, p.bytes, p.error])).collect();
        }
        if let BlobId::PunctualLights(blob) = id {
            let count = self.messages.iter().find_map(|message| match message {
                ServerMessage::PunctualLights(punctual_lights) => Some(punctual_lights.count),
                _ => None,
            });
            value["contents"] = match *blob {
                PunctualLightBlob::DirectoryPage(page) => {
                    let listed = decode_punctual_lights(
                        bytes,
                        PunctualLights::on_directory_page(count.unwrap(), page),
                    )
                    .unwrap();
                    listed.iter().map(self::listed).collect()
                }
                PunctualLightBlob::Page(page) => {
                    let punctual_lights =
                        decode_page(bytes, PunctualLights::on_page(count.unwrap(), page)).unwrap();
                    punctual_lights.iter().map(punctual_light).collect()
                }
            };
        }
        if let BlobId::Parts(blob) = *id {
            let table = self.messages.iter().find_map(|message| match message {
                ServerMessage::Parts(table) => Some(*table),
                _ => None,
            });
            let instances = self.messages.iter().find_map(|message| match message {
                ServerMessage::Welcome(welcome) => Some(welcome.scene.instance_count),
                _ => None,
            });
            value["contents"] = parts(blob, bytes, table.unwrap(), instances.unwrap());
        }
        if let BlobId::Animation(_) = *id {
            value["contents"] = animation(&AnimatedModel::from_bytes(bytes).unwrap());
        }
        value
    }
}

/// Contents of the blob of an animated model.
fn animation(model: &AnimatedModel) -> Value {
    let map = |map: &glam::DAffine3| json!(map.to_cols_array());
    let node = |node: &AnimatedNode| {
        let Rest { translation, rotation, scale } = node.rest;
        json!([node.parent, map(&node.to_parent), translation, rotation, scale])
    };
    let part = |part: &AnimatedPart| json!([part.node, map(&part.to_node), map(&part.from_model)]);
    let joint = |joint: &SkinJoint| json!([joint.node, map(&joint.to_node)]);
    let skin = |skin: &AnimatedSkin| skin.joints.iter().map(joint).collect::<Vec<_>>();
    let numbers = |list: &[f32]| list.iter().map(|&number| f64::from(number)).collect::<Vec<_>>();
    let channel = |channel: &Channel| {
        let [property, interpolation] =
            [format!("{:?}", channel.property), format!("{:?}", channel.interpolation)]
                .map(|name| name.to_lowercase());
        json!([channel.node, property, interpolation, channel.timeline, numbers(&channel.values)])
    };
    let clip = |clip: &Clip| json!([clip.name, clip.channels.iter().map(channel).collect::<Vec<_>>()]);
    json!({
        "nodes": model.nodes.iter().map(node).collect::<Vec<_>>(),
        "parts": model.parts.iter().map(part).collect::<Vec<_>>(),
        "skins": model.skins.iter().map(skin).collect::<Vec<_>>(),
        "places": model.places,
        "timelines": model.timelines.iter().map(|times| numbers(times)).collect::<Vec<_>>(),
        "clips": model.clips.iter().map(clip).collect::<Vec<_>>(),
    })
}

/// Contents of a blob of the table of parts.
fn parts(blob: PartBlob, bytes: &[u8], table: PartTable, instances: u32) -> Value {
    match blob {
        PartBlob::DirectoryPage(page) => {
            let count = PartTable::on_directory_page(instances, page);
            let runs = decode_parts(bytes, count, table.records).unwrap();
            runs.iter().map(|run| json!([run.instances, run.parts, run.first])).collect()
        }
        PartBlob::Page(page) => {
            let count = table.on_page(page);
            let record = |number| decode_record(bytes, count, number).unwrap().unwrap();
            (0..count)
                .map(record)
                .map(|info| {
                    let Placement { translation, rotation, scale } = info.in_file;
                    json!([
                        info.name,
                        info.path,
                        info.extras.unwrap_or_default(),
                        translation,
                        rotation,
                        scale
                    ])
                })
                .collect()
        }
    }
}

/// Binary messages that a server wrote over WebSocket after its answer to the upgrade.
fn messages(bytes: &[u8]) -> Vec<Bytes> {
    let head = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap() + 4;
    let mut rest = &bytes[head..];
    let mut messages = Vec::new();
    while rest.first() == Some(&0x82) {
        let (start, length) = match rest[1] {
            126 => (4, usize::from(u16::from_be_bytes([rest[2], rest[3]]))),
            short => (2, usize::from(short)),
        };
        messages.push(Bytes::copy_from_slice(&rest[start..start + length]));
        rest = &rest[start + length..];
    }
    messages
}

fn client_message(message: &ClientMessage) -> Value {
    match message {
        ClientMessage::Hello(hello) => json!(["Hello", self::hello(hello)]),
        ClientMessage::Want(wants) => json!(["Want", wants.iter().map(want).collect::<Vec<_>>()]),
        ClientMessage::Cancel(ids) => {
            json!(["Cancel", ids.iter().map(|id| blob_id(*id)).collect::<Vec<_>>()])
        }
        ClientMessage::SetView(view) => json!(["SetView", self::view(view)]),
        ClientMessage::WantScenePages(pages) => json!(["WantScenePages", pages]),
        ClientMessage::Ping(number) => json!(["Ping", number]),
        ClientMessage::Bye => json!(["Bye", null]),
        ClientMessage::Token(token) => json!(["Token", token.0]),
    }
}

fn server_message(message: &ServerMessage) -> Value {
    match message {
        ServerMessage::Welcome(welcome) => json!(["Welcome", self::welcome(welcome)]),
        ServerMessage::ScenePage(page) => json!(["ScenePage", self::page(page)]),
        ServerMessage::PunctualLights(punctual_lights) => {
            json!(["PunctualLights", self::punctual_lights(punctual_lights)])
        }
        ServerMessage::Parts(table) => json!(["Parts", table.records]),
        ServerMessage::Animations(table) => json!(["Animations", table.models]),
        ServerMessage::Refused(refused) => json!(["Refused", self::refused(refused)]),
        ServerMessage::RefusedMany(many) => {
            json!(["RefusedMany", many.iter().map(self::refused).collect::<Vec<_>>()])
        }
        ServerMessage::BasesSent => json!(["BasesSent", null]),
        ServerMessage::Done => json!(["Done", null]),
        ServerMessage::Pong(number) => json!(["Pong", number]),
        ServerMessage::Close(close) => {
            json!(["Close", {"code": format!("{:?}", close.code), "reason": close.reason}])
        }
    }
}

fn refused(refused: &Refused) -> Value {
    json!({"id": blob_id(refused.id), "reason": format!("{:?}", refused.reason)})
}

fn punctual_lights(said: &PunctualLights) -> Value {
    let first = match said.first().unwrap() {
        First::PunctualLights(all) => all.iter().map(punctual_light).collect(),
        First::Directory(listed) => listed.iter().map(self::listed).collect(),
        First::Nothing => Value::Null,
    };
    json!({"count": said.count, "first": first})
}

fn listed(entry: &PunctualLightPageEntry) -> Value {
    let PunctualLightPageEntry { center, radius, intensity, bytes } = entry;
    json!({"center": center, "radius": radius, "intensity": intensity, "bytes": bytes})
}

fn punctual_light(punctual_light: &PunctualLight) -> Value {
    let brightest = punctual_light.brightest();
    let mut value = json!({
        "position": punctual_light.position,
        "colour": punctual_light.intensity.map(|i| (i / brightest * 255.0).round() as u8),
        "brightest": brightest,
        "range": punctual_light.range,
    });
    if let Some(spot) = punctual_light.spot {
        value["direction"] = json!(spot.direction);
        let angle = |x: f32| (f64::from(x) / std::f64::consts::FRAC_PI_2 * 65_535.0).round() as u16;
        value["angles"] = json!([angle(spot.inner), angle(spot.outer)]);
    }
    value
}

fn hello(hello: &Hello) -> Value {
    json!({
        "version_min": hello.version_min,
        "version_max": hello.version_max,
        "scene": hello.scene,
        "view": hello.view.as_ref().map(view),
        "max_blob_bytes": hello.max_blob_bytes,
        "budget_bytes": hello.budget_bytes,
        "fingerprint": hex(&hello.fingerprint),
        "have": hello.have.iter().map(|id| blob_id(*id)).collect::<Vec<_>>(),
    })
}

fn view(view: &View) -> Value {
    json!({
        "eye": view.eye,
        "rotation": view.rotation,
        "fov_y": view.fov_y,
        "viewport_px": view.viewport_px,
        "target_px": view.target_px,
    })
}

fn want(want: &Want) -> Value {
    json!({"id": blob_id(want.id), "priority": want.priority, "offset": want.offset, "end": want.end})
}

fn blob_id(id: BlobId) -> Value {
    match id {
        BlobId::Terrain(TerrainBlob::DirectoryPage(page)) => json!({"terrain_directory_page": page}),
        BlobId::Terrain(TerrainBlob::HeightOverrides(patch)) => json!({"height_overrides": patch}),
        BlobId::PunctualLights(PunctualLightBlob::DirectoryPage(page)) => {
            json!({"punctual_light_directory_page": page})
        }
        BlobId::PunctualLights(PunctualLightBlob::Page(page)) => {
            json!({"punctual_light_page": page})
        }
        BlobId::Parts(PartBlob::DirectoryPage(page)) => json!({"part_directory_page": page}),
        BlobId::Parts(PartBlob::Page(page)) => json!({"part_page": page}),
        BlobId::Animation(model) => json!({"animation": model}),
        BlobId::Asset { asset, part } => match part {
            BlobPart::Base => json!({"asset": asset, "base": true}),
            BlobPart::IndexPage(page) => json!({"asset": asset, "page": page}),
            BlobPart::Chunk(chunk) => json!({"asset": asset, "chunk": chunk}),
            BlobPart::Texture { texture, level } => {
                json!({"asset": asset, "texture": texture, "level": level})
            }
            BlobPart::TextureRegions => json!({"asset": asset, "texture_regions": true}),
            BlobPart::Tile(Tile { texture, level, tile }) => {
                json!({"asset": asset, "texture": texture, "level": level, "tile": tile})
            }
        },
    }
}

fn welcome(welcome: &Welcome) -> Value {
    json!({
        "version": welcome.version,
        "session": welcome.session,
        "rate_bits_per_s": welcome.rate_bits_per_s,
        "idle_timeout_ms": welcome.idle_timeout_ms,
        "scene": header(&welcome.scene),
    })
}

fn header(header: &SceneHeader) -> Value {
    let SceneHeader { light, camera, .. } = header;
    json!({
        "name": header.name,
        "fingerprint": hex(&header.fingerprint),
        "asset_count": header.asset_count,
        "instance_count": header.instance_count,
        "page_count": header.page_count,
        "light": {"direction": light.direction, "color": light.color, "ambient": light.ambient},
        "background": header.background,
        "terrain": header.terrain.as_deref().map(terrain),
        "camera": {"eye": camera.eye, "target": camera.target, "up": camera.up, "fov_y": camera.fov_y},
        "root_slope": header.root_slope,
    })
}

fn terrain(entry: &TerrainEntry) -> Value {
    let p = &entry.parameters;
    let mut value = json!({
        "seed": p.seed,
        "finest_level": p.finest_level,
        "erosion_level": p.erosion.level,
        "extent_log2": p.extent_log2,
        "gaussian": p.distribution == Distribution::Gaussian,
        "amplitude": p.amplitude,
        "roughness": p.roughness,
        "base": p.base,
        "passes": p.erosion.passes,
        "talus": p.erosion.talus,
        "spike_limit": p.erosion.spike_limit,
        "unit": entry.unit,
        "height_unit": entry.height_unit,
        "zones": entry.zones,
        "stamps": entry.stamps.iter().map(stamp).collect::<Vec<_>>(),
        "patches": entry.patches,
    });
    if let Some(water) = &entry.water {
        value["water"] = json!({"level": water.level, "clarity": water.clarity});
    }
    value
}

fn stamp(stamp: &Stamp) -> Value {
    let mut value = match &stamp.shape {
        Shape::Ridge { from, to, half_width, height } => {
            json!({"kind": "ridge", "line": [from, to], "length": half_width, "height": height})
        }
        Shape::Valley { from, to, half_width, depth } => {
            json!({"kind": "valley", "line": [from, to], "length": half_width, "height": depth})
        }
        Shape::Crater { centre, radius, depth, rim } => {
            json!({"kind": "crater", "line": [centre], "length": radius, "height": depth, "rim": rim})
        }
        Shape::Plateau { centre, radius, falloff, height } => {
            json!({"kind": "plateau", "line": [centre], "length": radius, "height": height, "falloff": falloff})
        }
        Shape::RiverBed { line, half_width, depth } => {
            json!({"kind": "river bed", "line": line, "length": half_width, "height": depth})
        }
    };
    value["fixed"] = json!(stamp.mode == Mode::Fixed);
    value
}

fn page(page: &ScenePage) -> Value {
    json!({
        "page": page.page,
        "first_asset": page.first_asset,
        "first_instance": page.first_instance,
        "assets": page.assets.iter().map(asset).collect::<Vec<_>>(),
        "instances": page.instances.iter().map(instance).collect::<Vec<_>>(),
        "first_proxy": page.first_proxy,
        "proxies": page.proxies.iter().map(proxy).collect::<Vec<_>>(),
    })
}

fn proxy(proxy: &Proxy) -> Value {
    json!({
        "asset": proxy.asset,
        "parent": proxy.parent,
        "first_instance": proxy.first_instance,
        "instance_count": proxy.instance_count,
        "child_count": proxy.child_count,
        "error": proxy.error,
    })
}

fn asset(asset: &AssetEntry) -> Value {
    let mut known = json!({
        "name": asset.name,
        "fingerprint": hex(&asset.fingerprint),
        "origin": asset.origin,
        "center": asset.sphere.center,
        "radius": asset.sphere.radius,
        "root_error": asset.root_error,
        "base_bytes": asset.base_bytes,
        "chunk_count": asset.chunk_count,
    });
    if !asset.shared.is_empty() {
        let shared = asset.shared.iter();
        known["shared"] = shared
            .map(|shared| json!({ "texture": shared.texture, "asset": shared.asset, "of": shared.of }))
            .collect();
    }
    known
}

fn instance(instance: &Instance) -> Value {
    json!({
        "asset": instance.asset,
        "translation": instance.placement.translation,
        "rotation": instance.placement.rotation,
        "scale": instance.placement.scale,
    })
}

fn base(base: &Base) -> Value {
    json!({
        "position_bits": base.grid.bits,
        "codec": base.codec.to_string(),
        "uv_bits": base.uv_grid.bits,
        "colors": base.colors,
        "normals": base.normals,
        "level_count": base.level_count,
        "shifts": base.shifts,
        "origin": base.grid.origin,
        "step": base.grid.step,
        "center": base.sphere.center,
        "radius": base.sphere.radius,
        "diagonal": base.diagonal,
        "geometric_error": base.geometric_error,
        "chunk_count": base.chunk_count,
        "material_count": base.material_count,
        "part_count": base.part_count,
        "vertices": base.totals.vertices,
        "wedges": base.totals.wedges,
        "faces": base.totals.faces,
        "description": description(&AssetDescription::decode(&base.description).unwrap()),
    })
}

fn description(description: &AssetDescription) -> Value {
    json!({
        "name": description.name,
        "materials": description.materials.iter().map(material).collect::<Vec<_>>(),
        "textures": description.textures.iter().map(texture).collect::<Vec<_>>(),
    })
}

fn material(material: &Material) -> Value {
    let mut value = json!({
        "name": material.name,
        "base_color": material.base_color.map(|x| (x * 65_535.0).round() as u16),
        "roughness": (material.roughness * 255.0).round() as u8,
    });
    if let Some(texture) = material.base_color_texture {
        value["base_color_texture"] = json!(texture);
    }
    if let Some(texture) = material.height_texture {
        value["height_texture"] = json!(texture);
        value["relief_depth"] = json!(material.relief_depth);
    }
    if material.metallic > 0.0 {
        value["metallic"] = json!((material.metallic * 255.0).round() as u8);
    }
    if material.emission != [0.0; 3] {
        value["emission"] = json!(material.emission);
    }
    if let Some(texture) = material.surface_texture {
        value["surface_texture"] = json!(texture);
    }
    if let Some(texture) = material.normal_texture {
        value["normal_texture"] = json!(texture);
        value["normal_scale"] = json!(material.normal_scale);
    }
    if let Some(texture) = material.emission_texture {
        value["emission_texture"] = json!(texture);
    }
    let Material { alpha, unlit, flat, wrap, specular, clear_coat, transmission, .. } = material;
    let has_third = !specular.is_usual() || !clear_coat.is_none() || *transmission > 0.0;
    if (*alpha, *unlit, *flat, *wrap) != (Alpha::Opaque, false, false, [Wrap::Repeat; 2]) || has_third {
        let wrap = |wrap| match wrap {
            Wrap::Repeat => "repeat",
            Wrap::Clamp => "clamp",
            Wrap::Mirror => "mirror",
        };
        value["alpha"] = json!(match material.alpha {
            Alpha::Opaque => "opaque",
            Alpha::Mask(_) => "mask",
            Alpha::Blend => "blend",
        });
        value["unlit"] = json!(material.unlit);
        value["flat"] = json!(material.flat);
        value["wrap"] = json!(material.wrap.map(wrap));
        if let Alpha::Mask(cutoff) = material.alpha {
            value["cutoff"] = json!((cutoff * 255.0).round() as u8);
        }
        if !specular.is_usual() {
            value["specular"] = json!(specular.bytes());
        }
        if !clear_coat.is_none() {
            let both = [clear_coat.factor, clear_coat.roughness];
            value["clear_coat"] = json!(both.map(|share| (share * 255.0).round() as u8));
        }
        if *transmission > 0.0 {
            value["transmission"] = json!((transmission * 255.0).round() as u8);
        }
    }
    value
}

fn texture(texture: &TextureInfo) -> Value {
    let format = |format| match format {
        TextureFormat::Jpeg => "jpeg",
        TextureFormat::Png => "png",
        TextureFormat::WebP => "webp",
    };
    let levels = texture.levels.iter();
    let levels = levels
        .map(|l| json!({"width": l.width, "height": l.height, "bytes": l.bytes, "format": format(l.format)}));
    json!({
        "kind": match texture.kind {
            TextureKind::Color => "color",
            TextureKind::Height => "height",
            TextureKind::Normal => "normal",
            TextureKind::Surface => "surface",
        },
        "width": texture.width,
        "height": texture.height,
        "planes": texture.planes,
        "mean": texture.mean,
        "uv_per_unit": texture.uv_per_unit,
        "levels": levels.collect::<Vec<_>>(),
    })
}
