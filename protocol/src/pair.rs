//! Both sessions over a link in virtual time, for tests: a latency each way, a rate towards the client,
//! WebSocket-like framing, and a client that selects, requests and applies at once.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;

use crate::client::{ClientConfig, ClientEvent, ClientSession, Resume};
use crate::frame::{Frame, encode_client, encode_piece};
use crate::message::{Close, Welcome};
use crate::server::{ServerConfig, ServerSession, Transmit};
use crate::source::SceneSource;
use crate::testing::{MemoryScene, SlowScene};
use crate::time::Time;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, decode_stated_page};
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::description::Instance;
use lodestream_scene::view::View;
use lodestream_select::{AssetState, Selection, Selector, State};

/// One direction of the link: messages in flight with their arrival times.
#[derive(Default)]
pub(crate) struct Pipe {
    queue: VecDeque<(Time, Vec<u8>)>,
    free_at: Time,
}

impl Pipe {
    /// Sends bytes at a rate (bits per second; 0: at once) after what is queued.
    fn send(&mut self, now: Time, bytes: Vec<u8>, rate: u64, latency: Duration) {
        let ns = (bytes.len() as u64 * 8_000_000_000).checked_div(rate).unwrap_or(0);
        self.free_at = self.free_at.max(now) + Duration::from_nanos(ns);
        self.queue.push_back((self.free_at + latency, bytes));
    }

    fn receive(&mut self, now: Time) -> Option<Vec<u8>> {
        self.queue.pop_front_if(|(at, _)| *at <= now).map(|(_, bytes)| bytes)
    }

    /// When a driver may send again: a transport buffers a few milliseconds of the link.
    fn ready_at(&self) -> Time {
        self.free_at - Duration::from_millis(5)
    }
}

/// State of the client of a [`Pair`], and a record of what it received.
#[derive(Default)]
pub(crate) struct ClientState {
    pub(crate) welcome: Option<Welcome>,
    pub(crate) instances: Vec<Instance>,
    pub(crate) assets: Vec<AssetState>,
    pub(crate) pages: BTreeMap<u32, Time>,
    /// Blobs in order of completion, with repetitions.
    pub(crate) blobs: Vec<(Time, BlobId)>,
    /// Bytes of all blobs, with repetitions.
    pub(crate) received_bytes: u64,
    pub(crate) bases_sent: Option<Time>,
    pub(crate) done: Option<Time>,
    pub(crate) first_frame: Option<Time>,
    pub(crate) closed: Option<Close>,
    /// Arrival of every frame and its length.
    pub(crate) arrivals: Vec<(Time, usize)>,
}

pub(crate) struct Pair {
    pub(crate) now: Time,
    pub(crate) server: ServerSession,
    pub(crate) client: ClientSession,
    pub(crate) client_state: ClientState,
    pub(crate) view: View,
    pub(crate) selector: Selector,
    /// Whether the client requests blobs.
    pub(crate) asks: bool,
    pub(crate) latency: Duration,
    pub(crate) link_rate: u64,
    pub(crate) scene: Arc<MemoryScene>,
    /// Duration of the store's pending reads.
    pub(crate) read_time: Duration,
    /// Outstanding reads, with the times of their completion.
    pub(crate) reads: VecDeque<(Time, BlobId)>,
    /// Most reads outstanding at a time.
    pub(crate) most_reads: usize,
    up: Pipe,
    down: Pipe,
}

impl Pair {
    /// Both ends begin at time zero. The link is a little faster than the limiter.
    pub(crate) fn new(scene: &Arc<MemoryScene>, config: ServerConfig, resume: Resume) -> Self {
        Self::of(Arc::clone(scene) as _, scene, config, resume)
    }

    /// The same with a store whose reads are pending.
    pub(crate) fn slow(scene: &Arc<MemoryScene>, config: ServerConfig, is_slow: fn(&BlobId) -> bool) -> Self {
        let source = Arc::new(SlowScene { scene: Arc::clone(scene), is_slow });
        Self::of(source, scene, config, Resume::default())
    }

