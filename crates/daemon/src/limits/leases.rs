//! Leases: bound the number of sessions, in all and per address.
//!
//! A session takes a lease when its client has validated its address and sent `Hello`. The last eighth of the leases is
//! reserved for addresses without one. When no lease is free, a new session takes the lease of the least useful session:
//! the longest idle one of the address with most sessions, if that address has at least two more than the new one's, or
//! one more and the session has requested nothing for 30 seconds.

use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use lodestream_protocol::Time;
use tokio::sync::Notify;

use crate::limits::pre_auth_pool::AddressBlock;

/// One lease in this many is reserved for addresses without a lease.
const RESERVED_SHARE: u64 = 8;
/// One address may have one lease in this many by default, …
const ADDRESS_SHARE: u64 = 8;
/// … and at least this many.
const MIN_PER_ADDRESS: u64 = 8;
/// A session that has requested nothing for this long may lose its lease to an address without one.
const IDLE: Duration = Duration::from_secs(30);
/// Most sessions whose lease was revoked and that have not ended yet. They take two seconds to close at most.
const MAX_REVOKED: usize = 64;

/// Default number of leases per address, of `total` leases.
pub(crate) const fn default_per_address(total: u64) -> u64 {
    let share = total / ADDRESS_SHARE;
    if share < MIN_PER_ADDRESS { MIN_PER_ADDRESS } else { share }
}

/// Why a session gets no lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum LeaseError {
    /// All leases are held by active sessions.
    #[error("the server is full")]
    Full,
    /// The address has as many leases as one address may have.
    #[error("this address has the most sessions that the server allows for one address")]
    AddressLimit,
    /// The address started too many sessions within seconds.
    #[error("this address started too many sessions within seconds; try again later")]
    RateLimit,
    /// The server is draining.
    #[error("the server is shutting down")]
    Draining,
}

/// The table of leases.
#[derive(Debug)]
pub(crate) struct Leases {
    total: AtomicU64,
    per_address: AtomicU64,
    table: Mutex<Table>,
}

#[derive(Debug, Default)]
struct Table {
    next: u64,
    taken: BTreeMap<u64, (AddressBlock, Arc<LeaseHolder>)>,
    revoked: BTreeMap<u64, AddressBlock>,
    by_block: HashMap<AddressBlock, u64>,
}

/// The holder of a lease, shared by the table and the session.
#[derive(Debug)]
struct LeaseHolder {
    /// Time of the last request, in nanoseconds of [`Time`].
    last_request_ns: AtomicU64,
    notice: Notify,
}

impl Table {
    fn held_by(&self, block: AddressBlock) -> u64 {
        self.by_block.get(&block).copied().unwrap_or(0)
    }

    fn insert(&mut self, number: u64, block: AddressBlock, holder: Arc<LeaseHolder>) {
        self.taken.insert(number, (block, holder));
        *self.by_block.entry(block).or_insert(0) += 1;
    }

    fn remove(&mut self, number: u64) -> Option<(AddressBlock, Arc<LeaseHolder>)> {
        let (block, holder) = self.taken.remove(&number)?;
        if let Some(count) = self.by_block.get_mut(&block) {
            *count -= 1;
            if *count == 0 {
                self.by_block.remove(&block);
            }
        }
        Some((block, holder))
    }

    /// The session whose lease is revoked for an address that holds `held` others; `None` if all are more useful.
    fn least_useful(&self, held: u64, now: Time) -> Option<u64> {
        let known = self.taken.iter().map(|(&number, (block, holder))| {
            let asked = Time::from_ns(holder.last_request_ns.load(Ordering::Relaxed));
            (self.held_by(*block), now.since(asked), number)
        });
        let worse = |&(of_block, idle, _): &(u64, Duration, u64)| {
            of_block > held + 1 || (of_block > held && idle >= IDLE)
        };
        known.filter(worse).max().map(|(_, _, number)| number)
    }
}

