//! First flights that the sessions of a scene share.
//!
//! To order a scene for a view costs a pass over the instances in view; and whoever connects sees the start view, before
//! anybody knows whether he is there at all.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::first_flight::first_flight;
use super::places::Places;
use crate::scheduler::Unit;
use crate::select::priority::Priority;
use crate::source::SceneSource;
use crate::view::View;

/// Flights kept beside that of the start view: those of clients with pictures of the same size who come at one time.
const MAX_KEPT: usize = 8;

/// Units of the first flight for a view, least urgent first.
pub(super) type Flight = Arc<[(Priority, Unit)]>;

/// See the module. All sessions that share it must be of one scene.
#[derive(Debug, Default)]
pub struct Plans {
    places: OnceLock<Places>,
    start: OnceLock<(View, Flight)>,
    kept: Mutex<VecDeque<(View, Flight)>>,
}

impl Plans {
    /// Nothing planned yet.
    #[must_use]
    pub fn new() -> Arc<Self> {
        Arc::default()
    }

    /// What of the scene lies where.
    pub(super) fn places(&self, source: &dyn SceneSource) -> &Places {
        self.places.get_or_init(|| Places::new(source))
    }

    /// The flight for a view. The first one that is asked for is taken for the start view's, and kept for good.
    pub(super) fn flight(&self, source: &dyn SceneSource, view: &View) -> Flight {
        let plan = || Flight::from(first_flight(source, self.places(source), view));
        let (start, flight) = self.start.get_or_init(|| (*view, plan()));
        if start == view {
            return Arc::clone(flight);
        }
        // A thread that panicked while it held the lock left the list usable: entries are whole.
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, flight)) = kept().iter().find(|(of, _)| of == view) {
            return Arc::clone(flight);
        }
        // Two sessions may plan the same; none waits for another.
        let flight = plan();
        let mut kept = kept();
        kept.truncate(MAX_KEPT - 1);
        kept.push_front((*view, Arc::clone(&flight)));
        flight
    }
}

/// What is left of a flight: the shared one as far as nobody changed it.
#[derive(Debug)]
pub(super) struct Queue {
    flight: Flight,
    /// Units of the flight's beginning that are left; the rest was taken.
    left: usize,
    /// What came later and goes first.
    added: Vec<(Priority, Unit)>,
}

impl Default for Queue {
    fn default() -> Self {
        Self::of(Flight::default())
    }
}

impl Queue {
    /// All of a flight.
    pub(super) fn of(flight: Flight) -> Self {
        Self { left: flight.len(), flight, added: Vec::new() }
    }

    /// What of a flight passes a test; shared where all does.
    pub(super) fn of_those(flight: Flight, keep: impl Fn(&Unit) -> bool) -> Self {
        if flight.iter().all(|(_, unit)| keep(unit)) {
            return Self::of(flight);
        }
        Self::of(flight.iter().copied().filter(|(_, unit)| keep(unit)).collect())
    }

    /// The next unit.
    pub(super) fn last(&self) -> Option<&(Priority, Unit)> {
        self.added.last().or_else(|| self.flight.get(self.left.checked_sub(1)?))
    }

    /// Takes the next unit.
    pub(super) fn pop(&mut self) {
        if self.added.pop().is_none() {
            self.left = self.left.saturating_sub(1);
        }
    }

    /// Puts a unit before all others.
    pub(super) fn push(&mut self, unit: (Priority, Unit)) {
        self.added.push(unit);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(super) fn len(&self) -> usize {
        self.left + self.added.len()
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &(Priority, Unit)> {
        self.flight.iter().take(self.left).chain(&self.added)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::MemoryScene;

    #[test]
    fn flights_of_one_view_are_one_and_few_are_kept() {
        let scene = MemoryScene::new(3, 2, 2);
        let plans = Plans::default();
        let start = scene.header.camera.view([1280, 720], 1.0);
        let at = |n: u32| View { eye: [f64::from(n), 1.0, 4.0], ..start };
        let first = plans.flight(&*scene, &start);
        for n in 1..100 {
            let flight = plans.flight(&*scene, &at(n));
            assert!(Arc::ptr_eq(&flight, &plans.flight(&*scene, &at(n))));
            assert_eq!(flight[..], first_flight(&*scene, &Places::new(&*scene), &at(n))[..]);
        }
        assert!(Arc::ptr_eq(&first, &plans.flight(&*scene, &start)));
        assert_eq!(plans.kept.lock().unwrap().len(), MAX_KEPT);
    }

    #[test]
    fn what_is_left_of_a_flight_is_taken_from_its_end() {
        let unit = |n: u32| (n, Unit::Page(n));
        let flight: Flight = (0..4).map(unit).collect();
        let mut queue = Queue::of_those(Arc::clone(&flight), |_| true);
        assert!(Arc::ptr_eq(&queue.flight, &flight));
        queue.pop();
        queue.push(unit(9));
        assert_eq!(queue.iter().copied().collect::<Vec<_>>(), [0, 1, 2, 9].map(unit));
        let mut taken = Vec::new();
        while let Some(next) = queue.last().copied() {
            queue.pop();
            taken.push(next);
        }
        assert_eq!(taken, [9, 2, 1, 0].map(unit));
        queue.pop();
        assert!(queue.is_empty());
        let some = Queue::of_those(flight, |unit| *unit != Unit::Page(1));
        assert_eq!(some.iter().copied().collect::<Vec<_>>(), [0, 2, 3].map(unit));
    }
}