    fn of(
        source: Arc<dyn SceneSource>,
        scene: &Arc<MemoryScene>,
        config: ServerConfig,
        resume: Resume,
    ) -> Self {
        let rate = config.limiter.rate_bits_per_s.unwrap_or(0);
        let view = scene.header.camera.view([1280, 720], 1.0);
        let now = Time::ZERO;
        Self {
            now,
            server: ServerSession::new(Arc::new(config), source, 1, now),
            client: ClientSession::new(ClientConfig::default(), Some(view), resume, now),
            client_state: ClientState::default(),
            view,
            selector: Selector::default(),
            asks: true,
            latency: Duration::from_millis(25),
            link_rate: rate + rate / 10,
            scene: Arc::clone(scene),
            read_time: Duration::from_millis(40),
            reads: VecDeque::new(),
            most_reads: 0,
            up: Pipe::default(),
            down: Pipe::default(),
        }
    }

    /// Runs until a moment, or until no events are left before it.
    pub(crate) fn run_until(&mut self, end: Time) {
        loop {
            self.work();
            let next = [
                self.server.poll_timeout(),
                self.client.poll_timeout(),
                self.up.queue.front().map(|(at, _)| *at),
                self.down.queue.front().map(|(at, _)| *at),
                self.reads.front().map(|(at, _)| *at),
                Some(self.down.ready_at()).filter(|at| *at > self.now),
            ];
            match next.into_iter().flatten().min() {
                // A timeout that lies in the past would be an endless loop in a driver.
                Some(at) if at <= self.now && at < end => {
                    panic!("a timeout at {at:?} is still due at {:?}", self.now)
                }
                Some(at) if at <= end => self.now = at,
                _ => break,
            }
        }
        self.now = end;
    }

    fn work(&mut self) {
        let now = self.now;
        self.server.handle_timeout(now);
        self.client.handle_timeout(now);
        while let Some(bytes) = self.up.receive(now) {
            let frame = Frame::parse(Bytes::from(bytes)).unwrap();
            let message = frame.into_client_message().unwrap().unwrap();
            self.server.handle_message(now, message);
        }
        while let Some(bytes) = self.down.receive(now) {
            self.client_state.arrivals.push((now, bytes.len()));
            let frame = Frame::parse(Bytes::from(bytes)).unwrap();
            self.client.handle_frame(now, frame.into_server_frame().unwrap().unwrap());
        }
        self.events();
        if self.asks {
            self.ask();
        }
        while let Some(message) = self.client.poll_transmit(now) {
            self.up.send(now, encode_client(&message).unwrap(), 0, self.latency);
        }
        while let Some((_, id)) = self.reads.pop_front_if(|(at, _)| *at <= now) {
            self.server.handle_read(now, id, &self.scene.read(&id));
        }
        while self.down.ready_at() <= now {
            let Some(transmit) = self.server.poll_transmit(now) else { break };
            let bytes = match transmit {
                Transmit::Message { frame, .. } => frame.to_vec(),
                Transmit::Piece { piece, .. } => encode_piece(&piece).unwrap(),
                Transmit::Abandon(_) => continue,
            };
            self.down.send(now, bytes, self.link_rate, self.latency);
        }
        while let Some(id) = self.server.poll_read() {
            assert!(self.reads.iter().all(|(_, read)| *read != id), "{id} is read twice at a time");
            self.reads.push_back((now + self.read_time, id));
            self.most_reads = self.most_reads.max(self.reads.len());
        }
    }

