//! Seed inputs, encoded by the project's own writers: regenerate them after a format change.

use std::path::Path;

use data_encoding::BASE64;
use lodestream_bake::compose::compose;
use lodestream_bake::scene;
use lodestream_compress::{compress, encode_base};
use lodestream_geometry::Codec;
use lodestream_geometry::index::{self, ChunkInfo, Sphere, TruncationPoint};
use lodestream_geometry::mesh::SourceMesh;
use lodestream_geometry::pack::{BlobKind, write};
use lodestream_geometry::prepare::Prepared;
use lodestream_protocol::frame::{BlobPiece, encode_client, encode_piece, encode_server};
use lodestream_protocol::message::{
    ClientMessage, Close, CloseCode, Hello, ServerMessage, Token, Want, Welcome,
};
use lodestream_protocol::stream::blob_head;
use lodestream_scene::asset::{
    Alpha, AssetDescription, Material, TextureFormat, TextureInfo, TextureKind, TextureLevel, Wrap,
};
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::{AssetEntry, Camera, Instance, SceneHeader, SceneLighting, ScenePage};
use lodestream_scene::parts::{self, PartInfo, PartTable};
use lodestream_scene::placement::Placement;
use lodestream_scene::published::{
    ChunkPlace, ChunkTable, IndexPage, PackContents, Texture, TexturePlace, part_hash,
};
use lodestream_scene::punctual_lights::{
    PunctualLight, PunctualLightPageEntry, PunctualLights, Spot, encode_directory, encode_page,
};
use lodestream_scene::shared::SharedTexture;
use lodestream_scene::view::View;
use lodestream_store::SceneObject;
use lodestream_terrain::{
    Distribution, Erosion, HeightOverride, HeightOverrides, Mode, Parameters, Shape, Stamp, encode_points,
    encode_stamps,
};

use crate::common::shapes;
use crate::compressed;
use crate::fixtures;
use crate::glb::glb;

/// The seeds of a target, by the name of its corpus, as (file name, bytes). None for an unknown name.
///
/// # Panics
/// If a seed cannot be encoded.
#[must_use]
pub fn of(target: &str) -> Vec<(String, Vec<u8>)> {
    match target {
        "pack_reader" => packs(),
        "base_decoder" => bases(),
        "chunk_decoder" => chunks(),
        "apply_undo" => sequences(),
        "obj_import" => models(),
        "gltf_import" => scenes(),
        "gltf_compressed" => compressed::seeds(),
        "ply_import" => scans(),
        "messages" => messages(),
        "terrain" => terrain(),
        "punctual_lights" => punctual_lights(),
        "parts" => parts(),
        "scene_object" | "range_session" => published(),
        _ => Vec::new(),
    }
}

/// A seed that a target must accept.
fn seed(name: impl Into<String>, bytes: Vec<u8>) -> (String, Vec<u8>) {
    (name.into(), bytes)
}

fn pack(asset: &Prepared) -> Vec<u8> {
    let base = encode_base(&asset.base).expect("a prepared base is encoded");
    let stored = |chunk: &Vec<u8>| match asset.base.codec {
        Codec::Range | Codec::AxisAligned => chunk.clone(),
        Codec::Zstd => compress(chunk).expect("a chunk is compressed"),
    };
    let chunks: Vec<Vec<u8>> = asset.chunks.iter().map(stored).collect();
    let mut blobs: Vec<(BlobKind, &[u8])> = vec![(BlobKind::Base, &base)];
    blobs.extend((0..).zip(&asset.pages).map(|(i, page)| (BlobKind::IndexPage(i), page.as_slice())));
    blobs.extend((0..).zip(&chunks).map(|(i, chunk)| (BlobKind::Chunk(i), chunk.as_slice())));
    write([7; 32], &blobs).expect("a pack is written")
}

fn packs() -> Vec<(String, Vec<u8>)> {
    fixtures::all().iter().map(|f| seed(f.name, pack(&f.asset))).collect()
}

fn bases() -> Vec<(String, Vec<u8>)> {
    let encode = |f: &fixtures::Fixture| f.asset.base.encode().expect("a prepared base is encoded");
    fixtures::all().iter().map(|f| seed(f.name, encode(f))).collect()
}

