//! Cache of first flights and first refinements, which the sessions of a scene share.
//!
//! Ordering a scene for a view costs a pass over the instances in view. All connections begin with the start view,
//! before their addresses are validated, so the work must not grow with their number.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use super::first_flight::first_flight;
use super::pushed_blob::PushedBlob;
use super::refinement::{Missing, ReadPage, Refinement, first_refinement};
use super::scene_index::SceneIndex;
use crate::scheduler::Unit;
use crate::source::SceneSource;
use lodestream_scene::view::View;
use lodestream_select::priority::Priority;

/// Entries of each cache, beside the start view's flight: enough for clients that connect at one time with different
/// picture sizes.
const MAX_CACHED: usize = 8;

/// Units of the first flight for a view, least urgent first.
pub(super) type Flight = Arc<[(Priority, Unit)]>;

/// First flights and refinements by view. All sessions that share it must be of one scene.
#[derive(Debug, Default)]
pub struct Plans {
    index: OnceLock<SceneIndex>,
    start: OnceLock<(View, Flight)>,
    flights: LruCache<View, (Priority, Unit)>,
    /// By view and budget in bytes.
    refinements: LruCache<(View, u64), PushedBlob>,
}

/// A small cache of lists, most recently used first.
#[derive(Debug)]
struct LruCache<K, T>(Mutex<VecDeque<(K, Arc<[T]>)>>);

impl<K, T> Default for LruCache<K, T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: PartialEq, T> LruCache<K, T> {
    /// Poisoning is ignored: a panic leaves no entry half changed.
    fn lists(&self) -> MutexGuard<'_, VecDeque<(K, Arc<[T]>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn get(&self, key: &K) -> Option<Arc<[T]>> {
        let mut lists = self.lists();
        let at = lists.iter().position(|(of, _)| of == key)?;
        let list = lists.remove(at)?;
        let cached = Arc::clone(&list.1);
        lists.push_front(list);
        Some(cached)
    }

    fn insert(&self, key: K, list: &Arc<[T]>) {
        let mut lists = self.lists();
        lists.truncate(MAX_CACHED - 1);
        lists.push_front((key, Arc::clone(list)));
    }
}

impl Plans {
    /// An empty cache.
    #[must_use]
    pub fn new() -> Arc<Self> {
        Arc::default()
    }

    /// The index of the scene's description, built on the first call.
    pub(super) fn index(&self, source: &dyn SceneSource) -> &SceneIndex {
        self.index.get_or_init(|| SceneIndex::new(source))
    }

    /// The first flight for a view. The view of the first call counts as the start view; its flight is kept for good.
    pub(super) fn flight(&self, source: &dyn SceneSource, view: &View) -> Flight {
        let plan = || Flight::from(first_flight(source, self.index(source), view));
        let (start, flight) = self.start.get_or_init(|| (*view, plan()));
        if start == view {
            return Arc::clone(flight);
        }
        if let Some(flight) = self.flights.get(view) {
            return flight;
        }
        // Two sessions may compute the same flight: neither waits for the other.
        let flight = plan();
        self.flights.insert(*view, &flight);
        flight
    }

    /// The result of `first_refinement` for a view and a budget.
    ///
    /// # Errors
    /// The index pages that must be read first.
    pub(super) fn refinement(
        &self,
        source: &dyn SceneSource,
        view: &View,
        budget_bytes: u64,
        read: ReadPage<'_>,
    ) -> Result<Arc<[PushedBlob]>, Missing> {
        let key = (*view, budget_bytes);
        if let Some(refinement) = self.refinements.get(&key) {
            return Ok(refinement);
        }
        let (flight, index) = (self.flight(source, view), self.index(source));
        let Refinement { pushed, is_final } =
            first_refinement((source, index), view, &flight, budget_bytes, read)?;
        let pushed = Arc::from(pushed);
        if is_final {
            self.refinements.insert(key, &pushed);
        }
        Ok(pushed)
    }
}

/// The remaining units of a flight. The flight itself is shared between sessions.
#[derive(Debug)]
pub(super) struct Queue {
    flight: Flight,
    /// The first `remaining` units of the flight are left; the others were taken.
    remaining: usize,
    /// Units added later, which are sent before the flight's.
    added: Vec<(Priority, Unit)>,
}

impl Default for Queue {
    fn default() -> Self {
        Self::new(Flight::default())
    }
}

