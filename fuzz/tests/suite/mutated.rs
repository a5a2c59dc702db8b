//! Damaged packs and first flights, as `lodestream-sim mutate` makes them by the ten thousand, under the meter: nothing
//! panics or goes on without an end, none costs more than its ceiling of memory and steps, and nothing is held afterwards.
#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests are tests, whatever the lint thinks of functions without #[test]"
)]

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

use lodestream_fuzz::meter::{held_bytes, measure};
use lodestream_scenario::mutate::{Flights, Packs, Verdict};
use tempfile::TempDir;

const SEED: u64 = 1;
const CASES: u32 = 150;
/// Times that all are judged again while more is held each time.
const MOST_ROUNDS: usize = 6;
/// What a case may hold: a scene of some ten kB, read, decoded and drawn by nobody.
const MOST_BYTES: usize = 8 << 20;
/// What a case may take: a few passes over some thousand faces.
const MOST_STEPS: u64 = 1 << 21;

/// A folder that holds the prepared packs.
fn cache() -> &'static Path {
    static CACHE: OnceLock<TempDir> = OnceLock::new();
    let prepared = || {
        let folder = tempfile::tempdir().unwrap();
        Packs::prepare(folder.path(), false).unwrap();
        folder
    };
    CACHE.get_or_init(prepared).path()
}

/// Judges cases again and again, until what is held afterwards is no more than before: the second time everything that is
/// kept for later is there already, but caches free what was given back in bags of some kilobytes (crossbeam's epochs), of
/// which there may be one more. What is leaked is more each time. By itself: what is held is counted for each thread, and
/// a bag of one may be freed by another.
fn judged(least_kinds: usize, judge: impl Fn(u64, u32) -> anyhow::Result<Verdict>) {
    static ALONE: Mutex<()> = Mutex::new(());
    // A test that failed meanwhile changes nothing for this one.
    let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
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
fn packs_damaged_behind_their_hashes_are_refused_or_taken_and_leave_nothing() {
    let packs = Packs::prepare(cache(), true).unwrap();
    judged(6, |seed, case| packs.judge(seed, case));
}

#[test]
fn damaged_first_flights_are_refused_or_taken_and_leave_nothing() {
    let flights = Flights::record(cache()).unwrap();
    judged(3, |seed, case| flights.judge(seed, case));
}