impl Leases {
    /// A table of `total` leases, `per_address` for one address.
    pub(crate) fn new(total: u64, per_address: u64) -> Arc<Self> {
        Arc::new(Self { total: total.into(), per_address: per_address.into(), table: Mutex::default() })
    }

    /// Changes the limits. Leases that are held stay valid.
    pub(crate) fn set(&self, total: u64, per_address: u64) {
        self.total.store(total, Ordering::Relaxed);
        self.per_address.store(per_address, Ordering::Relaxed);
    }

    // A thread that panics with the lock leaves a consistent table.
    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of entries in all maps.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        let table = self.table();
        table.taken.len() + table.revoked.len() + table.by_block.len()
    }

    /// The lease to revoke for a new session of `block`; `None` if one is free.
    fn lease_to_revoke(
        &self,
        table: &Table,
        block: AddressBlock,
        now: Time,
    ) -> Result<Option<u64>, LeaseError> {
        let held = table.held_by(block);
        let [total, per_address] =
            [&self.total, &self.per_address].map(|count| count.load(Ordering::Relaxed));
        if held >= per_address {
            return Err(LeaseError::AddressLimit);
        }
        let free = total.saturating_sub(table.taken.len() as u64);
        let reserved = if held == 0 { 0 } else { total / RESERVED_SHARE };
        if free > reserved {
            return Ok(None);
        }
        if table.revoked.len() >= MAX_REVOKED {
            return Err(LeaseError::Full);
        }
        table.least_useful(held, now).map(Some).ok_or(LeaseError::Full)
    }

    /// Whether an address would get a lease; revokes none.
    pub(crate) fn check(&self, address: IpAddr, now: Time) -> Result<(), LeaseError> {
        self.lease_to_revoke(&self.table(), AddressBlock::of(address), now).map(drop)
    }

    /// Takes a lease for an address, and revokes another if none is free.
    pub(crate) fn take(self: &Arc<Self>, address: IpAddr, now: Time) -> Result<Lease, LeaseError> {
        let block = AddressBlock::of(address);
        let mut table = self.table();
        if let Some(number) = self.lease_to_revoke(&table, block, now)?
            && let Some((block, holder)) = table.remove(number)
        {
            table.revoked.insert(number, block);
            holder.notice.notify_one();
        }
        table.next += 1;
        let number = table.next;
        let holder =
            Arc::new(LeaseHolder { last_request_ns: AtomicU64::new(now.as_ns()), notice: Notify::new() });
        table.insert(number, block, Arc::clone(&holder));
        Ok(Lease { leases: Arc::clone(self), number, holder })
    }
}

/// A session's lease; returned when dropped.
#[derive(Debug)]
pub(crate) struct Lease {
    leases: Arc<Leases>,
    number: u64,
    holder: Arc<LeaseHolder>,
}

impl Lease {
    /// Notes a request: the session is active.
    pub(crate) fn record_request(&self, now: Time) {
        self.holder.last_request_ns.store(now.as_ns(), Ordering::Relaxed);
    }

    /// Charges the lease to the client's new address, even beyond that address's limit: a change of network must not
    /// end a session.
    pub(crate) fn set_address(&self, address: IpAddr) {
        let mut table = self.leases.table();
        if let Some((_, holder)) = table.remove(self.number) {
            table.insert(self.number, AddressBlock::of(address), holder);
        }
    }

    /// Resolves once when the lease is revoked.
    pub(crate) async fn revoked(&self) {
        self.holder.notice.notified().await;
    }
}

