//! Tests against theoretical values.

use super::*;

const MS: u64 = 1_000_000;

fn settings(rate: u64, loss: f64) -> LinkSettings {
    let rate = NonZeroU64::new(rate).unwrap();
    LinkSettings {
        loss: Loss::Random(loss),
        ..LinkSettings::constant(rate, 25 * MS, 64 * 1024, IP_UDP_BYTES)
    }
}

#[test]
fn packets_arrive_at_the_computed_times() {
    // At 2 Mbit/s a byte takes 4 µs. Three packets of 1,000 bytes with headers at once, and one on the idle link.
    let mut link = Link::new(settings(2_000_000, 0.0), 1);
    for i in 1..=3 {
        assert_eq!(link.offer(0, 972), Fate::Arrives { at_ns: i * 4 * MS + 25 * MS });
    }
    assert_eq!(link.backlog_bytes(0), 3000);
    assert_eq!(link.backlog_bytes(5 * MS), 1750);
    assert_eq!(link.offer(20 * MS, 472), Fate::Arrives { at_ns: 20 * MS + 2 * MS + 25 * MS });
    assert_eq!(link.counters().arrived_payload_bytes, 3 * 972 + 472);
}

#[test]
fn rates_that_do_not_divide_a_nanosecond_do_not_drift() {
    // 300,000 packets of 1,000 bytes at 7 Mbit/s, offered as fast as they are sent.
    let mut link = Link::new(settings(7_000_000, 0.0), 1);
    let mut last = 0;
    for i in 0..300_000u64 {
        let Fate::Arrives { at_ns } = link.offer(i * 8_000_000 / 7, 972) else { panic!("{i}") };
        last = at_ns;
    }
    assert_eq!(last, (300_000u64 * 8_000_000).div_ceil(7) + 25 * MS);
}

#[test]
fn the_queue_drops_its_tail_and_drains_at_the_rate() {
    let mut link = Link::new(settings(2_000_000, 0.0), 1);
    let taken = (0..100).filter(|_| link.offer(0, 1472) != Fate::QueueFull).count();
    assert_eq!(taken, 64 * 1024 / 1500);
    assert_eq!(link.counters().queue_full, 100 - taken as u64);
    // One packet's time later there is room for one packet.
    assert!(matches!(link.offer(6 * MS, 1472), Fate::Arrives { .. }));
    assert_eq!(link.offer(6 * MS, 1472), Fate::QueueFull);
    assert!(link.counters().longest_queue_bytes <= 64 * 1024);
}

#[test]
fn an_idle_link_takes_a_packet_without_any_queue() {
    let mut link = Link::new(LinkSettings { queue_bytes: 0, ..settings(8_000_000, 0.0) }, 1);
    assert!(matches!(link.offer(0, 972), Fate::Arrives { .. }));
    assert_eq!(link.offer(0, 0), Fate::QueueFull);
    assert!(matches!(link.offer(MS, 972), Fate::Arrives { .. }));
}

#[test]
fn packets_above_the_mtu_do_not_pass() {
    for mtu_bytes in [600, 1500, 9000] {
        let mut link = Link::new(LinkSettings { mtu_bytes, ..settings(8_000_000, 0.0) }, 1);
        let most = (mtu_bytes - IP_UDP_BYTES) as usize;
        assert_eq!(link.offer(0, most + 1), Fate::TooBig);
        assert_eq!(link.backlog_bytes(0), 0, "what does not pass takes no time");
        assert_eq!(link.offer(0, most), Fate::Arrives { at_ns: u64::from(mtu_bytes) * 1000 + 25 * MS });
        assert_eq!((link.counters().too_big, link.counters().arrived), (1, 1));
    }
}

#[test]
fn loss_is_near_its_nominal_rate_and_takes_up_the_link() {
    for (loss, seed) in [(0.01, 1), (0.01, 2), (0.3, 3)] {
        let mut link = Link::new(settings(1_000_000_000, loss), seed);
        let packets = 200_000u64;
        for i in 0..packets {
            link.offer(i * 8_000, 972);
        }
        let found = link.counters().lost as f64 / packets as f64;
        // Four standard deviations of a binomial distribution.
        let slack = 4.0 * (loss * (1.0 - loss) / packets as f64).sqrt();
        assert!((found - loss).abs() < slack, "{found} for {loss}");
        assert_eq!(link.backlog_bytes((packets - 1) * 8_000), 1000);
    }
}

#[test]
fn loss_depends_on_the_seed_alone() {
    let fates = |seed, gap| {
        let mut link = Link::new(settings(2_000_000, 0.1), seed);
        (0..1000u64).map(|i| link.offer(i * gap, 972) == Fate::Lost).collect::<Vec<_>>()
    };
    assert_eq!(fates(5, 10 * MS), fates(5, 4 * MS));
    assert_ne!(fates(5, 10 * MS), fates(6, 10 * MS));
}

fn arrival(fate: Fate) -> u64 {
    let Fate::Arrives { at_ns } = fate else { panic!("{fate:?}") };
    at_ns
}

#[test]
fn packets_that_cross_a_step_take_both_rates() {
    // A byte takes 4 µs until 10 ms, none passes until 30 ms, then it takes 16 µs.
    let rate = Rate::steps(&[(0, 2_000_000), (10 * MS, 0), (30 * MS, 500_000)]).unwrap();
    let mut link = Link::new(LinkSettings { rate, ..settings(1, 0.0) }, 1);
    let sent: Vec<u64> = (0..4).map(|_| arrival(link.offer(0, 972)) - 25 * MS).collect();
    // 4 and 8 ms; half of the third passes in the remaining 2 ms, the rest takes 8 ms after the outage.
    assert_eq!(sent, [4 * MS, 8 * MS, 38 * MS, 54 * MS]);
    assert_eq!(
        [0, 9, 10, 29, 31, 38].map(|ms| link.backlog_bytes(ms * MS)),
        [4000, 1750, 1500, 1500, 1438, 1000]
    );
    assert_eq!(link.idle_from_ns(), 54 * MS);
}

