//! The sessions under a shared rate limit, and when each may send its next piece.

use std::collections::BTreeMap;
use std::time::Duration;

use slab::Slab;

use super::filling::{Claim, Level, UNBOUNDED, fill, level_of, rate_at};
use super::gate::Gate;
use super::limits::Limits;
use super::member::{Clock, Member, Turn};
use super::send_request::SendRequest;
use super::weight::Weight;
use crate::time::Time;

/// Least time between two computations of the levels, if something has changed, …
const REFILL_INTERVAL: Duration = Duration::from_millis(5);
/// … plus this for each session.
const REFILL_INTERVAL_PER_SESSION: Duration = Duration::from_micros(5);
/// Levels are computed at least this often, because no call reports that a session's link is blocked.
const MAX_REFILL_INTERVAL: Duration = Duration::from_millis(20);
/// A waiting session asks again after this time, in case levels have risen, …
const RETRY: Duration = Duration::from_millis(25);
/// … or after this time for each session that sends, if that is more: at most ten thousand retries per second in all.
const RETRY_PER_SESSION: Duration = Duration::from_micros(100);

/// The group of the sessions without a group; it has no gate.
const NO_GROUP: usize = 0;

/// Sessions that share the limit of a group.
#[derive(Clone, Debug)]
struct Group {
    clock: Clock,
    gate: Option<Gate>,
    members: usize,
}

/// The gates of a group and of the total.
fn gates<'a>(group: &'a mut Group, total: &'a mut Option<Gate>) -> [Option<&'a mut Gate>; 2] {
    [group.gate.as_mut(), total.as_mut()]
}

/// Cancels a member's turns.
fn cancel_turns(member: &mut Member, gates: [Option<&mut Gate>; 2]) {
    if let Some(turn) = member.turn.take() {
        for (gate, reserved) in gates.into_iter().zip(turn.reserved) {
            if let Some(gate) = gate.filter(|_| reserved) {
                gate.cancel_turn();
            }
        }
    }
}

/// The level of a session that sends alone: in a group, and without a group.
fn sole_levels(limits: Limits) -> [Level; 2] {
    let all = limits.total_bits_per_s.map_or(UNBOUNDED, |rate| level_of(rate.max(1), 1));
    let of_group = limits.group_bits_per_s.map_or(UNBOUNDED, |rate| level_of(rate.max(1), 1)).min(all);
    [of_group, all]
}

fn set_rate(gate: &mut Option<Gate>, rate: Option<u64>, now: Time) {
    match (gate.as_mut(), rate) {
        (Some(gate), Some(rate)) => gate.set_rate(rate, now),
        _ => *gate = rate.map(Gate::new),
    }
}

/// Sessions, groups and gates of one shared rate limit.
#[derive(Debug)]
pub(super) struct Table {
    limits: Limits,
    /// Latest time passed in. Threads pass times that differ a little; time never runs backwards here.
    now: Time,
    total: Option<Gate>,
    members: Slab<Member>,
    groups: Slab<Group>,
    by_key: BTreeMap<u128, usize>,
    /// The level of a session that sends alone: in a group, and without a group.
    sole_levels: [Level; 2],
    filled_at: Option<Time>,
    changed: bool,
    active: usize,
    allocated_bits_per_s: u64,
    /// Kept for its allocation.
    claims: Vec<(usize, Claim)>,
}

impl Table {
    pub(super) fn new(limits: Limits) -> Self {
        let [of_group, all] = sole_levels(limits);
        let mut groups = Slab::new();
        groups.insert(Group { clock: Clock::new(Time::ZERO, all), gate: None, members: 0 });
        Self {
            limits,
            now: Time::ZERO,
            total: limits.total_bits_per_s.map(Gate::new),
            members: Slab::new(),
            groups,
            by_key: BTreeMap::new(),
            sole_levels: [of_group, all],
            filled_at: None,
            changed: true,
            active: 0,
            allocated_bits_per_s: 0,
            claims: Vec::new(),
        }
    }

    /// Changes the limits of all sessions from now on.
    pub(super) fn set_limits(&mut self, limits: Limits, now: Time) {
        let now = self.advance(now);
        for (_, member) in &mut self.members {
            if let Some(group) = self.groups.get_mut(member.group) {
                member.settle(&group.clock, now);
                cancel_turns(member, gates(group, &mut self.total));
                member.waited = false;
            }
        }
        set_rate(&mut self.total, limits.total_bits_per_s, now);
        for (number, group) in &mut self.groups {
            if number != NO_GROUP {
                set_rate(&mut group.gate, limits.group_bits_per_s, now);
            }
        }
        (self.limits, self.sole_levels) = (limits, sole_levels(limits));
        self.changed = true;
        self.filled_at = None;
    }

