//! The core: books, and the order in which things happen.

mod arrivals;
mod blob_states;
mod decoding;
mod events;
mod refinement;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use bytes::Bytes;
use lodestream_protocol::client::{ClientSession, Resume};
use lodestream_protocol::frame::{BlobPiece, FrameError, ServerFrame};
use lodestream_protocol::message::{ClientMessage, Close, CloseCode, Token, Welcome};
use lodestream_protocol::time::Time;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::SceneHeader;
use lodestream_scene::limits::MAX_HAVE;
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::view::View;
use lodestream_select::{Counters, Selection, Selector, State, Wanted};

use super::cache::BlobCache;
use super::changes::Change;
use super::config::{Config, StartView};
use super::failures::Failures;
use super::milestones::Milestones;
use super::motion::Motion;
use super::punctual_light_pages::PunctualLightPages;
use super::scene::Scene;
use super::stats::{Connection, MAX_LACKING, Received, Stats};
use arrivals::Arrived;

/// What [`ClientCore::update`] leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The budget is used up: call again soon.
    More,
    /// Nothing is left to do until something arrives, the view changes or a timeout comes.
    Idle,
}

/// The client's state. See the [module](super) for how it is driven.
#[derive(Debug)]
pub struct ClientCore {
    pub(super) config: Config,
    session: Option<ClientSession>,
    selector: Selector,
    pub(super) scene: Scene,
    pub(super) cache: BlobCache,
    pub(super) failures: Failures,
    /// Base meshes and index pages that arrived and are not decoded yet; bounded by what the session has
    /// in flight.
    pub(super) arrived: VecDeque<(BlobId, Bytes)>,
    /// Blobs of assets whose scene page is not here yet.
    early: Vec<Arrived>,
    /// What came of each blob, where that is counted.
    received: BTreeMap<BlobId, Received>,
    view: Option<View>,
    motion: Motion,
    /// The last selection's list, states kept up to date.
    pub(super) wanted: Vec<Wanted>,
    /// What the view needs and failed, as of the last selection.
    failed: Vec<BlobId>,
    /// Whether something happened that the last selection did not see.
    stale: bool,
    /// Whether the view lacks no listed points of the terrain.
    terrain_settled: bool,
    /// Whether the view lacks no punctual lights.
    punctual_lights_settled: bool,
    selected: Option<Time>,
    bases_sent: bool,
    started: Option<Time>,
    /// Transport payload of the present connection, and of earlier ones.
    transport_bytes: u64,
    earlier_bytes: u64,
    closed: Option<Close>,
    welcome: Option<Welcome>,
    milestones: Milestones,
    pub(super) counts: Counts,
}

/// Counters that only grow.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub(super) undone: u64,
    pub(super) decoded_faces: u64,
    pub(super) decode_failures: u64,
    evicted: u64,
    refused: u64,
    selections: u64,
    connections: u64,
    pub(super) texture_levels: u64,
    settled_after: Option<Duration>,
}

impl ClientCore {
    /// A client that has not connected yet.
    #[must_use]
    pub fn new(config: Config) -> Self {
        let view = match config.start {
            StartView::Given(view) => Some(view),
            StartView::OfScene { .. } => None,
        };
        Self {
            session: None,
            selector: Selector::new(config.select),
            scene: Scene::default(),
            cache: BlobCache::new(config.cache_bytes),
            failures: Failures::default(),
            arrived: VecDeque::new(),
            early: Vec::new(),
            received: BTreeMap::new(),
            view,
            motion: Motion::default(),
            wanted: Vec::new(),
            failed: Vec::new(),
            stale: false,
            terrain_settled: true,
            punctual_lights_settled: true,
            selected: None,
            bases_sent: false,
            started: None,
            transport_bytes: 0,
            earlier_bytes: 0,
            closed: None,
            welcome: None,
            milestones: Milestones::default(),
            counts: Counts::default(),
            config,
        }
    }

