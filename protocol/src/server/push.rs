//! What is pushed next: ordered for a view, ordered anew for another, within the budgets.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;

use super::config::ServerConfig;
use super::plans::{Plans, Queue};
use super::refinement::{MAX_REFINED_PAGES, Missing, Refining};
use super::requests::Requests;
use crate::scheduler::Unit;
use crate::source::{Reading, SceneSource, SourceError};
use crate::time::Time;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::view::View;
use lodestream_select::priority::{Priority, is_base};

/// Pushed units that are moved to the scheduler ahead of their turn.
const PUSH_AHEAD: usize = 16;
/// Least time between two orderings of what is pushed, …
const REPLAN_INTERVAL: Duration = Duration::from_millis(100);
/// … and for each instance of the scene: an ordering takes a twentieth of that.
const REPLAN_PER_INSTANCE: Duration = Duration::from_micros(1);

/// See the module.
#[derive(Debug)]
pub(super) struct Push {
    view: View,
    /// What sessions with the scene share.
    plans: Arc<Plans>,
    /// What is pushed next.
    queue: Queue,
    /// Units without which a visible instance cannot be drawn, and what comes with them, not handed over yet.
    bases_left: HashSet<Unit>,
    bases_told: bool,
    refinement_pushed: bool,
    /// The first refinement, as far as it is not asked for.
    unasked: HashSet<Unit>,
    /// Index pages that the refinement is chosen by, where the store had to be waited for.
    pages: Pages,
    /// The client holds parts of the scene already, so guesses at what it lacks would be wrong.
    resumes: bool,
    bytes: u64,
    budget: u64,
    /// The view has changed since the last ordering.
    replan_at: Option<Time>,
    /// When it was last ordered because the view had changed.
    replanned: Option<Time>,
}

/// Index pages that are read for the server's own use.
#[derive(Debug, Default)]
struct Pages {
    due: Vec<BlobId>,
    under_way: HashSet<BlobId>,
    here: HashMap<BlobId, Result<Bytes, SourceError>>,
}

impl Push {
    /// Nothing ordered yet; `budget` bounds the bytes.
    pub(super) fn new(plans: Arc<Plans>, view: View, budget: u64) -> Self {
        Self {
            view,
            plans,
            queue: Queue::default(),
            bases_left: HashSet::new(),
            bases_told: false,
            refinement_pushed: false,
            unasked: HashSet::new(),
            pages: Pages::default(),
            resumes: false,
            bytes: 0,
            budget,
            replan_at: None,
            replanned: None,
        }
    }

    /// The client has spoken: what it looks at, what room it has, and whether it was here before.
    pub(super) fn open(&mut self, view: Option<View>, budget: u64, resumes: bool) {
        self.view = view.unwrap_or(self.view);
        self.budget = budget;
        self.bytes = 0;
        self.resumes = resumes;
    }

    /// The session is over.
    pub(super) fn clear(&mut self) {
        *self = Self { bases_told: self.bases_told, ..Self::new(Arc::clone(&self.plans), self.view, 0) };
    }

    /// What is looked at.
    pub(super) const fn view(&self) -> &View {
        &self.view
    }

    /// The view has changed: what was pushed for another stops at once. It is ordered anew soon, if `order`; the scene has
    /// so many `instances`.
    pub(super) fn set_view(
        &mut self,
        now: Time,
        view: View,
        requests: &mut Requests,
        order: bool,
        instances: u32,
    ) {
        self.view = view;
        self.drop_unasked(requests);
        if order {
            let interval = REPLAN_INTERVAL.max(REPLAN_PER_INSTANCE * instances);
            let at = self.replanned.map_or(now, |last| now.max(last + interval));
            self.replan_at.get_or_insert(at);
        }
    }

    /// When it should be ordered anew.
    pub(super) const fn replan_at(&self) -> Option<Time> {
        self.replan_at
    }

    /// Orders anew if it is time.
    pub(super) fn replan_if_due(
        &mut self,
        now: Time,
        source: &dyn SceneSource,
        requests: &mut Requests,
    ) -> bool {
        let due = self.replan_at.is_some_and(|at| at <= now);
        if due {
            self.replanned = Some(now);
            self.plan(source, requests);
        }
        due
    }

    /// Takes back what the client may not need: what it has not asked for, as far as it has not begun.
    fn drop_unasked(&mut self, requests: &mut Requests) {
        requests.take_back(&self.unasked);
        self.unasked.clear();
    }

    /// Orders anew what is pushed for the view last known.
    pub(super) fn plan(&mut self, source: &dyn SceneSource, requests: &mut Requests) {
        self.replan_at = None;
        self.drop_unasked(requests);
        if !requests.asks() {
            // Nothing but pushes is queued.
            requests.scheduler.retain(|_| false);
        }
        self.refinement_pushed = false;
        let flight = self.plans.flight(source, &self.view);
        self.queue = Queue::of_those(flight, |unit| !requests.has(unit));
        self.bases_left = self.queue.iter().filter(|(p, _)| is_base(*p)).map(|(_, unit)| *unit).collect();
        let half_sent = requests.scheduler.begun().filter(|(priority, _)| is_base(*priority));
        self.bases_left.extend(half_sent.map(|(_, unit)| unit));
        self.bases_told = false;
    }

