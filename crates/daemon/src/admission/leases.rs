//! Who may have a session: so many in all, so many of one address, and who leaves when nothing is left for an untrusted peer.
//!
//! A session holds a lease, from when its client has proved an address and said `Hello`. The last eighth of them is kept
//! for addresses that hold none. When nothing is left, a newcomer gets the lease of the least useful session, if that is
//! of an address with more sessions than his, or has asked for nothing for a while: whoever holds many leases, or holds
//! one idly, loses them first.

use std::collections::{BTreeMap, HashMap};
use std::net::IpAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use lodestream_protocol::Time;
use tokio::sync::Notify;

use crate::admission::pre_auth_pool::AddressBlock;

/// Share of the leases that is kept for addresses that hold none: one in so many.
const RESERVED_SHARE: u64 = 8;
/// Share of the leases that one address may have unless that is said: one in so many, …
const ADDRESS_SHARE: u64 = 8;
/// … and at least so many.
const MIN_PER_ADDRESS: u64 = 8;
/// After so long without asking for anything a session may be ended for an address that has none.
const IDLE: Duration = Duration::from_secs(30);
/// Sessions at once that were told to leave and have not left yet. Their last words take two seconds at most.
const MAX_REVOKED: usize = 64;

/// How many leases one address may have where nobody says so.
pub(crate) const fn default_per_address(total: u64) -> u64 {
    let share = total / ADDRESS_SHARE;
    if share < MIN_PER_ADDRESS { MIN_PER_ADDRESS } else { share }
}

/// Why there is no lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum LeaseError {
    /// All are taken, by sessions that are of use.
    #[error("the server is full")]
    Full,
    /// The address has as many as one may.
    #[error("the server has as many sessions of this address as one may have")]
    AddressLimit,
    /// The address began too many sessions lately.
    #[error("too many sessions of this address began within seconds; try again later")]
    RateLimit,
    /// The server takes no more clients.
    #[error("the server is shutting down")]
    Draining,
}

/// See the module.
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

/// What is known of a session that has a lease.
#[derive(Debug)]
struct LeaseHolder {
    /// When it last asked for anything, in nanoseconds of [`Time`].
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

    /// The session that leaves for an address with `held` others, if any has to.
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
    /// So many leases in all and of one address.
    pub(crate) fn new(total: u64, per_address: u64) -> Arc<Self> {
        Arc::new(Self { total: total.into(), per_address: per_address.into(), table: Mutex::default() })
    }

    /// So many from now on. Who has one keeps it.
    pub(crate) fn set(&self, total: u64, per_address: u64) {
        self.total.store(total, Ordering::Relaxed);
        self.per_address.store(per_address, Ordering::Relaxed);
    }

    /// A thread that panicked while it held the lock left the table usable: counts are changed with it.
    fn table(&self) -> MutexGuard<'_, Table> {
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Entries of all tables.
    #[cfg(test)]
    pub(crate) fn len(&self) -> usize {
        let table = self.table();
        table.taken.len() + table.revoked.len() + table.by_block.len()
    }

    /// Who has to leave for a session of an address; `None` where nobody.
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

    /// Whether there would be a lease for an address; nobody has to leave yet.
    pub(crate) fn check(&self, address: IpAddr, now: Time) -> Result<(), LeaseError> {
        self.lease_to_revoke(&self.table(), AddressBlock::of(address), now).map(drop)
    }

    /// Takes a lease for an address; whoever has to leave for it is told.
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

/// A session's lease; given back when dropped.
#[derive(Debug)]
pub(crate) struct Lease {
    leases: Arc<Leases>,
    number: u64,
    holder: Arc<LeaseHolder>,
}

impl Lease {
    /// The client has asked for something: the session is of use.
    pub(crate) fn record_request(&self, now: Time) {
        self.holder.last_request_ns.store(now.as_ns(), Ordering::Relaxed);
    }

    /// The session's client has another address now, and the lease is that one's, even if it has as many as one may: a
    /// network that changes is no reason to end a session.
    pub(crate) fn set_address(&self, address: IpAddr) {
        let mut table = self.leases.table();
        if let Some((_, holder)) = table.remove(self.number) {
            table.insert(self.number, AddressBlock::of(address), holder);
        }
    }

