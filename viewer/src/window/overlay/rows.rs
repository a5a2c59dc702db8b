//! The overlay's statistics, a row each.

use std::rc::Rc;
use std::time::Duration;

use lodestream_client::core::{Milestone, Stats};
use lodestream_render::{Counters, HiddenParts, Timings};
use lodestream_scene::parts::ScenePart;

use crate::outcome::describe_missing;
use crate::window::keyboard::Bindings;
use crate::window::state::State;

/// Values shown besides [`Stats`].
#[derive(Clone, Debug)]
pub(in crate::window) struct OverlayState {
    pub(in crate::window) bindings: Rc<Bindings>,
    pub(in crate::window) adapter: String,
    pub(in crate::window) address: String,
    /// Short name of what is shown.
    pub(in crate::window) name: String,
    /// Nothing is shown, and nothing will be.
    pub(in crate::window) is_empty: bool,
    pub(in crate::window) message: Option<String>,
    /// What is being loaded, if it is not streamed.
    pub(in crate::window) progress: Option<String>,
    /// What a tool says.
    pub(in crate::window) tool: Option<String>,
    /// Measured points in pixels of the window; `None` behind the eye.
    pub(in crate::window) marks: Vec<Option<[f64; 2]>>,
    /// Parts that are hidden, for their list.
    pub(in crate::window) hidden_parts: HiddenParts,
    pub(in crate::window) selected: Option<ScenePart>,
    /// Where the section plane is along its axis, in world units.
    pub(in crate::window) section_position: Option<f64>,
    pub(in crate::window) frame_ms: f64,
    pub(in crate::window) fps: f64,
    pub(in crate::window) bits_per_s: f64,
    pub(in crate::window) presented: Option<Duration>,
    pub(in crate::window) state: State,
    pub(in crate::window) quality: String,
    pub(in crate::window) mode: &'static str,
    pub(in crate::window) camera: String,
    /// The selected part.
    pub(in crate::window) part: String,
    pub(in crate::window) draw: Counters,
    pub(in crate::window) gpu_bytes: u64,
    pub(in crate::window) waiting_steps: usize,
    /// Times of passes; empty unless their table is open.
    pub(in crate::window) times: Timings,
}

impl OverlayState {
    /// Nothing but what keys do.
    #[cfg(test)]
    pub(in crate::window) fn new(bindings: &Rc<Bindings>) -> Self {
        Self {
            bindings: Rc::clone(bindings),
            adapter: String::new(),
            address: String::new(),
            name: String::new(),
            is_empty: false,
            message: None,
            progress: None,
            tool: None,
            marks: Vec::new(),
            hidden_parts: HiddenParts::default(),
            selected: None,
            section_position: None,
            frame_ms: 0.0,
            fps: 0.0,
            bits_per_s: 0.0,
            presented: None,
            state: State::default(),
            quality: String::new(),
            mode: "",
            camera: String::new(),
            part: String::new(),
            draw: Counters::default(),
            gpu_bytes: 0,
            waiting_steps: 0,
            times: Timings::default(),
        }
    }
}

