//! [`ClientCore`]: its state, and the settings that may change while it runs. Each module below it holds one
//! responsibility.

mod animation;
mod apply;
mod arrivals;
mod blob_error;
mod blob_states;
mod parts;
mod ranges;
mod report;
mod session;
mod session_events;
mod source;
mod state;
mod update;

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use bytes::Bytes;
use lodestream_protocol::message::Token;
use lodestream_protocol::time::Time;
use lodestream_scene::animation::Moment;
use lodestream_scene::blob::BlobId;
use lodestream_scene::description::SceneHeader;
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::view::View;
use lodestream_select::{SelectSettings, Selector};

use super::cache::BlobCache;
use super::changes::Change;
use super::config::{Config, StartView};
use super::decoders::Decoders;
use super::failures::Failures;
use super::milestones::Milestones;
use super::motion::Motion;
use super::moved_parts::MovedParts;
use super::parts::PartLookups;
use super::punctual_light_pages::PunctualLightPages;
use super::scene::Scene;
use super::stats::Received;
use state::{ConnectionState, ReceivedBlob, SelectionState};

/// Result of [`ClientCore::update`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The budget is used up; call again soon.
    More,
    /// Nothing is left to do until a message arrives, the view changes or the timeout passes.
    Idle,
}

/// The client without network, graphics and clock. The [module](super) describes how it is driven.
#[derive(Debug)]
pub struct ClientCore {
    pub(super) config: Config,
    connection: ConnectionState,
    pub(super) selection: SelectionState,
    pub(super) scene: Scene,
    pub(super) cache: BlobCache,
    pub(super) failures: Failures,
    pub(super) parts: PartLookups,
    pub(super) moved: MovedParts,
    /// What is shown of animations.
    moment: Option<Moment>,
    /// Base meshes and index pages that have arrived and are not decoded yet; bounded by what the session has in
    /// flight.
    undecoded: VecDeque<(BlobId, Bytes)>,
    /// Blobs of assets whose scene page has not arrived.
    early: Vec<ReceivedBlob>,
    /// Bytes received and used of each blob, if [`Config::track_received`] is set.
    received: BTreeMap<BlobId, Received>,
    view: Option<View>,
    motion: Motion,
    milestones: Milestones,
    pub(super) counts: Counts,
}

