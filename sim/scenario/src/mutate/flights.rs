//! Damaged first flights: the first bytes of a server, over WebSocket and over QUIC, given to a client's core.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use bytes::Bytes;
use lodestream_client::core::ClientCore;
use lodestream_protocol::Time;
use lodestream_protocol::frame::{Frame, FrameError, FrameReader, ServerFrame};
use lodestream_protocol::stream::{BlobStreamReader, blob_head};
use lodestream_scene::BlobId;
use rand::Rng as _;
use rand_pcg::Pcg64Mcg;

use super::damage;
use super::exchange::{core, stream, work};
use super::subject::Subject;
use super::tally::Verdict;
use crate::plan::SceneChoice;
use crate::scene;

/// Length of a recorded first flight: everything that the first frame needs, and some chunks.
const FLIGHT_BYTES: usize = 48 << 10;
/// Bytes of a stream that arrive at once.
const PACKET_BYTES: usize = 1200;
/// Timeouts of the core that are awaited after the flight.
const TIMEOUTS: u32 = 20;

/// A recorded first flight.
#[derive(Debug)]
pub struct Flights {
    /// Frames, as WebSocket carries them.
    frames: Vec<Vec<u8>>,
    /// Streams, as QUIC carries them, the control stream first, without their type bytes.
    streams: Vec<Vec<u8>>,
}

impl Flights {
    /// Records the first flight that a server sends to a correct client.
    ///
    /// # Errors
    /// A scene that cannot be generated or prepared.
    pub fn record(cache: &Path) -> anyhow::Result<Self> {
        let source = scene::open(&SceneChoice::DemoSmall, None, cache, true)?;
        let (mut frames, mut bytes) = (Vec::new(), 0);
        stream(source, |frame| {
            if bytes < FLIGHT_BYTES {
                bytes += frame.len();
                frames.push(frame.to_vec());
            }
        })?;
        let streams = as_streams(&frames).context("the frames of an unmodified server are not understood")?;
        Ok(Self { frames, streams })
    }

    /// Damaged frames, as WebSocket carries them.
    pub(super) fn damaged_frames(&self, random: &mut Pcg64Mcg) -> Vec<Vec<u8>> {
        let mut frames = self.frames.clone();
        for _ in 0..damage::times(random) {
            if random.random_range(0..4) == 0 || frames.is_empty() {
                damage::order(&mut frames, random);
                continue;
            }
            let at = random.random_range(0..frames.len());
            let other = &self.frames[random.random_range(0..self.frames.len())];
            damage::frame(&mut frames[at], other, random);
        }
        frames
    }

    /// Damages the flight and gives it to a core.
    ///
    /// # Errors
    /// None.
    pub fn judge(&self, seed: u64, case: u32) -> anyhow::Result<Verdict> {
        let mut random = Subject::Flights.random(seed, case);
        let mut core = core();
        core.connect(Time::ZERO);
        let mut reader = Reader { core, ended: false };
        if random.random::<bool>() {
            for frame in self.damaged_frames(&mut random) {
                reader.take(Frame::parse(frame.into()).and_then(Frame::into_server_frame));
            }
        } else {
            self.over_streams(&mut random, &mut reader);
        }
        Ok(reader.end())
    }

