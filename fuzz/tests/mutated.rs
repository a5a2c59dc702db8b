//! Damaged packs and first flights, as `lodestream-sim mutate` makes them by the ten thousand, under the meter: nothing
//! panics or goes on without an end, none costs more than its ceiling of memory and steps, and nothing is held afterwards.
#![allow(
    clippy::unwrap_used,
    reason = "helpers of tests are tests, whatever the lint thinks of functions without #[test]"
)]

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::OnceLock;

use lodestream_fuzz::meter::{held_bytes, measure};
use lodestream_scenario::mutate::{Flights, Packs, Verdict};
use tempfile::TempDir;

const SEED: u64 = 1;
const CASES: u32 = 150;
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

/// Judges cases twice; the second time everything that is kept for later is there already.
fn judged(least_kinds: usize, judge: impl Fn(u64, u32) -> anyhow::Result<Verdict>) {
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
    let (first, second) = (all(), all());
    println!("at most {most_bytes} bytes and {most_steps} steps; {kinds:?}");
    assert!(kinds.len() >= least_kinds, "the damage is of one kind: {kinds:?}");
    assert!(second <= first, "{} bytes are held for {CASES} cases", second - first);
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