impl Drop for Lease {
    fn drop(&mut self) {
        let mut table = self.leases.table();
        if table.remove(self.number).is_none() {
            table.revoked.remove(&self.number);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use futures_util::FutureExt as _;

    use super::*;

    fn ip(n: u32) -> IpAddr {
        Ipv4Addr::from_bits(0x0a00_0000 + n).into()
    }

    fn is_revoked(lease: &Lease) -> bool {
        lease.revoked().now_or_never().is_some()
    }

    #[test]
    fn one_address_cannot_take_all_leases() {
        let leases = Leases::new(1000, default_per_address(1000));
        let of_one: Vec<_> = (0..1000).map(|_| leases.take(ip(1), Time::ZERO)).collect();
        let taken = of_one.iter().filter(|lease| lease.is_ok()).count();
        assert_eq!(taken, 125);
        assert_eq!(of_one[125].as_ref().unwrap_err(), &LeaseError::AddressLimit);
        let others: Vec<_> = (2..=876).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        assert_eq!(others.len() + taken, 1000);
        assert!(!others.iter().any(is_revoked));
    }

    #[test]
    fn reserved_leases_are_for_addresses_without_sessions() {
        let leases = Leases::new(80, 100);
        let mut of_two = Vec::new();
        for n in 0..100 {
            of_two.extend(leases.take(ip(n % 2), Time::ZERO));
        }
        assert_eq!(of_two.len(), 70, "the last eighth is reserved");
        let newcomers: Vec<_> = (2..12).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        assert!(!of_two.iter().any(is_revoked));
        // Full: leases move from addresses with many to those with none, and never back.
        let more: Vec<_> = (12..40).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        assert_eq!(of_two.iter().filter(|lease| is_revoked(lease)).count(), more.len());
        assert!(!newcomers.iter().any(is_revoked));
        assert_eq!(leases.take(ip(0), Time::ZERO).unwrap_err(), LeaseError::Full);
    }

    #[test]
    fn a_new_client_takes_the_lease_of_the_longest_idle_session() {
        let leases = Leases::new(3, 3);
        let held: Vec<_> = (0..3).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        let later = Time::from_ms(31_000);
        held[0].record_request(later);
        held[2].record_request(Time::from_ms(500));
        assert_eq!(leases.take(ip(9), Time::from_ms(29_000)).unwrap_err(), LeaseError::Full);
        assert!(
            leases.check(ip(9), later).is_ok() && !held.iter().any(is_revoked),
            "a check revokes no lease"
        );
        let newcomer = leases.take(ip(9), later).unwrap();
        assert_eq!(held.iter().map(is_revoked).collect::<Vec<_>>(), [false, true, false], "the longest idle");
        drop((held, newcomer));
        assert!(leases.table().taken.is_empty() && leases.table().revoked.is_empty());
        assert!(leases.table().by_block.is_empty());
    }

    #[test]
    fn a_lease_counts_for_the_clients_new_address() {
        let leases = Leases::new(100, 2);
        let roaming = leases.take(ip(1), Time::ZERO).unwrap();
        let other = leases.take(ip(1), Time::ZERO).unwrap();
        assert_eq!(leases.check(ip(1), Time::ZERO).unwrap_err(), LeaseError::AddressLimit);
        roaming.set_address(ip(2));
        let _third = leases.take(ip(1), Time::ZERO).unwrap();
        let _fourth = leases.take(ip(2), Time::ZERO).unwrap();
        assert_eq!(leases.check(ip(2), Time::ZERO).unwrap_err(), LeaseError::AddressLimit);
        // The session continues although the new address is at its limit.
        roaming.set_address(ip(1));
        assert_eq!(leases.table().held_by(AddressBlock::of(ip(1))), 3);
        drop(roaming);
        assert_eq!(leases.table().held_by(AddressBlock::of(ip(1))), 2);
        assert!(!is_revoked(&other));
    }

    #[test]
    fn revoked_sessions_that_have_not_ended_are_bounded() {
        let leases = Leases::new(1000, 1000);
        let held: Vec<_> = (0..1000).filter_map(|_| leases.take(ip(1), Time::ZERO).ok()).collect();
        let newcomers: Vec<_> = (2..1000).map_while(|n| leases.take(ip(n), Time::ZERO).ok()).collect();
        // The reserved eighth, then one for each revoked lease.
        assert_eq!(newcomers.len(), 125 + MAX_REVOKED);
        drop(held);
        assert!(leases.take(ip(5000), Time::ZERO).is_ok());
    }
}
