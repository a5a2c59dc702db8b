//! For tests: the test scene published into memory, and a core that reads it over a link in virtual time.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use bytes::Bytes;
use lodestream_protocol::source::SceneSource;
use lodestream_protocol::time::Time;
use lodestream_scene::blob::{BlobId, BlobPart};
use lodestream_scene::published::{Contents, PackContents};

use super::{ContentRange, Object, RangeRequest, ResponseHead};
use crate::core::testing::TestScene;
use crate::core::{ClientCore, Config, Progress, StartView};

/// Objects by name; the scene has none.
pub(crate) type Objects = BTreeMap<Option<String>, Vec<u8>>;

/// Publishes a scene.
pub(crate) fn publish(scene: &TestScene) -> Objects {
    let mut objects = Objects::new();
    let page = scene.page(0).unwrap();
    let mut packs = Vec::new();
    for (number, asset) in (0..).zip(&page.assets) {
        let read = |part| scene.read(&BlobId::Asset { asset: number, part }).unwrap();
        let mut pack = vec![0x55; 64];
        let mut contents = PackContents { base: read(BlobPart::Base), ..PackContents::default() };
        for page in 0..asset.index_pages() {
            contents.add_index_page(read(BlobPart::IndexPage(page))).unwrap();
        }
        for chunk in 0..asset.chunk_count {
            let bytes = read(BlobPart::Chunk(chunk));
            contents.add_chunk(chunk, pack.len() as u64, &bytes).unwrap();
            pack.extend_from_slice(&bytes);
        }
        for level in 0..3 {
            let bytes = read(BlobPart::Texture { texture: 0, level });
            contents.add_texture(0, level, pack.len() as u64, bytes.clone()).unwrap();
            pack.extend_from_slice(&bytes);
        }
        let key = *blake3::hash(&number.to_le_bytes()).as_bytes();
        (contents.key, contents.bytes) = (key, pack.len() as u64);
        packs.push(contents);
        objects.insert(Object::Pack(key, 0).name(), pack);
    }
    let directory = scene.blob_len(&BlobId::terrain_page(0)).filter(|&bytes| bytes > 0);
    let blobs = |id: fn(u32) -> BlobId| -> Vec<Bytes> {
        (0..)
            .map(id)
            .take_while(|id| scene.blob_len(id).is_some())
            .map(|id| scene.read(&id).unwrap())
            .collect()
    };
    let contents = Contents {
        header: scene.header().clone(),
        pages: vec![(*page).clone()],
        terrain_directory: directory
            .map(|_| scene.read(&BlobId::terrain_page(0)).unwrap())
            .into_iter()
            .collect(),
        height_overrides: Vec::new(),
        punctual_lights: scene.punctual_lights().cloned(),
        light_directory: blobs(BlobId::punctual_light_directory),
        light_pages: blobs(BlobId::punctual_light_page),
        parts: scene.parts(),
        part_directory: blobs(BlobId::part_directory),
        part_pages: blobs(BlobId::part_page),
        animations: blobs(BlobId::Animation),
        packs,
    };
    objects.insert(None, contents.encode().unwrap());
    objects
}

/// What a faulty host does with a request.
#[derive(Clone, Debug)]
pub(crate) enum Fault {
    /// Answers with a status and no body.
    Status(u16),
    /// Answers with a status and the bytes of another range.
    OtherRange,
    /// Ends the body after so many bytes.
    Cut(u64),
    /// Never answers.
    Silent,
    /// Refuses the connection.
    Refuse,
}

type Faults = Box<dyn FnMut(&RangeRequest) -> Option<Fault>>;

/// What is under way to the client.
enum Event {
    Head(ResponseHead),
    Body(Vec<u8>),
    End,
    Fail,
}

/// A core and a host of objects, 25 ms apart, 2 Mbit/s towards the client.
pub(crate) struct RangeLoopback {
    pub(crate) now: Time,
    pub(crate) core: ClientCore,
    pub(crate) objects: Objects,
    pub(crate) faults: Faults,
    /// All requests made.
    pub(crate) requests: Vec<RangeRequest>,
    /// Requests that were aborted.
    pub(crate) cancelled: Vec<u64>,
    /// Bytes that have arrived.
    pub(crate) received: u64,
    down: VecDeque<(Time, u64, Event)>,
    busy_until: Time,
}