impl Queue {
    /// A queue of all units of a flight.
    pub(super) fn new(flight: Flight) -> Self {
        Self { remaining: flight.len(), flight, added: Vec::new() }
    }

    /// A queue of the units that pass a predicate; the flight stays shared if all do.
    pub(super) fn filtered(flight: Flight, keep: impl Fn(&Unit) -> bool) -> Self {
        if flight.iter().all(|(_, unit)| keep(unit)) {
            return Self::new(flight);
        }
        Self::new(flight.iter().copied().filter(|(_, unit)| keep(unit)).collect())
    }

    /// The next unit.
    pub(super) fn peek(&self) -> Option<&(Priority, Unit)> {
        self.added.last().or_else(|| self.flight.get(self.remaining.checked_sub(1)?))
    }

    /// Removes the next unit.
    pub(super) fn pop(&mut self) {
        if self.added.pop().is_none() {
            self.remaining = self.remaining.saturating_sub(1);
        }
    }

    /// Adds a unit before all others.
    pub(super) fn push(&mut self, unit: (Priority, Unit)) {
        self.added.push(unit);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(super) fn len(&self) -> usize {
        self.remaining + self.added.len()
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &(Priority, Unit)> {
        self.flight.iter().take(self.remaining).chain(&self.added)
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
    fn flights_are_cached_by_view_and_bounded() {
        let scene = MemoryScene::new(3, 2, 2);
        let plans = Plans::default();
        let start = scene.header.camera.view([1280, 720], 1.0);
        let at = |n: u32| View { eye: [f64::from(n), 1.0, 4.0], ..start };
        let first = plans.flight(&*scene, &start);
        for n in 1..100 {
            let flight = plans.flight(&*scene, &at(n));
            assert!(Arc::ptr_eq(&flight, &plans.flight(&*scene, &at(n))));
            assert_eq!(flight[..], first_flight(&*scene, &SceneIndex::new(&*scene), &at(n))[..]);
        }
        assert!(Arc::ptr_eq(&first, &plans.flight(&*scene, &start)));
        assert_eq!(plans.flights.lists().len(), MAX_CACHED);
    }

    #[test]
    fn final_refinements_are_cached_and_others_are_not() {
        let scene = MemoryScene::new(3, 2, 5);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let chosen = |scene: &MemoryScene, plans: &Plans, budget| {
            plans.refinement(scene, &view, budget, &|id| scene.try_read(id)).unwrap()
        };
        let plans = Plans::default();
        let first = chosen(&scene, &plans, 20_000);
        assert!(!first.is_empty());
        // No occluder is known; one may become known later.
        assert!(!Arc::ptr_eq(&first, &chosen(&scene, &plans, 20_000)));
        let mut scene = scene;
        Arc::get_mut(&mut scene).unwrap().occluder =
            Some(Arc::new(Occluder::new(vec![[0.0; 3]; 3], vec![[0, 1, 2]])));
        let first = chosen(&scene, &plans, 20_000);
        assert!(Arc::ptr_eq(&first, &chosen(&scene, &plans, 20_000)));
        assert_ne!(first, chosen(&scene, &plans, 64_000));
        // A page that could not be read may be readable later.
        let plans = Plans::default();
        let broken = |id: &BlobId| Err(SourceError::NotFound(*id));
        let without = plans.refinement(&*scene, &view, 20_000, &broken).unwrap();
        assert!(without.is_empty());
        assert_eq!(chosen(&scene, &plans, 20_000), first);
    }

    #[test]
    fn queue_takes_a_flight_from_its_end() {
        let unit = |n: u32| (n, Unit::Page(n));
        let flight: Flight = (0..4).map(unit).collect();
        let mut queue = Queue::filtered(Arc::clone(&flight), |_| true);
        assert!(Arc::ptr_eq(&queue.flight, &flight));
        queue.pop();
        queue.push(unit(9));
        assert_eq!(queue.iter().copied().collect::<Vec<_>>(), [0, 1, 2, 9].map(unit));
        let mut taken = Vec::new();
        while let Some(next) = queue.peek().copied() {
            queue.pop();
            taken.push(next);
        }
        assert_eq!(taken, [9, 2, 1, 0].map(unit));
        queue.pop();
        assert!(queue.is_empty());
        let some = Queue::filtered(flight, |unit| *unit != Unit::Page(1));
        assert_eq!(some.iter().copied().collect::<Vec<_>>(), [0, 2, 3].map(unit));
    }
}