    /// Notes the moment of the user's connect call, from which milestones count. Without it, the first
    /// [`ClientCore::connect`] is that moment.
    pub fn begin(&mut self, now: Time) {
        self.started.get_or_insert(now);
    }

    /// A transport is open: begins a session over it. What is here already is not fetched again if the
    /// server still has the same scene.
    pub fn connect(&mut self, now: Time) {
        self.begin(now);
        self.disconnect();
        let mut resume = Resume::default();
        if let Some(header) = &self.scene.header {
            resume.fingerprint = header.fingerprint;
            let held = (0..).zip(&self.scene.states).flat_map(|(asset, state)| state.held(asset));
            resume.have = held.take(MAX_HAVE).collect();
        }
        self.session = Some(ClientSession::new(self.config.session.clone(), self.view, resume, now));
        self.early.clear();
        self.bases_sent = false;
        self.closed = None;
        self.welcome = None;
        self.counts.connections += 1;
        self.stale = true;
    }

    /// The session is over: what was under way will not come.
    fn disconnect(&mut self) {
        self.session = None;
        self.earlier_bytes += std::mem::take(&mut self.transport_bytes);
        self.scene.reset_in_flight();
    }

    /// Takes a frame of the server.
    pub fn handle_frame(&mut self, now: Time, frame: ServerFrame) {
        if let Some(session) = &mut self.session {
            session.handle_frame(now, frame);
            self.drain(now);
        }
    }

    /// Takes a piece of a blob.
    pub fn handle_piece(&mut self, now: Time, piece: BlobPiece) {
        if let Some(session) = &mut self.session {
            session.handle_piece(now, piece);
            self.drain(now);
        }
    }

    /// The stream of a blob was reset.
    pub fn handle_abandoned(&mut self, now: Time, id: BlobId) {
        if let Some(session) = &mut self.session {
            session.handle_abandoned(now, id);
            self.drain(now);
        }
    }

    /// Takes what the driver could not decode: the session ends.
    pub fn handle_frame_error(&mut self, now: Time, error: &FrameError) {
        if let Some(session) = &mut self.session {
            session.handle_frame_error(now, error);
            self.drain(now);
        }
    }

    /// The transport failed or ended.
    pub fn handle_lost(&mut self, now: Time, reason: &str) {
        if let Some(session) = &mut self.session {
            session.handle_lost(now, reason);
            self.drain(now);
        }
    }

    /// Leaves: the session says `Bye`.
    pub fn leave(&mut self, now: Time) {
        if let Some(session) = &mut self.session {
            session.close(now, CloseCode::Normal, "the viewer left");
            self.drain(now);
        }
    }

    /// Transport payload received over the present connection so far, handshake included.
    pub fn note_transport_bytes(&mut self, bytes: u64) {
        self.transport_bytes = bytes;
    }

    /// Call when the moment given by [`ClientCore::poll_timeout`] has come, then
    /// [`ClientCore::update`]; earlier is harmless.
    pub fn handle_timeout(&mut self, now: Time) {
        if let Some(session) = &mut self.session {
            session.handle_timeout(now);
            self.drain(now);
        }
        for id in self.failures.due(now) {
            self.set_state(id, State::Absent);
            self.stale = true;
        }
    }

    /// When to call [`ClientCore::handle_timeout`].
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Time> {
        let session = self.session.as_ref().and_then(ClientSession::poll_timeout);
        let select = (self.stale && self.view.is_some()).then(|| self.next_selection());
        [session, self.failures.next(), select].into_iter().flatten().min()
    }

    /// The next message to send. Call until `None`, while the transport can take it.
    pub fn poll_transmit(&mut self, now: Time) -> Option<ClientMessage> {
        self.session.as_mut()?.poll_transmit(now)
    }

    /// Whether a session is open and the server has answered.
    #[must_use]
    pub const fn is_open(&self) -> bool {
        self.session.is_some() && self.welcome.is_some() && self.closed.is_none()
    }