fn chunks() -> Vec<(String, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (number, fixture) in (0..).zip(fixtures::all()) {
        for chunk in 0..fixture.asset.chunks.len() {
            let info = &fixture.asset.infos[chunk];
            let mut bytes = vec![number];
            bytes.extend((chunk as u16).to_le_bytes());
            // Counts as given, parents as they are.
            bytes.push(2);
            for count in [info.vertices, info.wedges, info.faces] {
                bytes.extend((count as u16).to_le_bytes());
            }
            bytes.extend(&fixture.asset.chunks[chunk]);
            seeds.push(seed(format!("{}-{chunk}", fixture.name), bytes));
        }
    }
    seeds
}

fn sequences() -> Vec<(String, Vec<u8>)> {
    let mut seeds = Vec::new();
    for (number, fixture) in (0..).zip(fixtures::all()) {
        let chunks = fixture.before.len().min(12) as u16;
        let mut operation = |name: &str, operations: &mut dyn FnMut(&mut Vec<u8>)| {
            let mut bytes = vec![number];
            operations(&mut bytes);
            seeds.push(seed(format!("{}-{name}", fixture.name), bytes));
        };
        let all = |bytes: &mut Vec<u8>, operation: u8| {
            for chunk in 0..chunks {
                bytes.push(operation);
                bytes.extend(chunk.to_le_bytes());
            }
        };
        operation("up-and-down", &mut |bytes| {
            all(bytes, 0);
            all(bytes, 3);
            all(bytes, 4);
        });
        // To the first truncation points, on which children cannot be applied, and on to the end.
        operation("by-way-of-truncation_points", &mut |bytes| {
            all(bytes, 6);
            all(bytes, 3);
            all(bytes, 0);
        });
        operation("damaged", &mut |bytes| {
            for chunk in 0..chunks {
                bytes.push(u8::from(chunk % 2 == 1));
                bytes.extend(chunk.to_le_bytes());
                if chunk % 2 == 1 {
                    bytes.extend([chunk as u8 * 5, 0, 1]);
                }
            }
        });
        operation("forged", &mut |bytes| {
            all(bytes, 0);
            for chunk in (0..chunks).rev() {
                for what in 0..3 {
                    bytes.extend([3, chunk as u8, 0, 5, chunk as u8, 0, what * 3 + chunk as u8, 1, 0, 2]);
                }
            }
        });
        operation("misplaced", &mut |bytes| {
            bytes.extend([0, 0, 0]);
            for chunk in 1..chunks {
                bytes.extend([2, chunk as u8, 0, 0, 0]);
            }
        });
    }
    seeds
}

/// The text of an OBJ file.
fn obj(mesh: &SourceMesh) -> String {
    use std::fmt::Write as _;
    let mut text = String::from("mtllib m.mtl\n");
    for [x, y, z] in &mesh.positions {
        let _ = writeln!(text, "v {x:.3} {y:.3} {z:.3}");
    }
    for [u, v] in &mesh.uvs {
        let _ = writeln!(text, "vt {u:.2} {v:.2}");
    }
    for [x, y, z] in &mesh.normals {
        let _ = writeln!(text, "vn {x:.2} {y:.2} {z:.2}");
    }
    for (face, material) in mesh.faces.iter().zip(&mesh.materials) {
        let _ = write!(text, "usemtl m{material}\nf");
        for corner in face {
            let given = |index: u32| if index == u32::MAX { String::new() } else { (index + 1).to_string() };
            let _ = write!(text, " {}/{}/{}", corner.position + 1, given(corner.uv), given(corner.normal));
        }
        text.push('\n');
    }
    text
}

