//! Requests and responses in frames over one byte stream, with the lengths of HTTP/2 (RFC 9113) for typical headers.

use std::collections::VecDeque;
use std::io;
use std::sync::Arc;

use bytes::Bytes;
use lodestream_client::net::{Fetch, Report, Reports};
use lodestream_client::ranges::{ContentRange, Object, RangeRequest, ResponseHead};
use lodestream_netsim::stream_pipe::{StreamCounters, StreamEnd};
use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWriteExt as _, ReadHalf, WriteHalf};
use tokio::sync::mpsc;

use super::objects::Objects;

/// Length of a request: its frame, and path, range and a few more headers, compressed.
const REQUEST_BYTES: usize = 130;
/// Length of a response's head: its frame, and range, tag, date and a few more headers, compressed.
const HEAD_BYTES: usize = 120;
/// Length of a frame's own head, and of one that resets a stream.
const FRAME_BYTES: usize = 9;
const RESET_BYTES: usize = 13;
/// Most bytes of a frame of data. Shorter than servers send, so that a reset takes effect soon.
const DATA_BYTES: usize = 4096;

const KIND_REQUEST: u8 = 1;
const KIND_RESET: u8 = 2;
const KIND_HEAD: u8 = 3;
const KIND_DATA: u8 = 4;
const KIND_END: u8 = 5;

/// A frame's head: kind, stream, length of data.
fn frame(kind: u8, id: u64, length: usize) -> [u8; FRAME_BYTES] {
    let mut bytes = [0; FRAME_BYTES];
    bytes[0] = kind;
    bytes[1..5].copy_from_slice(&u32::try_from(id).unwrap_or(u32::MAX).to_le_bytes());
    bytes[5..9].copy_from_slice(&u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes());
    bytes
}

async fn read_frame(from: &mut (impl AsyncRead + Unpin)) -> io::Result<(u8, u64, usize)> {
    let mut bytes = [0; FRAME_BYTES];
    from.read_exact(&mut bytes).await?;
    let [kind, a, b, c, d, e, f, g, h] = bytes;
    Ok((kind, u32::from_le_bytes([a, b, c, d]).into(), u32::from_le_bytes([e, f, g, h]) as usize))
}

/// A request's frame: its object and range, filled up to the length of a typical one.
fn request(id: u64, object: &Object, start: u64, end: u64) -> Vec<u8> {
    let mut bytes = frame(KIND_REQUEST, id, REQUEST_BYTES - FRAME_BYTES).to_vec();
    let (key, length) = match object {
        Object::Scene => ([0; 32], 0),
        Object::Pack(key, length) => (*key, *length),
    };
    bytes.extend(key);
    for number in [length, start, end] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.resize(REQUEST_BYTES, 0);
    bytes
}

fn number(bytes: &[u8]) -> u64 {
    bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes))
}

/// The client's side.
pub(super) struct Connection {
    out: mpsc::UnboundedSender<Vec<u8>>,
    started: mpsc::UnboundedSender<Reports>,
    counters: StreamCounters,
}

impl Connection {
    pub(super) fn new(stream: StreamEnd, counters: StreamCounters) -> Self {
        let (read, write) = tokio::io::split(stream);
        let (out, waiting) = mpsc::unbounded_channel();
        let (started, reports) = mpsc::unbounded_channel();
        tokio::spawn(send(write, waiting));
        tokio::spawn(receive(read, reports));
        Self { out, started, counters }
    }
}

impl Fetch for Connection {
    fn start(&mut self, asked: RangeRequest, reports: Reports) {
        let _ = self.started.send(reports);
        let _ = self.out.send(request(asked.id, &asked.object, asked.range.start, asked.range.end));
    }

    fn abort(&mut self, id: u64) {
        let mut bytes = frame(KIND_RESET, id, RESET_BYTES - FRAME_BYTES).to_vec();
        bytes.resize(RESET_BYTES, 0);
        let _ = self.out.send(bytes);
    }

    fn received_bytes(&self) -> u64 {
        self.counters.client_received_bytes()
    }
}