    /// Resolves, once, when another has the lease.
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

    fn lost(lease: &Lease) -> bool {
        lease.revoked().now_or_never().is_some()
    }

    #[test]
    fn one_address_took_every_place() {
        let leases = Leases::new(1000, default_per_address(1000));
        let of_one: Vec<_> = (0..1000).map(|_| leases.take(ip(1), Time::ZERO)).collect();
        let taken = of_one.iter().filter(|lease| lease.is_ok()).count();
        assert_eq!(taken, 125);
        assert_eq!(of_one[125].as_ref().unwrap_err(), &LeaseError::AddressLimit);
        let others: Vec<_> = (2..=876).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        assert_eq!(others.len() + taken, 1000);
        assert!(!others.iter().any(lost));
    }

    #[test]
    fn addresses_with_a_session_took_the_places_of_those_without() {
        let leases = Leases::new(80, 100);
        let mut of_two = Vec::new();
        for n in 0..100 {
            of_two.extend(leases.take(ip(n % 2), Time::ZERO));
        }
        assert_eq!(of_two.len(), 70, "the last eighth is kept");
        let untrusted_peers: Vec<_> = (2..12).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        assert!(!of_two.iter().any(lost));
        // Full: leases pass from who has many to who has none, and never back.
        let more: Vec<_> = (12..40).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        assert_eq!(of_two.iter().filter(|lease| lost(lease)).count(), more.len());
        assert!(!untrusted_peers.iter().any(lost));
        assert_eq!(leases.take(ip(0), Time::ZERO).unwrap_err(), LeaseError::Full);
    }

    #[test]
    fn sessions_that_only_ping_kept_those_out_that_would_stream() {
        let leases = Leases::new(3, 3);
        let held: Vec<_> = (0..3).map(|n| leases.take(ip(n), Time::ZERO).unwrap()).collect();
        let later = Time::from_ms(31_000);
        held[0].record_request(later);
        held[2].record_request(Time::from_ms(500));
        assert_eq!(leases.take(ip(9), Time::from_ms(29_000)).unwrap_err(), LeaseError::Full);
        assert!(leases.check(ip(9), later).is_ok() && !held.iter().any(lost), "looking costs nobody a lease");
        let newcomer = leases.take(ip(9), later).unwrap();
        assert_eq!(held.iter().map(lost).collect::<Vec<_>>(), [false, true, false], "the longest idle");
        drop((held, newcomer));
        assert!(leases.table().taken.is_empty() && leases.table().revoked.is_empty());
        assert!(leases.table().by_block.is_empty());
    }

    #[test]
    fn a_lease_stayed_that_of_an_address_which_its_client_had_left() {
        let leases = Leases::new(100, 2);
        let roaming = leases.take(ip(1), Time::ZERO).unwrap();
        let other = leases.take(ip(1), Time::ZERO).unwrap();
        assert_eq!(leases.check(ip(1), Time::ZERO).unwrap_err(), LeaseError::AddressLimit);
        roaming.set_address(ip(2));
        let _third = leases.take(ip(1), Time::ZERO).unwrap();
        let _fourth = leases.take(ip(2), Time::ZERO).unwrap();
        assert_eq!(leases.check(ip(2), Time::ZERO).unwrap_err(), LeaseError::AddressLimit);
        // Where there is no room for it, it goes on all the same.
        roaming.set_address(ip(1));
        assert_eq!(leases.table().held_by(AddressBlock::of(ip(1))), 3);
        drop(roaming);
        assert_eq!(leases.table().held_by(AddressBlock::of(ip(1))), 2);
        assert!(!lost(&other));
    }

    #[test]
    fn those_who_were_told_to_leave_are_few_at_a_time() {
        let leases = Leases::new(1000, 1000);
        let held: Vec<_> = (0..1000).filter_map(|_| leases.take(ip(1), Time::ZERO).ok()).collect();
        let untrusted_peers: Vec<_> = (2..1000).map_while(|n| leases.take(ip(n), Time::ZERO).ok()).collect();
        // The eighth that is kept, and then one for each that leaves.
        assert_eq!(untrusted_peers.len(), 125 + MAX_REVOKED);
        drop(held);
        assert!(leases.take(ip(5000), Time::ZERO).is_ok());
    }
}
