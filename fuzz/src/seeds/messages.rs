//! Messages, pieces of blobs and descriptions of assets.

use lodestream_protocol::frame::{BlobPiece, encode_client, encode_piece, encode_server};
use lodestream_protocol::message::{
    ClientMessage, Close, CloseCode, Hello, ServerMessage, Token, Want, Welcome,
};
use lodestream_protocol::stream::blob_head;
use lodestream_scene::animation::AnimationTable;
use lodestream_scene::asset::{
    Alpha, AssetDescription, ClearCoat, Material, NORMAL_PLANES, Specular, TextureFormat, TextureInfo,
    TextureKind, TextureLevel, Wrap,
};
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::{AssetEntry, Camera, Instance, SceneHeader, SceneLighting, ScenePage};
use lodestream_scene::parts::PartTable;
use lodestream_scene::placement::Placement;
use lodestream_scene::proxy::Proxy;
use lodestream_scene::punctual_lights::{PunctualLights, encode_page};
use lodestream_scene::shared::SharedTexture;
use lodestream_scene::view::View;

use super::scenes::some_punctual_lights;
use super::seed::seed;

pub(super) fn messages() -> Vec<(String, Vec<u8>)> {
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
        root_slope: 0.02,
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
        proxies: vec![
            Proxy { asset: 1, instance_count: 2, child_count: 1, error: 0.5, ..Proxy::default() },
            Proxy { asset: 0, parent: 1, first_instance: 1, instance_count: 1, ..Proxy::default() },
        ],
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
        ServerMessage::Animations(AnimationTable { models: 2 }),
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
        planes: match kind {
            TextureKind::Normal => NORMAL_PLANES,
            TextureKind::Surface => 7,
            TextureKind::Color | TextureKind::Height => 0,
        },
        mean: None,
        uv_per_unit: 1.0,
        levels: vec![TextureLevel { width: 8, height: 8, bytes: 99, format: TextureFormat::WebP }],
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
    let layered = Material {
        alpha: Alpha::Blend,
        specular: Specular { f0: [0.5, 0.25, 0.125], f90: 0.5 },
        clear_coat: ClearCoat { factor: 1.0, roughness: 0.25 },
        transmission: 0.75,
        ..Material::default()
    };
    let kinds = [TextureKind::Color, TextureKind::Surface, TextureKind::Normal, TextureKind::Height];
    let description = AssetDescription {
        materials: vec![full, Material { alpha: Alpha::Blend, ..Material::default() }, layered],
        textures: kinds.map(texture).into(),
        ..AssetDescription::default()
    };
    let description = description.encode().expect("a description is encoded");
    seeds.push(seed("materials", [&[4], &description[..]].concat()));
    seeds
}