    fn advance(&mut self, now: Time) -> Time {
        self.now = self.now.max(now);
        self.now
    }

    /// The group of a key; [`NO_GROUP`] if groups have no limit.
    fn group(&mut self, key: Option<u128>, now: Time) -> usize {
        let (Some(key), Some(rate)) = (key, self.limits.group_bits_per_s) else { return NO_GROUP };
        let level = self.sole_levels[0];
        let groups = &mut self.groups;
        *self.by_key.entry(key).or_insert_with(|| {
            groups.insert(Group { clock: Clock::new(now, level), gate: Some(Gate::new(rate)), members: 0 })
        })
    }

    pub(super) fn join(&mut self, key: Option<u128>, weight: Weight, now: Time) -> usize {
        let now = self.advance(now);
        let group = self.group(key, now);
        let clock = self.enter(group);
        self.members.insert(Member::new(weight.get(), group, &clock, now))
    }

    /// Adds a member to a group's count; returns the group's clock.
    fn enter(&mut self, number: usize) -> Clock {
        match self.groups.get_mut(number) {
            Some(group) => {
                group.members += 1;
                group.clock
            }
            None => Clock::new(self.now, UNBOUNDED),
        }
    }

    pub(super) fn leave(&mut self, number: usize) {
        if let Some(mut member) = self.members.try_remove(number) {
            self.active -= usize::from(member.active);
            self.changed |= member.active;
            if let Some(group) = self.groups.get_mut(member.group) {
                group.members -= 1;
                cancel_turns(&mut member, gates(group, &mut self.total));
            }
        }
    }

    pub(super) fn move_to(&mut self, number: usize, key: Option<u128>, now: Time) {
        let now = self.advance(now);
        let group = self.group(key, now);
        let Some(from) =
            self.members.get_mut(number).map(|member| member.group).filter(|from| *from != group)
        else {
            return;
        };
        let to = self.enter(group);
        if let (Some(old), Some(member)) = (self.groups.get_mut(from), self.members.get_mut(number)) {
            old.members -= 1;
            cancel_turns(member, gates(old, &mut self.total));
            member.move_to(group, &old.clock, &to, now);
        }
        self.changed = true;
    }

    pub(super) fn set_weight(&mut self, number: usize, weight: Weight, now: Time) {
        let now = self.advance(now);
        if let Some(member) = self.members.get_mut(number)
            && let Some(group) = self.groups.get_mut(member.group)
        {
            member.set_weight(weight.get(), &group.clock, now);
            self.changed = true;
        }
    }

    /// Time until a member may send, or until it should ask again.
    pub(super) fn ask(&mut self, number: usize, request: SendRequest, now: Time) -> Duration {
        let now = self.advance(now);
        let Some(member) = self.members.get_mut(number) else { return Duration::ZERO };
        let Some(group) = self.groups.get_mut(member.group) else { return Duration::ZERO };
        if member.active != request.active || member.own_bits_per_s != request.own_bits_per_s {
            member.settle(&group.clock, now);
            self.changed = true;
            self.active =
                if request.active { self.active + 1 } else { self.active } - usize::from(member.active);
            (member.active, member.own_bits_per_s) = (request.active, request.own_bits_per_s);
            cancel_turns(member, gates(group, &mut self.total));
            member.waited = false;
        }
        member.sent_at = None;
        self.refresh(now);
        if !(request.active && request.own_ready) {
            return Duration::ZERO;
        }
        let each = RETRY_PER_SESSION.saturating_mul(u32::try_from(self.active).unwrap_or(u32::MAX));
        self.admitted_at(number, now).since(now).min(RETRY.max(each))
    }

    fn admitted_at(&mut self, number: usize, now: Time) -> Time {
        let Some(member) = self.members.get_mut(number) else { return now };
        let Some(group) = self.groups.get_mut(member.group) else { return now };
        let ready = group.clock.time_of(now, member.ready);
        if ready > now {
            return ready;
        }
        let mut both = gates(group, &mut self.total);
        match member.turn {
            // The sessions with earlier turns have left.
            Some(turn) if turn.at > now && both.iter().flatten().all(|gate| gate.is_full(now)) => {
                cancel_turns(member, both);
                now
            }
            Some(turn) if turn.at > now => turn.at,
            Some(_) => both.into_iter().flatten().map(|gate| gate.ready_at()).max().unwrap_or(now),
            None => {
                let mut turn = Turn { at: now, reserved: [false; 2] };
                for (gate, reserved) in both.iter_mut().zip(&mut turn.reserved) {
                    if let Some(gate) = gate.as_mut().filter(|gate| !gate.is_open(now)) {
                        turn.at = turn.at.max(gate.reserve_turn(now));
                        *reserved = true;
                    }
                }
                if turn.reserved != [false; 2] {
                    member.turn = Some(turn);
                    member.waited = true;
                }
                turn.at
            }
        }
    }

