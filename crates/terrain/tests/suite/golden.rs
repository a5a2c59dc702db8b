//! Heights equal the recorded hashes, on every machine.

use super::golden_cases::hashes;

/// The hashes, as `examples/golden.rs` prints them.
const GOLDEN: &str = include_str!("golden.txt");

#[test]
fn heights_equal_the_golden_hashes() {
    let lines = hashes().unwrap().into_iter().map(|(name, hash)| format!("{hash:016x} {name}\n"));
    let now: String = lines.collect();
    assert_eq!(now, GOLDEN, "a change of heights breaks every scene that has terrain");
}
