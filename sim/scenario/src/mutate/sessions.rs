//! Damaged sessions to the shipped daemon: valid messages in a possible order, then damaged. Each session has an
//! address of its own, so that limits per address do not apply.
//!
//! The verdict is the server's last message, or that it answers the ping after the damage.

use std::net::{IpAddr, Ipv4Addr};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use futures_util::StreamExt as _;
use futures_util::stream::iter;
use lodestream_protocol::frame::{FrameError, encode_client};
use lodestream_protocol::message::{ClientMessage, Hello, Token, Want};
use lodestream_protocol::source::SceneSource;
use lodestream_scene::BlobId;
use lodestream_scene::view::View;
use rand::Rng as _;
use rand_pcg::Pcg64Mcg;
use tokio::runtime::Builder;
use tokio::time::{Instant, sleep, timeout};

use super::damage;
use super::subject::{SCENE, Settings, Subject};
use super::tally::{MutationOutcome, Tally, Verdict};
use super::wire::{Answer, over_quic, over_websocket};
use crate::bare_client::chunks;
use crate::plan::{self, Transport};
use crate::scene;
use crate::served::{Address, Server, Serving};

/// Concurrent sessions: enough for two cores and for several at once in the server.
const AT_ONCE: usize = 8;
/// Real time that a server may take to answer.
const TIMEOUT: Duration = Duration::from_secs(60);
/// Rate limit of a session.
const RATE_BITS_PER_S: u64 = 16_000_000;
/// Time from the end of the last session until memory is measured.
const AFTER: Duration = Duration::from_secs(2);

pub(super) fn measure(
    transport: Transport,
    settings: Settings,
    cache: &Path,
    named: Option<&Path>,
) -> anyhow::Result<MutationOutcome> {
    let subject = match transport {
        Transport::Ws => Subject::WebSocketSessions,
        Transport::Quic => Subject::QuicSessions,
    };
    let source = scene::open(&plan::scene_choice(SCENE)?, None, cache, true)?;
    let sessions = Arc::new(Sessions::of(&source));
    let mut server = Server::start(SCENE, named, RATE_BITS_PER_S, Serving::Shipped)?;
    let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let found = runtime.block_on(async {
        let run = async |cases: Settings| {
            let mut tally = Tally::default();
            let one = |case: u32| {
                let (sessions, at) = (Arc::clone(&sessions), server.at());
                async move {
                    let begun = Instant::now();
                    let mut random = subject.random(cases.seed, case);
                    let frames = sessions.damaged(&mut random);
                    let task = tokio::spawn(judge(transport, at, case, frames, random));
                    (case, begun, task.await.ok())
                }
            };
            let mut done = iter(cases.cases()).map(one).buffer_unordered(AT_ONCE);
            while let Some((case, begun, verdict)) = done.next().await {
                tally.note(subject, case, begun.elapsed(), verdict);
            }
            tally
        };
        let warm = run(settings.warm_up()).await;
        let (before_bytes, cpu_before) = (server.memory_bytes()?, server.cpu_s()?);
        let mut tally = run(settings).await;
        sleep(AFTER).await;
        let memory = [before_bytes, server.memory_bytes()?];
        tally.add_findings(&warm);
        tally.panics += server.panics();
        anyhow::Ok(tally.found(subject, memory, server.cpu_s()? - cpu_before))
    })?;
    anyhow::ensure!(server.is_running(), "the server is gone");
    Ok(found)
}

/// Runs one session.
async fn judge(
    transport: Transport,
    server: Address,
    case: u32,
    frames: Vec<Vec<u8>>,
    random: Pcg64Mcg,
) -> Verdict {
    let from = own_address(case);
    let session = async {
        match transport {
            Transport::Ws => over_websocket(server, from, frames, random).await,
            Transport::Quic => over_quic(server, from, frames).await,
        }
    };
    match timeout(TIMEOUT, session).await {
        Err(_) => Verdict::Stuck,
        Ok(Ok(Answer::Pong)) => Verdict::Taken,
        Ok(Ok(Answer::Close(close))) => Verdict::refused(format!("{:?}", close.code)),
        Ok(Ok(Answer::End)) => Verdict::refused("connection ended"),
        Ok(Err(why)) => Verdict::refused(format!("no connection: {why}")),
    }
}

