//! PreAuthPool for those who have not proved to be clients: connections without a request, sessions without `Hello`.
//!
//! A room never refuses. When it is full, who has been in it longest leaves, of the address that holds most of it: one
//! address that fills it turns out nobody but itself, and honest clients stay in it for a round trip.

use std::collections::{BTreeMap, HashMap};
use std::net::{IpAddr, Ipv6Addr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

/// Who counts as one: an IPv4 address, or an IPv6 network of 64 bits, which is what one customer gets at least.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct AddressBlock(IpAddr);

impl AddressBlock {
    pub(crate) fn of(address: IpAddr) -> Self {
        Self(match address.to_canonical() {
            IpAddr::V6(ip) => IpAddr::V6(Ipv6Addr::from_bits(ip.to_bits() & !u128::from(u64::MAX))),
            ip => ip,
        })
    }

    /// A number of its own for each.
    pub(crate) fn number(self) -> u128 {
        match self.0 {
            // No other block has such an address: it would be canonical.
            IpAddr::V4(ip) => ip.to_ipv6_mapped().to_bits(),
            IpAddr::V6(ip) => ip.to_bits(),
        }
    }
}

/// See the module.
#[derive(Debug)]
pub(crate) struct PreAuthPool {
    limit: usize,
    seats: Mutex<Slots>,
}

#[derive(Debug, Default)]
struct Slots {
    next: u64,
    /// By number, so the oldest first.
    taken: BTreeMap<u64, (AddressBlock, Arc<Notify>)>,
    by_block: HashMap<AddressBlock, usize>,
}

impl Slots {
    fn leave(&mut self, number: u64) -> Option<Arc<Notify>> {
        let (block, bell) = self.taken.remove(&number)?;
        if let Some(count) = self.by_block.get_mut(&block) {
            *count -= 1;
            if *count == 0 {
                self.by_block.remove(&block);
            }
        }
        Some(bell)
    }

    /// Who leaves next.
    fn last(&self) -> Option<u64> {
        let most = self.by_block.values().copied().max()?;
        let of_most = |block: &AddressBlock| self.by_block.get(block) == Some(&most);
        self.taken.iter().find(|(_, (block, _))| of_most(block)).map(|(number, _)| *number)
    }
}

impl PreAuthPool {
    /// A room of so many seats, at least one.
    pub(crate) fn new(limit: usize) -> Arc<Self> {
        Arc::new(Self { limit: limit.max(1), seats: Mutex::default() })
    }

    /// A thread that panicked while it held the lock left the seats usable: counts are changed with them.
    fn seats(&self) -> MutexGuard<'_, Slots> {
        self.seats.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a seat; whoever has to leave for it is told.
    pub(crate) fn enter(self: &Arc<Self>, address: IpAddr) -> PreAuthSlot {
        let (block, bell) = (AddressBlock::of(address), Arc::new(Notify::new()));
        let mut seats = self.seats();
        while seats.taken.len() >= self.limit
            && let Some(last) = seats.last()
        {
            if let Some(bell) = seats.leave(last) {
                bell.notify_one();
            }
        }
        seats.next += 1;
        let number = seats.next;
        seats.taken.insert(number, (block, Arc::clone(&bell)));
        *seats.by_block.entry(block).or_insert(0) += 1;
        PreAuthSlot { room: Arc::clone(self), number, bell }
    }

    /// Slots that are taken.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        self.seats().taken.len()
    }
}

/// A seat in a room; given back when dropped.
#[derive(Debug)]
pub(crate) struct PreAuthSlot {
    room: Arc<PreAuthPool>,
    number: u64,
    bell: Arc<Notify>,
}

impl PreAuthSlot {
    /// Resolves, once, when another has the seat.
    pub(crate) async fn lost(&self) {
        self.bell.notified().await;
    }
}

impl Drop for PreAuthSlot {
    fn drop(&mut self) {
        self.room.seats().leave(self.number);
    }
}

#[cfg(test)]
mod tests {
    use futures_util::FutureExt as _;

    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    fn lost(seat: &PreAuthSlot) -> bool {
        seat.lost().now_or_never().is_some()
    }

    #[test]
    fn a_network_of_64_bits_counts_as_one_and_a_mapped_address_as_what_it_maps() {
        let block = |text| AddressBlock::of(ip(text));
        assert_eq!(block("2001:db8:1:2::1"), block("2001:db8:1:2:ffff::9"));
        assert_ne!(block("2001:db8:1:2::1"), block("2001:db8:1:3::1"));
        assert_eq!(block("::ffff:10.0.0.1"), block("10.0.0.1"));
        assert_ne!(block("10.0.0.1"), block("10.0.0.2"));
        assert_eq!(block("2001:db8:1:2::1").number(), 0x2001_0db8_0001_0002 << 64);
        assert_eq!(block("10.0.0.2").number(), 0xffff_0a00_0002);
    }

    #[test]
    fn one_address_that_fills_a_room_turned_others_out() {
        let room = PreAuthPool::new(4);
        let honest = room.enter(ip("10.0.0.1"));
        let mut flood: Vec<PreAuthSlot> = (0..3).map(|_| room.enter(ip("10.0.0.2"))).collect();
        for _ in 0..100 {
            flood.push(room.enter(ip("10.0.0.2")));
            assert_eq!(room.len(), 4);
        }
        assert!(!lost(&honest));
        assert!(flood[..100].iter().all(lost) && !flood[100..].iter().any(lost), "the oldest leave");
        let other = room.enter(ip("10.0.0.3"));
        assert!(!lost(&honest) && !lost(&other) && lost(&flood[100]));
        drop(flood);
        assert_eq!(room.len(), 2);
        assert!(room.seats().by_block.len() == 2, "addresses without a seat are forgotten");
    }
}