    /// For how long the server has been silent, if that is longer than an answer takes ([`ClientSession::silence`]).
    #[must_use]
    pub fn silence(&self, now: Time) -> Option<Duration> {
        self.session.as_ref()?.silence(now)
    }

    /// Why the session ended, once it has and all its messages are sent.
    #[must_use]
    pub fn closed(&self) -> Option<&Close> {
        self.session.as_ref().filter(|session| session.is_closed()).and(self.closed.as_ref())
    }

    /// Asks for the scene of this name in sessions that begin from now on; empty for the server's only one.
    pub fn ask_for(&mut self, scene: &str) {
        scene.clone_into(&mut self.config.session.scene);
    }

    /// What shows that the client may see the scene.
    #[must_use]
    pub const fn token(&self) -> Option<&Token> {
        self.config.session.token.as_ref()
    }

    /// Shows another token, in this session and those after it.
    pub fn set_token(&mut self, token: Token) {
        if self.config.session.token.as_ref() == Some(&token) {
            return;
        }
        if let Some(session) = &mut self.session {
            session.set_token(token.clone());
        }
        self.config.session.token = Some(token);
    }

    /// Moves the camera. Views that cannot be drawn are ignored.
    pub fn set_view(&mut self, now: Time, view: View) {
        if self.view == Some(view) || view.check().is_err() {
            return;
        }
        self.motion.moved(now, self.view.map(|view| view.eye), view.eye);
        self.view = Some(view);
        self.stale = true;
        if let Some(session) = &mut self.session {
            session.set_view(now, view);
        }
    }

    /// Whether what casts shadows into view from out of it is refined too, instead of as the configuration says.
    pub fn set_shadows(&mut self, shadows: bool) {
        let wanted = &mut self.selector.settings_mut().shadows;
        self.stale |= *wanted != shadows;
        *wanted = shadows;
    }

    /// The camera, once known.
    #[must_use]
    pub const fn view(&self) -> Option<View> {
        self.view
    }

    /// The scene's header, once known.
    #[must_use]
    pub const fn scene(&self) -> Option<&SceneHeader> {
        self.scene.header.as_ref()
    }

    /// The refined mesh of an asset whose base mesh is here.
    #[must_use]
    pub fn mesh(&self, asset: u32) -> Option<&lodestream_geometry::refine::ActiveMesh> {
        self.scene.refined.get(asset as usize)?.as_ref().map(super::asset::RefinedAsset::mesh)
    }

    /// The punctual lights of the scene that are here, in an order that all clients share. More come as views want them.
    pub fn punctual_lights(&self) -> impl Iterator<Item = &PunctualLight> {
        self.scene.punctual_lights.iter().flat_map(PunctualLightPages::here)
    }

    /// How many punctual lights the scene has in all.
    #[must_use]
    pub fn punctual_light_count(&self) -> u32 {
        self.scene.punctual_lights.as_ref().map_or(0, PunctualLightPages::count)
    }

    /// Transport payload received over all connections so far, handshakes included.
    #[must_use]
    pub const fn received_bytes(&self) -> u64 {
        self.earlier_bytes + self.transport_bytes
    }