#[test]
fn a_changing_rate_does_not_drift() {
    // 3 and 7 Mbit/s in turn, every second, always busy: after 100 s exactly 500 Mbit have passed, which
    // are 62,500 packets of 1,000 bytes.
    let rate = Rate::trace(&[3_000_000, 7_000_000], AtEnd::Repeat).unwrap();
    let mut link = Link::new(LinkSettings { rate, queue_bytes: 1 << 30, ..settings(1, 0.0) }, 1);
    let mut last = 0;
    for _ in 0..62_500 {
        last = arrival(link.offer(0, 972));
    }
    assert_eq!(last, 100 * NS_PER_S + 25 * MS);
}

/// Arrival times of packets that are sent a millisecond apart, with up to 20 ms of jitter.
fn jittered(reorders: bool, loss: f64) -> Vec<Option<u64>> {
    let jitter = Jitter { largest_ns: 20 * MS, reorders };
    let mut link = Link::new(LinkSettings { jitter, ..settings(1_000_000_000, loss) }, 4);
    (0..20_000)
        .map(|i| match link.offer(i * MS, 972) {
            Fate::Arrives { at_ns } => Some(at_ns),
            _ => None,
        })
        .collect()
}

#[test]
fn jitter_is_uniform_and_reorders_only_if_allowed() {
    let free: Vec<u64> = jittered(true, 0.0).into_iter().flatten().collect();
    // 8 µs on the link, 25 ms of delay, and the jitter.
    let added: Vec<u64> = free.iter().zip(0..).map(|(at_ns, i)| at_ns - i * MS - 25 * MS - 8_000).collect();
    assert!(added.iter().all(|&ns| ns <= 20 * MS));
    let mean = added.iter().sum::<u64>() as f64 / added.len() as f64;
    // Four standard deviations of the mean of an even distribution (width / √12).
    let slack = 4.0 * 20e6 / (12.0 * added.len() as f64).sqrt();
    assert!((mean - 10e6).abs() < slack, "{mean} ± {slack}");
    assert!(!free.is_sorted());

    // In order, a packet arrives at the latest unordered arrival time of it and those before it.
    let kept: Vec<u64> = jittered(false, 0.0).into_iter().flatten().collect();
    let latest = free.iter().scan(0, |latest: &mut u64, &at_ns| {
        *latest = at_ns.max(*latest);
        Some(*latest)
    });
    assert!(kept.is_sorted());
    assert_eq!(kept, latest.collect::<Vec<_>>());
}

#[test]
fn jitter_and_loss_do_not_change_each_other() {
    let (without, with) = (jittered(true, 0.0), jittered(true, 0.1));
    let lost = with.iter().filter(|at| at.is_none()).count();
    assert!((1800..2200).contains(&lost), "{lost}");
    assert!(with.iter().zip(&without).all(|(a, b)| a.is_none() || a == b));
    let mut smooth = Link::new(settings(1_000_000_000, 0.1), 4);
    let smooth: Vec<bool> = (0..20_000).map(|i| smooth.offer(i * MS, 972) == Fate::Lost).collect();
    assert_eq!(smooth, with.iter().map(Option::is_none).collect::<Vec<_>>());
}

#[test]
fn lost_packets_in_bursts_take_up_the_link_too() {
    let channel = GilbertElliott { to_bad: 0.05, to_good: 0.2, loss_good: 0.0, loss_bad: 1.0 };
    let loss = Loss::Burst(channel);
    let mut link = Link::new(LinkSettings { loss, queue_bytes: 1 << 40, ..settings(8_000_000, 0.0) }, 9);
    let fates: Vec<Fate> = (0..10_000).map(|_| link.offer(0, 972)).collect();
    let lost = fates.iter().filter(|fate| **fate == Fate::Lost).count();
    // A fifth of the packets, in bursts of five: four standard deviations, as in the loss model's test.
    assert!((lost as f64 - 2000.0).abs() < 4.0 * (400.0 * 45.0_f64).sqrt(), "{lost}");
    assert_eq!(link.idle_from_ns(), 10_000 * MS);
}

#[test]
fn a_queue_never_holds_more_than_its_bytes() {
    use rand::{Rng, SeedableRng};
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(3);
    for queue_bytes in [1500, 4000, 65_536] {
        let rate = Rate::trace(&[1_000_000, 0, 3_333_333], AtEnd::Repeat).unwrap();
        let mut link = Link::new(LinkSettings { rate, queue_bytes, ..settings(1, 0.0) }, 1);
        let mut now_ns = 0;
        for _ in 0..20_000 {
            now_ns += random.random_range(0..6 * MS);
            let before = link.backlog_bytes(now_ns);
            let payload = random.random_range(0..=1472);
            let fate = link.offer(now_ns, payload);
            let wire = payload as u64 + u64::from(IP_UDP_BYTES);
            let fits = before == 0 || before + wire <= queue_bytes;
            assert_eq!(fate == Fate::QueueFull, !fits, "{before} + {wire} of {queue_bytes}");
            // Rounding up may exceed it by one byte.
            assert!(link.backlog_bytes(now_ns) <= queue_bytes);
        }
        let counters = link.counters();
        assert!(
            counters.longest_queue_bytes <= queue_bytes && counters.longest_queue_bytes > queue_bytes / 2
        );
        assert!(counters.queue_full > 100 && counters.arrived > 100, "{counters:?}");
    }
}
