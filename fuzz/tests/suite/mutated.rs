//! Damaged packs and first flights, as `lodestream-sim mutate` generates them by the ten thousand: no panic, no endless
//! work, no cost above the limits of memory and steps, and no leak.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use lodestream_fuzz::meter::{held_bytes, measure};
use lodestream_scenario::mutate::{Flights, Packs, Verdict};
use tempfile::TempDir;

use crate::exclusive::exclusive;

const SEED: u64 = 1;
const CASES: u32 = 150;
/// Most repetitions of all cases while held memory grows each time.
const MOST_ROUNDS: usize = 6;
/// Memory limit of a case: a scene of some ten kB, decoded without drawing.
const MOST_BYTES: usize = 8 << 20;
/// Step limit of a case: a few passes over some thousand faces.
const MOST_STEPS: u64 = 1 << 21;

/// A folder with the prepared packs.
fn cache() -> &'static Path {
    static CACHE: OnceLock<TempDir> = OnceLock::new();
    let prepared = || {
        let folder = tempfile::tempdir().unwrap();
        Packs::prepare(folder.path(), false).unwrap();
        folder
    };
    CACHE.get_or_init(prepared).path()
}

/// Judges all cases repeatedly until the held memory does not grow: from the second time on, lazily created state
/// exists, but caches free memory in batches of some kilobytes (crossbeam's epochs), of which one more may be pending.
/// A leak grows each time. Runs exclusively, since memory is counted per thread and a batch may be freed by another
/// thread.
fn judged(least_kinds: usize, judge: impl Fn(u64, u32) -> anyhow::Result<Verdict>) {
    let _exclusive = exclusive();
    let mut kinds = BTreeSet::new();
    let (mut most_bytes, mut most_steps) = (0, 0);
    let mut all = || {
        for case in 0..CASES {
            let (verdict, cost) = measure(|| judge(SEED, case).unwrap());
            assert_ne!(verdict, Verdict::Stuck, "case {case}");
            most_bytes = most_bytes.max(cost.peak_bytes);
            most_steps = most_steps.max(cost.steps);
            assert!(cost.peak_bytes <= MOST_BYTES && cost.steps <= MOST_STEPS, "case {case}: {cost:?}");
            kinds.insert(verdict);
        }
        held_bytes()
    };
    let mut held = all();
    let grows = |_| {
        let before = std::mem::replace(&mut held, all());
        (held > before).then(|| held - before)
    };
    let grown: Vec<usize> = (0..MOST_ROUNDS).map_while(grows).collect();
    println!("at most {most_bytes} bytes and {most_steps} steps; {kinds:?}");
    assert!(kinds.len() >= least_kinds, "the damage is of one kind: {kinds:?}");
    assert!(grown.len() < MOST_ROUNDS, "each time {CASES} cases left more bytes: {grown:?}");
}

#[test]
fn damaged_packs_are_refused_and_leave_nothing() {
    let packs = Packs::prepare(cache(), false).unwrap();
    judged(2, |seed, case| packs.judge(seed, case));
}

#[test]
fn packs_damaged_with_correct_hashes_are_refused_or_accepted_and_leave_nothing() {
    let packs = Packs::prepare(cache(), true).unwrap();
    judged(6, |seed, case| packs.judge(seed, case));
}

#[test]
fn damaged_first_flights_are_refused_or_accepted_and_leave_nothing() {
    let flights = Flights::record(cache()).unwrap();
    judged(3, |seed, case| flights.judge(seed, case));
}
