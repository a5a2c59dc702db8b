//! Adaptive probabilities and their logistic mixing. Integer arithmetic only, so all machines agree.

/// Number of observations after which adaptation no longer slows down.
pub const MAX_COUNT: u8 = 120;
/// Most contexts per mixed decision.
pub const MAX_INPUTS: usize = 4;
/// Probabilities stay at least this far (of 65536) from 0 and 1, so every symbol has a bounded, positive cost.
const MARGIN: i32 = 48;
/// Learning rate of mixing weights: weight += stretch × error / 2^this.
const LEARNING_SHIFT: u32 = 17;

/// An adaptive estimate of the probability that a bit is set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prob {
    /// Probability in 65536ths.
    pub p: u16,
    /// Number of observations behind the estimate.
    pub count: u8,
}

impl Default for Prob {
    fn default() -> Self {
        Self { p: 1 << 15, count: 0 }
    }
}

impl Prob {
    /// Moves the estimate towards an observed bit, by 1/(n + 1.5).
    #[inline(always)]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the margins: see the test over all estimates"
    )]
    pub fn update(&mut self, bit: bool) {
        let (p, rate) = (i32::from(self.p), RATE[usize::from(self.count)]);
        // No rate is so small that the opposite bound could be exceeded.
        self.p = if bit {
            (p + (((65535 - p) * rate) >> 15)).min(65536 - MARGIN)
        } else {
            (p + ((-p * rate) >> 15)).max(MARGIN)
        } as u16;
        self.count += u8::from(self.count < MAX_COUNT);
    }
}

/// 2^15 / (n + 1.5).
#[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "below 256")]
const RATE: [i32; 256] = {
    let mut table = [0; 256];
    let mut n = 0;
    while n < 256 {
        table[n] = (1 << 16) / (2 * n as i32 + 3);
        n += 1;
    }
    table
};

/// 65536 / (1 + exp(-x)) for x from -8 to 8 in steps of 1/2.
const LOGISTIC: [i32; 33] = [
    22, 36, 60, 98, 162, 267, 439, 720, 1179, 1921, 3108, 4971, 7812, 11955, 17625, 24743, 32768, 40793,
    47911, 53581, 57724, 60565, 62428, 63615, 64357, 64816, 65097, 65269, 65374, 65438, 65476, 65500, 65514,
];

/// The probability, in 65536ths, of log odds in 256ths from -2048 (`x` 0) to 2047 (`x` 4095): [`LOGISTIC`] interpolated.
/// Computed, since a table of it would be 4 kB of every browser's download.
#[inline(always)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "x is below 4096, values of LOGISTIC are positive"
)]
const fn squash(x: usize) -> u16 {
    let (at, part) = (x / 128, (x % 128) as i32);
    ((LOGISTIC[at] * (128 - part) + LOGISTIC[at + 1] * part) as u32 / 128) as u16
}

/// Inverse of [`squash`]: probabilities in 4096ths to log odds.
#[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "below 4096")]
static STRETCH: [i16; 4096] = {
    let mut table = [0; 4096];
    let (mut p, mut x) = (0_usize, 0_usize);
    while p < 4096 {
        while x < 4095 && (squash(x) as usize) < p * 16 + 8 {
            x += 1;
        }
        table[p] = x as i16 - 2048;
        p += 1;
    }
    table
};

/// All adaptive state of one stream.
#[derive(Clone, Debug)]
pub struct Contexts {
    /// Estimates by context.
    pub probs: Vec<Prob>,
    /// Mixing weights by mixer, in 65536ths.
    pub weights: Vec<[i32; MAX_INPUTS]>,
}

/// A mixed estimate with its inputs, for learning.
pub struct Mixed<const N: usize> {
    /// In 65536ths.
    pub p: u16,
    stretched: [i32; N],
}

