//! Compressed streams of glTF files, truncated at every length and damaged a thousand times each: no panic, and no
//! memory beyond the limit.

use lodestream_fuzz::seeds;
use lodestream_fuzz::targets::gltf_compressed;

/// Damaged inputs per seed.
const CASES: u64 = 1000;

/// Seeded random numbers (SplitMix64; Steele, Lea and Flood 2014).
fn random(state: &mut u64) -> usize {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (z ^ (z >> 31)) as usize >> 8
}

#[test]
fn every_truncation_is_refused() {
    for (name, seed) in seeds::of("gltf_compressed") {
        for length in 0..seed.len() {
            assert!(!gltf_compressed(&seed[..length]), "{name} cut to {length} bytes");
        }
    }
}

#[test]
fn damaged_streams_are_refused_or_accepted_within_the_limits() {
    let (mut accepted, mut all) = (0, 0);
    for (name, seed) in seeds::of("gltf_compressed") {
        let mut state = CASES;
        let mut taken = 0;
        for case in 0..CASES {
            let mut damaged = seed.clone();
            // The codec byte stays; half of the damage goes to the beginning of the stream, which controls how the rest
            // is read.
            let end = if case % 2 == 0 { damaged.len() } else { damaged.len().min(40) };
            for _ in 0..=random(&mut state) % 4 {
                let at = 1 + random(&mut state) % (end - 1);
                damaged[at] = match random(&mut state) % 3 {
                    0 => damaged[at] ^ 1 << (random(&mut state) % 8),
                    1 => [0, 1, 0x7f, 0x80, 0xff][random(&mut state) % 5],
                    _ => random(&mut state) as u8,
                };
            }
            taken += u32::from(gltf_compressed(&damaged));
        }
        println!("{name}: {taken} of {CASES} accepted");
        accepted += taken;
        all += CASES as u32;
    }
    assert!(accepted > all / 50 && accepted < all / 2, "the damage is of one kind: {accepted} of {all}");
}
