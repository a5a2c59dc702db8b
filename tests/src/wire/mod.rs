//! docs/protocol.md and docs/formats.md are correct: a reader written from them, in Python, understands recorded
//! sessions, and the bytes shown are those that are sent.
//!
//! The reader needs `python3` (3.8 or later, no packages). Without it these tests fail; `LODESTREAM_SKIP_PYTHON=1`
//! skips them with a message. `LODESTREAM_WRITE_PROTOCOL=1` rewrites the page's hex dump.

mod known;
mod record;
mod scenes;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use lodestream_geometry::base::FORMAT_VERSION;
use lodestream_protocol::message::{
    ClientMessage, CloseCode, Hello, RefusedReason, ServerMessage, Token, VERSIONS,
};
use lodestream_protocol::source::SceneSource as _;
use lodestream_protocol::stream::ALPN;
use lodestream_scene::limits::{
    MAX_ASSETS, MAX_BLOB_BYTES, MAX_CHUNKS, MAX_DECODED_BYTES, MAX_DESCRIPTION_BYTES, MAX_ENTRIES_PER_PAGE,
    MAX_FRAME_BYTES, MAX_HAVE, MAX_IDS_PER_MESSAGE, MAX_INSTANCES, MAX_MESSAGE_BYTES, MAX_NAME_BYTES,
    MAX_PAGES_PER_MESSAGE, MAX_PIECE_BYTES, MAX_QUEUED, MAX_REASON_BYTES, MAX_SCENE_PAGES, MAX_TOKEN_BYTES,
};
use lodestream_scene::parts;
use lodestream_scene::punctual_lights::{
    LISTED_PER_PAGE, MAX_PAGE_BYTES, MAX_PUNCTUAL_LIGHTS, PUNCTUAL_LIGHTS_PER_PAGE,
};
use lodestream_scene::terrain::{MAX_EROSION_PASSES, MAX_SEGMENTS};
use serde_json::Value;

use crate::support::daemon::Transport;
use crate::support::raw::hello;
use known::Expected;
use record::{Recording, record};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

/// The reader's output for a recording, or `None` if Python is skipped.
fn read(recording: &Recording, arguments: &[&str]) -> Option<Result<String, String>> {
    if std::env::var("LODESTREAM_SKIP_PYTHON").is_ok_and(|v| v == "1") {
        // Not `eprintln!`: the test runner would swallow it when the test "passes".
        let test = std::thread::current().name().unwrap_or("a test").to_owned();
        let _ = writeln!(std::io::stderr(), "SKIPPED, NOT PASSED (LODESTREAM_SKIP_PYTHON=1): {test}");
        return None;
    }
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(recording.json().to_string().as_bytes()).unwrap();
    let reader = root().join("docs/protocol/reader.py");
    let output = Command::new("python3").arg("-B").arg(reader).arg(file.path()).args(arguments).output();
    let output = output.expect("this test needs python3: install it (or set LODESTREAM_SKIP_PYTHON=1)");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Some(if output.status.success() { Ok(text(output.stdout)) } else { Err(text(output.stderr)) })
}

