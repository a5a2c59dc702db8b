//! Wrong input by users, and packs damaged on disk. The command lines themselves are tested beside the programs.

use std::fs::OpenOptions;
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::Path;
use std::time::Duration;

use data_encoding::BASE64;
use lodestream_bake::scene::of_files;
use lodestream_daemon::SessionSettings;
use lodestream_protocol::source::{SceneSource as _, SourceError};
use lodestream_scene::BlobId;
use serde_json::json;

use crate::support::daemon::{Server, Transport};
use crate::support::program::Program;
use crate::support::scene::{TestScene, prepare_all};
use crate::support::shapes::ball;
use crate::support::viewer::{Viewer, config};

/// Checks that a server with another certificate than the address names is refused, with the remedy in the message.
#[test]
fn a_wrong_fingerprint_is_reported_in_one_line() {
    let server = Server::start(TestScene::small().source(), SessionSettings::default());
    let good = server.url(Transport::Quic);
    let (rest, last) = good.split_at(good.len() - 1);
    let other = if last == "0" { "1" } else { "0" };
    let mut viewer = Viewer::start(&format!("{rest}{other}").parse().unwrap(), config());
    let end = viewer.end(Duration::from_secs(50));
    assert!(end.contains("certificate") && end.contains("#spki-sha256="), "{end}");
    assert_eq!(end.lines().count(), 1, "{end}");
    server.assert_healthy();
}

fn overwrite(pack: &Path, at: usize, bytes: &[u8]) {
    let mut file = OpenOptions::new().write(true).open(pack).unwrap();
    file.seek(SeekFrom::Start(at as u64)).unwrap();
    file.write_all(bytes).unwrap();
}

/// Checks that a chunk damaged on disk under a running server is refused while everything else is served, and that the
/// client gets the chunk once the file is restored.
#[test]
fn a_chunk_damaged_on_disk_is_refused_until_it_is_restored() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("ball.obj");
    std::fs::write(&model, ball(30, 40)).unwrap();
    let scene = of_files(&[model]).unwrap();
    let cache = folder.path().join("cache");
    let opened = TestScene::open(&scene, prepare_all(&scene, &cache));
    let pack = std::fs::read_dir(&cache).unwrap().next().unwrap().unwrap().path();

    // In the middle of the first chunk, on which others depend.
    let (chunk, whole) = (&opened.assets[0].chunks[0], std::fs::read(&pack).unwrap());
    let start = whole.windows(chunk.len()).position(|window| window == chunk).unwrap();
    let at = start + chunk.len() / 2;
    overwrite(&pack, at, &[whole[at] ^ 1]);
    let read = opened.store.read(&BlobId::chunk(0, 0));
    assert!(matches!(read, Err(SourceError::Unreadable { .. })), "{read:?}");

    let server = Server::start(opened.source(), SessionSettings::default());
    let mut viewer = Viewer::start(&server.address(Transport::WebSocket), config());
    let status = viewer.wait("a refusal", |s| s.stats.refused > 0 && s.stats.faces > 0);
    assert_eq!(status.stats.decode_failures, 0, "{:?}", status.stats);
    assert!(status.stats.milestones.first_frame.is_some());
    server.assert_healthy();

    overwrite(&pack, at, &whole[at..=at]);
    let stats = viewer.settle().stats;
    assert!(stats.applied_chunks > 0 && stats.connections == 1, "{stats:?}");
    server.assert_healthy();
}

/// A PNG file of a few bytes that states a size.
fn png(width: u32, height: u32) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let header = [&width.to_be_bytes()[..], &height.to_be_bytes(), &[8, 2, 0, 0, 0]].concat();
    for (name, data) in [(b"IHDR", header), (b"IDAT", vec![0x78, 1, 3, 0, 0, 0, 0, 1]), (b"IEND", Vec::new())]
    {
        file.extend((data.len() as u32).to_be_bytes());
        let named = [&name[..], &data].concat();
        // CRC-32, as PNG has it (ISO/IEC 15948, annex D).
        let crc = named.iter().fold(!0_u32, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xedb8_8320 * (crc & 1)))
        });
        file.extend(named);
        file.extend((!crc).to_be_bytes());
    }
    file
}

/// A KTX2 file of RGBA texels, of which it has a few, that states a size.
fn ktx2(width: u32, height: u32) -> Vec<u8> {
    let mut file = b"\xABKTX 20\xBB\r\n\x1A\n".to_vec();
    // Format R8G8B8A8, then the size, one face and one level, and sections of no bytes.
    file.extend(
        [37, 1, width, height, 0, 0, 1, 1, 0, 0, 0, 0, 0].iter().flat_map(|number| number.to_le_bytes()),
    );
    file.resize(80, 0);
    file.extend([104_u64, 16, 16].iter().flat_map(|number| number.to_le_bytes()));
    file.resize(104 + 16, 0x80);
    file
}

/// Checks that the viewer decodes no texture that states an absurd size, and says once what to do.
#[test]
fn a_texture_that_states_an_absurd_size_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let corners = [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let uv = [0.0_f32, 1.0, 1.0, 1.0, 0.0, 0.0];
    let bytes: Vec<u8> = corners.iter().chain(&uv).flat_map(|number| number.to_le_bytes()).collect();
    let model = at("model.gltf");
    for (image, mime, file, stated) in [
        ("bomb.png", "image/png", png(60_000, 60_000), "60000 × 60000"),
        ("bomb.ktx2", "image/ktx2", ktx2(60_000, 60_000), "60000 × 60000"),
        ("most.ktx2", "image/ktx2", ktx2(u32::MAX, u32::MAX), "4294967295 × 4294967295"),
        // Not above the longest side, but to be decoded as a whole.
        ("whole.ktx2", "image/ktx2", ktx2(32_768, 32_768), "32768 × 32768"),
    ] {
        std::fs::write(at(image), file).unwrap();
        let source = json!({"source": 0});
        let (texture, used) = match mime {
            "image/png" => (source, vec![]),
            _ => (json!({"extensions": {"KHR_texture_basisu": source}}), vec!["KHR_texture_basisu"]),
        };
        let text = json!({
            "asset": {"version": "2.0"}, "extensionsUsed": used, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            "textures": [texture], "images": [{"uri": image, "mimeType": mime}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3, "min": [0, 0, 0], "max": [1, 1, 0]},
                {"bufferView": 1, "componentType": 5126, "type": "VEC2", "count": 3},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
            "buffers": [{"byteLength": 60, "uri": format!("data:application/octet-stream;base64,{}", BASE64.encode(&bytes))}],
        });
        std::fs::write(&model, text.to_string()).unwrap();
        let picture = at("picture.png");
        let cache = at("cache");
        let arguments = ["--cache", cache.to_str().unwrap()];
        let ended = Program::headless(model.to_str().unwrap(), &picture, &arguments).end();
        let errors = String::from_utf8(ended.stderr).unwrap();
        assert_eq!((ended.status.code(), picture.exists()), (Some(2), false), "{image}: {errors}");
        let told = errors.lines().find(|line| line.starts_with("error: ")).unwrap_or_default();
        let once = |text: &str| told.matches(text).count() == 1;
        assert!(once(stated) && once(image) && once("scale it down"), "{image}: {errors}");
        // What is known of the model may stay.
        let names = std::fs::read_dir(&cache).unwrap().map(|entry| entry.unwrap().path());
        let left: Vec<_> = names.filter(|path| path.extension().is_none_or(|own| own != "memo")).collect();
        assert!(left.is_empty(), "{image}: {left:?}");
    }
}