/// A loopback address other than 127.0.0.0/16; Linux accepts all of 127.0.0.0/8.
fn own_address(case: u32) -> IpAddr {
    let [_, b, c, d] = (case % (254 << 16)).to_be_bytes();
    IpAddr::V4(Ipv4Addr::new(127, 1 + b, c, d))
}

/// Generates messages about a scene.
struct Sessions {
    blobs: Vec<BlobId>,
    fingerprint: [u8; 16],
    view: View,
}

impl Sessions {
    fn of(source: &Arc<dyn SceneSource>) -> Self {
        let header = source.header();
        let mut blobs = chunks(source);
        blobs.extend((0..header.asset_count).map(BlobId::base));
        blobs.extend((0..header.asset_count).map(|asset| BlobId::index_page(asset, 0)));
        blobs.extend((0..header.asset_count).map(|asset| BlobId::texture(asset, 0, 0)));
        blobs.extend([
            BlobId::terrain_page(0),
            BlobId::punctual_light_directory(0),
            BlobId::punctual_light_page(0),
        ]);
        blobs.retain(|id| source.blob_len(id).is_some());
        let view = header.camera.view([1280, 720], 1.0);
        Self { blobs, fingerprint: header.fingerprint, view }
    }

    /// The damaged frames of a session.
    fn damaged(&self, random: &mut Pcg64Mcg) -> Vec<Vec<u8>> {
        // Messages that cannot be encoded are omitted.
        let sound = |random: &mut Pcg64Mcg| -> Vec<Vec<u8>> {
            self.session(random).iter().map(encode_client).filter_map(Result::<_, FrameError>::ok).collect()
        };
        let (mut frames, others) = (sound(random), sound(random));
        for _ in 0..damage::times(random) {
            if random.random_range(0..3) == 0 || frames.is_empty() {
                damage::order(&mut frames, random);
                continue;
            }
            let at = random.random_range(0..frames.len());
            let other = &others[random.random_range(0..others.len())];
            damage::frame(&mut frames[at], other, random);
        }
        frames
    }

    /// The messages of a valid session.
    fn session(&self, random: &mut Pcg64Mcg) -> Vec<ClientMessage> {
        let mut said = vec![ClientMessage::Hello(Hello {
            view: random.random::<bool>().then_some(self.view),
            fingerprint: if random.random::<bool>() { self.fingerprint } else { [0; 16] },
            have: self.some(random, 40),
            ..Hello::new("")
        })];
        for _ in 0..random.random_range(2..=10) {
            said.push(match random.random_range(0..8) {
                0 => ClientMessage::Cancel(self.some(random, 20)),
                1 => ClientMessage::SetView(self.moved(random)),
                2 => ClientMessage::WantScenePages(vec![random.random_range(0..4)]),
                3 => ClientMessage::Ping(random.random()),
                4 => ClientMessage::Token(Token("x".repeat(random.random_range(1..200)))),
                _ => ClientMessage::Want(
                    self.some(random, 40).into_iter().map(|id| want(id, random)).collect(),
                ),
            });
        }
        if random.random_range(0..8) == 0 {
            said.push(ClientMessage::Bye);
        }
        said
    }

    fn some(&self, random: &mut Pcg64Mcg, most: usize) -> Vec<BlobId> {
        let mut ids: Vec<BlobId> = (0..random.random_range(0..=most))
            .map(|_| self.blobs[random.random_range(0..self.blobs.len())])
            .collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }

    fn moved(&self, random: &mut Pcg64Mcg) -> View {
        let mut view = self.view;
        view.eye[random.random_range(0..3)] += f64::from(random.random_range(-100_i32..100));
        view
    }
}

/// A request for a blob or a part of it, which may lie outside the blob.
fn want(id: BlobId, random: &mut Pcg64Mcg) -> Want {
    let mut want = Want::whole(id, random.random());
    if random.random_range(0..4) == 0 {
        want.offset = random.random_range(0..2000);
        want.end = random.random::<bool>().then(|| want.offset + random.random_range(1..2000));
    }
    want
}
