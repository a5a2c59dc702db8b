//! A cancelled preparation ends within the regions in progress.

use std::sync::atomic::{AtomicUsize, Ordering};

use lodestream_geometry::MeshError;
use lodestream_geometry::pool::{Monitor, Progress};
use lodestream_geometry::prepare::{Hooks, prepare};

use crate::common::{Shuffled, quantised, regions, shapes};

/// Cancels from report number `no` on.
struct CancelAt {
    no: usize,
    reports: AtomicUsize,
}

impl Monitor for CancelAt {
    fn report(&self, progress: Progress) -> bool {
        assert!(progress.faces_done <= progress.faces_total);
        self.reports.fetch_add(1, Ordering::SeqCst) < self.no
    }
}

#[test]
fn cancelling_takes_effect_at_any_report() {
    let mesh = quantised(&shapes::sphere(40, 60, 0.05));
    let threads = 3;
    let run = |no| {
        let monitor = CancelAt { no, reports: AtomicUsize::new(0) };
        let result = prepare(&mesh, &regions(200), &Hooks::new(&Shuffled { threads, seed: 4 }, &monitor));
        (result, monitor.reports.into_inner())
    };
    let (whole, reports) = run(usize::MAX);
    assert!(whole.is_ok() && reports > 50, "{reports} reports");
    for no in (0..reports).step_by(7) {
        let (result, made) = run(no);
        assert_eq!(result.unwrap_err(), MeshError::Cancelled, "report {no}");
        assert!(made <= no + threads, "{made} reports, cancelled at {no}");
    }
}
