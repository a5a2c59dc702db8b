//! Limit on the rate at which one address may start sessions: a token bucket per address. It bounds short sessions, of
//! which few are open at once.
//!
//! A bucket is stored as the time at which it will be full again: the generic cell rate algorithm (ITU-T I.371,
//! annex A), which admits what a token bucket does. The table is not one of `TokenBucket`s because that time is also the
//! key by which full buckets are dropped and the table is bounded, and because a reload changes the limit of all buckets
//! at once. Full buckets are not stored, so the table holds only addresses that started sessions within 8 seconds.

use std::collections::{BTreeSet, HashMap};
use std::net::IpAddr;
use std::num::NonZeroU32;
use std::str::FromStr;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use lodestream_protocol::Time;

use crate::limits::invalid_setting::InvalidSetting;
use crate::limits::pre_auth_pool::AddressBlock;

/// Time in which an empty bucket fills.
const REFILL_TIME: Duration = Duration::from_secs(8);
/// Least default burst; otherwise it is the number of sessions that an address may have.
const MIN_DEFAULT_BURST: u32 = 32;
/// Most buckets in the table, about 100 bytes each. Beyond that the fullest bucket is dropped.
const MAX_BUCKETS: usize = 16_384;

/// Sessions that one address (IPv6: one /64 network) may start at once; an eighth of them is refilled per second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionRateLimit {
    /// A burst of this many sessions.
    Burst(NonZeroU32),
    /// No limit.
    Unlimited,
}

impl SessionRateLimit {
    /// The default for an address that may have `sessions` sessions.
    pub(crate) fn default_for(sessions: u64) -> Self {
        let burst = u32::try_from(sessions).unwrap_or(u32::MAX).max(MIN_DEFAULT_BURST);
        NonZeroU32::new(burst).map_or(Self::Unlimited, Self::Burst)
    }
}

impl FromStr for SessionRateLimit {
    type Err = InvalidSetting;

    /// Parses a number from 1 up, or `off`.
    fn from_str(text: &str) -> Result<Self, InvalidSetting> {
        if text.eq_ignore_ascii_case("off") {
            return Ok(Self::Unlimited);
        }
        let expected = |_| InvalidSetting::new(text, "a number of sessions", "for example 32, or off");
        text.parse().map(Self::Burst).map_err(expected)
    }
}

/// The token buckets of all addresses.
#[derive(Debug)]
pub(crate) struct SessionRateLimiter {
    table: Mutex<Table>,
}

#[derive(Debug)]
struct Table {
    limit: SessionRateLimit,
    /// Time at which each bucket will be full.
    full_at: HashMap<AddressBlock, Time>,
    /// The same in order, the fullest bucket first.
    order: BTreeSet<(Time, AddressBlock)>,
}

impl Table {
    fn drop_fullest(&mut self) {
        if let Some((_, block)) = self.order.pop_first() {
            self.full_at.remove(&block);
        }
    }

    fn store(&mut self, block: AddressBlock, full_at: Time) {
        if let Some(before) = self.full_at.insert(block, full_at) {
            self.order.remove(&(before, block));
        } else if self.full_at.len() > MAX_BUCKETS {
            self.drop_fullest();
        }
        self.order.insert((full_at, block));
    }
}

impl SessionRateLimiter {
    /// A table of full buckets.
    pub(crate) fn new(limit: SessionRateLimit) -> Self {
        let table = Table { limit, full_at: HashMap::new(), order: BTreeSet::new() };
        Self { table: Mutex::new(table) }
    }

    /// Changes the limit. The times at which buckets will be full stay.
    pub(crate) fn set(&self, limit: SessionRateLimit) {
        self.table().limit = limit;
    }

    // A thread that panics with the lock loses one bucket at worst.
    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Time at which the bucket will be full if a session starts now; `None` without a token.
    fn full_at_after(table: &Table, burst: NonZeroU32, block: AddressBlock, now: Time) -> Option<Time> {
        let token = REFILL_TIME / burst.get();
        let full_at = table.full_at.get(&block).map_or(now, |full_at| (*full_at).max(now));
        (full_at.since(now) <= token * (burst.get() - 1)).then(|| full_at + token)
    }

