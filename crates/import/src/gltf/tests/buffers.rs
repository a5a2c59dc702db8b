//! Buffers in files of their own.

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::import;

#[test]
fn more_buffers_than_stay_open_are_read_and_short_ones_are_errors() {
    let dir = TempDir::new().unwrap();
    let write = |buffer: u32, corners: usize| {
        let at = buffer as f32;
        let points = [[at, 0.0, 0.0], [at + 1.0, 0.0, 0.0], [at, 1.0, 0.0]];
        let bytes: Vec<u8> = points[..corners].as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
        std::fs::write(dir.path().join(format!("{buffer}.bin")), bytes).unwrap();
    };
    let all = |of: fn(u32) -> Value| (0..100).map(of).collect::<Vec<_>>();
    (0..100).for_each(|buffer| write(buffer, 3));
    let file = json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": (0..100).collect::<Vec<u32>>()}],
        "nodes": all(|i| json!({"mesh": i})),
        "meshes": all(|i| json!({"primitives": [{"attributes": {"POSITION": i}}]})),
        "accessors": all(|i| json!({"bufferView": i, "componentType": 5126, "type": "VEC3", "count": 3})),
        "bufferViews": all(|i| json!({"buffer": i, "byteLength": 36})),
        "buffers": all(|i| json!({"byteLength": 36, "uri": format!("{i}.bin")})),
    });
    let path = dir.path().join("a.gltf");
    std::fs::write(&path, file.to_string()).unwrap();
    let mesh = import(&path).unwrap().mesh;
    assert_eq!((mesh.faces.len(), mesh.positions[3 * 77]), (100, [77.0, 0.0, 0.0]));
    for buffer in [3, 90] {
        write(buffer, 2);
        let why = import(&path).unwrap_err().to_string();
        assert!(why.contains(&format!("buffers[{buffer}] states 36 bytes but has 24")), "{why}");
        write(buffer, 3);
    }
}
