//! The figures of a session as a JavaScript object, with the names of the viewer's report (`lodestream-viewer --stats`).

use std::time::Duration;

use js_sys::{Array, Object, Reflect, Uint8Array};
use lodestream_client::core::{Connection, Milestone, QUALITIES_PX, Stats};
use wasm_bindgen::JsValue;

use crate::pictures::Picture;

/// The object for these counters. `waits`: changes are waiting for the page. `begun_ms`: the connect call, in
/// milliseconds since the navigation.
pub(crate) fn object(stats: &Stats, waits: bool, begun_ms: f64) -> Object {
    let milestones = &stats.milestones;
    let first = milestones.first_frame;
    let connection = match &stats.connection {
        Connection::None => "none",
        Connection::Opening => "opening",
        Connection::Open => "open",
        Connection::Closed(_) => "closed",
    };
    let error = stats.counters.max_screen_error_px;
    let lacking: Array = stats.lacking.iter().map(|id| JsValue::from(id.to_string())).collect();
    fields([
        ("scene", stats.scene.as_str().into()),
        ("connection", connection.into()),
        ("rate_bits_per_s", number(stats.rate_bits_per_s.map(|rate| rate as f64))),
        ("rtt_ms", number(stats.session.rtt.map(ms))),
        ("ttff_ms", number(first.map(|at| ms(at.after)))),
        ("ttff_since_navigation_ms", number(first.map(|at| ms(at.after) + begun_ms))),
        ("first_frame_bytes", number(first.map(|at| at.bytes as f64))),
        ("ttq_ms", by_error(milestones.quality, |at| ms(at.after))),
        ("ttq_bytes", by_error(milestones.quality, |at| at.bytes as f64)),
        ("unoccluded_ttq_ms", by_error(milestones.unoccluded_quality, |at| ms(at.after))),
        ("unoccluded_ttq_bytes", by_error(milestones.unoccluded_quality, |at| at.bytes as f64)),
        ("total_bytes", (stats.transport_bytes as f64).into()),
        ("bytes", (stats.transport_bytes as f64).into()),
        ("settled", (stats.settled && !waits).into()),
        ("settled_ms", number(stats.settled_after.map(ms))),
        ("lacking_blobs", (stats.lacking_blobs as f64).into()),
        ("lacking", lacking.into()),
        ("max_screen_error_px", number((first.is_some() && error.is_finite()).then_some(error))),
        ("faces", (stats.faces as f64).into()),
        ("mesh_bytes", (stats.mesh_bytes as f64).into()),
        ("cached_bytes", (stats.cached_bytes as f64).into()),
        ("texels", (stats.counters.texels as f64).into()),
        ("levels_without_room", stats.counters.levels_without_room.into()),
        ("needed_bytes", (stats.counters.needed_bytes as f64).into()),
        ("missing_bytes", (stats.counters.missing_bytes as f64).into()),
        ("wanted_chunks", (stats.wanted_chunks as f64).into()),
        ("decode_failures", (stats.decode_failures as f64).into()),
        ("connections", (stats.connections as f64).into()),
    ])
}

/// A picture for the script.
pub(crate) fn picture(picture: &Picture) -> JsValue {
    let [width, height] = picture.size;
    let object = fields([
        ("number", picture.number.into()),
        ("uses", picture.uses.into()),
        ("file", Uint8Array::from(&picture.file[..]).into()),
        ("width", width.into()),
        ("height", height.into()),
        ("height_map", picture.is_height.into()),
        ("planes", picture.has_planes.into()),
    ]);
    object.into()
}

fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

fn number(value: Option<f64>) -> JsValue {
    value.map_or(JsValue::NULL, JsValue::from)
}

fn by_error(noted: [Option<Milestone>; QUALITIES_PX.len()], value: fn(Milestone) -> f64) -> JsValue {
    let object = Object::new();
    for (px, noted) in QUALITIES_PX.iter().zip(noted) {
        set(&object, &px.to_string(), &number(noted.map(value)));
    }
    object.into()
}

/// An object with these fields.
pub(crate) fn fields<const N: usize>(fields: [(&str, JsValue); N]) -> Object {
    let object = Object::new();
    fields.iter().for_each(|(name, value)| set(&object, name, value));
    object
}

fn set(object: &Object, name: &str, value: &JsValue) {
    // Setting a field of a new object cannot fail.
    let _ = Reflect::set(object, &name.into(), value);
}
