//! A set of ids that numbers its members in ascending order: two bits for each id that there could be, where a map of
//! numbers would take thirty-two (Jacobson, "Space-efficient static trees and graphs", 1989: rank).

const BITS: usize = u64::BITS as usize;

/// Ids below a bound, and how many lie below each.
#[derive(Clone, Debug, Default)]
pub(crate) struct IdSet {
    words: Vec<u64>,
    /// By word, the members in the words before it.
    before: Vec<u32>,
}

impl IdSet {
    /// The given ids, in any order, some perhaps more than once; all below `bound`.
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

    /// The number of a member: how many are less. `None` for what is none.
    pub(crate) fn number(&self, id: u32) -> Option<u32> {
        let (word, bit) = (id as usize / BITS, id as usize % BITS);
        let bits = *self.words.get(word)?;
        (bits >> bit & 1 == 1).then(|| self.before[word] + (bits & ((1 << bit) - 1)).count_ones())
    }

    /// How many members there are.
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
    fn members_are_numbered_from_the_least_and_others_have_no_number() {
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
