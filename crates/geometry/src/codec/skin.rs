//! Coding of the skin of a new vertex: which joints move it, and their weights, predicted from its neighbours'.

use crate::codec::model::{
    JOINT_BITS, MAX_EXPECTED, SKIN_ANOTHER, SKIN_JOINT, SKIN_PRESENT, SKIN_SAME, SKIN_WEIGHT, WEIGHT_CLASSES,
};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::{INTEGER_CONTEXTS, signed, tree};
use crate::error::DecodeError;
use crate::mesh::skin::{MAX_INFLUENCES, Skin, WHOLE};

/// What a vertex's neighbours let expect of its skin.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ExpectedSkin {
    /// The skin of the nearest neighbour.
    near: Skin,
    /// Joints of the neighbours with the sums of their weights.
    sums: [(u8, u32); MAX_EXPECTED],
    count: usize,
}

impl ExpectedSkin {
    /// Expects something like `near`.
    pub(crate) fn near(near: Skin) -> Self {
        let mut expected = Self { near, ..Self::default() };
        expected.add(near);
        expected
    }

    /// Adds a neighbour. Joints beyond the first eight are left out.
    pub(crate) fn add(&mut self, skin: Skin) {
        for (joint, weight) in skin.influences() {
            let at = self.sums[..self.count].iter().position(|sum| sum.0 == joint).unwrap_or(self.count);
            if at < MAX_EXPECTED {
                self.sums[at] = (joint, self.sums[at].1 + u32::from(weight));
                self.count = self.count.max(at + 1);
            }
        }
    }

    /// The expected joints with their weights, largest first; weights have a sum of at most [`WHOLE`].
    fn sorted(&self) -> ([(u8, u32); MAX_EXPECTED], usize) {
        let mut sorted = self.sums;
        let known = &mut sorted[..self.count];
        known.sort_unstable_by_key(|&(joint, weight)| (u32::MAX - weight, joint));
        let total = known.iter().map(|sum| sum.1).sum::<u32>().max(1);
        known.iter_mut().for_each(|(_, weight)| *weight = *weight * u32::from(WHOLE) / total);
        (sorted, self.count)
    }
}

/// Codes a skin: whether it is the nearest neighbour's; else for each expected joint whether it has it, then other joints,
/// then all weights but the last.
pub(crate) fn code_skin<C: Coder>(
    coder: &mut C,
    expected: &ExpectedSkin,
    want: Option<Skin>,
) -> Result<Skin, DecodeError> {
    if coder.bit(SKIN_SAME, want.is_none_or(|want| want == expected.near)) {
        return Ok(expected.near);
    }
    let weight_of = |joint: u8| want?.influences().find(|own| own.0 == joint).map(|own| own.1);
    let mut found = [(0_u8, 0_u32); MAX_INFLUENCES];
    let mut count = 0;
    let (sorted, known) = expected.sorted();
    for (rank, &(joint, weight)) in sorted[..known].iter().enumerate() {
        if count == MAX_INFLUENCES {
            break;
        }
        let class = weight as usize * WEIGHT_CLASSES / (usize::from(WHOLE) + 1);
        if coder.bit(SKIN_PRESENT + rank * WEIGHT_CLASSES + class, weight_of(joint).is_some()) {
            found[count] = (joint, weight);
            count += 1;
        }
    }
    let mut others = want.into_iter().flat_map(Skin::influences).map(|own| own.0);
    while count < MAX_INFLUENCES {
        let known = |joint: u8| found[..count].iter().any(|f| f.0 == joint);
        let other = others.find(|&joint| !known(joint));
        if !coder.bit(SKIN_ANOTHER + count, other.is_some()) {
            break;
        }
        let got = tree(coder, SKIN_JOINT, JOINT_BITS, u32::from(other.unwrap_or(0)));
        let joint = u8::try_from(got).map_err(|_| DecodeError::new("skin", "a joint is out of range"))?;
        if known(joint) {
            return Err(DecodeError::new("skin", "a joint occurs twice"));
        }
        found[count] = (joint, 0);
        count += 1;
    }
    let total = found[..count].iter().map(|f| f.1).sum::<u32>().max(1);
    let mut rest = i32::from(WHOLE);
    let mut weights = [0_u8; MAX_INFLUENCES];
    for at in 0..count {
        let (joint, weight) = found[at];
        let weight = if at + 1 == count {
            rest
        } else {
            let guess = (weight * u32::from(WHOLE) / total).cast_signed();
            let residual = weight_of(joint).map_or(0, |own| i32::from(own) - guess);
            guess.wrapping_add(signed(coder, SKIN_WEIGHT + at * INTEGER_CONTEXTS, residual))
        };
        rest = rest.wrapping_sub(weight);
        weights[at] = u8::try_from(weight)
            .ok()
            .filter(|&weight| weight > 0)
            .ok_or_else(|| DecodeError::new("skin", "a weight is out of range"))?;
    }
    Skin::of(found.map(|f| f.0).into_iter().zip(weights).take(count))
        .ok_or_else(|| DecodeError::new("skin", "the weights of a vertex do not add up"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::model::contexts;
    use crate::entropy::range_coder::{Decoder, Encoder};
    use crate::random::Random;

    #[test]
    fn skins_come_back_whatever_was_expected() {
        let mut random = Random::new(3);
        let mut any = |joints: u64| {
            let count = 1 + random.next_u64() % 4;
            let one = |_| ((random.next_u64() % joints) as u8, (1 + random.next_u64() % 99) as f64);
            Skin::new((0..count).map(one).collect::<Vec<_>>())
        };
        let skins: Vec<Skin> = (0..2000).map(|i| any(if i % 3 == 0 { 256 } else { 5 })).collect();
        let expected = |i: usize| {
            let mut expected = ExpectedSkin::near(skins[i.saturating_sub(1)]);
            skins[i.saturating_sub(4)..i].iter().for_each(|&skin| expected.add(skin));
            expected
        };
        let mut encoder = Encoder::new(contexts());
        for (i, &skin) in skins.iter().enumerate() {
            assert_eq!(code_skin(&mut encoder, &expected(i), Some(skin)).unwrap(), skin);
        }
        let bytes = encoder.finish(0);
        let mut decoder = Decoder::new(contexts(), &bytes);
        for (i, &skin) in skins.iter().enumerate() {
            assert_eq!(code_skin(&mut decoder, &expected(i), None).unwrap(), skin, "{i}");
        }
    }

    #[test]
    fn a_skin_that_is_expected_costs_next_to_nothing() {
        let skin = Skin::new([(3, 0.4), (4, 0.6)]);
        let mut encoder = Encoder::new(contexts());
        for _ in 0..1000 {
            code_skin(&mut encoder, &ExpectedSkin::near(skin), Some(skin)).unwrap();
        }
        assert!(encoder.finish(0).len() < 16);
    }
}
