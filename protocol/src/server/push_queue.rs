//! What is pushed next: ordered for a view, ordered anew for another, within the budgets.

use super::push::{self, Refining};
use super::{Phase, ServerConfig, ServerSession};
use crate::scheduler::Unit;
use crate::select::priority::is_base;
use crate::time::Time;

/// Pushed units that are moved to the scheduler ahead of their turn.
const PUSH_AHEAD: usize = 16;

impl ServerSession {
    /// Takes back what the client may not need: what it has not asked for, as far as it has not begun.
    pub(super) fn drop_unasked(&mut self) {
        let Self { scheduler, unasked, pushed_parts, .. } = self;
        scheduler.retain(|unit| {
            let dropped = unasked.contains(unit);
            if let (true, Unit::Blob(id)) = (dropped, unit) {
                pushed_parts.remove(id);
            }
            !dropped
        });
        unasked.clear();
    }

    pub(super) fn replan(&mut self, now: Time) {
        self.replanned = Some(now);
        self.plan();
    }

    /// Orders anew what is pushed for the view last known.
    pub(super) fn plan(&mut self) {
        self.replan_at = None;
        self.drop_unasked();
        if !self.client_wants {
            // Nothing but pushes is queued.
            self.scheduler.retain(|_| false);
        }
        self.refinement_pushed = false;
        self.push = push::first_flight(&*self.source, &self.view);
        let Self { handed, scheduler, .. } = self;
        self.push.retain(|(_, unit)| !handed.contains_key(unit) && !scheduler.contains(unit));
        self.bases_left = self.push.iter().filter(|(p, _)| is_base(*p)).map(|(_, unit)| *unit).collect();
        let half_sent = self.scheduler.begun().filter(|(priority, _)| is_base(*priority));
        self.bases_left.extend(half_sent.map(|(_, unit)| unit));
        self.bases_told = false;
    }

    /// Moves the most urgent pushes to the scheduler.
    pub(super) fn refill(&mut self) {
        let open = self.phase == Phase::Open;
        while self.scheduler.queued() < PUSH_AHEAD {
            let Some(&(priority, unit)) = self.push.last() else { break };
            let fits = self.fits_push_budget(unit);
            if !fits && !open {
                break;
            }
            if !fits || self.handed.contains_key(&unit) {
                // The client has it, or no room for more than it asks for.
                self.push.pop();
                self.bases_left.remove(&unit);
                continue;
            }
            if !self.scheduler.want(unit, priority) {
                // The queue is full of what was asked for: this waits until there is room.
                break;
            }
            self.push.pop();
            self.pushed_bytes = self.pushed_bytes.saturating_add(self.estimated_bytes(unit));
        }
        if self.bases_left.is_empty() && !self.refinement_pushed {
            self.refinement_pushed = true;
            if !self.client_refines && !self.resumes {
                self.push_refinement();
            }
        }
    }

    fn estimated_bytes(&self, unit: Unit) -> u64 {
        match unit {
            // Typical lengths of asset and instance entries.
            Unit::Page(page) => self
                .source
                .page(page)
                .map_or(0, |page| 8 + 80 * page.assets.len() as u64 + 20 * page.instances.len() as u64),
            Unit::Blob(id) => self.source.blob_len(&id).map_or(0, u64::from),
        }
    }

    /// Whether a unit may be pushed. The first page always is: without it nothing can be placed; and all
    /// pages once the client has spoken, since only they tell it what there is.
    pub(super) fn fits_push_budget(&self, unit: Unit) -> bool {
        match unit {
            Unit::Page(0) => true,
            Unit::Page(_) if self.phase == Phase::Open => true,
            _ => self.pushed_bytes.saturating_add(self.estimated_bytes(unit)) <= self.push_budget,
        }
    }

    fn push_refinement(&mut self) {
        let ServerConfig { push_after_hello_bytes, refine_before_hello_bytes, .. } = *self.config;
        let room = self.push_budget.saturating_sub(self.pushed_bytes);
        let budget = if self.phase == Phase::Open {
            push_after_hello_bytes.min(room)
        } else {
            refine_before_hello_bytes.saturating_sub(self.pushed_bytes).min(push_after_hello_bytes).min(room)
        };
        if budget == 0 {
            return;
        }
        for Refining { priority, id, end } in push::first_refinement(&*self.source, &self.view, budget) {
            let unit = Unit::Blob(id);
            if !self.handed.contains_key(&unit)
                && !self.scheduler.contains(&unit)
                && self.scheduler.want_part(unit, priority, 0..end.unwrap_or(u32::MAX))
            {
                self.unasked.insert(unit);
                if let Some(end) = end {
                    self.pushed_parts.insert(id, end);
                }
            }
        }
    }
}
