//! A set of ids with rank queries: two bits per possible id, where a map to numbers would take 32 (Jacobson,
//! "Space-efficient static trees and graphs", 1989).

const BITS: usize = u64::BITS as usize;

/// A bit set with the rank at each word.
#[derive(Clone, Debug, Default)]
pub(crate) struct IdSet {
    words: Vec<u64>,
    /// Number of members before each word.
    before: Vec<u32>,
}

impl IdSet {
    /// The given ids, in any order, duplicates allowed; all below `bound`.
    pub(crate) fn new(bound: usize, ids: impl Iterator<Item = u32>) -> Self {
        let mut words = vec![0_u64; bound.div_ceil(BITS)];
        ids.for_each(|id| words[id as usize / BITS] |= 1 << (id as usize % BITS));
        let mut count = 0;
        let before = words.iter().map(|word| {
            let before = count;
            count += word.count_ones();
            before
        });
        Self { before: before.collect(), words }
    }

    /// The rank of a member (the number of smaller members); `None` for others.
    pub(crate) fn number(&self, id: u32) -> Option<u32> {
        let (word, bit) = (id as usize / BITS, id as usize % BITS);
        let bits = *self.words.get(word)?;
        (bits >> bit & 1 == 1).then(|| self.before[word] + (bits & ((1 << bit) - 1)).count_ones())
    }

    /// Number of members.
    pub(crate) fn len(&self) -> usize {
        match (self.before.last(), self.words.last()) {
            (Some(&before), Some(word)) => (before + word.count_ones()) as usize,
            _ => 0,
        }
    }

    /// The members, ascending.
    pub(crate) fn iter(&self) -> impl Iterator<Item = u32> {
        (0_u32..).zip(&self.words).flat_map(|(word, &bits)| {
            let mut left = bits;
            std::iter::from_fn(move || {
                let bit = left.trailing_zeros();
                left &= left.wrapping_sub(1);
                (bit < u64::BITS).then(|| word * u64::BITS + bit)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rank_counts_smaller_members() {
        let ids = [70_u32, 3, 3, 199, 64, 63, 127];
        let set = IdSet::new(200, ids.into_iter());
        let sorted = [3, 63, 64, 70, 127, 199];
        assert_eq!((set.iter().collect::<Vec<u32>>(), set.len()), (sorted.to_vec(), 6));
        for (number, id) in (0..).zip(sorted) {
            assert_eq!(set.number(id), Some(number));
        }
        assert_eq!([0, 62, 65, 198, 100_000].map(|id| set.number(id)), [None; 5]);
        let none = IdSet::new(0, std::iter::empty());
        assert_eq!((none.iter().count(), none.len()), (0, 0));
    }
}
