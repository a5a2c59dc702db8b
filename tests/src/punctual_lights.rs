//! Punctual lights arrive with their scene, light its picture, and do not delay the first frame.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use lodestream_bake::scene::of_files;
use lodestream_client::core::{Change, ClientCore, Milestone, Progress};
use lodestream_client::net::{Clock, Host, WebSocketConnection, run_quic, run_websocket};
use lodestream_daemon::{ServerState, SessionSettings};
use lodestream_netsim::clock::virtual_runtime;
use lodestream_protocol::Time;
use lodestream_protocol::source::SceneSource as _;
use serde_json::json;

use crate::support::daemon::{Server, Transport};
use crate::support::picture::{comparison, draw, headless, keep, same};
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::write_scene;
use crate::support::viewer::{Viewer, config};
use crate::support::virtual_link::{QuicLink, SERVER, tcp_connect};

/// Most bytes that punctual lights may add to a first frame: the message with at most 16 lights or 16 pages' spheres,
/// and the part of the first pages in flight when the last base mesh has arrived.
const MORE_BYTES: u64 = 2_500;
const RATE_BITS_PER_S: u64 = 2_000_000;
const RTT_MS: u64 = 50;

/// The small scene at night with some punctual lights, in a folder of its own.
fn night(folder: &Path, punctual_lights: u32) -> TestScene {
    let path = write_scene(folder);
    let day = std::fs::read_to_string(&path).unwrap();
    let mut text = day.replacen("color = [0.6, 0.58, 0.52]", "intensity = 0.0", 1);
    text = text.replacen("color = [0.08, 0.08, 0.08]", "color = [0.002, 0.002, 0.004]", 1);
    assert_ne!(text, day);
    text.push_str("\n[background]\ncolor = [0.002, 0.003, 0.006]\n");
    // Around the ball, from near to far beyond the ground.
    for n in 0..punctual_lights {
        let (angle, distance) = (2.4 * f64::from(n), 0.4 + 0.25 * f64::from(n).sqrt());
        let (sin, cos) = angle.sin_cos();
        let color = ["[1.0, 0.7, 0.4]", "[0.5, 0.7, 1.0]", "[1.0, 1.0, 1.0]"][n as usize % 3];
        write!(
            text,
            "[[punctual_light]]\nposition = [{:.3}, 0.7, {:.3}]\ncolor = {color}\nintensity = 0.8\nrange = 3.0\n",
            distance * cos,
            distance * sin
        )
        .unwrap();
    }
    std::fs::write(&path, text).unwrap();
    let scene = of_files(&[path]).unwrap();
    assert_eq!(scene.punctual_lights.len(), punctual_lights as usize);
    TestScene::open(&scene, prepare_all(&scene, &folder.join("cache")))
}

/// Checks punctual lights from scene file to picture, for few lights sent with the scene and many in pages: a settled
/// client shows the same as the local scene with all lights, and they do change the picture.
#[test]
fn a_night_scene_is_lit_by_its_punctual_lights() {
    let Some(mut headless) = headless() else { return };
    let folder = tempfile::tempdir().unwrap();
    for (count, transport) in [(12, Transport::Quic), (400, Transport::WebSocket)] {
        let scene = night(folder.path(), count);
        let server = Server::start(scene.source(), SessionSettings::default());
        let whole = draw(&mut headless, scene.whole());
        keep(&whole, &format!("night-{count}-whole"));
        // With the same exposure, since punctual lights are announced.
        let without =
            scene.whole().into_iter().filter(|change| !matches!(change, Change::PunctualLightPage { .. }));
        let dark = draw(&mut headless, without.collect());
        let mut viewer = Viewer::start(&server.address(transport), config());
        let status = viewer.settle();
        assert_eq!((status.stats.decode_failures, status.stats.refused), (0, 0), "{:?}", status.stats);
        let settled = draw(&mut headless, viewer.changes);
        keep(&settled, &format!("night-{count}"));
        let found = comparison(&settled, &whole);
        println!("{count} punctual lights: {found:?}");
        assert!(same(&found), "{count} punctual lights: {found:?}");
        let light = |picture: &image::RgbaImage| {
            picture.pixels().map(|pixel| u64::from(pixel.0[0]) + u64::from(pixel.0[1])).sum::<u64>()
        };
        let (lit, unlit) = (light(&settled.image), light(&dark.image));
        assert!(lit > 2 * unlit, "{count} punctual lights make {lit} of {unlit}");
        assert!(!same(&comparison(&settled, &dark)), "{count} punctual lights change nothing");
        server.assert_healthy();
    }
}

/// A client that leaves once its picture has settled.
struct UntilSettled {
    core: ClientCore,
    /// Punctual lights received before the first frame.
    early: usize,
    /// Number of lights received, and the time of the last.
    lit: (usize, Time),
}

impl Host for UntilSettled {
    fn core(&mut self) -> &mut ClientCore {
        &mut self.core
    }

