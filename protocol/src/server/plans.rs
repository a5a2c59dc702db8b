//! First flights, and first refinements behind them, that the sessions of a scene share.
//!
//! To order a scene for a view costs a pass over the instances in view; and whoever connects sees the start view, before
//! anybody knows whether he is there at all.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use super::first_flight::first_flight;
use super::places::Places;
use super::refinement::{Missing, ReadPage, Refinement, Refining, first_refinement};
use crate::scheduler::Unit;
use crate::source::SceneSource;
use lodestream_scene::view::View;
use lodestream_select::priority::Priority;

/// Flights kept beside that of the start view, and refinements: those of clients with pictures of the same size who come
/// at one time.
const MAX_KEPT: usize = 8;

/// Units of the first flight for a view, least urgent first.
pub(super) type Flight = Arc<[(Priority, Unit)]>;

/// See the module. All sessions that share it must be of one scene.
#[derive(Debug, Default)]
pub struct Plans {
    places: OnceLock<Places>,
    start: OnceLock<(View, Flight)>,
    kept: RecentLists<View, (Priority, Unit)>,
    /// By view and budget in bytes.
    refinements: RecentLists<(View, u64), Refining>,
}

/// Lists of one kind, the one that was used last in front.
#[derive(Debug)]
struct RecentLists<K, T>(Mutex<VecDeque<(K, Arc<[T]>)>>);

impl<K, T> Default for RecentLists<K, T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: PartialEq, T> RecentLists<K, T> {
    /// A thread that panicked while it held the lock left the lists usable: entries are whole.
    fn lists(&self) -> MutexGuard<'_, VecDeque<(K, Arc<[T]>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn get(&self, key: &K) -> Option<Arc<[T]>> {
        let mut lists = self.lists();
        let at = lists.iter().position(|(of, _)| of == key)?;
        let list = lists.remove(at)?;
        let found = Arc::clone(&list.1);
        lists.push_front(list);
        Some(found)
    }

    fn keep(&self, key: K, list: &Arc<[T]>) {
        let mut lists = self.lists();
        lists.truncate(MAX_KEPT - 1);
        lists.push_front((key, Arc::clone(list)));
    }
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
        if let Some(flight) = self.kept.get(view) {
            return flight;
        }
        // Two sessions may plan the same; none waits for another.
        let flight = plan();
        self.kept.keep(*view, &flight);
        flight
    }

    /// The first refinement for a view within a budget, as `first_refinement` chooses it.
    pub(super) fn refinement(
        &self,
        source: &dyn SceneSource,
        view: &View,
        budget_bytes: u64,
        read: ReadPage<'_>,
    ) -> Result<Arc<[Refining]>, Missing> {
        let key = (*view, budget_bytes);
        if let Some(refinement) = self.refinements.get(&key) {
            return Ok(refinement);
        }
        let (flight, places) = (self.flight(source, view), self.places(source));
        let Refinement { pushed, lasts } =
            first_refinement((source, places), view, &flight, budget_bytes, read)?;
        let pushed = Arc::from(pushed);
        if lasts {
            self.refinements.keep(key, &pushed);
        }
        Ok(pushed)
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
    use crate::source::SourceError;
    use crate::testing::MemoryScene;
    use lodestream_scene::blob::BlobId;
    use lodestream_select::Occluder;

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
        assert_eq!(plans.kept.lists().len(), MAX_KEPT);
    }

    #[test]
    fn a_refinement_is_chosen_once_unless_something_may_be_better_known_later() {
        let scene = MemoryScene::new(3, 2, 5);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let chosen = |scene: &MemoryScene, plans: &Plans, budget| {
            plans.refinement(scene, &view, budget, &|id| scene.try_read(id)).unwrap()
        };
        let plans = Plans::default();
        let first = chosen(&scene, &plans, 20_000);
        assert!(!first.is_empty());
        // No surface is known that may hide something: one may be later.
        assert!(!Arc::ptr_eq(&first, &chosen(&scene, &plans, 20_000)));
        let mut scene = scene;
        Arc::get_mut(&mut scene).unwrap().occluder =
            Some(Arc::new(Occluder::new(vec![[0.0; 3]; 3], vec![[0, 1, 2]])));
        let first = chosen(&scene, &plans, 20_000);
        assert!(Arc::ptr_eq(&first, &chosen(&scene, &plans, 20_000)));
        assert_ne!(first, chosen(&scene, &plans, 64_000));
        // What could not be read may be read later.
        let plans = Plans::default();
        let broken = |id: &BlobId| Err(SourceError::NotFound(*id));
        let without = plans.refinement(&*scene, &view, 20_000, &broken).unwrap();
        assert!(without.is_empty());
        assert_eq!(chosen(&scene, &plans, 20_000), first);
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
