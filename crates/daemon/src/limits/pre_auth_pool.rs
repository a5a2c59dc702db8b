//! Pre-auth pool: bounds the connections whose peer has not been admitted, such as connections without a request and
//! sessions without `Hello` (compare `MaxStartups` of OpenSSH).
//!
//! The pool never refuses. When it is full, it evicts the oldest connection of the address with the most slots: an
//! address that fills the pool evicts only its own connections. Well-behaved clients need a slot for one round trip.

use std::collections::{BTreeMap, HashMap};
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// Unit in which addresses are counted: an IPv4 address or an IPv6 /64 network, the least that one customer gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct AddressBlock(IpAddr);

impl AddressBlock {
    /// The block of an address; an IPv4-mapped IPv6 address counts as IPv4.
    pub(crate) fn of(address: IpAddr) -> Self {
        Self(match address.to_canonical() {
            IpAddr::V6(ip) => IpAddr::V6(Ipv6Addr::from_bits(ip.to_bits() & !u128::from(u64::MAX))),
            ip => ip,
        })
    }

    /// A number unique to the block.
    pub(crate) fn number(self) -> u128 {
        match self.0 {
            // No IPv6 block has a mapped address: `of` makes them IPv4.
            IpAddr::V4(ip) => ip.to_ipv6_mapped().to_bits(),
            IpAddr::V6(ip) => ip.to_bits(),
        }
    }
}

/// The pool.
#[derive(Debug)]
pub(crate) struct PreAuthPool {
    limit: usize,
    slots: Mutex<Slots>,
}

#[derive(Debug, Default)]
struct Slots {
    next: u64,
    /// By number, so in order of age.
    taken: BTreeMap<u64, (AddressBlock, Arc<Notify>)>,
    by_block: HashMap<AddressBlock, usize>,
}

impl Slots {
    fn remove(&mut self, number: u64) -> Option<Arc<Notify>> {
        let (block, notice) = self.taken.remove(&number)?;
        if let Some(count) = self.by_block.get_mut(&block) {
            *count -= 1;
            if *count == 0 {
                self.by_block.remove(&block);
            }
        }
        Some(notice)
    }

    /// The oldest slot of the block with the most slots.
    fn next_to_evict(&self) -> Option<u64> {
        let most = self.by_block.values().copied().max()?;
        let of_most = |block: &AddressBlock| self.by_block.get(block) == Some(&most);
        self.taken.iter().find(|(_, (block, _))| of_most(block)).map(|(number, _)| *number)
    }
}

impl PreAuthPool {
    /// A pool of `limit` slots, at least one.
    pub(crate) fn new(limit: usize) -> Arc<Self> {
        Arc::new(Self { limit: limit.max(1), slots: Mutex::default() })
    }

    // A thread that panics with the lock leaves consistent slots.
    fn slots(&self) -> MutexGuard<'_, Slots> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a slot; evicts others if the pool is full.
    pub(crate) fn enter(self: &Arc<Self>, address: IpAddr) -> PreAuthSlot {
        let (block, notice) = (AddressBlock::of(address), Arc::new(Notify::new()));
        let mut slots = self.slots();
        while slots.taken.len() >= self.limit
            && let Some(victim) = slots.next_to_evict()
        {
            if let Some(notice) = slots.remove(victim) {
                notice.notify_one();
            }
        }
        slots.next += 1;
        let number = slots.next;
        slots.taken.insert(number, (block, Arc::clone(&notice)));
        *slots.by_block.entry(block).or_insert(0) += 1;
        PreAuthSlot { pool: Arc::clone(self), number, notice }
    }

    /// Slots in use.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.slots().taken.len()
    }
}

/// A slot in a pool; returned when dropped.
#[derive(Debug)]
pub(crate) struct PreAuthSlot {
    pool: Arc<PreAuthPool>,
    number: u64,
    notice: Arc<Notify>,
}

impl PreAuthSlot {
    /// Resolves once when the slot is evicted.
    pub(crate) async fn evicted(&self) {
        self.notice.notified().await;
    }
}

impl Drop for PreAuthSlot {
    fn drop(&mut self) {
        self.pool.slots().remove(self.number);
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;

    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    fn evicted(slot: &PreAuthSlot) -> bool {
        slot.evicted().now_or_never().is_some()
    }

    #[test]
    fn a_64_bit_network_and_a_mapped_address_count_as_one() {
        let block = |text| AddressBlock::of(ip(text));
        assert_eq!(block("2001:db8:1:2::1"), block("2001:db8:1:2:ffff::9"));
        assert_ne!(block("2001:db8:1:2::1"), block("2001:db8:1:3::1"));
        assert_eq!(block("::ffff:10.0.0.1"), block("10.0.0.1"));
        assert_ne!(block("10.0.0.1"), block("10.0.0.2"));
        assert_eq!(block("2001:db8:1:2::1").number(), 0x2001_0db8_0001_0002 << 64);
        assert_eq!(block("10.0.0.2").number(), 0xffff_0a00_0002);
    }

    #[test]
    fn an_address_that_fills_the_pool_evicts_only_its_own_connections() {
        let pool = PreAuthPool::new(4);
        let honest = pool.enter(ip("10.0.0.1"));
        let mut flood: Vec<PreAuthSlot> = (0..3).map(|_| pool.enter(ip("10.0.0.2"))).collect();
        for _ in 0..100 {
            flood.push(pool.enter(ip("10.0.0.2")));
            assert_eq!(pool.len(), 4);
        }
        assert!(!evicted(&honest));
        assert!(
            flood[..100].iter().all(evicted) && !flood[100..].iter().any(evicted),
            "the oldest are evicted"
        );
        let other = pool.enter(ip("10.0.0.3"));
        assert!(!evicted(&honest) && !evicted(&other) && evicted(&flood[100]));
        drop(flood);
        assert_eq!(pool.len(), 2);
        assert!(pool.slots().by_block.len() == 2, "addresses without a slot are removed");
    }
}