/// A pyramid on a quad in every format, with all vertex properties and with positions only, and a strip.
fn scans() -> Vec<(String, Vec<u8>)> {
    let full = "property double x\nproperty short y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
                property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\nproperty float t\n";
    let faces = "element face 5\nproperty list uchar int vertex_indices\nend_header\n";
    let places = [[0_i16, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [2, 2, 3]];
    let polygons: [&[i32]; 5] = [&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]];
    let head =
        |format: &str, rest: &str| format!("ply\nformat {format} 1.0\nelement vertex 5\n{rest}").into_bytes();
    let binary = |format: &str, big: bool| {
        let mut out = head(format, &format!("{full}{faces}"));
        let mut put = |bytes: &[u8]| match big {
            true => out.extend(bytes.iter().rev()),
            false => out.extend(bytes),
        };
        for [x, y, z] in places {
            put(&f64::from(x).to_le_bytes());
            put(&y.to_le_bytes());
            [f32::from(z), 0.0, 0.6, 0.8].iter().for_each(|x| put(&x.to_le_bytes()));
            [x, y, z].iter().for_each(|x| put(&[*x as u8 * 60]));
            [x, y].iter().for_each(|x| put(&(f32::from(*x) / 4.0).to_le_bytes()));
        }
        for polygon in polygons {
            put(&[polygon.len() as u8]);
            polygon.iter().for_each(|corner| put(&corner.to_le_bytes()));
        }
        out
    };
    let vertices: String = places.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect();
    let listed = |polygon: &&[i32]| {
        let corners: Vec<String> = polygon.iter().map(ToString::to_string).collect();
        format!("{} {}\n", polygon.len(), corners.join(" "))
    };
    let listed: String = polygons.iter().map(listed).collect();
    let xyz = "property float x\nproperty float y\nproperty float z\n";
    let text = |rest: &str| [head("ascii", &format!("{xyz}{rest}")), vertices.clone().into()].concat();
    let strips = "element tristrips 1\nproperty list int int vertex_indices\nend_header\n";
    let extra = "element edge 1\nproperty int a\nelement face 5\nproperty list uchar int vertex_index\nproperty float area\n\
                 comment x\nend_header\n";
    let areas = listed.replace('\n', " 0.5\n");
    vec![
        seed("text", [text(faces), listed.into_bytes()].concat()),
        seed("strip", [text(strips), b"8 0 1 4 2 -1 3 0 4\n".to_vec()].concat()),
        seed("passed-over", [text(extra), b"9\n".to_vec(), areas.into_bytes()].concat()),
        seed("little-endian", binary("binary_little_endian", false)),
        seed("big-endian", binary("binary_big_endian", true)),
    ]
}

