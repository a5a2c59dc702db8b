//! How often one address may begin sessions: a token bucket for each, so that connections which come and go quickly are
//! bounded too, of which few are there at once.
//!
//! A bucket is one moment, that at which it will be full again: the generic cell rate algorithm (ITU-T I.371, annex A),
//! which admits exactly what a token bucket does. A bucket that is full is nothing to remember, so the table holds only
//! addresses that began sessions lately.

use std::collections::{BTreeSet, HashMap};
use std::net::IpAddr;
use std::num::NonZeroU32;
use std::str::FromStr;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use lodestream_protocol::Time;

use crate::admission::pre_auth_pool::AddressBlock;

/// An empty bucket is full again after so long.
const REFILLED_AFTER: Duration = Duration::from_secs(8);
/// Sessions that one address may begin at once unless that is said: as many as it may have, and at least so many.
const AT_ONCE_LEAST: u32 = 32;
/// Addresses whose buckets are remembered, about 100 bytes each. Beyond them the fullest bucket is forgotten.
const MAX_REMEMBERED: usize = 16_384;

/// How many sessions one address (of IPv6: one network of 64 bits) may begin at once; an eighth of that is given back
/// each second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionRateLimit {
    /// So many.
    AtOnce(NonZeroU32),
    /// As many as it likes.
    Unlimited,
}

impl SessionRateLimit {
    /// What holds where nobody says so, of an address that may have so many sessions.
    pub(crate) fn of_places(places: u64) -> Self {
        let at_once = u32::try_from(places).unwrap_or(u32::MAX).max(AT_ONCE_LEAST);
        NonZeroU32::new(at_once).map_or(Self::Unlimited, Self::AtOnce)
    }
}

impl FromStr for SessionRateLimit {
    type Err = String;

    /// Reads a number from 1, or `off`.
    fn from_str(text: &str) -> Result<Self, String> {
        if text.eq_ignore_ascii_case("off") {
            return Ok(Self::Unlimited);
        }
        let expected = |_| format!("{text:?} is no number of sessions: write for example 32, or off");
        text.parse().map(Self::AtOnce).map_err(expected)
    }
}

/// See the module.
#[derive(Debug)]
pub(crate) struct SessionRateLimiter {
    table: Mutex<Table>,
}

#[derive(Debug)]
struct Table {
    limit: SessionRateLimit,
    /// When each bucket will be full.
    full_at: HashMap<AddressBlock, Time>,
    /// The same, the fullest first.
    order: BTreeSet<(Time, AddressBlock)>,
}

impl Table {
    fn forget_first(&mut self) {
        if let Some((_, block)) = self.order.pop_first() {
            self.full_at.remove(&block);
        }
    }

    fn remember(&mut self, block: AddressBlock, full_at: Time) {
        if let Some(before) = self.full_at.insert(block, full_at) {
            self.order.remove(&(before, block));
        } else if self.full_at.len() > MAX_REMEMBERED {
            self.forget_first();
        }
        self.order.insert((full_at, block));
    }
}

impl SessionRateLimiter {
    /// With all buckets full.
    pub(crate) fn new(limit: SessionRateLimit) -> Self {
        let table = Table { limit, full_at: HashMap::new(), order: BTreeSet::new() };
        Self { table: Mutex::new(table) }
    }

    /// With this limit from now on. Buckets are full when they would have been.
    pub(crate) fn set(&self, limit: SessionRateLimit) {
        self.table().limit = limit;
    }

    /// A thread that panicked while it held the lock left at worst one bucket forgotten.
    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// When the bucket is full again if a session begins now; `None` where there is no token.
    fn after(table: &Table, at_once: NonZeroU32, block: AddressBlock, now: Time) -> Option<Time> {
        let token = REFILLED_AFTER / at_once.get();
        let full_at = table.full_at.get(&block).map_or(now, |full_at| (*full_at).max(now));
        (full_at.since(now) <= token * (at_once.get() - 1)).then(|| full_at + token)
    }