    /// Whether an address may start a session; takes no token.
    pub(crate) fn check(&self, address: IpAddr, now: Time) -> bool {
        let table = self.table();
        match table.limit {
            SessionRateLimit::Unlimited => true,
            SessionRateLimit::Burst(n) => {
                Self::full_at_after(&table, n, AddressBlock::of(address), now).is_some()
            }
        }
    }

    /// Takes a token of an address; returns whether there was one.
    pub(crate) fn take(&self, address: IpAddr, now: Time) -> bool {
        let block = AddressBlock::of(address);
        let mut table = self.table();
        let SessionRateLimit::Burst(burst) = table.limit else { return true };
        while table.order.first().is_some_and(|(full_at, _)| *full_at <= now) {
            table.drop_fullest();
        }
        let after = Self::full_at_after(&table, burst, block, now);
        if let Some(full_at) = after {
            table.store(block, full_at);
        }
        after.is_some()
    }

    /// Number of buckets in the table.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        let table = self.table();
        assert_eq!(table.full_at.len(), table.order.len());
        table.order.len()
    }
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, Ipv6Addr};

    use super::*;

    fn ip(n: u32) -> IpAddr {
        Ipv4Addr::from_bits(0x0a00_0000 + n).into()
    }

    fn of(burst: u32) -> SessionRateLimiter {
        SessionRateLimiter::new(SessionRateLimit::Burst(NonZeroU32::new(burst).unwrap()))
    }

    fn taken(limiter: &SessionRateLimiter, address: IpAddr, now: Time) -> usize {
        (0..1000).filter(|_| limiter.take(address, now)).count()
    }

    #[test]
    fn an_address_may_start_a_burst_and_then_an_eighth_of_it_per_second() {
        let limiter = of(32);
        assert_eq!(taken(&limiter, ip(1), Time::from_ms(5)), 32);
        assert!(!limiter.check(ip(1), Time::from_ms(254)) && limiter.check(ip(1), Time::from_ms(255)));
        assert_eq!(taken(&limiter, ip(1), Time::from_ms(1005)), 4);
        assert_eq!(taken(&limiter, ip(1), Time::from_ms(3005)), 8);
        // A longer pause saves no more than the burst.
        assert_eq!(taken(&limiter, ip(1), Time::from_ms(3_600_000)), 32);
        assert_eq!(taken(&limiter, ip(2), Time::from_ms(3_600_000)), 32, "of each address");
        for burst in [1, 3, 125] {
            assert_eq!(taken(&of(burst), ip(1), Time::ZERO), burst as usize);
        }
        assert_eq!(taken(&SessionRateLimiter::new(SessionRateLimit::Unlimited), ip(1), Time::ZERO), 1000);
    }

    #[test]
    fn a_64_bit_network_has_one_bucket() {
        let limiter = of(32);
        let address = |n: u128| IpAddr::from(Ipv6Addr::from_bits((0x2001_0db8_0001_0002_u128 << 64) + n));
        assert_eq!((0..100).filter(|n| limiter.take(address(*n), Time::ZERO)).count(), 32);
    }

    #[test]
    fn the_table_is_bounded_and_drops_the_fullest_buckets() {
        let limiter = of(32);
        assert_eq!(taken(&limiter, ip(0), Time::ZERO), 32);
        for n in 1..100_000 {
            assert!(limiter.take(ip(n), Time::ZERO));
            assert!(limiter.len() <= MAX_BUCKETS);
        }
        assert!(!limiter.check(ip(0), Time::ZERO), "new addresses do not displace an empty bucket");
        assert!(limiter.take(ip(1), Time::from_ms(8_000)));
        assert_eq!(limiter.len(), 1, "full buckets are not stored");
    }

    #[test]
    fn limits_are_parsed() {
        assert_eq!("off".parse(), Ok(SessionRateLimit::Unlimited));
        assert_eq!("40".parse(), Ok(SessionRateLimit::default_for(40)));
        assert_eq!(
            SessionRateLimit::default_for(8),
            SessionRateLimit::default_for(32),
            "at least 32, since pages are reloaded"
        );
        for text in ["0", "-1", "", "many", "4294967296"] {
            let why = text.parse::<SessionRateLimit>().unwrap_err().to_string();
            assert!(why.contains("write for example 32"), "{why}");
        }
    }
}