/// Monotonic counters.
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
            StartView::OfScene { .. } | StartView::OrthographicOfScene { .. } => None,
        };
        Self {
            connection: ConnectionState::default(),
            selection: SelectionState::new(Selector::new(config.select)),
            scene: Scene::default(),
            cache: BlobCache::new(config.cache_bytes),
            failures: Failures::default(),
            parts: PartLookups::default(),
            moved: MovedParts::default(),
            moment: None,
            undecoded: VecDeque::new(),
            early: Vec::new(),
            received: BTreeMap::new(),
            view,
            motion: Motion::default(),
            milestones: Milestones::default(),
            counts: Counts::default(),
            config,
        }
    }

    /// Sets where chunks are decoded from now on.
    pub fn set_decoders(&mut self, decoders: Decoders) {
        self.config.decoders = decoders;
    }

    /// Sets the scene to request in later sessions; empty for the server's only one.
    pub fn set_scene_name(&mut self, scene: &str) {
        scene.clone_into(&mut self.config.session.scene);
    }

    /// The access token for the scene.
    #[must_use]
    pub const fn token(&self) -> Option<&Token> {
        self.config.session.token.as_ref()
    }

    /// Sets another token, for this session and later ones.
    pub fn set_token(&mut self, token: Token) {
        if self.config.session.token.as_ref() == Some(&token) {
            return;
        }
        if let Some(session) = &mut self.connection.session {
            session.set_token(token.clone());
        }
        self.config.session.token = Some(token);
    }

    /// Sets the view. Invalid views are ignored.
    pub fn set_view(&mut self, now: Time, view: View) {
        if self.view == Some(view) || view.check().is_err() {
            return;
        }
        self.motion.record_move(now, self.view.map(|view| view.eye), view.eye);
        self.view = Some(view);
        self.selection.stale = true;
        if let Some(session) = &mut self.connection.session {
            session.set_view(now, view);
        }
    }

    /// Sets whether objects out of view that cast shadows into it are refined too.
    pub fn set_shadows(&mut self, shadows: bool) {
        let wanted = &mut self.selection.selector.settings_mut().shadows;
        self.selection.stale |= *wanted != shadows;
        *wanted = shadows;
    }

    /// Bounds the memory of client and renderer from now on, as [`Config::bound_memory`]. Base meshes stay, whatever the
    /// bound; chunks are undone, and blobs evicted, until the rest fits.
    pub fn bound_memory(&mut self, memory_bytes: u64) {
        self.config.bound_memory(memory_bytes);
        let SelectSettings { max_bytes, max_texels, .. } = self.config.select;
        let settings = self.selection.selector.settings_mut();
        *settings = SelectSettings { max_bytes, max_texels, ..*settings };
        self.cache.set_capacity(self.config.cache_bytes);
        self.selection.stale = true;
    }

    /// Sets the instances for which no proxy may stand where they are in view, because their parts are hidden, tinted or
    /// isolated. They may have to be requested.
    pub fn pin_instances(&mut self, instances: &[u32]) {
        self.selection.selector.pin(instances);
        self.selection.stale = true;
    }

    /// The view, once known.
    #[must_use]
    pub const fn view(&self) -> Option<View> {
        self.view
    }

    /// The scene's header, once known.
    #[must_use]
    pub const fn scene(&self) -> Option<&SceneHeader> {
        self.scene.header.as_ref()
    }

    /// The mesh of an asset whose base mesh has arrived.
    #[must_use]
    pub fn mesh(&self, asset: u32) -> Option<&lodestream_geometry::refine::ActiveMesh> {
        self.scene.refined.get(asset as usize)?.as_ref().map(super::asset::RefinedAsset::mesh)
    }

    /// The punctual lights that have arrived, ordered by page; the order is the same for all clients. More are
    /// requested as views need them.
    pub fn punctual_lights(&self) -> impl Iterator<Item = &PunctualLight> {
        self.scene.punctual_lights.iter().flat_map(PunctualLightPages::received)
    }

    /// Number of punctual lights in the scene.
    #[must_use]
    pub fn punctual_light_count(&self) -> u32 {
        self.scene.punctual_lights.as_ref().map_or(0, PunctualLightPages::count)
    }

    /// Takes the next changes for a renderer, in order, about `max_bytes` of them. The morph of new vertices starts at
    /// `now`.
    pub fn take_changes(&mut self, now: Time, max_bytes: usize) -> Vec<Change> {
        // Seconds since the start: milliseconds for 4 hours.
        let now_s = Duration::from(now).as_secs_f64() as f32;
        self.scene.take_changes(now_s, max_bytes)
    }

    /// Whether [`ClientCore::take_changes`] has a change.
    #[must_use]
    pub fn has_changes(&self) -> bool {
        self.scene.has_changes()
    }

    /// Lets [`ClientCore::take_changes`] give the whole scene again, beginning with [`Change::Scene`]: for a renderer
    /// that has lost its graphics device. Nothing is received again but texture levels that the cache has evicted.
    /// Without a scene, or if changes are not recorded, it does nothing. Cost: a pass over assets and texture levels;
    /// the meshes are copied as their changes are taken.
    pub fn restate(&mut self, now: Time) {
        if !self.config.track_changes {
            return;
        }
        for id in self.scene.restate() {
            if self.cache.contains(id) {
                self.scene.set_state(id, self.unused_state(id));
            } else {
                self.mark_absent(now, id);
            }
            self.selection.stale = true;
        }
    }

    /// Memory of the changes that wait for [`ClientCore::take_changes`], in bytes, meshes not counted.
    #[must_use]
    pub const fn waiting_bytes(&self) -> usize {
        self.scene.waiting_bytes()
    }
}