    /// Whether an address may begin a session; nothing is taken.
    pub(crate) fn check(&self, address: IpAddr, now: Time) -> bool {
        let table = self.table();
        match table.limit {
            SessionRateLimit::Unlimited => true,
            SessionRateLimit::AtOnce(n) => Self::after(&table, n, AddressBlock::of(address), now).is_some(),
        }
    }

    /// Takes a token of an address that begins a session; whether there was one.
    pub(crate) fn take(&self, address: IpAddr, now: Time) -> bool {
        let block = AddressBlock::of(address);
        let mut table = self.table();
        let SessionRateLimit::AtOnce(at_once) = table.limit else { return true };
        while table.order.first().is_some_and(|(full_at, _)| *full_at <= now) {
            table.forget_first();
        }
        let after = Self::after(&table, at_once, block, now);
        if let Some(full_at) = after {
            table.remember(block, full_at);
        }
        after.is_some()
    }

    /// Addresses whose buckets are remembered.
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

    fn of(at_once: u32) -> SessionRateLimiter {
        SessionRateLimiter::new(SessionRateLimit::AtOnce(NonZeroU32::new(at_once).unwrap()))
    }

    fn taken(session_rate: &SessionRateLimiter, address: IpAddr, now: Time) -> usize {
        (0..1000).filter(|_| session_rate.take(address, now)).count()
    }

    #[test]
    fn an_address_begins_a_burst_and_then_an_eighth_of_it_each_second() {
        let session_rate = of(32);
        assert_eq!(taken(&session_rate, ip(1), Time::from_ms(5)), 32);
        assert!(
            !session_rate.check(ip(1), Time::from_ms(254)) && session_rate.check(ip(1), Time::from_ms(255))
        );
        assert_eq!(taken(&session_rate, ip(1), Time::from_ms(1005)), 4);
        assert_eq!(taken(&session_rate, ip(1), Time::from_ms(3005)), 8);
        // However long it waits, there is no more than the burst.
        assert_eq!(taken(&session_rate, ip(1), Time::from_ms(3_600_000)), 32);
        assert_eq!(taken(&session_rate, ip(2), Time::from_ms(3_600_000)), 32, "of each address");
        for at_once in [1, 3, 125] {
            assert_eq!(taken(&of(at_once), ip(1), Time::ZERO), at_once as usize);
        }
        assert_eq!(taken(&SessionRateLimiter::new(SessionRateLimit::Unlimited), ip(1), Time::ZERO), 1000);
    }

    #[test]
    fn a_network_of_64_bits_had_as_many_buckets_as_addresses() {
        let session_rate = of(32);
        let address = |n: u128| IpAddr::from(Ipv6Addr::from_bits((0x2001_0db8_0001_0002_u128 << 64) + n));
        assert_eq!((0..100).filter(|n| session_rate.take(address(*n), Time::ZERO)).count(), 32);
    }

    #[test]
    fn the_table_of_buckets_is_bounded_and_forgets_who_owes_least() {
        let session_rate = of(32);
        assert_eq!(taken(&session_rate, ip(0), Time::ZERO), 32);
        for n in 1..100_000 {
            assert!(session_rate.take(ip(n), Time::ZERO));
            assert!(session_rate.len() <= MAX_REMEMBERED);
        }
        assert!(!session_rate.check(ip(0), Time::ZERO), "who floods is not forgotten for untrusted peers");
        assert!(session_rate.take(ip(1), Time::from_ms(8_000)));
        assert_eq!(session_rate.len(), 1, "full buckets are nothing to remember");
    }

    #[test]
    fn limits_are_read() {
        assert_eq!("off".parse(), Ok(SessionRateLimit::Unlimited));
        assert_eq!("40".parse(), Ok(SessionRateLimit::of_places(40)));
        assert_eq!(SessionRateLimit::of_places(8), SessionRateLimit::of_places(32), "people reload pages");
        for text in ["0", "-1", "", "many", "4294967296"] {
            let why = text.parse::<SessionRateLimit>().unwrap_err();
            assert!(why.contains("write for example 32"), "{why}");
        }
    }
}