/// Names and values of the rows, from the top.
pub(super) fn rows(stats: &Stats, overlay: &OverlayState) -> Vec<(&'static str, String)> {
    let ms = |d: Option<Duration>| d.map_or("–".into(), |d| format!("{:.0} ms", d.as_secs_f64() * 1e3));
    let c = &stats.counters;
    let px = |px: f64| if px.is_finite() { format!("{px:.2} px") } else { "–".into() };
    let first = stats.milestones.first_frame;
    let at = |m: Option<Milestone>| match m {
        Some(m) => format!("{} at {}", ms(Some(m.after)), bytes(m.bytes)),
        None => "–".into(),
    };
    let [seen, everywhere] = [stats.milestones.unoccluded_quality[2], stats.milestones.quality[2]];
    let state = match overlay.state {
        State::Settled => "settled".to_owned(),
        State::Refining => "refining".to_owned(),
        State::Incomplete => describe_missing(stats.lacking_blobs, &stats.lacking),
    };
    vec![
        ("scene", format!("{} ({}/{} instances)", stats.scene, stats.instances, stats.scene_instances)),
        ("source", overlay.address.clone()),
        ("graphics", overlay.adapter.clone()),
        ("frame", format!("{:.1} ms ({:.1} fps)", overlay.frame_ms, overlay.fps)),
        (
            "first frame",
            format!(
                "{} at {}, shown {}",
                ms(first.map(|m| m.after)),
                first.map_or("–".into(), |m| bytes(m.bytes)),
                ms(overlay.presented)
            ),
        ),
        ("error ≤ 1 px", format!("where seen {}, everywhere {}", at(seen), at(everywhere))),
        ("received", format!("{} ({:.2} Mbit/s)", bytes(stats.transport_bytes), overlay.bits_per_s / 1e6)),
        (
            "chunks",
            format!(
                "{} wanted · {} in flight · {} applied · {} needed, {} for shadows",
                c.missing_chunks,
                stats.session.in_flight_blobs,
                stats.applied_chunks,
                bytes(c.needed_bytes),
                bytes(c.shadow_bytes)
            ),
        ),
        (
            "screen error",
            format!(
                "{}, where seen {} (threshold {}), {state}",
                px(c.max_screen_error_px),
                px(c.unoccluded_screen_error_px),
                px(c.threshold_px)
            ),
        ),
        ("quality", overlay.quality.clone()),
        (
            "faces",
            format!("{} refined · {} drawn", thousands(stats.faces), thousands(overlay.draw.triangles)),
        ),
        (
            "memory",
            format!(
                "meshes {} · GPU {} · cache {}{}",
                bytes(stats.mesh_bytes),
                bytes(overlay.gpu_bytes),
                bytes(stats.cached_bytes),
                if overlay.waiting_steps > 0 {
                    format!(" · {} steps wait", overlay.waiting_steps)
                } else {
                    String::new()
                }
            ),
        ),
        ("camera", format!("{}: {}", overlay.mode, overlay.camera)),
        ("part", overlay.part.clone()),
    ]
}

/// Formats bytes with a unit.
pub(super) fn bytes(bytes: u64) -> String {
    let b = bytes as f64;
    match bytes {
        0..10_000 => format!("{bytes} B"),
        10_000..10_000_000 => format!("{:.1} kB", b / 1e3),
        _ => format!("{:.1} MB", b / 1e6),
    }
}

/// Formats a number with spaces between thousands.
fn thousands(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bindings() -> Rc<Bindings> {
        Rc::new(Bindings::new(&Default::default()).unwrap())
    }

    fn value(stats: &Stats, overlay: &OverlayState, name: &str) -> String {
        let rows = rows(stats, overlay);
        rows.into_iter().find(|row| row.0 == name).unwrap_or_else(|| panic!("no row {name}")).1
    }

    #[test]
    fn a_row_shows_the_step_of_quality() {
        let bindings = bindings();
        let quality = "step 2 of 7: 70 % of the pixels' sides".into();
        let overlay = OverlayState { quality, ..OverlayState::new(&bindings) };
        assert_eq!(value(&Stats::default(), &overlay, "quality"), overlay.quality);
    }

    #[test]
    fn a_row_names_the_missing_blobs_of_an_incomplete_picture() {
        let bad = lodestream_scene::BlobId::base(3);
        let stats = Stats { lacking_blobs: 1, lacking: vec![bad], ..Stats::default() };
        let bindings = bindings();
        let text =
            |state| value(&stats, &OverlayState { state, ..OverlayState::new(&bindings) }, "screen error");
        assert!(
            text(State::Incomplete).ends_with("damaged or refused (asset 3 base)"),
            "{}",
            text(State::Incomplete)
        );
        assert!(text(State::Settled).ends_with(", settled") && text(State::Refining).ends_with(", refining"));
    }

    #[test]
    fn numbers_are_readable() {
        assert_eq!(bytes(1234), "1234 B");
        assert_eq!(bytes(12_345), "12.3 kB");
        assert_eq!(bytes(12_345_678), "12.3 MB");
        assert_eq!(thousands(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(thousands(12), "12");
    }
}