    /// Moves the most urgent pushes to the scheduler. `open`: the client has spoken.
    pub(super) fn refill(
        &mut self,
        source: &dyn SceneSource,
        requests: &mut Requests,
        config: &ServerConfig,
        open: bool,
    ) {
        while let Some(&(priority, unit)) = self.queue.last() {
            // What is asked for meanwhile does not keep base meshes waiting.
            let is_first = requests.scheduler.peek().is_none_or(|(next, _)| next < priority);
            if requests.scheduler.queued() >= PUSH_AHEAD && !is_first {
                break;
            }
            let fits = self.fits(source, unit, open);
            if !fits && !open {
                break;
            }
            if !fits || requests.was_handed(&unit) || (self.resumes && is_texture(unit)) {
                // The client has it, or may have it and will ask if not, or has no room for more than it asks for.
                self.queue.pop();
                self.bases_left.remove(&unit);
                continue;
            }
            if !requests.scheduler.want(unit, priority) {
                // The queue is full of what was asked for: this waits until there is room.
                break;
            }
            self.queue.pop();
            self.bytes = self.bytes.saturating_add(estimated_bytes(source, unit));
        }
        if self.bases_left.is_empty() && !self.refinement_pushed && !self.pages.is_waited_for() {
            self.refinement_pushed = true;
            if !requests.refines() && !self.resumes {
                self.push_refinement(source, requests, config, open);
            }
        }
    }

    /// Whether a unit may be pushed. The first page always is: without it nothing can be placed; and all
    /// pages once the client has spoken, since only they tell it what there is.
    fn fits(&self, source: &dyn SceneSource, unit: Unit, open: bool) -> bool {
        match unit {
            Unit::Page(0) => true,
            Unit::Page(_) if open => true,
            _ => self.bytes.saturating_add(estimated_bytes(source, unit)) <= self.budget,
        }
    }

    fn push_refinement(
        &mut self,
        source: &dyn SceneSource,
        requests: &mut Requests,
        config: &ServerConfig,
        open: bool,
    ) {
        let &ServerConfig { push_after_hello_bytes, refine_before_hello_bytes, .. } = config;
        let room = self.budget.saturating_sub(self.bytes);
        let budget = if open {
            push_after_hello_bytes.min(room)
        } else {
            refine_before_hello_bytes.saturating_sub(self.bytes).min(push_after_hello_bytes).min(room)
        };
        if budget == 0 {
            return;
        }
        let read = |id: &BlobId| match self.pages.here.get(id) {
            Some(read) => read.clone().map(Reading::Ready),
            None => source.try_read(id),
        };
        match self.plans.refinement(source, &self.view, budget, &read) {
            Ok(refinement) => {
                self.pages.here = HashMap::new();
                for &Refining { priority, id, end } in &*refinement {
                    let unit = Unit::Blob(id);
                    if !requests.has(&unit) && requests.push_part(id, priority, end) {
                        self.unasked.insert(unit);
                    }
                }
            }
            Err(Missing(pages)) if self.pages.here.len() < MAX_REFINED_PAGES => {
                self.refinement_pushed = false;
                self.pages.wait(pages);
            }
            Err(_) => self.pages.here = HashMap::new(),
        }
    }

    /// A page of the scene finds no room in the queue: it waits here, before all else.
    pub(super) fn wait_page(&mut self, page: u32, priority: Priority) {
        self.queue.push((priority, Unit::Page(page)));
    }

    /// The client asks for a blob: it is no longer a guess.
    pub(super) fn asked_for(&mut self, id: BlobId) {
        self.unasked.remove(&Unit::Blob(id));
    }

    /// A unit was handed over, cannot be, or is not wanted.
    pub(super) fn settled(&mut self, unit: Unit) {
        self.bases_left.remove(&unit);
    }

    /// Whether all base meshes have been handed over, of which nothing was told yet.
    pub(super) fn bases_to_tell(&self) -> bool {
        !self.bases_told && self.bases_left.is_empty()
    }

    /// The client is told.
    pub(super) fn tell_bases(&mut self) {
        self.bases_told = true;
    }

    /// Whether all base meshes have been handed over.
    pub(super) fn has_all_bases(&self) -> bool {
        self.bases_left.is_empty()
    }

    /// Whether nothing is left to push.
    pub(super) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// Whether there is something that may be pushed.
    pub(super) fn has_work(&self, source: &dyn SceneSource, open: bool) -> bool {
        self.queue.last().is_some_and(|(_, unit)| open || self.fits(source, *unit, open))
    }