/// Collects differences of two values. Floats may differ by two units in the last place of an `f64`, from parsing JSON.
fn differences(path: &str, read: &Value, known: &Value, found: &mut Vec<String>) {
    match (read, known) {
        (Value::Object(a), Value::Object(b)) => {
            for key in a.keys().chain(b.keys().filter(|key| !a.contains_key(*key))) {
                let none = Value::String("nothing".into());
                let [a, b] = [a, b].map(|map| map.get(key).unwrap_or(&none));
                differences(&format!("{path}.{key}"), a, b, found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (n, (a, b)) in a.iter().zip(b).enumerate() {
                differences(&format!("{path}[{n}]"), a, b, found);
            }
        }
        (Value::Number(a), Value::Number(b)) if a.is_f64() || b.is_f64() => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            if (a - b).abs() > 2.0 * f64::EPSILON * b.abs() {
                found.push(format!("{path}: {a} instead of {b}"));
            }
        }
        (a, b) if a == b => {}
        (a, b) => found.push(format!("{path}: {a} instead of {b}")),
    }
}

/// Compares the reader's output with the expected contents.
fn assert_understood(recording: &Recording, known: &Expected, said: &[Vec<ClientMessage>]) {
    let Some(printed) = read(recording, &[]) else { return };
    let printed = serde_json::from_str(&printed.unwrap()).unwrap();
    let mut found = Vec::new();
    differences("session", &printed, &known.json(said), &mut found);
    assert!(found.is_empty(), "docs/protocol/reader.py read\n{}", found.join("\n"));
}

#[test]
fn a_reader_written_from_the_page_understands_every_message() {
    let scene = scenes::gallery();
    let said = scenes::conversation(&scene);
    for transport in Transport::BOTH {
        let recording = record(scene.source(), transport, &said);
        let known = Expected::of(&recording);
        let seen =
            |wanted: &dyn Fn(&ServerMessage) -> bool| known.messages.iter().filter(|m| wanted(m)).count();
        assert!(matches!(&known.messages[0], ServerMessage::Welcome(w) if w.scene == *scene.store.header()));
        assert_eq!(
            seen(&|m| matches!(m, ServerMessage::ScenePage(_))),
            4,
            "{transport:?}: two pages, twice each"
        );
        assert_eq!(
            seen(
                &|m| matches!(m, ServerMessage::PunctualLights(punctual_lights) if punctual_lights.count == 1100)
            ),
            1
        );
        assert_eq!(seen(&|m| *m == ServerMessage::Pong(0xdead_beef)), 1);
        assert!(seen(&|m| *m == ServerMessage::BasesSent) > 0 && seen(&|m| *m == ServerMessage::Done) > 0);
        for reason in [RefusedReason::NotFound, RefusedReason::OutOfRange] {
            assert_eq!(
                seen(&|m| matches!(m, ServerMessage::Refused(r) if r.reason == reason)),
                1,
                "{reason:?}"
            );
        }
        assert_eq!(seen(&|m| matches!(m, ServerMessage::RefusedMany(many) if many.len() == 2)), 1);
        let json = known.json(&said);
        let blobs = json["blobs"].as_array().unwrap();
        for (what, there) in [
            ("the rest of a chunk", blobs.iter().any(|blob| blob["offset"].as_u64() > Some(0))),
            ("a texture", blobs.iter().any(|blob| blob["id"]["texture"].is_u64())),
            (
                "a page of punctual lights with a spot",
                blobs.iter().any(|blob| blob["contents"][0]["angles"].is_array()),
            ),
            (
                "a directory of punctual lights",
                blobs.iter().any(|blob| blob["contents"].as_array().is_some_and(|pages| pages.len() == 18)),
            ),
            ("an animation", blobs.iter().any(|blob| blob["contents"]["clips"][0][0] == "lift")),
            ("a directory of parts", blobs.iter().any(|blob| blob["id"]["part_directory_page"].is_u64())),
            (
                "a page of parts",
                blobs.iter().any(|blob| blob["id"]["part_page"].is_u64() && blob["contents"].is_array()),
            ),
            ("a described texture", json.to_string().contains("\"relief_depth\"")),
            (
                "a directory",
                blobs
                    .iter()
                    .any(|blob| blob["id"]["terrain_directory_page"].is_u64() && blob["contents"].is_array()),
            ),
        ] {
            assert!(there, "{transport:?}: {what} was not sent");
        }
        assert_understood(&recording, &known, &said);
    }
}

#[test]
fn a_reader_written_from_the_page_understands_initial_punctual_lights() {
    for count in [1, 16, 17, 400] {
        let scene = scenes::lit(count);
        let said = [vec![ClientMessage::Hello(hello())]];
        let recording = record(scene.source(), Transport::Quic, &said);
        let known = Expected::of(&recording);
        assert!(
            matches!(&known.messages[1], ServerMessage::PunctualLights(punctual_lights) if punctual_lights.count == count)
        );
        assert_understood(&recording, &known, &said);
    }
}

#[test]
fn a_reader_written_from_the_page_understands_a_refusal() {
    let scene = scenes::tetrahedron();
    let said = [vec![ClientMessage::Hello(Hello { version_min: 9, version_max: 300, ..hello() })]];
    for transport in Transport::BOTH {
        let recording = record(scene.source(), transport, &said);
        let known = Expected::of(&recording);
        assert!(
            matches!(known.messages.last(), Some(ServerMessage::Close(close)) if close.code == CloseCode::Version)
        );
        assert_understood(&recording, &known, &said);
    }
}

#[test]
fn a_reader_written_from_the_page_understands_tokens() {
    let scene = scenes::tetrahedron();
    let token = |text: &str| ClientMessage::Token(Token(text.repeat(MAX_TOKEN_BYTES / text.len())));
    let said = [vec![token("a.b.c"), ClientMessage::Hello(hello()), token("d.e")]];
    for transport in Transport::BOTH {
        let recording = record(scene.source(), transport, &said);
        assert_understood(&recording, &Expected::of(&recording), &said);
    }
}

#[test]
fn the_reader_refuses_bytes_that_violate_the_page() {
    let scene = scenes::tetrahedron();
    let said = [vec![ClientMessage::Hello(hello())]];
    let Recording::Quic(streams) = record(scene.source(), Transport::Quic, &said) else { unreachable!() };
    // Kind, tag and version of the server's stream; length of the header and of the blob; the client's first tag.
    for (stream, at) in [(1, 0), (1, 1), (1, 3), (2, 1), (2, 4), (0, 1)] {
        let mut broken = streams.clone();
        broken[stream].2[at] ^= 0x35;
        let Some(outcome) = read(&Recording::Quic(broken), &[]) else { return };
        let why = outcome.expect_err("nothing was wrong");
        assert!(why.contains("not as docs/protocol.md says"), "stream {stream}, byte {at}: {why}");
    }
}

/// The numbers in a text, without thousands separators.
fn numbers(text: &str) -> Vec<u64> {
    let text = text.replace(',', "");
    text.split(|c: char| !c.is_ascii_digit()).filter_map(|digits| digits.parse().ok()).collect()
}

#[test]
fn the_page_states_the_limits_and_close_codes_of_the_program() {
    let page = std::fs::read_to_string(root().join("docs/protocol.md")).unwrap();
    let versions = format!(
        "This is version {} of the messages, over transports named `{ALPN}`. Blobs have a format \
         version of their own, which is {FORMAT_VERSION}.",
        VERSIONS.end()
    );
    assert!(page.replace('\n', " ").contains(&versions), "{versions}");
    let rows: Vec<Vec<&str>> =
        page.lines().filter(|l| l.starts_with('|')).map(|l| l.split('|').map(str::trim).collect()).collect();
    for (what, limits) in [
        ("body of a message", &[MAX_MESSAGE_BYTES as u64][..]),
        ("memory that decoding a message claims", &[MAX_DECODED_BYTES as u64]),
        ("a WebSocket message", &[MAX_FRAME_BYTES as u64]),
        ("bytes of a piece", &[MAX_PIECE_BYTES as u64]),
        ("a blob", &[u64::from(MAX_BLOB_BYTES)]),
        ("requests of a Want, ids of a Cancel, refusals of a RefusedMany", &[MAX_IDS_PER_MESSAGE as u64]),
        ("blobs queued for a client; then `Refused` with QueueFull", &[MAX_QUEUED as u64]),
        ("ids in `have`", &[MAX_HAVE as u64]),
        ("pages in a WantScenePages", &[MAX_PAGES_PER_MESSAGE as u64]),
        ("assets, and instances, of a page", &[MAX_ENTRIES_PER_PAGE as u64]),
        ("names; reasons; tokens", &[MAX_NAME_BYTES, MAX_REASON_BYTES, MAX_TOKEN_BYTES].map(|n| n as u64)),
        ("assets of a scene; instances; pages", &[MAX_ASSETS, MAX_INSTANCES, MAX_SCENE_PAGES].map(u64::from)),
        ("chunks of an asset", &[u64::from(MAX_CHUNKS)]),
        ("an asset's description", &[MAX_DESCRIPTION_BYTES as u64]),
        (
            "segments of a terrain's stamps; passes of erosion",
            &[MAX_SEGMENTS as u64, u64::from(MAX_EROSION_PASSES)],
        ),
        (
            "punctual lights of a scene; of a page; pages on a page of their directory; bytes of a page",
            &[MAX_PUNCTUAL_LIGHTS, PUNCTUAL_LIGHTS_PER_PAGE, LISTED_PER_PAGE, MAX_PAGE_BYTES].map(u64::from),
        ),
        (
            "records of parts; bytes of name, path, extras",
            &[
                u64::from(parts::MAX_RECORDS),
                parts::MAX_NAME_BYTES as u64,
                parts::MAX_PATH_BYTES as u64,
                parts::MAX_EXTRAS_BYTES as u64,
            ],
        ),
    ] {
        let row = rows.iter().find(|row| row[1] == what).unwrap_or_else(|| panic!("no row {what:?}"));
        assert_eq!(numbers(row[2]), limits, "{what}");
    }
    for code in CloseCode::ALL {
        let (number, name) = (code.number().to_string(), format!("{code:?}"));
        let row = rows.iter().find(|row| row[1] == number && row[2] == name);
        let row = row.unwrap_or_else(|| panic!("no row for {number} {name}"));
        assert_eq!(row[4] == "later", code.worth_retrying(), "{name}");
    }
}

#[test]
fn the_dump_shows_the_bytes_of_a_first_flight() {
    let scene = scenes::tetrahedron();
    let said = [vec![ClientMessage::Hello(hello())]];
    let recording = record(scene.source(), Transport::Quic, &said);
    assert_understood(&recording, &Expected::of(&recording), &said);
    let path = root().join("docs/protocol/first-flight.txt");
    let shown = std::fs::read_to_string(&path).unwrap();
    let dump = read(&recording, &["--dump"]).map(|dump| dump.unwrap());
    if std::env::var("LODESTREAM_WRITE_PROTOCOL").is_ok_and(|v| v == "1") {
        std::fs::write(&path, dump.expect("writing the dump needs python3")).unwrap();
        return;
    }
    // The bytes are compared with or without Python.
    let Recording::Quic(streams) = &recording else { unreachable!() };
    let mut lines = shown.lines().filter(|line| !line.is_empty()).peekable();
    for (from, number, bytes) in streams {
        assert_eq!(lines.next(), Some(&*format!("stream {number}, from the {from}")));
        let mut dumped = Vec::new();
        while let Some(line) = lines.next_if(|line| !line.starts_with("stream")) {
            assert_eq!(usize::from_str_radix(&line[..4], 16), Ok(dumped.len()), "{line}");
            let hex = line[6..].split("  ").next().unwrap().split(' ');
            dumped.extend(hex.map(|byte| u8::from_str_radix(byte, 16).unwrap()));
        }
        assert!(
            dumped == *bytes,
            "stream {number} differs from docs/protocol/first-flight.txt: {dumped:02x?}\n{bytes:02x?}"
        );
    }
    assert_eq!(lines.next(), None, "docs/protocol/first-flight.txt shows a stream that was not recorded");
    if let Some(dump) = dump {
        assert!(
            dump == shown,
            "docs/protocol/first-flight.txt names other fields than its reader; the dump is now\n{dump}"
        );
    }
}
