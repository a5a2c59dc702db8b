//! What the server pushes: units ordered for the client's view, reordered when it changes, within byte budgets.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;

use super::config::ServerConfig;
use super::plans::{Plans, Queue};
use super::pushed_blob::PushedBlob;
use super::refinement::{MAX_REFINED_PAGES, Missing};
use super::requests::Requests;
use super::scene_index::estimated_page_bytes;
use crate::scheduler::Unit;
use crate::source::{Reading, SceneSource, SourceError};
use crate::time::Time;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::view::View;
use lodestream_select::priority::{Priority, is_base};

/// Pushed units that are in the scheduler at a time.
const PUSH_AHEAD: usize = 16;
/// Least time between two orderings, …
const REPLAN_INTERVAL: Duration = Duration::from_millis(100);
/// … and per instance of the scene. An ordering takes a twentieth of that.
const REPLAN_PER_INSTANCE: Duration = Duration::from_micros(1);

/// The state of what is pushed to one client.
#[derive(Debug)]
pub(super) struct Push {
    view: View,
    /// Cache that the scene's sessions share.
    plans: Arc<Plans>,
    /// Units to push.
    queue: Queue,
    /// Units with the priority of base meshes that are not handed over yet.
    bases_left: HashSet<Unit>,
    bases_reported: bool,
    refinement_pushed: bool,
    /// Units of the first refinement that the client has not requested.
    unrequested: HashSet<Unit>,
    /// Index pages that choosing the refinement needs and that must be read from the store.
    pages: PageReads,
    /// Whether the client has parts of the scene from an earlier session; then nothing is pushed on a guess.
    resumes: bool,
    bytes: u64,
    budget: u64,
    /// When to reorder for a changed view.
    replan_at: Option<Time>,
    /// When a changed view last caused a reordering.
    replanned: Option<Time>,
}

/// Reads of index pages for the session's own use.
#[derive(Debug, Default)]
struct PageReads {
    due: Vec<BlobId>,
    outstanding: HashSet<BlobId>,
    read: HashMap<BlobId, Result<Bytes, SourceError>>,
}

impl Push {
    /// An empty queue; `budget` bounds the pushed bytes.
    pub(super) fn new(plans: Arc<Plans>, view: View, budget: u64) -> Self {
        Self {
            view,
            plans,
            queue: Queue::default(),
            bases_left: HashSet::new(),
            bases_reported: false,
            refinement_pushed: false,
            unrequested: HashSet::new(),
            pages: PageReads::default(),
            resumes: false,
            bytes: 0,
            budget,
            replan_at: None,
            replanned: None,
        }
    }

    /// Applies `Hello`: the client's view, its memory budget in bytes and whether it has blobs from an earlier session.
    pub(super) fn open(&mut self, view: Option<View>, budget: u64, resumes: bool) {
        self.view = view.unwrap_or(self.view);
        self.budget = budget;
        self.bytes = 0;
        self.resumes = resumes;
    }

    /// Ends the session.
    pub(super) fn clear(&mut self) {
        *self =
            Self { bases_reported: self.bases_reported, ..Self::new(Arc::clone(&self.plans), self.view, 0) };
    }

    /// The client's view.
    pub(super) const fn view(&self) -> &View {
        &self.view
    }

    /// Changes the view. Withdraws what was pushed for the old one and, if `replan`, schedules a reordering.
    /// `instances` is the number of instances of the scene.
    pub(super) fn set_view(
        &mut self,
        now: Time,
        view: View,
        requests: &mut Requests,
        replan: bool,
        instances: u32,
    ) {
        self.view = view;
        self.drop_unrequested(requests);
        if replan {
            let interval = REPLAN_INTERVAL.max(REPLAN_PER_INSTANCE * instances);
            let at = self.replanned.map_or(now, |last| now.max(last + interval));
            self.replan_at.get_or_insert(at);
        }
    }

    /// When to call [`replan_if_due`](Self::replan_if_due).
    pub(super) const fn replan_at(&self) -> Option<Time> {
        self.replan_at
    }

    /// Reorders if that is due; returns whether it was.
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