impl Contexts {
    /// Parses the bytes of [`Contexts::to_bytes`]: `count` probabilities, then weights.
    ///
    /// # Panics
    /// If there are fewer than `count` probabilities: the table is compiled into the program.
    #[must_use]
    pub fn from_bytes(bytes: &[u8], count: usize) -> Self {
        let (probs, weights) = bytes.split_at(count * 3);
        let prob = |b: &[u8]| Prob { p: u16::from_le_bytes([b[0], b[1]]), count: b[2].min(MAX_COUNT) };
        let weight =
            |b: &[u8], i: usize| i32::from_le_bytes([b[4 * i], b[4 * i + 1], b[4 * i + 2], b[4 * i + 3]]);
        let mixer = |b: &[u8]| std::array::from_fn(|i| weight(b, i));
        Self {
            probs: probs.chunks_exact(3).map(prob).collect(),
            weights: weights.chunks_exact(4 * MAX_INPUTS).map(mixer).collect(),
        }
    }

    /// Serialises the state: three bytes per context, four per weight.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.probs.len() * 3 + self.weights.len() * 4);
        for prob in &self.probs {
            bytes.extend(prob.p.to_le_bytes());
            bytes.push(prob.count);
        }
        for weight in self.weights.as_flattened() {
            bytes.extend(weight.to_le_bytes());
        }
        bytes
    }

    /// The estimates of several contexts, mixed with the weights of `mixer`.
    #[inline(always)]
    #[must_use]
    pub fn mixed<const N: usize>(&self, contexts: [usize; N], mixer: usize) -> Mixed<N> {
        Mixed::of(contexts.map(|context| self.probs[context]), &self.weights[mixer])
    }

    /// Updates the contexts and weights of an estimate with the observed bit.
    #[inline(always)]
    pub fn learn<const N: usize>(&mut self, contexts: [usize; N], mixer: usize, mixed: &Mixed<N>, bit: bool) {
        for context in contexts {
            self.probs[context].update(bit);
        }
        mixed.update_weights(&mut self.weights[mixer], bit);
    }

    /// Two runs of `T` contexts that do not overlap, in ascending order, and the weights of `mixer`.
    #[inline]
    pub fn trees<const T: usize>(&mut self, [a, b]: [usize; 2], mixer: usize) -> Option<Trees<'_, T>> {
        let (low, high) = self.probs.split_at_mut_checked(b)?;
        let trees = [low.get_mut(a..)?.first_chunk_mut()?, high.first_chunk_mut()?];
        Some((trees, self.weights.get_mut(mixer)?))
    }
}

/// Result of [`Contexts::trees`].
pub type Trees<'a, const T: usize> = ([&'a mut [Prob; T]; 2], &'a mut [i32; MAX_INPUTS]);

impl<const N: usize> Mixed<N> {
    /// Mixes estimates with weights.
    #[inline(always)]
    #[must_use]
    pub fn of(probs: [Prob; N], weights: &[i32; MAX_INPUTS]) -> Self {
        let stretched = probs.map(|prob| i32::from(STRETCH[usize::from(prob.p >> 4)]));
        let products = stretched.iter().zip(weights).map(|(&s, &weight)| i64::from(s) * i64::from(weight));
        let x = (products.sum::<i64>() >> 16).clamp(-2047, 2047) + 2048;
        Self { p: squash(usize::try_from(x).unwrap_or(0)), stretched }
    }

    /// Updates the weights with the observed bit.
    #[inline(always)]
    pub fn update_weights(&self, weights: &mut [i32; MAX_INPUTS], bit: bool) {
        let error = (i32::from(bit) << 16) - i32::from(self.p);
        for (weight, s) in weights.iter_mut().zip(self.stretched) {
            // Below 2^11 times 2^16.
            let step = (s * error) >> LEARNING_SHIFT;
            *weight = (*weight + step).clamp(-(1 << 20), 1 << 20);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_estimate_leaves_its_range() {
        for p in 0..=u16::MAX {
            for count in 0..=MAX_COUNT {
                for bit in [false, true] {
                    let mut prob = Prob { p, count };
                    prob.update(bit);
                    let target = 65535 * i32::from(bit);
                    let plain = i32::from(p) + (((target - i32::from(p)) * RATE[usize::from(count)]) >> 15);
                    assert_eq!(i32::from(prob.p), plain.clamp(MARGIN, 65536 - MARGIN), "{p} {count} {bit}");
                    let inside =
                        i32::from(prob.p) <= 65536 - MARGIN && i32::from(prob.p) >= MARGIN.min(p.into());
                    assert!(
                        inside && (bit || prob.p <= p.max(48)) && (!bit || prob.p >= p.min(65488)),
                        "{p} {count} {bit}"
                    );
                }
            }
        }
    }
}