    fn over_streams(&self, random: &mut Pcg64Mcg, reader: &mut Reader) {
        let mut streams = self.streams.clone();
        for _ in 0..damage::times(random) {
            let at = random.random_range(0..streams.len());
            let other = &self.streams[random.random_range(0..self.streams.len())];
            match random.random_range(0..5) {
                // The control stream stays first.
                0 => {
                    let mut blobs = streams.split_off(1);
                    damage::order(&mut blobs, random);
                    streams.extend(blobs);
                }
                1 => damage::bytes(&mut streams[0], other, random),
                _ => damage::bytes(&mut streams[at], other, random),
            }
        }
        let mut streams = streams.into_iter();
        let mut control = FrameReader::new();
        for packet in streams.next().unwrap_or_default().chunks(PACKET_BYTES) {
            control.push(packet);
            loop {
                match control.next_frame() {
                    Ok(Some(frame)) => reader.take(frame.into_server_frame()),
                    Ok(None) => break,
                    Err(why) => {
                        reader.take(Err(why));
                        return;
                    }
                }
            }
        }
        for stream in streams {
            let (mut blob, stream) = (BlobStreamReader::new(), Bytes::from(stream));
            let mut read = || {
                for at in (0..stream.len()).step_by(PACKET_BYTES) {
                    let packet = stream.slice(at..stream.len().min(at + PACKET_BYTES));
                    blob.push(packet)?.into_iter().for_each(|piece| {
                        reader.take(Ok(Some(ServerFrame::Piece(piece))));
                    });
                }
                blob.finish()
            };
            if let Err(why) = read() {
                match (why, blob.blob()) {
                    // As for a stream that was reset.
                    (FrameError::Truncated, Some((id, _))) => reader.core.handle_abandoned(Time::ZERO, id),
                    (FrameError::Truncated, None) => {}
                    (why, _) => reader.take(Err(why)),
                }
            }
        }
    }
}

/// Feeds a core as the client's drivers do.
struct Reader {
    core: ClientCore,
    /// The core never became idle.
    ended: bool,
}

impl Reader {
    fn take(&mut self, frame: Result<Option<ServerFrame>, FrameError>) {
        let now = Time::ZERO;
        match frame {
            Ok(Some(ServerFrame::Piece(piece))) => self.core.handle_piece(now, piece),
            Ok(Some(frame)) => self.core.handle_frame(now, frame),
            Ok(None) => {}
            Err(why) => self.core.handle_frame_error(now, &why),
        }
        self.ended |= !work(&mut self.core, now);
        while self.core.poll_transmit(now).is_some() {}
    }

    /// The core's verdict on the flight, after it has waited in vain for more.
    fn end(mut self) -> Verdict {
        let verdict = of_core(&self.core);
        let mut now = Time::ZERO;
        for _ in 0..TIMEOUTS {
            let Some(next) = self.core.poll_timeout() else { break };
            now = next.max(now + Duration::from_millis(1));
            self.core.handle_timeout(now);
            self.ended |= !work(&mut self.core, now);
            while self.core.poll_transmit(now).is_some() {}
        }
        if self.ended { Verdict::Stuck } else { verdict }
    }
}

/// The verdict of a core on what it received.
fn of_core(core: &ClientCore) -> Verdict {
    match core.closed() {
        Some(close) => Verdict::refused(format!("session closed: {:?}", close.code)),
        None => of_blobs(core),
    }
}

/// The same for a session whose end tells nothing.
pub(super) fn of_blobs(core: &ClientCore) -> Verdict {
    match core.stats().decode_failures {
        0 => Verdict::Taken,
        _ => Verdict::refused("blob asked for again"),
    }
}

/// The same flight in QUIC streams.
fn as_streams(frames: &[Vec<u8>]) -> Result<Vec<Vec<u8>>, FrameError> {
    let mut streams = vec![Vec::new()];
    // By blob, the stream that carries it.
    let mut of_blob = BTreeMap::<BlobId, usize>::new();
    for bytes in frames {
        let frame = Frame::parse(bytes.clone().into()).and_then(Frame::into_server_frame)?;
        let Some(ServerFrame::Piece(piece)) = frame else {
            streams[0].extend(bytes);
            continue;
        };
        let stream = match of_blob.get(&piece.id) {
            Some(stream) if piece.offset > 0 => *stream,
            _ => {
                // After the type byte.
                streams.push(blob_head(&piece)?.split_off(1));
                of_blob.insert(piece.id, streams.len() - 1);
                streams.len() - 1
            }
        };
        streams[stream].extend(&piece.bytes);
    }
    Ok(streams)
}