    /// Withdraws units of the refinement that the client has not requested and of which nothing was sent.
    fn drop_unrequested(&mut self, requests: &mut Requests) {
        requests.withdraw(&self.unrequested);
        self.unrequested.clear();
    }

    /// Orders what is pushed for the current view.
    pub(super) fn plan(&mut self, source: &dyn SceneSource, requests: &mut Requests) {
        self.replan_at = None;
        self.drop_unrequested(requests);
        if !requests.has_requested() {
            // Only pushed units are queued.
            requests.scheduler.retain(|_| false);
        }
        self.refinement_pushed = false;
        let flight = self.plans.flight(source, &self.view);
        self.queue = Queue::filtered(flight, |unit| !requests.has(unit));
        self.bases_left = self.queue.iter().filter(|(p, _)| is_base(*p)).map(|(_, unit)| *unit).collect();
        let partly_sent = requests.scheduler.begun().filter(|(priority, _)| is_base(*priority));
        self.bases_left.extend(partly_sent.map(|(_, unit)| unit));
        self.bases_reported = false;
    }

    /// Moves the most urgent units to the scheduler. `open` says that `Hello` has arrived.
    pub(super) fn refill(
        &mut self,
        source: &dyn SceneSource,
        requests: &mut Requests,
        config: &ServerConfig,
        open: bool,
    ) {
        while let Some(&(priority, unit)) = self.queue.peek() {
            // Base meshes do not wait for requests of lower priority.
            let is_first = requests.scheduler.peek().is_none_or(|(next, _)| next < priority);
            if requests.scheduler.queued() >= PUSH_AHEAD && !is_first {
                break;
            }
            let fits = self.fits(source, unit, open);
            if !fits && !open {
                break;
            }
            if !fits || requests.was_sent(&unit) || (self.resumes && is_texture(unit)) {
                // The client has it, or may have it and requests it otherwise, or has no memory left for pushed units.
                self.queue.pop();
                self.bases_left.remove(&unit);
                continue;
            }
            if !requests.scheduler.want(unit, priority) {
                // The queue is full of requests: the unit waits until there is room.
                break;
            }
            self.queue.pop();
            self.bytes = self.bytes.saturating_add(estimated_bytes(source, unit));
        }
        if self.bases_left.is_empty() && !self.refinement_pushed && !self.pages.is_pending() {
            self.refinement_pushed = true;
            if !requests.has_requested_chunks() && !self.resumes {
                self.push_refinement(source, requests, config, open);
            }
        }
    }

    /// Whether a unit is within the budget. The first page always is, since nothing can be placed without it, and after
    /// `Hello` all pages, since the client can request only what they list.
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
        let read = |id: &BlobId| match self.pages.read.get(id) {
            Some(read) => read.clone().map(Reading::Ready),
            None => source.try_read(id),
        };
        match self.plans.refinement(source, &self.view, budget, &read) {
            Ok(refinement) => {
                self.pages.read = HashMap::new();
                for &PushedBlob { priority, id, end } in &*refinement {
                    let unit = Unit::Blob(id);
                    if !requests.has(&unit) && requests.push_part(id, priority, end) {
                        self.unrequested.insert(unit);
                    }
                }
            }
            Err(Missing(pages)) if self.pages.read.len() < MAX_REFINED_PAGES => {
                self.refinement_pushed = false;
                self.pages.request(pages);
            }
            Err(_) => self.pages.read = HashMap::new(),
        }
    }

    /// Adds a scene page before all other units, because the scheduler's queue is full.
    pub(super) fn queue_page(&mut self, page: u32, priority: Priority) {
        self.queue.push((priority, Unit::Page(page)));
    }

    /// Records that the client has requested a blob, which is then not withdrawn.
    pub(super) fn requested(&mut self, id: BlobId) {
        self.unrequested.remove(&Unit::Blob(id));
    }

    /// Records that a unit was handed over, cannot be read, or was cancelled.
    pub(super) fn settled(&mut self, unit: Unit) {
        self.bases_left.remove(&unit);
    }

    /// Whether all base meshes are handed over and `BasesSent` is not sent yet.
    pub(super) fn must_report_bases(&self) -> bool {
        !self.bases_reported && self.bases_left.is_empty()
    }

    /// Records that `BasesSent` was sent.
    pub(super) fn bases_reported(&mut self) {
        self.bases_reported = true;
    }

    /// Whether all base meshes are handed over.
    pub(super) fn has_all_bases(&self) -> bool {
        self.bases_left.is_empty()
    }

    /// Whether nothing is left to push.
    pub(super) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// Whether there is a unit that may be pushed now.
    pub(super) fn has_work(&self, source: &dyn SceneSource, open: bool) -> bool {
        self.queue.peek().is_some_and(|(_, unit)| open || self.fits(source, *unit, open))
    }

    /// The next index page to read from the store.
    pub(super) fn poll_read(&mut self) -> Option<BlobId> {
        let id = self.pages.due.pop()?;
        self.pages.outstanding.insert(id);
        Some(id)
    }

    /// Takes the result of a read that [`Push::poll_read`] requested.
    pub(super) fn handle_read(&mut self, id: BlobId, bytes: &Result<Bytes, SourceError>) {
        if self.pages.outstanding.remove(&id) {
            self.pages.read.insert(id, bytes.clone());
        }
    }

    #[cfg(test)]
    pub(super) fn queued(&self) -> usize {
        self.queue.len()
    }
}