fn models() -> Vec<(String, Vec<u8>)> {
    const MTL: &str = "newmtl m0\nKd 0.5 0.25 1\nd 0.5\nNs 10\nmap_Kd -s 2 2 1 a b.png\nbump -bm 0.25 h.png\n\
                       newmtl m1\nKd 0.5\nTr 0.25\ndisp -mm 0 1 d.png\n\
                       newmtl m2\nKe 1 2 0.5\nPr 0.5\nPm 1\nillum 0\nmap_Kd -clamp on a.png\nmap_Ke e.png\n\
                       map_Pr -imfchan g s.png\nmap_Pm -imfchan b s.png\nmap_d a.png\nnorm -bm 0.5 n.png\n";
    let texts = [
        ("torus", obj(&shapes::materials(shapes::torus(3, 4), 2))),
        ("frigate", obj(&shapes::frigate(1)).lines().take(40).map(|l| format!("{l}\n")).collect::<String>() + "f 1 2 3\n"),
        ("relative", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv .5 .2 0\nf -5 -4 -3 -2 -1\n".into()),
        ("odd", "\u{feff}# x\r\nf 1/1 2/1 \\\r\n  3/1 # f\r\nv 0 0 0 2\r\nv 2 0 0 2\r\nv 0 1 0 1 0 0\r\nvt 0.5\r\nl 1 2\r\n".into()),
        ("concave", "v 0 2 0\nv -1 0 0\nv 0 1 0\nv 1 0 0\nvn 0 0 4\nusemtl a b\nf 1//1 2//1 3//1 4//1\n".into()),
    ];
    texts.map(|(name, text)| seed(name, [text.as_bytes(), b"\0", MTL.as_bytes()].concat())).into()
}

/// The beginning of a material with all properties, and the textures that it uses.
const MAPS: &str = r#""images":[{"uri":"a.png"},{"bufferView":1,"mimeType":"image/png"}],"samplers":[{"wrapS":33071,"wrapT":33648}],"textures":[{"source":0,"sampler":0},{"source":1,"sampler":0}],"extensionsUsed":["KHR_materials_emissive_strength"],"extensionsRequired":["KHR_materials_transmission"],"materials":[{"normalTexture":{"index":0,"scale":0.5,"extensions":{"KHR_texture_transform":{"offset":[0.5,0],"rotation":1,"scale":[2,1]}}},"occlusionTexture":{"index":1,"strength":0.5,"texCoord":1},"emissiveTexture":{"index":0},"emissiveFactor":[1,0.5,0],"alphaMode":"MASK","alphaCutoff":0.25,"doubleSided":true,"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":4},"KHR_materials_unlit":{},"KHR_materials_transmission":{"transmissionFactor":0.5},"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[0,0,0,1],"glossinessFactor":0.5,"specularGlossinessTexture":{"index":1}}},"name":"m","#;

/// Nodes with lights of every kind, and the lights.
const LIGHTS: &str = r#""extensionsRequired":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[{"type":"point","color":[1,0.5,0],"intensity":40,"range":9},{"type":"spot","intensity":9,"spot":{"innerConeAngle":0.25,"outerConeAngle":0.5}},{"type":"directional"}]}},"nodes":[{"mesh":0,"children":[1,2,3]},{"translation":[1,2,3],"extensions":{"KHR_lights_punctual":{"light":0}}},{"scale":[2,-1,0.5],"extensions":{"KHR_lights_punctual":{"light":1}}},{"extensions":{"KHR_lights_punctual":{"light":2}}}]"#;

fn scenes() -> Vec<(String, Vec<u8>)> {
    // Four corners of a square, their uvs, six indices.
    let mut bin: Vec<u8> = Vec::new();
    for (x, y) in [(0.0_f32, 0.0_f32), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
        bin.extend([x, y, 0.5 * x * y].iter().flat_map(|c| c.to_le_bytes()));
    }
    bin.extend([0, 0, 255, 0, 255, 255, 0, 255]);
    bin.extend([0, 1, 2, 0, 2, 3]);
    let views = r#""bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":8},{"buffer":0,"byteOffset":56,"byteLength":6}]"#;
    let accessors = r#""accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":4,"min":[0,0,0],"max":[1,1,1]},{"bufferView":1,"componentType":5121,"normalized":true,"type":"VEC2","count":4},{"bufferView":2,"componentType":5121,"type":"SCALAR","count":6}]"#;
    let file = |buffer: &str, mode: u8, nodes: &str, more: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],{nodes},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"mode":{mode}{more}}}]}}],"buffers":[{{{buffer}"byteLength":62}}],{views},{accessors},"materials":[{{"name":"m","pbrMetallicRoughness":{{"baseColorFactor":[1,0.5,0,1],"roughnessFactor":0.3}}}}]}}"#
        )
    };
    let one = r#""nodes":[{"mesh":0}]"#;
    let nested = r#""nodes":[{"children":[1,2],"translation":[1,2,3]},{"mesh":0,"rotation":[0,0.6,0,0.8],"scale":[2,2,2]},{"mesh":0,"matrix":[1,0,0,0,0,-1,0,0,0,0,3,0,0,0,5,1]}]"#;
    let places = r#""extensionsRequired":["EXT_mesh_gpu_instancing"],"nodes":[{"mesh":0,"extensions":{"EXT_mesh_gpu_instancing":{"attributes":{"TRANSLATION":0,"SCALE":0}}}}]"#;
    let data = format!(r#""uri":"data:application/octet-stream;base64,{}","#, BASE64.encode(&bin));
    vec![
        seed("square.glb", glb(&file("", 4, one, r#","material":0"#), &bin)),
        seed("strip.glb", glb(&file("", 5, one, ""), &bin)),
        seed("fan.glb", glb(&file("", 6, nested, r#","material":0"#), &bin)),
        seed("nodes.glb", glb(&file("", 4, nested, ""), &bin)),
        seed("places.glb", glb(&file("", 4, places, ""), &bin)),
        seed("data-uri.gltf", file(&data, 4, nested, "").into_bytes()),
        seed("materials.glb", glb(&file("", 4, one, r#","material":0"#).replace(r#""materials":[{"name":"m","#, MAPS), &bin)),
        seed("lights.glb", glb(&file("", 4, LIGHTS, ""), &bin)),
        seed("sparse.glb", glb(&file("", 4, one, "").replace(r#","count":4,"min":[0,0,0]"#, r#","count":4,"sparse":{"count":1,"indices":{"bufferView":2,"componentType":5121},"values":{"bufferView":0}},"min":[0,0,0]"#), &bin)),
    ]
}

fn messages() -> Vec<(String, Vec<u8>)> {
    let view = View::look_at([0.0, 1.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 1.0, [1280, 720]);
    let wants = || [BlobId::base(0), BlobId::chunk(1, 70_000), BlobId::texture(2, 3, 4)];
    let client = [
        ClientMessage::Hello(Hello {
            version_min: 1,
            view: Some(view),
            max_blob_bytes: 1 << 20,
            budget_bytes: 1 << 28,
            fingerprint: [3; 16],
            have: vec![BlobId::base(1)],
            ..Hello::new("s")
        }),
        ClientMessage::Want(wants().map(|id| Want::whole(id, 9)).into()),
        ClientMessage::Want(vec![
            Want { id: BlobId::chunk(0, 3), priority: 8, offset: 0, end: Some(700) },
            Want { id: BlobId::chunk(0, 4), priority: 7, offset: 700, end: None },
        ]),
        ClientMessage::Cancel(wants().into()),
        ClientMessage::SetView(view),
        ClientMessage::WantScenePages(vec![0, 1, 300]),
        ClientMessage::Ping(77),
        ClientMessage::Bye,
        ClientMessage::Token(Token("head.claims.signature".into())),
    ];
    let camera = Camera { eye: [0.0, 1.0, 5.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 1.0 };
    let scene = SceneHeader {
        name: "scene".into(),
        fingerprint: [9; 16],
        asset_count: 1,
        instance_count: 2,
        page_count: 1,
        light: SceneLighting { direction: [0.0, -1.0, 0.0], color: [1.0; 3], ambient: [0.1; 3] },
        background: [0.5; 3],
        terrain: None,
        camera,
    };
    let turned = Instance {
        asset: 0,
        placement: Placement { rotation: [0.0, 0.6, 0.0, 0.8], scale: 2.0, ..Placement::at([1e9, 0.1, 0.0]) },
    };
    let page = ScenePage {
        assets: vec![
            AssetEntry { name: "a".into(), chunk_count: 9, ..AssetEntry::default() },
            AssetEntry {
                shared: vec![SharedTexture { texture: 2, asset: 0, of: 1 }],
                ..AssetEntry::default()
            },
        ],
        instances: vec![Instance::at(0, [1.0, 0.0, 0.0]), turned],
        ..ScenePage::default()
    };
    let server = [
        ServerMessage::Welcome(Welcome {
            version: 2,
            session: 5,
            rate_bits_per_s: 1 << 21,
            idle_timeout_ms: 20_000,
            scene,
        }),
        ServerMessage::ScenePage(page),
        ServerMessage::BasesSent,
        ServerMessage::Done,
        ServerMessage::Pong(77),
        ServerMessage::Close(Close::new(CloseCode::ALL[0], "reason")),
        ServerMessage::PunctualLights(PunctualLights {
            count: 1,
            first: encode_page(&some_punctual_lights()[..1]).expect("a page is encoded"),
        }),
        ServerMessage::PunctualLights(PunctualLights { count: 5000, first: Vec::new() }),
        ServerMessage::Parts(PartTable { records: 700 }),
    ];
    let mut seeds = Vec::new();
    let mut stream = vec![2];
    for (i, message) in client.iter().enumerate() {
        let frame = encode_client(message).expect("a message is encoded");
        stream.extend(&frame);
        seeds.push(seed(format!("client-{i}"), [&[0], &frame[..]].concat()));
    }
    seeds.push(seed("stream", stream));
    for (i, message) in server.iter().enumerate() {
        let frame = encode_server(message).expect("a message is encoded");
        seeds.push(seed(format!("server-{i}"), [&[1], &frame[..]].concat()));
    }
    let piece =
        BlobPiece { id: BlobId::chunk(1, 2), offset: 3, end: 18, total: 20, bytes: b"blob"[..].into() };
    let piece = encode_piece(&piece).expect("a piece is encoded");
    seeds.push(seed("piece", [&[1], &piece[..]].concat()));
    for (name, offset, end) in [("blob", 0, 9), ("beginning", 0, 4), ("rest", 4, 9)] {
        let run = BlobPiece { id: BlobId::chunk(1, 2), offset, end, total: 9, bytes: b""[..].into() };
        let head = blob_head(&run).expect("a head is encoded");
        seeds.push(seed(name, [&[3], &head[1..], &b"some blob"[offset as usize..end as usize]].concat()));
    }
    let description = AssetDescription {
        name: "asset".into(),
        materials: vec![Material::default(), Material { name: "m".into(), ..Material::default() }],
        textures: Vec::new(),
    };
    let description = description.encode().expect("a description is encoded");
    seeds.push(seed("description", [&[4], &description[..]].concat()));
    let texture = |kind| TextureInfo {
        kind,
        width: 8,
        height: 8,
        mean: None,
        levels: vec![TextureLevel { width: 8, height: 8, bytes: 99, format: TextureFormat::Jpeg }],
    };
    let full = Material {
        metallic: 0.5,
        emission: [1.0, 2.0, 3.0],
        alpha: Alpha::Mask(0.25),
        unlit: true,
        wrap: [Wrap::Clamp, Wrap::Mirror],
        base_color_texture: Some(0),
        surface_texture: Some(1),
        normal_texture: Some(2),
        normal_scale: 0.5,
        emission_texture: Some(0),
        height_texture: Some(3),
        relief_depth: 0.125,
        ..Material::default()
    };
    let kinds = [TextureKind::Color, TextureKind::Surface, TextureKind::Normal, TextureKind::Height];
    let description = AssetDescription {
        materials: vec![full, Material { alpha: Alpha::Blend, ..Material::default() }],
        textures: kinds.map(texture).into(),
        ..AssetDescription::default()
    };
    let description = description.encode().expect("a description is encoded");
    seeds.push(seed("materials", [&[4], &description[..]].concat()));
    seeds
}

/// A point light, a spot light, and others with equal parameters.
fn some_punctual_lights() -> Vec<PunctualLight> {
    let bulb =
        PunctualLight { position: [1.0, 2.0, -3.5], intensity: [40.0, 20.0, 0.0], range: 12.0, spot: None };
    let cone = Spot { direction: [0.0, -0.8, 0.6], inner: 0.25, outer: 0.75 };
    let spot = PunctualLight { position: [5.0, 2.0, -3.5], spot: Some(cone), ..bulb };
    let far = PunctualLight { position: [1e9, -7.25, 0.0], intensity: [1e6; 3], range: 0.5, spot: None };
    vec![
        bulb,
        spot,
        PunctualLight { position: [9.0, 2.0, 0.0], ..spot },
        far,
        PunctualLight { range: 12.0, ..far },
    ]
}

fn punctual_lights() -> Vec<(String, Vec<u8>)> {
    let some = some_punctual_lights();
    let page = |punctual_lights: &[PunctualLight]| encode_page(punctual_lights).expect("a page is encoded");
    let listed = |punctual_lights: &[PunctualLight]| {
        PunctualLightPageEntry::of(punctual_lights, page(punctual_lights).len() as u32)
    };
    let street: Vec<PunctualLight> = (0..64)
        .map(|n| PunctualLight {
            position: [5.0 * f64::from(n), 6.0, f64::from(n % 2) * 8.0],
            ..some[n as usize % 3]
        })
        .collect();
    let directory = |count: usize| {
        let entries: Vec<PunctualLightPageEntry> =
            (0..count).map(|n| listed(&street[..1 + n % 64])).collect();
        encode_directory(&entries).expect("a directory is encoded")
    };
    let with = |kind: u8, count: u8, bytes: Vec<u8>| [&[kind, count], &bytes[..]].concat();
    vec![
        seed("bulb", with(0, 1, page(&some[..1]))),
        seed("all-kinds", with(0, 5, page(&some))),
        seed("street", with(0, 64, page(&street))),
        seed("directory", with(1, 9, directory(9))),
        seed("few", with(2, 5, page(&some))),
        seed("few-pages", with(2, 200, directory(4))),
    ]
}

fn parts() -> Vec<(String, Vec<u8>)> {
    let called = |n: u32| PartInfo {
        name: format!("door {n}"),
        path: format!("site/building {}/floor {}", n / 9, n % 3),
        extras: n.is_multiple_of(2).then(|| format!("{{\"number\":{n}}}")),
    };
    let page = |count: u32| {
        let records: Vec<PartInfo> = (0..count).map(called).collect();
        parts::encode_page(&records).expect("a page is encoded")
    };
    let directory =
        |ranges: &[std::ops::Range<u32>]| parts::encode_directory(ranges).expect("a directory is encoded");
    let with = |kind: u8, count: u32, bytes: Vec<u8>| [&[kind, (count - 1) as u8], &bytes[..]].concat();
    // Names as long as they may be, the second like the first.
    let longest = PartInfo {
        name: "n".repeat(parts::MAX_NAME_BYTES),
        path: "p".repeat(parts::MAX_PATH_BYTES),
        extras: Some(format!("\"{}\"", "e".repeat(parts::MAX_EXTRAS_BYTES - 2))),
    };
    let long = parts::encode_page(&[longest.clone(), longest]).expect("a page is encoded");
    // Instances of three models in turn.
    let many: Vec<_> = (0..200).map(|n| [0..1, 1..8, 8..9][n % 3].clone()).collect();
    vec![
        seed("one", with(0, 1, page(1))),
        seed("some", with(0, 20, page(20))),
        seed("whole-page", with(0, 256, page(256))),
        seed("long", with(0, 2, long)),
        seed("directory", with(1, 4, directory(&[0..300, 300..301, 300..301, 301..302]))),
        seed("many-instances", with(1, 200, directory(&many))),
    ]
}

fn published_chunk(n: u32) -> ChunkInfo {
    let point = TruncationPoint { payload_bytes: 20, error: 0.5, vertices: 1, wedges: 1, faces: 1 };
    ChunkInfo {
        level: 1,
        sphere: Sphere { center: [0.0; 3], radius: 1.0 },
        error: 1.0,
        attribute_error: 0.0,
        truncation_points: if n.is_multiple_of(2) { vec![point] } else { Vec::new() },
        parents: Vec::new(),
        payload_bytes: 40 + n,
        vertices: 2,
        wedges: 2,
        faces: 2,
    }
}

/// What a published scene holds of a pack with chunks and textures.
fn published_pack(asset: &AssetEntry) -> PackContents {
    let infos: Vec<ChunkInfo> = (0..asset.chunk_count).map(published_chunk).collect();
    let place = |info: &ChunkInfo| ChunkPlace::of(info).hashed(&vec![5; info.payload_bytes as usize]);
    let chunks = infos.iter().map(|info| place(info).expect("the length is the index's"));
    let chunks = ChunkTable { offset: 300, chunks: chunks.collect() };
    let texture = |level: u8| {
        let bytes = vec![level; 9];
        let place = TexturePlace { texture: 0, level, bytes: 9, hash: part_hash(&bytes) };
        Texture { place, copy: (level == 0).then(|| bytes.into()) }
    };
    PackContents {
        key: [asset.fingerprint[0]; 32],
        bytes: 4096,
        base: vec![3; asset.base_bytes as usize].into(),
        index: vec![IndexPage {
            bytes: index::encode_page(&infos, 0).expect("chunks are indexed").into(),
            chunks,
        }],
        textures_offset: 2000,
        textures: vec![texture(0), texture(1)],
    }
}

/// Scenes with the directories of made-up packs.
fn published() -> Vec<(String, Vec<u8>)> {
    let assets = "[[asset]]\nname = 'a'\nfile = 'a.obj'\n[[asset]]\nname = 'b'\nfile = 'b.obj'\n";
    let places = |count: usize| -> String {
        let place = |n: usize| {
            format!("[[instance]]\nasset = '{}'\ntranslation = [{n}, 0, 0.5]\n", ["a", "b"][n % 2])
        };
        (0..count).map(place).collect()
    };
    let punctual_lights =
        |count: usize| "[[punctual_light]]\nposition = [0, 2, 0]\nintensity = 40\n".repeat(count);
    let object = |text: String| {
        let scene = scene::parse(Path::new("scene.toml"), &text).expect("the text is a scene");
        let entry = |(n, asset): (u8, &scene::Asset)| AssetEntry {
            name: asset.name.clone(),
            fingerprint: [n; 16],
            sphere: Sphere { center: [0.0; 3], radius: 1.0 },
            root_error: 0.1,
            base_bytes: 100,
            chunk_count: 3,
            ..AssetEntry::default()
        };
        let entries: Vec<_> = (1..).zip(&scene.assets).map(entry).collect();
        let description = compose(&scene, &entries, &[Vec::new(), Vec::new()]).expect("it can be described");
        let assets = description.pages.iter().flat_map(|page| &page.assets);
        let packs = assets.map(published_pack).collect();
        SceneObject { description, packs }.encode().expect("a scene is encoded")
    };
    vec![
        seed("one", object(format!("{assets}{}", places(1)))),
        seed("two", object(format!("{assets}{}", places(2)))),
        seed("pages", object(format!("{assets}{}", places(150)))),
        seed("punctual_lights", object(format!("{assets}{}{}", places(2), punctual_lights(3)))),
        seed("streets", object(format!("{assets}{}{}", places(1), punctual_lights(300)))),
        seed(
            "ground",
            object(format!(
                "{assets}{}[terrain]\nseed = 7\npatch_cells = 64\npatches = 4\namplitude = 30\n",
                places(2)
            )),
        ),
    ]
}

fn terrain() -> Vec<(String, Vec<u8>)> {
    let erosion = Erosion { level: 7, passes: 5, talus: 300, spike_limit: 8 };
    let eroded =
        Parameters { seed: 5, erosion, distribution: Distribution::Gaussian, ..Parameters::default() };
    let parameters = [("parameters", Parameters::default()), ("eroded", eroded)]
        .map(|(name, parameters)| seed(name, [&[0], &parameters.encode()[..]].concat()));
    let line = vec![[-5, 0], [3000, 70], [2000, 900]];
    let shapes = [
        Shape::Ridge { from: [0, 1], to: [100, -50], half_width: 20, height: 900 },
        Shape::Valley { from: [1 << 31, 0], to: [(1 << 31) - 9, 9], half_width: 1, depth: 7000 },
        Shape::Crater { centre: [60, -60], radius: 50, depth: i32::MAX, rim: i32::MIN },
        Shape::Plateau { centre: [-99, 0], radius: 300, falloff: 0, height: 12 },
        Shape::RiverBed { line, half_width: 1 << 20, depth: 3 },
    ];
    let stamp = |(i, shape)| Stamp { mode: if i % 2 == 0 { Mode::Fixed } else { Mode::Additive }, shape };
    let stamps =
        encode_stamps(&(0..).zip(shapes).map(stamp).collect::<Vec<_>>()).expect("stamps are encoded");
    let list = |name: &str, level: u8, points: &mut dyn Iterator<Item = (u16, u16, i32, bool)>| {
        let point = |(x, y, height, fixed)| HeightOverride {
            x,
            y,
            mode: if fixed { Mode::Fixed } else { Mode::Additive },
            height,
        };
        let points =
            HeightOverrides::new(level, points.map(point).collect()).expect("points are in the patch");
        let bytes = encode_points(level, &points).expect("points are encoded");
        seed(name, [&[2, level - 1], &bytes[..]].concat())
    };
    let lists = [
        list("none", 1, &mut std::iter::empty()),
        list("one", 12, &mut std::iter::once((4096, 0, i32::MIN, true))),
        list(
            "band",
            6,
            &mut (0..65).flat_map(|y| (y / 2..y / 2 + 9).map(move |x| (x, y, i32::from(x * y), false))),
        ),
        list("scattered", 12, &mut (0..40).map(|i| (i * 101, i * i * 2, i32::from(i) << 20, i % 3 == 0))),
        list("lattice", 10, &mut (0..100).map(|i| (i % 10 * 100, i / 10 * 64, -25 * i32::from(i % 7), true))),
    ];
    let mut seeds = vec![seed("stamps", [&[1], &stamps[..]].concat())];
    seeds.extend(parameters);
    seeds.extend(lists);
    seeds
}