    fn events(&mut self) {
        let now = self.now;
        let client_state = &mut self.client_state;
        while let Some(event) = self.client.poll_event() {
            match event {
                ClientEvent::Connected(welcome) => client_state.welcome = Some(welcome),
                ClientEvent::ScenePage(page) => {
                    assert_eq!(page.first_asset as usize, client_state.assets.len(), "pages out of order");
                    client_state.pages.insert(page.page, now);
                    client_state.assets.extend(page.assets.into_iter().map(AssetState::new));
                    client_state.instances.extend(page.instances);
                }
                ClientEvent::Blob { id, offset, total, bytes } => {
                    let blob = self.scene.read(&id).unwrap();
                    let range = offset as usize..offset as usize + bytes.len();
                    assert_eq!((bytes.as_ref(), total as usize), (&blob[range], blob.len()), "{id}");
                    client_state.blobs.push((now, id));
                    client_state.received_bytes += bytes.len() as u64;
                    let (asset, part) = of_asset(id);
                    arrived(&mut client_state.assets[asset], part, offset, &bytes);
                }
                ClientEvent::Refused { id, .. } => {
                    let (asset, part) = of_asset(id);
                    client_state.assets[asset].set_state(part, State::Failed);
                }
                ClientEvent::PunctualLights(_) | ClientEvent::Parts(_) | ClientEvent::Animations(_) => {}
                ClientEvent::BasesSent => client_state.bases_sent = Some(now),
                ClientEvent::Done => client_state.done = Some(now),
                ClientEvent::Closed(close) => client_state.closed = Some(close),
            }
        }
    }

    fn ask(&mut self) {
        let Selection { wanted, cancel, counters, .. } =
            self.selector.select(&self.view, &self.client_state.instances, &self.client_state.assets).clone();
        let all_known = self
            .client_state
            .welcome
            .as_ref()
            .is_some_and(|w| self.client_state.instances.len() == w.scene.instance_count as usize);
        if all_known && counters.drawable_instances == counters.visible_instances {
            self.client_state.first_frame.get_or_insert(self.now);
        }
        for id in self.client.set_wanted(self.now, &wanted, &cancel) {
            let (asset, part) = of_asset(id);
            self.client_state.assets[asset].set_state(part, State::InFlight);
        }
        for id in cancel {
            let (asset, part) = of_asset(id);
            self.client_state.assets[asset].set_state(part, State::Absent);
        }
    }
}

/// The scenes of these tests have no terrain.
fn of_asset(id: BlobId) -> (usize, BlobPart) {
    let BlobId::Asset { asset, part } = id else { panic!("{id} is of no asset") };
    (asset as usize, part)
}

/// Applies a blob if its parents are applied, and then the cached blobs that depend on it.
fn arrived(asset: &mut AssetState, part: BlobPart, offset: u32, bytes: &[u8]) {
    match part {
        BlobPart::IndexPage(page) => {
            let infos = decode_stated_page(bytes, page * CHUNKS_PER_PAGE as u32).unwrap();
            asset.add_index_page(page, infos).unwrap();
        }
        BlobPart::Chunk(chunk) => {
            assert_eq!(offset, asset.held_bytes(chunk), "chunk {chunk}: bytes that are here, or a gap");
            asset.set_held(chunk, offset + bytes.len() as u32);
            asset.set_state(part, State::Cached);
        }
        part => asset.set_state(part, State::Applied),
    }
    for chunk in 0..asset.chunks().len() as u32 {
        let part = BlobPart::Chunk(chunk);
        let ready = |&parent: &u32| asset.state(BlobPart::Chunk(parent)) == State::Applied;
        let Some(info) = asset.chunk(chunk) else { continue };
        if asset.state(part) == State::Cached && info.parents.iter().all(ready) {
            // Up to the last truncation point within the received bytes.
            let held = asset.held_bytes(chunk);
            let truncation =
                (0..).zip(&info.truncation_points).take_while(|(_, s)| s.payload_bytes <= held).last();
            if held == info.payload_bytes {
                asset.set_state(part, State::Applied);
            } else {
                let truncation = truncation.map(|(truncation, _)| truncation);
                asset.set_truncation(chunk, truncation);
            }
        }
    }
}
