//! The overlay's statistics, a row each.

use std::time::Duration;

use lodestream_client::core::{Milestone, Stats};
use lodestream_render::{Counters, Timings};

use crate::outcome::describe_missing;
use crate::window::state::State;

/// Values shown besides [`Stats`].
#[derive(Clone, Debug, Default)]
pub(in crate::window) struct OverlayState<'a> {
    pub(in crate::window) adapter: &'a str,
    pub(in crate::window) address: &'a str,
    pub(in crate::window) message: Option<&'a str>,
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

/// Names and values of the rows, from the top.
pub(super) fn rows(stats: &Stats, overlay: &OverlayState<'_>) -> Vec<(&'static str, String)> {
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
        ("server", overlay.address.to_owned()),
        ("graphics", overlay.adapter.to_owned()),
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
fn bytes(bytes: u64) -> String {
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

    fn value(stats: &Stats, overlay: &OverlayState<'_>, name: &str) -> String {
        let rows = rows(stats, overlay);
        rows.into_iter().find(|row| row.0 == name).unwrap_or_else(|| panic!("no row {name}")).1
    }

    #[test]
    fn a_row_shows_the_step_of_quality() {
        let overlay = OverlayState {
            quality: "step 2 of 7: 70 % of the pixels' sides".into(),
            ..OverlayState::default()
        };
        assert_eq!(value(&Stats::default(), &overlay, "quality"), overlay.quality);
    }

    #[test]
    fn a_row_names_the_missing_blobs_of_an_incomplete_picture() {
        let bad = lodestream_scene::BlobId::base(3);
        let stats = Stats { lacking_blobs: 1, lacking: vec![bad], ..Stats::default() };
        let text = |state| value(&stats, &OverlayState { state, ..OverlayState::default() }, "screen error");
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