    /// The next index page that the driver should have the store read.
    pub(super) fn poll_read(&mut self) -> Option<BlobId> {
        let id = self.pages.due.pop()?;
        self.pages.under_way.insert(id);
        Some(id)
    }

    /// A read that [`Push::poll_read`] gave is done.
    pub(super) fn handle_read(&mut self, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        if self.pages.under_way.remove(&id) {
            self.pages.here.insert(id, bytes.clone());
        }
    }

    #[cfg(test)]
    pub(super) fn queued(&self) -> usize {
        self.queue.len()
    }
}

impl Pages {
    fn is_waited_for(&self) -> bool {
        !self.due.is_empty() || !self.under_way.is_empty()
    }

    fn wait(&mut self, pages: Vec<BlobId>) {
        self.due.extend(pages.into_iter().filter(|id| !self.here.contains_key(id)));
    }
}

fn is_texture(unit: Unit) -> bool {
    matches!(unit, Unit::Blob(BlobId::Asset { part: BlobPart::Texture { .. }, .. }))
}

fn estimated_bytes(source: &dyn SceneSource, unit: Unit) -> u64 {
    match unit {
        // Typical lengths of asset and instance entries.
        Unit::Page(page) => source
            .page(page)
            .map_or(0, |page| 8 + 80 * page.assets.len() as u64 + 20 * page.instances.len() as u64),
        Unit::Blob(id) => source.blob_len(&id).map_or(0, u64::from),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheduler::Outgoing;
    use crate::testing::MemoryScene;

    fn start(scene: &MemoryScene) -> View {
        scene.header.camera.view([1280, 720], 1.0)
    }

    #[test]
    fn the_refinement_follows_the_last_base_mesh_and_stops_for_another_view() {
        let scene = MemoryScene::new(2, 1, 5);
        let (mut push, mut requests) =
            (Push::new(Plans::new(), start(&scene), u64::MAX), Requests::new(1000));
        let config = ServerConfig::quic(None);
        push.plan(&*scene, &mut requests);
        push.refill(&*scene, &mut requests, &config, true);
        assert!(!push.has_all_bases() && push.unasked.is_empty());
        while !push.has_all_bases() {
            match requests.next(&*scene, 1 << 14).unwrap() {
                Outgoing::Page(page) => push.settled(Unit::Page(page)),
                Outgoing::Piece { piece, .. } => push.settled(Unit::Blob(piece.id)),
                Outgoing::Failed { id, .. } => push.settled(Unit::Blob(id)),
            }
        }
        push.refill(&*scene, &mut requests, &config, true);
        assert!(push.bases_to_tell() && push.unasked.len() > 10);
        let other = View { eye: [0.0, 9.0, 0.5], ..start(&scene) };
        push.set_view(Time::ZERO, other, &mut requests, false, 2);
        assert!(requests.scheduler.is_empty() && push.unasked.is_empty());
        assert_eq!(push.replan_at(), None);
    }

    #[test]
    fn what_is_asked_for_meanwhile_does_not_keep_base_meshes_waiting() {
        let scene = MemoryScene::new(40, 1, 5);
        let (mut push, mut requests) =
            (Push::new(Plans::new(), start(&scene), u64::MAX), Requests::new(1000));
        let config = ServerConfig::quic(None);
        push.plan(&*scene, &mut requests);
        for chunk in 0..2 * PUSH_AHEAD as u32 {
            let want = crate::message::Want::whole(BlobId::chunk(0, chunk), 9.0_f32.to_bits());
            requests.want(&*scene, &want).unwrap();
        }
        loop {
            push.refill(&*scene, &mut requests, &config, true);
            if push.has_all_bases() {
                break;
            }
            match requests.next(&*scene, 1 << 14).unwrap() {
                Outgoing::Page(page) => push.settled(Unit::Page(page)),
                Outgoing::Piece { piece, .. } => {
                    assert_eq!(
                        piece.id.part(),
                        Some(lodestream_scene::blob::BlobPart::Base),
                        "before all bases"
                    );
                    push.settled(Unit::Blob(piece.id));
                }
                Outgoing::Failed { id, .. } => push.settled(Unit::Blob(id)),
            }
        }
    }

    #[test]
    fn nothing_is_moved_beyond_the_budget_before_the_client_has_spoken() {
        let scene = MemoryScene::new(12, 1, 2);
        let (mut push, mut requests) = (Push::new(Plans::new(), start(&scene), 3000), Requests::new(1000));
        push.plan(&*scene, &mut requests);
        push.refill(&*scene, &mut requests, &ServerConfig::quic(None), false);
        assert!(push.bytes <= 3000 && !push.is_empty() && !push.has_work(&*scene, false));
        push.open(None, u64::MAX, false);
        assert!(push.has_work(&*scene, true));
    }
}