    fn turn(&mut self, now: Time) -> Progress {
        let progress = self.core.update(now, u64::MAX);
        let here = self.core.punctual_lights().count();
        if self.core.milestones().first_frame.is_none() {
            self.early = here;
        }
        if here > self.lit.0 {
            self.lit = (here, now);
        }
        progress
    }

    fn wants_to_leave(&self) -> bool {
        self.core.is_settled()
    }
}

/// Time of the first frame, number of punctual lights when settled, and time of the last.
fn run(scene: &TestScene, transport: Transport) -> (Milestone, usize, Duration) {
    let state = ServerState::new(scene.source(), SessionSettings::default());
    virtual_runtime().unwrap().block_on(async {
        let clock = Clock::start();
        let (mut core, began) = (ClientCore::new(config()), clock.now());
        core.begin(began);
        let mut host = UntilSettled { core, early: 0, lit: (0, began) };
        match transport {
            Transport::Quic => {
                let link = QuicLink::new(state, RATE_BITS_PER_S, RTT_MS);
                run_quic(link.connect().await, &mut host, clock).await;
            }
            Transport::WebSocket => {
                let (stream, _) = tcp_connect(state, RATE_BITS_PER_S, RTT_MS).await;
                let opened =
                    WebSocketConnection::open(stream, &SERVER.to_string(), Duration::from_secs(9)).await;
                run_websocket(opened.unwrap(), &mut host, clock).await;
            }
        }
        // With many lights none is needed for the first frame, so none should arrive before it.
        assert!(
            host.early == 0 || host.core.punctual_light_count() <= 16,
            "{} punctual lights came first",
            host.early
        );
        let (punctual_lights, at) = host.lit;
        (host.core.milestones().first_frame.unwrap(), punctual_lights, at.since(began))
    })
}

/// Checks that 400 and 4,000 punctual lights add only a few hundred bytes to the first frame, and their transfer time.
#[test]
fn the_first_frame_does_not_wait_for_punctual_lights() {
    let folder = tempfile::tempdir().unwrap();
    let dark = night(folder.path(), 0);
    for transport in Transport::BOTH {
        let (bare, none, _) = run(&dark, transport);
        assert_eq!(none, 0);
        for count in [16, 400, 4000] {
            let scene = night(folder.path(), count);
            let (first, punctual_lights, lit) = run(&scene, transport);
            println!(
                "{transport:?}, {count} punctual lights: {first:?}, without {bare:?}; {punctual_lights} came until {lit:?}"
            );
            assert!(
                punctual_lights >= usize::try_from(count.min(64)).unwrap(),
                "{punctual_lights} of {count} came"
            );
            let more = first.bytes.saturating_sub(bare.bytes);
            assert!(more <= MORE_BYTES, "{transport:?}: {count} punctual lights: {more} bytes more");
            let transfer = Duration::from_secs_f64(MORE_BYTES as f64 * 8.0 * 1.15 / RATE_BITS_PER_S as f64);
            assert!(
                first.after <= bare.after + transfer,
                "{transport:?}: {count} punctual lights: {first:?} {bare:?}"
            );
        }
    }
}

/// Checks that a served model's own lights exist, wherever the scene places it.
#[test]
fn a_served_gltf_shows_its_light() {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> =
        [0f32, 0., 0., 1., 0., 0., 0., 0., -1.].iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.path().join("punctual_light.bin"), bytes).unwrap();
    let gltf = json!({
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensionsRequired": ["KHR_lights_punctual"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 4, "range": 9}]}},
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"mesh": 0},
            {"translation": [0, 2, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": "punctual_light.bin"}],
    });
    let model = folder.path().join("punctual_light.gltf");
    std::fs::write(&model, gltf.to_string()).unwrap();
    let text = "[[asset]]\nname = 'punctual_light'\nfile = 'punctual_light.gltf'\nmerge = true\n\
        [[instance]]\nasset = 'punctual_light'\n\
        [[instance]]\nasset = 'punctual_light'\ntranslation = [10, 0, 0]\nscale = 3\n";
    let placed = folder.path().join("scene.toml");
    std::fs::write(&placed, text).unwrap();
    for (file, expected) in
        [(&model, vec![[0.0, 2.0, 0.0]]), (&placed, vec![[0.0, 2.0, 0.0], [10.0, 6.0, 0.0]])]
    {
        let scene = of_files(std::slice::from_ref(file)).unwrap();
        let scene = TestScene::open(&scene, prepare_all(&scene, &folder.path().join("cache")));
        let (_, count, _) = run(&scene, Transport::Quic);
        assert_eq!(count, expected.len());
        let punctual_lights = scene.punctual_lights();
        for (punctual_light, place) in punctual_lights.iter().zip(expected) {
            assert_eq!(
                (punctual_light.position, punctual_light.range, punctual_light.intensity),
                (place, 9.0, [4.0; 3])
            );
        }
        assert!(scene.store.punctual_lights().is_some());
    }
}
