//! Recorded scenes: one tetrahedron, which docs/protocol.md shows byte by byte, and a scene that uses every feature of
//! the wire format.

use std::fmt::Write as _;

use lodestream_bake::scene::of_files;
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_protocol::source::SceneSource;
use lodestream_scene::{BlobId, View};

use crate::animations::write_crane;
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::{ball, write_wall};

const TETRAHEDRON: &str = "v -0.137 0.061 0.218\nv 0.913 0.149 0.007\nv 0.083 1.031 -0.192\nv 0.271 0.114 0.857\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

fn open(text: &str, write: impl FnOnce(&std::path::Path)) -> TestScene {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("tetrahedron.obj"), TETRAHEDRON).unwrap();
    write(folder.path());
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).unwrap();
    let scene = of_files(&[path]).unwrap();
    TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")))
}

const ONE: &str = r#"name = "one"
[[asset]]
name = "tetrahedron"
file = "tetrahedron.obj"
[[instance]]
asset = "tetrahedron"
[camera]
eye = [2.0, 2.0, 4.0]
target = [0.25, 0.25, 0.25]
"#;

/// One tetrahedron in front of the camera.
pub(super) fn tetrahedron() -> TestScene {
    open(ONE, |_| {})
}

/// The same with some punctual lights.
pub(super) fn lit(punctual_lights: u32) -> TestScene {
    let mut text = ONE.to_owned();
    for n in 0..punctual_lights {
        let spot = if n % 3 == 0 { "direction = [1.0, -1.0, 0.5]\n" } else { "" };
        write!(text, "[[punctual_light]]\nposition = [{n}.5, 2.0, -{n}]\nintensity = 25.0\n{spot}").unwrap();
    }
    open(&text, |_| {})
}

/// A model with the wall's material, its texture projected along z. Unlike the wall's, its base mesh is not compressed
/// with zstd, so the reader can decode it.
fn textured(obj: &str) -> String {
    let mut out = String::from("mtllib wall.mtl\nusemtl brick\n");
    for line in obj.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let at: Vec<f64> = words.map(|word| word.parse().unwrap()).collect();
                writeln!(out, "{line}\nvt {:.6} {:.6}", 0.5 + 0.3 * at[0], 0.5 + 0.3 * at[1]).unwrap();
            }
            _ => writeln!(out, "f {}", words.map(|v| format!("{v}/{v} ")).collect::<String>()).unwrap(),
        }
    }
    out
}