impl PageReads {
    fn is_pending(&self) -> bool {
        !self.due.is_empty() || !self.outstanding.is_empty()
    }

    fn request(&mut self, pages: Vec<BlobId>) {
        self.due.extend(pages.into_iter().filter(|id| !self.read.contains_key(id)));
    }
}

fn is_texture(unit: Unit) -> bool {
    matches!(unit, Unit::Blob(BlobId::Asset { part: BlobPart::Texture { .. }, .. }))
}

fn estimated_bytes(source: &dyn SceneSource, unit: Unit) -> u64 {
    match unit {
        Unit::Page(page) => source.page(page).map_or(0, |page| estimated_page_bytes(&page)),
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

    /// A push of at most so many bytes whose first units are planned.
    fn planned(scene: &Arc<MemoryScene>, bytes: u64) -> (Push, Requests) {
        let (mut push, mut requests) = (Push::new(Plans::new(), start(scene), bytes), Requests::new(1000));
        push.plan(&**scene, &mut requests);
        (push, requests)
    }

    #[test]
    fn refinement_follows_the_base_meshes_and_is_withdrawn_for_another_view() {
        let scene = MemoryScene::new(2, 1, 5);
        let (mut push, mut requests) = planned(&scene, u64::MAX);
        let config = ServerConfig::quic(None);
        push.refill(&*scene, &mut requests, &config, true);
        assert!(!push.has_all_bases() && push.unrequested.is_empty());
        while !push.has_all_bases() {
            match requests.next(&*scene, 1 << 14).unwrap() {
                Outgoing::Page { page, .. } => push.settled(Unit::Page(page)),
                Outgoing::Piece { piece, .. } => push.settled(Unit::Blob(piece.id)),
                Outgoing::Failed { id, .. } => push.settled(Unit::Blob(id)),
            }
        }
        push.refill(&*scene, &mut requests, &config, true);
        assert!(push.must_report_bases() && push.unrequested.len() > 10);
        let other = View { eye: [0.0, 9.0, 0.5], ..start(&scene) };
        push.set_view(Time::ZERO, other, &mut requests, false, 2);
        assert!(requests.scheduler.is_empty() && push.unrequested.is_empty());
        assert_eq!(push.replan_at(), None);
    }

    #[test]
    fn base_meshes_do_not_wait_for_requests() {
        let scene = MemoryScene::new(40, 1, 5);
        let (mut push, mut requests) = planned(&scene, u64::MAX);
        let config = ServerConfig::quic(None);
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
                Outgoing::Page { page, .. } => push.settled(Unit::Page(page)),
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
    fn push_before_hello_keeps_to_its_budget() {
        let scene = MemoryScene::new(12, 1, 2);
        let (mut push, mut requests) = planned(&scene, 3000);
        push.refill(&*scene, &mut requests, &ServerConfig::quic(None), false);
        assert!(push.bytes <= 3000 && !push.is_empty() && !push.has_work(&*scene, false));
        push.open(None, u64::MAX, false);
        assert!(push.has_work(&*scene, true));
    }
}
