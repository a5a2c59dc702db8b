//! A set of indices that is asked about each in every frame.

use std::collections::BTreeSet;

/// Most words of bits per index, so that a large index does not take much memory.
const MAX_WORDS: usize = 8;

/// A set of indices; finds one in constant time unless they are few and far apart.
#[derive(Debug)]
pub(crate) struct IndexSet {
    indices: BTreeSet<u32>,
    /// A bit per index up to the largest, if that takes little memory.
    bits: Option<Vec<u64>>,
}

impl IndexSet {
    pub(crate) fn new(indices: BTreeSet<u32>) -> Self {
        let words = indices.last().map_or(0, |last| *last as usize / 64 + 1);
        let bits = (words <= MAX_WORDS * indices.len()).then(|| {
            let mut bits = vec![0; words];
            indices.iter().for_each(|index| bits[*index as usize / 64] |= 1 << (index % 64));
            bits
        });
        Self { indices, bits }
    }

    pub(crate) fn indices(&self) -> &BTreeSet<u32> {
        &self.indices
    }

    pub(crate) fn contains(&self, index: u32) -> bool {
        match &self.bits {
            Some(bits) => bits.get(index as usize / 64).is_some_and(|word| word >> (index % 64) & 1 == 1),
            None => self.indices.contains(&index),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_has_its_indices_and_no_others() {
        for indices in [vec![], vec![0], vec![63, 64, 65, 200], vec![5, u32::MAX]] {
            let set = IndexSet::new(indices.iter().copied().collect());
            assert_eq!(set.bits.is_some(), indices.last() != Some(&u32::MAX));
            for index in (0..300).chain([u32::MAX - 1, u32::MAX]) {
                assert_eq!(set.contains(index), indices.contains(&index), "{index} of {indices:?}");
            }
        }
    }
}