/// Every kind of asset, instance and stamp, on two scene pages.
pub(super) fn gallery() -> TestScene {
    let mut text = String::from(
        r#"name = "gallery, größer"
[light]
direction = [0.5, 0.7, 0.5]
[ambient]
color = [0.1, 0.2, 0.3]
[background]
color = [0.25, 0.5, 0.75]
[[asset]]
name = "ball"
file = "ball.obj"
relief_depth = 0.03
codec = "axis-aligned"
[[asset]]
name = "wall"
file = "wall.obj"
relief_depth = 0.02
[[asset]]
name = "tetrahedron"
file = "tetrahedron.obj"
position_bits = 9
[[asset]]
name = "crane"
file = "crane.gltf"
[[instance]]
asset = "crane"
translation = [-3.5, 0.0, 1.0]
[[instance]]
asset = "ball"
translation = [0.1, 3.0, -2.0]
scale = 0.6
[[instance]]
asset = "wall"
translation = [1.25, 2.0, 0.5]
rotation = [0.0, 0.6, 0.0, 0.8]
[camera]
eye = [8.0, 6.0, 12.0]
target = [0.0, 1.0, 0.0]
fov_y_degrees = 50.0
[terrain]
seed = 12345678901234567
patch_cells = 64
patches = 64
amplitude = 12.0
base = -3.5
erosion = { level = 3, passes = 4, talus_degrees = 35 }
water = { level = -5.25, clarity = 0.75 }
features = "points.json"
[[terrain.stamp]]
kind = "ridge"
from = [-200, -150]
to = [200, -190]
half_width = 60
height = 40
[[terrain.stamp]]
kind = "valley"
mode = "fixed"
from = [-300, 500]
to = [300, 520]
half_width = 70
depth = 9
[[terrain.stamp]]
kind = "crater"
centre = [700, -700]
radius = 90
depth = 12
rim = 3
[[terrain.stamp]]
kind = "plateau"
mode = "fixed"
centre = [-700, -700]
radius = 90
falloff = 30
height = 14
[[terrain.stamp]]
kind = "river bed"
line = [[-900, 0], [-800, 40], [-700, 10]]
half_width = 8
depth = 2
"#,
    );
    for n in 0..70 {
        let turned = if n % 2 == 0 { "rotation = [0.5, 0.5, 0.5, 0.5]\n" } else { "" };
        write!(text, "[[instance]]\nasset = \"tetrahedron\"\ntranslation = [{n}.5, 0.0, -4.0]\n{turned}")
            .unwrap();
    }
    // More than their message holds, of every kind, and with each combination of shared values.
    for n in 0..1100 {
        let color = if n % 7 < 3 { "color = [1.0, 0.5, 0.0]\n" } else { "" };
        let range = if n % 5 < 2 { "range = 7.5\n" } else { "" };
        let spot = match n % 11 {
            0..4 => "direction = [0.3, -1.0, 0.2]\nouter_degrees = 30\n",
            4 => "direction = [0.0, 0.0, 1.0]\ninner_degrees = 12.5\n",
            _ => "",
        };
        let (x, z) = (3 * (n % 33) - 50, 2 * (n / 33) - 30);
        write!(
            text,
            "[[punctual_light]]\nposition = [{x}.25, 4.0, {z}]\nintensity = 40.0\n{color}{range}{spot}"
        )
        .unwrap();
    }
    let mut points = Vec::new();
    for y in -9..=9_i32 {
        points.extend((-9..=9_i32).map(|x| format!("[{x}, {y}, {}]", 10 * (x * x + y * y))));
    }
    let features = format!("{{\"mode\": \"fixed\", \"points\": [{}]}}", points.join(","));
    open(&text, |folder| {
        write_wall(folder);
        write_crane(folder);
        std::fs::write(folder.join("ball.obj"), textured(&ball(30, 40))).unwrap();
        std::fs::write(folder.join("points.json"), features).unwrap();
    })
}

/// Every message that a client can send, in groups that wait for each other's answers.
pub(super) fn conversation(scene: &TestScene) -> Vec<Vec<ClientMessage>> {
    let view = View::look_at([7.0, 5.5, 11.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], 0.9, [1920, 1080]);
    let hello = Hello {
        view: Some(view),
        max_blob_bytes: 1 << 20,
        budget_bytes: 1 << 33,
        fingerprint: [7; 16],
        have: vec![BlobId::base(300), BlobId::texture(1, 0, 2)],
        ..Hello::new(scene.store.header().name.clone())
    };
    let (ball, wall) = (scene.asset("ball"), scene.asset("wall"));
    let stop = scene.assets[ball as usize].infos[0].extent(Some(0)).payload_bytes;
    let points = [
        BlobId::terrain_page(0),
        BlobId::height_overrides(1),
        BlobId::punctual_light_directory(0),
        BlobId::punctual_light_page(0),
        BlobId::punctual_light_page(17),
        BlobId::part_directory(0),
        BlobId::part_page(0),
        BlobId::Animation(0),
    ];
    let again = [BlobId::base(wall), BlobId::index_page(ball, 0), BlobId::chunk(ball, 0)];
    let part = |offset, end| Want { offset, end, ..Want::whole(BlobId::chunk(ball, 0), 0x4180_0000) };
    let whole = |id| Want::whole(id, 77);
    vec![
        vec![ClientMessage::Hello(hello)],
        vec![
            ClientMessage::Ping(0xdead_beef),
            ClientMessage::SetView(View { target_px: 0.5, ..view }),
            ClientMessage::Cancel([&points[..], &again].concat()),
            ClientMessage::Want([&points[..], &again[..2]].concat().into_iter().map(whole).collect()),
            ClientMessage::Want(vec![part(0, Some(stop)), whole(BlobId::chunk(ball, 70_000))]),
            ClientMessage::Want((0..2).map(|texture| whole(BlobId::texture(wall, texture, 1))).collect()),
            ClientMessage::WantScenePages(vec![1, 0]),
        ],
        vec![ClientMessage::Want(vec![part(stop, None)]), ClientMessage::Want(vec![part(9, Some(9))])],
        vec![ClientMessage::Want([80_000, 80_001].map(|chunk| whole(BlobId::chunk(ball, chunk))).into())],
        vec![ClientMessage::Bye],
    ]
}
