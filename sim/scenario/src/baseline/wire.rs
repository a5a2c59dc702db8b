//! Requests and bodies over the simulated links: a stream each over QUIC, pipelined over TCP.
//!
//! Headers have a fixed length and bodies consist of zeros, since only lengths matter. Nothing on the path compresses
//! them.

use lodestream_netsim::stream_pipe::StreamEnd;
use tokio::io::{AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _};
use tokio::sync::mpsc;

/// Length of a request, and of a body's header, over QUIC: about what HTTP/3 with its static table (RFC 9204) needs for
/// a short path and a length.
pub(super) const QUIC_HEAD_BYTES: usize = 64;
/// The same over TCP: an HTTP/1.1 request line, `Host` and `Accept`, or a status line and three fields.
pub(super) const TCP_HEAD_BYTES: usize = 160;

/// Bytes read or written at once.
const PART_BYTES: usize = 64 * 1024;
static ZEROS: [u8; PART_BYTES] = [0; PART_BYTES];

/// A loader's request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Request {
    /// Counted from 0.
    pub(super) number: u64,
    pub(super) body_bytes: u64,
}

/// A loader's event.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Event {
    /// Bytes of some body arrived.
    Bytes,
    /// The response to the request with this number is complete.
    Done(u64),
    /// The connection is closed.
    Lost(String),
}

/// A loader's side of a connection.
pub(super) struct Wire {
    pub(super) requests: mpsc::Sender<Request>,
    pub(super) events: mpsc::Receiver<Event>,
}

/// The transport's side of the same channels.
struct ChannelEnds {
    requests: mpsc::Receiver<Request>,
    events: mpsc::Sender<Event>,
}

fn channels() -> (Wire, ChannelEnds) {
    let (requests, served_requests) = mpsc::channel(64);
    let (served_events, events) = mpsc::channel(256);
    (Wire { requests, events }, ChannelEnds { requests: served_requests, events: served_events })
}

fn head<const N: usize>(body_bytes: u64) -> [u8; N] {
    let mut head = [0; N];
    head[..8].copy_from_slice(&body_bytes.to_le_bytes());
    head
}

fn body_bytes(head: &[u8]) -> u64 {
    let mut length = [0; 8];
    length.copy_from_slice(&head[..8]);
    u64::from_le_bytes(length)
}

/// Runs a wire over a QUIC connection.
pub(super) fn over_quic(connection: quinn::Connection) -> Wire {
    let (wire, mut served) = channels();
    tokio::spawn(async move {
        while let Some(request) = served.requests.recv().await {
            if let Err(why) = ask(&connection, request, &served.events).await {
                let _ = served.events.send(Event::Lost(why.to_string())).await;
                break;
            }
        }
    });
    wire
}

async fn ask(
    connection: &quinn::Connection,
    request: Request,
    events: &mpsc::Sender<Event>,
) -> anyhow::Result<()> {
    let (mut send, mut receive) = connection.open_bi().await?;
    send.write_all(&head::<QUIC_HEAD_BYTES>(request.body_bytes)).await?;
    send.finish()?;
    let events = events.clone();
    tokio::spawn(async move {
        let mut came = 0;
        loop {
            let event = match receive.read_chunk(PART_BYTES, true).await {
                Ok(Some(chunk)) => {
                    came += chunk.bytes.len() as u64;
                    Event::Bytes
                }
                Ok(None) if came == QUIC_HEAD_BYTES as u64 + request.body_bytes => {
                    Event::Done(request.number)
                }
                Ok(None) => Event::Lost("a body ended early".to_owned()),
                Err(why) => Event::Lost(why.to_string()),
            };
            let last = event != Event::Bytes;
            if events.send(event).await.is_err() || last {
                break;
            }
        }
    });
    Ok(())
}

/// Answers requests over QUIC. Bodies are sent in the order of the requests, as RFC 9218 (§10) recommends for responses
/// that are of no use in part.
pub(super) async fn answer_quic(endpoint: quinn::Endpoint) {
    while let Some(incoming) = endpoint.accept().await {
        let Ok(connection) = incoming.await else { continue };
        let mut priority = 0_i32;
        while let Ok((send, receive)) = connection.accept_bi().await {
            tokio::spawn(answer(send, receive, priority));
            priority = priority.saturating_sub(1);
        }
    }
}

async fn answer(mut send: quinn::SendStream, mut receive: quinn::RecvStream, priority: i32) {
    let mut head = [0; QUIC_HEAD_BYTES];
    // A client that has left needs no error.
    if send.set_priority(priority).is_err() || receive.read_exact(&mut head).await.is_err() {
        return;
    }
    if write_zeros(&mut send, QUIC_HEAD_BYTES as u64 + body_bytes(&head)).await.is_ok() {
        let _ = send.finish();
    }
}

/// Runs a wire over the client's end of a TCP connection.
pub(super) fn over_tcp(stream: StreamEnd) -> Wire {
    let (wire, mut served) = channels();
    let (mut read, mut write) = tokio::io::split(stream);
    let (asked, mut expected) = mpsc::channel::<Request>(64);
    let lost = served.events.clone();
    tokio::spawn(async move {
        while let Some(request) = served.requests.recv().await {
            let written = write.write_all(&head::<TCP_HEAD_BYTES>(request.body_bytes)).await;
            if let Err(why) = written {
                let _ = lost.send(Event::Lost(why.to_string())).await;
                break;
            }
            if asked.send(request).await.is_err() {
                break;
            }
        }
    });
    let events = served.events;
    tokio::spawn(async move {
        let mut buffer = vec![0; PART_BYTES];
        while let Some(request) = expected.recv().await {
            let mut left = TCP_HEAD_BYTES as u64 + request.body_bytes;
            while left > 0 {
                let most = left.min(PART_BYTES as u64) as usize;
                let event = match read.read(&mut buffer[..most]).await {
                    Ok(0) => Event::Lost("the server closed the connection".to_owned()),
                    Ok(count) => {
                        left -= count as u64;
                        Event::Bytes
                    }
                    Err(why) => Event::Lost(why.to_string()),
                };
                let last = event != Event::Bytes;
                if events.send(event).await.is_err() || last {
                    return;
                }
            }
            if events.send(Event::Done(request.number)).await.is_err() {
                return;
            }
        }
    });
    wire
}

/// Writes the header and body of an answer.
async fn write_zeros(to: &mut (impl AsyncWrite + Unpin), mut left: u64) -> std::io::Result<()> {
    while left > 0 {
        let part = left.min(PART_BYTES as u64);
        // From a usize.
        to.write_all(&ZEROS[..part as usize]).await?;
        left -= part;
    }
    Ok(())
}

/// Answers requests over TCP, one after the other.
pub(super) async fn answer_tcp(mut stream: StreamEnd) {
    let mut head = [0; TCP_HEAD_BYTES];
    while stream.read_exact(&mut head).await.is_ok() {
        if write_zeros(&mut stream, TCP_HEAD_BYTES as u64 + body_bytes(&head)).await.is_err() {
            return;
        }
    }
}
