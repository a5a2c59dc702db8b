//! Packet loss: independent, or in bursts.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Model of packet loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Independent, with this probability per packet.
    Random(f64),
    /// In bursts.
    Burst(GilbertElliott),
}

impl Loss {
    /// No loss.
    pub const NONE: Self = Self::Random(0.0);

    /// Long-run share of lost packets.
    #[must_use]
    pub fn long_run(&self) -> f64 {
        match self {
            Self::Random(loss) => *loss,
            Self::Burst(model) => model.long_run_loss(),
        }
    }
}

/// Gilbert–Elliott channel of two states (E. N. Gilbert, "Capacity of a burst-noise channel", 1960; E. O. Elliott,
/// "Estimates of error rates for codes on burst-noise channels", 1963), one step per packet. The state does not change
/// while nothing is sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GilbertElliott {
    /// Probability, per packet, that a good channel turns bad.
    pub to_bad: f64,
    /// Probability, per packet, that a bad channel turns good.
    pub to_good: f64,
    /// Probability that a packet is lost while the channel is good.
    pub loss_good: f64,
    /// Probability that a packet is lost while the channel is bad.
    pub loss_bad: f64,
}

impl GilbertElliott {
    /// Share of time in the bad state: `to_bad / (to_bad + to_good)`.
    #[must_use]
    pub fn bad_share(&self) -> f64 {
        let both = self.to_bad + self.to_good;
        if both > 0.0 { self.to_bad / both } else { 0.0 }
    }

    /// Share of lost packets: the states' losses weighted by their shares of time.
    #[must_use]
    pub fn long_run_loss(&self) -> f64 {
        let bad = self.bad_share();
        bad * self.loss_bad + (1.0 - bad) * self.loss_good
    }

    /// Mean number of packets per visit to the bad state: `1 / to_good`. If all packets are lost there and none
    /// elsewhere, this is the mean burst length.
    #[must_use]
    pub fn mean_bad_packets(&self) -> f64 {
        1.0 / self.to_good
    }
}

/// Generates the losses of successive packets.
#[derive(Clone, Debug)]
pub(super) struct Losses {
    model: Loss,
    random: Pcg64Mcg,
    bad: bool,
}

impl Losses {
    /// Starts in a random state with the long-run shares, so that the first packet is lost as often as any other.
    pub(super) fn new(model: Loss, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let bad = match model {
            Loss::Random(_) => false,
            Loss::Burst(channel) => random.random::<f64>() < channel.bad_share(),
        };
        Self { model, random, bad }
    }

    /// Whether the next packet is lost if it is sent. Must be called for every packet, whatever its fate, so that
    /// losses depend only on the place in the sequence.
    pub(super) fn next_is_lost(&mut self) -> bool {
        let drawn = self.random.random::<f64>();
        match self.model {
            Loss::Random(loss) => drawn < loss,
            Loss::Burst(channel) => {
                let (loss, turn) = if self.bad {
                    (channel.loss_bad, channel.to_good)
                } else {
                    (channel.loss_good, channel.to_bad)
                };
                self.bad ^= self.random.random::<f64>() < turn;
                drawn < loss
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKETS: usize = 400_000;

    fn draw(model: GilbertElliott, seed: u64) -> Vec<bool> {
        let mut losses = Losses::new(Loss::Burst(model), seed);
        (0..PACKETS).map(|_| losses.next_is_lost()).collect()
    }

    fn share(lost: &[bool]) -> f64 {
        lost.iter().filter(|lost| **lost).count() as f64 / lost.len() as f64
    }

    #[test]
    fn bursts_have_the_loss_and_the_length_of_the_formulas() {
        // 0.01 / (0.01 + 0.25) = 1/26 of the packets, in bursts of 4.
        let model = GilbertElliott { to_bad: 0.01, to_good: 0.25, loss_good: 0.0, loss_bad: 1.0 };
        assert!((model.long_run_loss() - 1.0 / 26.0).abs() < 1e-12);
        assert!((model.mean_bad_packets() - 4.0).abs() < 1e-12);
        for seed in 1..=3 {
            let lost = draw(model, seed);
            let bursts: Vec<usize> =
                lost.chunk_by(|a, b| a == b).filter(|run| run[0]).map(<[bool]>::len).collect();
            let mean = bursts.iter().sum::<usize>() as f64 / bursts.len() as f64;
            // Four standard deviations. A geometric length with mean m has the variance m (m − 1); the
            // number of losses that of the number of bursts times (m² + m (m − 1)), nearly.
            let count = bursts.len() as f64;
            assert!((mean - 4.0).abs() < 4.0 * (12.0 / count).sqrt(), "{mean} over {count} bursts");
            let slack = 4.0 * (count * (16.0 + 12.0)).sqrt() / PACKETS as f64;
            assert!((share(&lost) - 1.0 / 26.0).abs() < slack, "{} ± {slack}", share(&lost));
        }
    }

    #[test]
    fn both_states_may_lose_some() {
        // Half of the time each: 0.5 × 0.02 + 0.5 × 0.3.
        let model = GilbertElliott { to_bad: 0.1, to_good: 0.1, loss_good: 0.02, loss_bad: 0.3 };
        assert!((model.long_run_loss() - 0.16).abs() < 1e-12);
        let found = share(&draw(model, 5));
        // Losses of one state are correlated over 1 / (0.1 + 0.1) packets: 0.16 × 0.84 + 2 × 5 × 0.14² / 4 …
        // is below 0.2 per packet; four standard deviations of that.
        assert!((found - 0.16).abs() < 4.0 * (0.2 / PACKETS as f64).sqrt(), "{found}");
    }

    #[test]
    fn a_channel_that_never_turns_stays_good() {
        let model = GilbertElliott { to_bad: 0.0, to_good: 0.0, loss_good: 0.0, loss_bad: 1.0 };
        assert_eq!(model.long_run_loss(), 0.0);
        assert!(!draw(model, 1).contains(&true));
    }

    #[test]
    fn the_first_packet_is_lost_as_often_as_any() {
        let model = GilbertElliott { to_bad: 0.2, to_good: 0.6, loss_good: 0.0, loss_bad: 1.0 };
        let first = |seed| Losses::new(Loss::Burst(model), seed).next_is_lost();
        let found = share(&(0..20_000).map(first).collect::<Vec<_>>());
        assert!((found - 0.25).abs() < 4.0 * (0.25 * 0.75 / 20_000.0_f64).sqrt(), "{found}");
    }
}