    pub(super) fn spend(&mut self, number: usize, bits: u64, now: Time) {
        let now = self.advance(now);
        let Some(member) = self.members.get_mut(number) else { return };
        let Some(group) = self.groups.get_mut(member.group) else { return };
        member.spend(bits, &group.clock, now);
        for gate in gates(group, &mut self.total).into_iter().flatten() {
            gate.spend(now, bits);
        }
    }

    /// Computes the levels if they are due.
    fn refresh(&mut self, now: Time) {
        let each =
            REFILL_INTERVAL_PER_SESSION.saturating_mul(u32::try_from(self.members.len()).unwrap_or(u32::MAX));
        let wait = if self.changed {
            REFILL_INTERVAL + each
        } else {
            MAX_REFILL_INTERVAL.max(REFILL_INTERVAL + each)
        };
        if self.filled_at.is_none_or(|at| now >= at + wait) {
            self.fill(now);
            self.filled_at = Some(now);
            self.changed = false;
        }
    }

    fn fill(&mut self, now: Time) {
        let groups = &mut self.groups;
        self.by_key.retain(|_, &mut number| {
            let gone = groups.get(number).is_some_and(|group| {
                group.members == 0 && group.gate.as_ref().is_none_or(|gate| gate.is_full(now))
            });
            if gone {
                groups.remove(number);
            }
            !gone
        });
        self.claims.clear();
        for (_, member) in self.members.iter_mut().filter(|(_, member)| member.active) {
            if let Some(group) = groups.get_mut(member.group) {
                member.settle(&group.clock, now);
            }
            member.demand.update();
            if member.is_blocked(now) {
                continue;
            }
            let max_level = member.demand.max_level(member.own_bits_per_s, member.weight);
            self.claims.push((member.group, Claim { max_level, weight: member.weight }));
        }
        let [of_group, all] = self.sole_levels;
        for (_, group) in groups.iter_mut() {
            group.clock.set_level(now, of_group);
        }
        if let Some(rate) = self.limits.group_bits_per_s {
            self.claims.sort_unstable_by_key(|(group, claim)| (*group, claim.max_level));
            for of_one in self.claims.chunk_by_mut(|(a, _), (b, _)| a == b) {
                let (number, _) = of_one[0];
                if number == NO_GROUP {
                    continue;
                }
                let Some(level) = fill(of_one.iter().map(|(_, claim)| claim), rate) else { continue };
                of_one.iter_mut().for_each(|(_, claim)| claim.max_level = claim.max_level.min(level));
                if let Some(group) = groups.get_mut(number) {
                    group.clock.set_level(now, level.clamp(1, of_group));
                }
            }
        }
        self.claims.sort_unstable_by_key(|(_, claim)| claim.max_level);
        let of_all =
            self.limits.total_bits_per_s.and_then(|rate| fill(self.claims.iter().map(|(_, c)| c), rate));
        let level = of_all.map_or(all, |level| level.clamp(1, all));
        for (_, group) in groups.iter_mut() {
            let lower = group.clock.level().min(level);
            group.clock.set_level(now, lower);
        }
        if let Some(none) = groups.get_mut(NO_GROUP) {
            none.clock.set_level(now, level);
        }
        let given = self.claims.iter().map(|(_, claim)| rate_at(claim.max_level.min(level), claim.weight));
        self.allocated_bits_per_s = given.fold(0, u64::saturating_add);
    }

    pub(super) fn allocated_bits_per_s(&mut self, now: Time) -> u64 {
        let now = self.advance(now);
        self.refresh(now);
        self.allocated_bits_per_s
    }

    /// The latest time passed in.
    #[cfg(test)]
    pub(super) fn last(&self) -> Time {
        self.now
    }

    /// Numbers of members, groups and keys.
    #[cfg(test)]
    pub(super) fn entries(&self) -> [usize; 3] {
        [self.members.len(), self.groups.len(), self.by_key.len()]
    }
}