    /// Whether the picture is as sharp as target and budgets allow, and nothing is under way or lacking.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.nothing_under_way() && self.lacking().next().is_none()
    }

    /// Blobs without which the view stays coarser than it might be, once everything else is here: they came damaged
    /// or the server refuses them, time and again. None while anything else is under way.
    pub fn lacking_blobs(&self) -> impl Iterator<Item = BlobId> {
        self.nothing_under_way().then(|| self.lacking()).into_iter().flatten()
    }

    fn lacking(&self) -> impl Iterator<Item = BlobId> {
        self.failed.iter().copied().filter(|id| self.failures.is_lacking(*id))
    }

    fn nothing_under_way(&self) -> bool {
        self.scene.is_complete()
            && !self.stale
            && self.counters().settled
            && self.terrain_settled
            && self.punctual_lights_settled
            && self.arrived.is_empty()
            && !self.failed.iter().any(|id| self.failures.is_hopeful(*id))
    }

    /// Counters of the last selection.
    #[must_use]
    pub const fn counters(&self) -> &Counters {
        &self.selector.last().counters
    }

    /// How many selections were made, and what the last one found.
    #[must_use]
    pub const fn last_selection(&self) -> (u64, &Selection) {
        (self.counts.selections, self.selector.last())
    }

    /// What came of each blob; of those that were cancelled on the way, only what came whole. Empty unless [`Config::track_received`] is set.
    #[must_use]
    pub const fn received(&self) -> &BTreeMap<BlobId, Received> {
        &self.received
    }

    /// What a renderer must fetch since the last call, in order, about `max_bytes` of it. `now` is the
    /// birth of vertices that appear for the first time.
    pub fn take_changes(&mut self, now: Time, max_bytes: usize) -> Vec<Change> {
        // Seconds since the start: milliseconds for 4 hours.
        let now_s = Duration::from(now).as_secs_f64() as f32;
        self.scene.take_changes(now_s, max_bytes)
    }

    /// Whether [`ClientCore::take_changes`] has something.
    #[must_use]
    pub fn has_changes(&self) -> bool {
        self.scene.has_changes()
    }

    /// Memory of what [`ClientCore::take_changes`] has, in bytes, meshes not counted.
    #[must_use]
    pub const fn waiting_bytes(&self) -> usize {
        self.scene.waiting_bytes()
    }

    /// The milestones so far.
    #[must_use]
    pub const fn milestones(&self) -> &Milestones {
        &self.milestones
    }

    /// [`Stats::decoded_faces`], without the rest.
    #[must_use]
    pub const fn decoded_faces(&self) -> u64 {
        self.counts.decoded_faces
    }

    /// Everything countable. Costs a pass over the assets.
    #[must_use]
    pub fn stats(&self) -> Stats {
        let connection = match (&self.session, &self.closed, &self.welcome) {
            (_, Some(close), _) => Connection::Closed(close.reason.clone()),
            (None, None, _) => Connection::None,
            (Some(_), None, None) => Connection::Opening,
            (Some(_), None, Some(_)) => Connection::Open,
        };
        let mut stats = Stats {
            scene: self.scene.header.as_ref().map(|h| h.name.clone()).unwrap_or_default(),
            connection,
            rate_bits_per_s: self.welcome.as_ref().map(|w| w.rate_bits_per_s).filter(|rate| *rate > 0),
            counters: *self.counters(),
            session: self.session.as_ref().map(ClientSession::stats).unwrap_or_default(),
            milestones: self.milestones,
            transport_bytes: self.received_bytes(),
            assets: self.scene.asset_count(),
            instances: u32::try_from(self.scene.instances().all().len()).unwrap_or(u32::MAX),
            scene_instances: self.scene.header.as_ref().map_or(0, |h| h.instance_count),
            wanted_chunks: u64::from(self.counters().missing_chunks),
            texture_levels: self.counts.texture_levels,
            cached_bytes: self.cache.bytes(),
            undone: self.counts.undone,
            decoded_faces: self.counts.decoded_faces,
            decode_failures: self.counts.decode_failures,
            evicted: self.counts.evicted,
            refused: self.counts.refused,
            selections: self.counts.selections,
            connections: self.counts.connections,
            settled: self.is_settled(),
            lacking_blobs: self.lacking_blobs().count() as u64,
            lacking: self.lacking_blobs().take(MAX_LACKING).collect(),
            settled_after: self.counts.settled_after,
            ..Stats::default()
        };
        for refined in self.scene.refined.iter().flatten() {
            stats.faces += refined.mesh().face_count() as u64;
            stats.vertices += refined.mesh().vertex_count() as u64;
            stats.applied_chunks += refined.mesh().applied_count() as u64;
            stats.mesh_bytes += refined.mesh().bytes() as u64;
        }
        stats
    }
}
