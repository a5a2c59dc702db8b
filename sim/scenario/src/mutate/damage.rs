//! Random damage to bytes and to lists.

use rand::Rng;
use rand_pcg::Pcg64Mcg;

/// Boundary values of lengths, counts and their encodings.
const EXTREMES: [u64; 16] = [
    0,
    1,
    0x3F,
    0x40,
    0x7F,
    0x80,
    0xFF,
    0x100,
    0x3FFF,
    0x4000,
    0xFFFF,
    0x1_0000,
    0x7FFF_FFFF,
    0xFFFF_FFFF,
    0x7FFF_FFFF_FFFF_FFFF,
    u64::MAX,
];
/// Most bytes that one damage adds.
const MOST_ADDED: usize = 4096;

/// One of the boundary values.
pub(super) fn extreme(random: &mut Pcg64Mcg) -> u64 {
    EXTREMES[random.random_range(0..EXTREMES.len())]
}

/// A random range within `length`, at most `most` long; empty if `length` is 0.
fn range(length: usize, most: usize, random: &mut Pcg64Mcg) -> std::ops::Range<usize> {
    if length == 0 {
        return 0..0;
    }
    let start = random.random_range(0..length);
    let most = (length - start).min(most);
    start..start + random.random_range(1..=most)
}

/// Number of damages: mostly one, so that the damage reaches code behind other checks.
pub(super) fn times(random: &mut Pcg64Mcg) -> u32 {
    [1, 1, 1, 1, 2, 3][random.random_range(0..6)]
}

/// Damages bytes in one random way.
pub(super) fn bytes(of: &mut Vec<u8>, other: &[u8], random: &mut Pcg64Mcg) {
    if random.random::<bool>() {
        in_place(of, other, random);
    } else {
        resize(of, other, random);
    }
}

/// Damages bytes without changing their number: flips bits, sets a number to an extreme, overwrites a part with
/// `other`.
fn in_place(of: &mut [u8], other: &[u8], random: &mut Pcg64Mcg) {
    let start = range(of.len(), 1, random).start;
    let put = |of: &mut [u8], piece: &[u8]| {
        for (place, byte) in of[start..].iter_mut().zip(piece) {
            *place = *byte;
        }
    };
    match random.random_range(0..6) {
        0 => put(of, &other[range(other.len(), MOST_ADDED, random)]),
        1 => {
            let width = 1 << random.random_range(0..4);
            let mut number = extreme(random).to_le_bytes();
            if random.random::<bool>() {
                number[..width].reverse();
            }
            put(of, &number[..width]);
        }
        // The most likely kind, since it leaves most of what follows intact.
        _ => {
            for _ in 0..random.random_range(1..=4) {
                let at = range(of.len(), 1, random).start;
                if let Some(byte) = of.get_mut(at) {
                    *byte ^= 1 << random.random_range(0..8);
                }
            }
        }
    }
}

/// Damages bytes and their number: cuts, inserts, removes, repeats, or inserts a part of `other`.
fn resize(of: &mut Vec<u8>, other: &[u8], random: &mut Pcg64Mcg) {
    match random.random_range(0..5) {
        0 => {
            let at = range(of.len(), MOST_ADDED, random).start;
            of.truncate(at);
        }
        1 => {
            let at = random.random_range(0..=of.len());
            let count = random.random_range(1..=16);
            of.splice(at..at, (0..count).map(|_| random.random::<u8>()));
        }
        2 => {
            let gone = range(of.len(), MOST_ADDED, random);
            of.drain(gone);
        }
        3 => {
            let again = range(of.len(), MOST_ADDED, random);
            let piece = of[again.clone()].to_vec();
            of.splice(again.end..again.end, piece);
        }
        _ => {
            let at = random.random_range(0..=of.len());
            of.splice(at..at, other[range(other.len(), MOST_ADDED, random)].iter().copied());
        }
    }
}

/// Damages a frame, or its contents, and corrects its length.
pub(super) fn frame(of: &mut Vec<u8>, other: &[u8], random: &mut Pcg64Mcg) {
    let head = 1 + (1_usize << (of.get(1).copied().unwrap_or(0) >> 6));
    if random.random_range(0..4) == 0 || of.len() <= head {
        bytes(of, other, random);
        return;
    }
    let mut body = of.split_off(head);
    if random.random_range(0..3) > 0 {
        in_place(&mut body, other, random);
    } else {
        bytes(&mut body, other, random);
    }
    // Encoded in four bytes, which can hold any length.
    let length = u32::try_from(body.len()).unwrap_or(u32::MAX) & 0x3FFF_FFFF;
    of.truncate(1);
    of.extend((length | 0x8000_0000).to_be_bytes());
    of.extend(body);
}

/// Reorders a list in one random way: swaps, repeats, removes or moves an element, or reverses a part.
pub(super) fn order<T: Clone>(of: &mut Vec<T>, random: &mut Pcg64Mcg) {
    if of.is_empty() {
        return;
    }
    let [a, b] = [(); 2].map(|()| random.random_range(0..of.len()));
    match random.random_range(0..5) {
        0 => of.swap(a, b),
        1 => of.insert(a, of[b].clone()),
        2 => drop(of.remove(a)),
        3 => {
            let moved = of.remove(a);
            of.insert(b.min(of.len()), moved);
        }
        _ => of[a.min(b)..=a.max(b)].reverse(),
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng as _;

    use super::*;

    #[test]
    fn damage_is_deterministic_bounded_and_works_on_any_length() {
        let damaged = |seed: u64, length: usize| {
            let mut random = Pcg64Mcg::seed_from_u64(seed);
            let (mut of, mut list) = (vec![7; length], vec![1; length]);
            for _ in 0..5 {
                bytes(&mut of, &[1, 2, 3], &mut random);
                order(&mut list, &mut random);
            }
            assert!(of.len() <= length + 5 * MOST_ADDED && list.len() <= length + 5);
            of
        };
        for length in [0, 1, 2, 100, 10_000] {
            let all: Vec<_> = (0..200).map(|seed| damaged(seed, length)).collect();
            assert_eq!(all, (0..200).map(|seed| damaged(seed, length)).collect::<Vec<_>>());
            let changed = all.iter().filter(|of| **of != vec![7; length]).count();
            assert!(length == 0 || changed >= 150, "{length}: {changed} of 200 changed");
        }
    }
}
