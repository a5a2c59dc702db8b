//! Rounds and stops, on the collapses of every generated mesh.

use std::collections::{BTreeMap, BTreeSet};

use crate::common;
use crate::pool::{Serial, Silent, Watched};
use crate::simplify::live::NO_VERTEX;
use crate::simplify::records::Records;
use crate::simplify::{Settings, simplify};

fn each_chunk(parts: usize, check: &mut dyn FnMut(&Records)) {
    for (_, source) in common::all() {
        let mesh = common::quantised(&source);
        let settings = Settings { parts, min_part_splits: 4, ..common::regions(200) };
        let simplified = simplify(&mesh, &settings, &mut Watched::new(&Serial, &Silent, 0)).unwrap();
        simplified.levels.iter().flatten().for_each(|chunk| check(&chunk.records));
    }
}

/// The part of a chunk in which each collapse is undone, counted from the first that is.
fn part(records: &Records, index: usize) -> usize {
    records.stops.iter().filter(|&&stop| (index as u32) < stop).count()
}

#[test]
fn no_round_reaches_across_a_stop() {
    let mut with_stops = 0;
    each_chunk(4, &mut |records| {
        assert!(records.stops.is_sorted_by(|a, b| a > b));
        assert!(records.stops.iter().all(|&s| s >= 4 && (s as usize) < records.collapses.len()));
        with_stops += usize::from(!records.stops.is_empty());
        let mut rounds: BTreeMap<usize, (u32, u32)> = BTreeMap::new();
        for (i, collapse) in records.collapses.iter().enumerate().filter(|(_, c)| c.target != NO_VERTEX) {
            let (least, most) = rounds.entry(part(records, i)).or_insert((u32::MAX, 0));
            (*least, *most) = ((*least).min(collapse.round), (*most).max(collapse.round));
        }
        let rounds: Vec<_> = rounds.into_values().collect();
        assert!(rounds.windows(2).all(|w| w[0].0 > w[1].1), "{rounds:?}");
    });
    assert!(with_stops > 20, "{with_stops} chunks have stops");
}

#[test]
fn collapses_of_one_round_share_no_face_and_makers_come_first() {
    each_chunk(4, &mut |records| {
        let mut used = BTreeSet::new();
        let mut removed_in = BTreeMap::new();
        for index in 0..records.collapses.len() {
            let (collapse, moved, removed) = records.parts(index);
            if collapse.target == NO_VERTEX {
                continue;
            }
            for face in moved.iter().map(|m| m.face).chain(removed.iter().map(|r| r.face)) {
                assert!(used.insert((collapse.round, face)), "face {face} twice in one round");
            }
            // Undone from the highest round on: what was collapsed onto must come back before.
            removed_in.insert(collapse.removed, collapse.round);
        }
        for index in 0..records.collapses.len() {
            let (collapse, _, removed) = records.parts(index);
            for vertex in removed.iter().filter_map(|r| r.third).chain([collapse.target]) {
                if let Some(&made) = removed_in.get(&vertex) {
                    assert!(made > collapse.round, "{vertex} must be there for {}", collapse.removed);
                }
            }
        }
    });
}

#[test]
fn small_chunks_have_no_stops() {
    let mut records = Records::default();
    records.schedule(4, 32);
    assert!(records.stops.is_empty());
    each_chunk(1, &mut |records| assert!(records.stops.is_empty()));
}