const LATENCY: Duration = Duration::from_millis(25);
const BYTES_PER_MS: u64 = 250;
const PIECE_BYTES: usize = 1250;

impl RangeLoopback {
    pub(crate) fn new(scene: &TestScene, adapt: impl FnOnce(&mut Config)) -> Self {
        let mut config = Config::new(StartView::OfScene { viewport_px: [640, 360], target_px: 1.0 });
        adapt(&mut config);
        let mut link = Self {
            now: Time::ZERO,
            core: ClientCore::new(config),
            objects: publish(scene),
            faults: Box::new(|_| None),
            requests: Vec::new(),
            cancelled: Vec::new(),
            received: 0,
            down: VecDeque::new(),
            busy_until: Time::ZERO,
        };
        link.core.connect_ranges(link.now);
        link
    }

    fn answer(&mut self, request: RangeRequest) {
        let fault = (self.faults)(&request);
        let answered = self.now + 2 * LATENCY;
        let id = request.id;
        let mut send = |at: Time, event| self.down.push_back((at, id, event));
        let head = |status, range: Option<(std::ops::Range<u64>, u64)>| ResponseHead {
            status,
            content_range: range.map(|(range, total)| ContentRange { range, total: Some(total) }),
            encoded: false,
        };
        let object = self.objects.get(&request.object.name());
        self.requests.push(request.clone());
        let mut range = request.range;
        match (&fault, object) {
            (Some(Fault::Silent), _) => return,
            (Some(Fault::Refuse), _) => return send(answered, Event::Fail),
            (Some(Fault::Status(status)), _) => return send(answered, Event::Head(head(*status, None))),
            (Some(Fault::OtherRange), _) => range = range.start + 1..range.end + 1,
            (_, None) => return send(answered, Event::Head(head(404, None))),
            (None | Some(Fault::Cut(_)), Some(_)) => {}
        }
        let object = object.unwrap();
        let total = object.len() as u64;
        if range.start >= total {
            return send(answered, Event::Head(head(416, None)));
        }
        let range = range.start..range.end.min(total);
        send(answered, Event::Head(head(206, Some((range.clone(), total)))));
        let mut body = &object[range.start as usize..range.end as usize];
        if let Some(Fault::Cut(bytes)) = fault {
            body = &body[..body.len().min(bytes as usize)];
        }
        let mut at = self.busy_until.max(answered);
        for piece in body.chunks(PIECE_BYTES) {
            at = at + Duration::from_micros(piece.len() as u64 * 1000 / BYTES_PER_MS);
            send(at, Event::Body(piece.to_vec()));
        }
        send(at, Event::End);
        self.busy_until = at;
        self.down.make_contiguous().sort_by_key(|(at, ..)| *at);
    }

    /// Runs for so many milliseconds, in steps of one.
    pub(crate) fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.now = self.now + Duration::from_millis(1);
            let now = self.now;
            while let Some((_, id, event)) = self.down.pop_front_if(|(at, ..)| *at <= now) {
                if self.cancelled.contains(&id) {
                    continue;
                }
                match event {
                    Event::Head(head) => self.core.handle_response_head(now, id, &head),
                    Event::Body(bytes) => {
                        self.received += bytes.len() as u64;
                        self.core.handle_response_body(now, id, &bytes);
                    }
                    Event::End => self.core.handle_response_end(now, id),
                    Event::Fail => self.core.handle_request_failure(now, id, "connection refused"),
                }
            }
            self.core.handle_timeout(now);
            while self.core.update(now, u64::MAX) == Progress::More {}
            self.core.check_states();
            while let Some(id) = self.core.poll_cancelled() {
                self.cancelled.push(id);
            }
            while let Some(request) = self.core.poll_request(now) {
                self.answer(request);
            }
        }
    }

    /// Runs until settled or closed; panics after a minute of virtual time.
    pub(crate) fn settle(&mut self) {
        for _ in 0..60_000 {
            self.run(1);
            if self.core.is_settled() || self.core.closed().is_some() {
                return;
            }
        }
        panic!("not settled: {:?}", self.core.stats());
    }

    /// Why the session ended.
    pub(crate) fn closed(&self) -> String {
        self.core.closed().map(ToString::to_string).unwrap_or_default()
    }
}