async fn send(mut to: WriteHalf<StreamEnd>, mut waiting: mpsc::UnboundedReceiver<Vec<u8>>) {
    while let Some(bytes) = waiting.recv().await {
        if to.write_all(&bytes).await.is_err() {
            return;
        }
    }
    let _ = to.shutdown().await;
}

/// Reports what arrives, to the channel of the last request: there is one for all.
async fn receive(mut from: ReadHalf<StreamEnd>, mut started: mpsc::UnboundedReceiver<Reports>) {
    let mut reports = None;
    while let Ok((kind, id, length)) = read_frame(&mut from).await {
        let mut data = vec![0; length];
        if from.read_exact(&mut data).await.is_err() {
            return;
        }
        while let Ok(next) = started.try_recv() {
            reports = Some(next);
        }
        let Some(reports) = &reports else { continue };
        let report = match kind {
            KIND_HEAD => Report::Head(head(&data)),
            KIND_DATA => Report::Body(data.into()),
            _ => Report::End,
        };
        if reports.send((id, report)).await.is_err() {
            return;
        }
    }
}

fn head(data: &[u8]) -> ResponseHead {
    let [start, end, total] = [0, 8, 16].map(|at| number(&data[at..]));
    let (status, content_range) = match total {
        0 => (404, None),
        _ if start >= end => (416, None),
        _ => (206, Some(ContentRange { range: start..end, total: Some(total) })),
    };
    ResponseHead { status, content_range, encoded: false }
}

/// A response under way.
struct Response {
    id: u64,
    left: Bytes,
}

/// Serves objects until the client leaves.
pub(super) async fn serve(stream: StreamEnd, objects: Arc<Objects>) {
    let (mut read, mut write) = tokio::io::split(stream);
    let (asked, mut waiting) = mpsc::unbounded_channel();
    let reading = tokio::spawn(async move {
        while let Ok((kind, id, length)) = read_frame(&mut read).await {
            let mut data = vec![0; length];
            if read.read_exact(&mut data).await.is_err() || asked.send((kind, id, data)).is_err() {
                return;
            }
        }
    });
    let mut active: VecDeque<Response> = VecDeque::new();
    loop {
        let next = if active.is_empty() { waiting.recv().await } else { waiting.try_recv().ok() };
        if next.is_none() && active.is_empty() {
            break;
        }
        let mut next = next;
        while let Some((kind, id, data)) = next {
            if kind == KIND_RESET {
                active.retain(|response| response.id != id);
            } else if write.write_all(&answer(&objects, id, &data, &mut active)).await.is_err() {
                return;
            }
            next = waiting.try_recv().ok();
        }
        let Some(mut response) = active.pop_front() else { continue };
        let data = response.left.split_to(response.left.len().min(DATA_BYTES));
        let mut bytes = frame(KIND_DATA, response.id, data.len()).to_vec();
        bytes.extend_from_slice(&data);
        if response.left.is_empty() {
            bytes.extend(frame(KIND_END, response.id, 0));
        }
        if write.write_all(&bytes).await.is_err() {
            return;
        }
        if !response.left.is_empty() {
            active.push_back(response);
        }
    }
    let _ = write.shutdown().await;
    reading.abort();
}

/// The head of a response, whose body is added to those under way.
fn answer(objects: &Objects, id: u64, data: &[u8], active: &mut VecDeque<Response>) -> Vec<u8> {
    let mut key = [0; 32];
    key.copy_from_slice(&data[..32]);
    let [length, start, end] = [32, 40, 48].map(|at| number(&data[at..]));
    let object = if length == 0 { Object::Scene } else { Object::Pack(key, length) };
    let bytes = objects.get(&object).cloned().unwrap_or_default();
    let total = bytes.len() as u64;
    let (start, end) = (start.min(total), end.min(total));
    let mut head = frame(KIND_HEAD, id, HEAD_BYTES - FRAME_BYTES).to_vec();
    for number in [start, end, total] {
        head.extend(number.to_le_bytes());
    }
    head.resize(HEAD_BYTES, 0);
    let place = usize::try_from(start).unwrap_or(0)..usize::try_from(end).unwrap_or(0);
    if !place.is_empty() {
        active.push_back(Response { id, left: bytes.slice(place) });
    }
    head
}
