//! Truncation points of the collapses of every generated mesh.

use crate::checkpoint::InMemoryCheckpoint;
use crate::collapse::Records;
use crate::common;
use crate::pool::{MonitoredPool, Serial, Silent};
use crate::simplify::settings::Settings;
use crate::simplify::simplify;

fn each_chunk(parts: usize, check: &mut dyn FnMut(&Records)) {
    // In meshes with parts, truncation points do not divide a component that vanishes.
    for (_, source) in common::all().into_iter().filter(|(_, source)| source.parts.is_empty()) {
        let mesh = common::quantised(&source);
        let settings = Settings { parts, min_part_splits: 4, ..common::regions(200) };
        let checkpoint = InMemoryCheckpoint::default();
        let simplified =
            simplify(&mesh, &settings, &mut MonitoredPool::new(&Serial, &Silent, 0), &checkpoint).unwrap();
        simplified.levels.all().iter().for_each(|chunk| check(&chunk.records));
    }
}

#[test]
fn truncation_points_divide_the_collapses_equally() {
    let mut with_truncation_points = 0;
    each_chunk(4, &mut |records| {
        with_truncation_points += usize::from(!records.truncation_points.is_empty());
        let total = records.collapses.len() as u32;
        let ends: Vec<u32> = [total].iter().chain(&records.truncation_points).chain([&0]).copied().collect();
        let parts: Vec<u32> = ends.windows(2).map(|e| e[0] - e[1]).collect();
        let (least, most) = (parts.iter().min().unwrap(), parts.iter().max().unwrap());
        assert!(most - least <= 1 && (*least >= 4 || parts.len() == 1), "{parts:?}");
    });
    assert!(with_truncation_points > 20, "{with_truncation_points} chunks have truncation_points");
}

#[test]
fn small_chunks_have_no_truncation_points() {
    let mut records = Records::default();
    records.choose_truncation_points(4, 32);
    assert!(records.truncation_points.is_empty());
    each_chunk(1, &mut |records| assert!(records.truncation_points.is_empty()));
}
