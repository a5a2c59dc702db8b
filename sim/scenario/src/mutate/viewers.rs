//! Damaged first flights over a socket: a server that sends them, and a viewer's client without renderer.

use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::Context as _;
use futures_util::future::join_all;
use futures_util::{SinkExt as _, StreamExt as _};
use lodestream_client::net::{Address, Clock, End, Retry, Server, stream as stream_from};
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::stream::ALPN;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Builder;
use tokio::time::{Instant, timeout};
use tokio_tungstenite::accept_hdr_async;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::handshake::server::{ErrorResponse, Request, Response};
use tokio_tungstenite::tungstenite::http::HeaderValue;
use tokio_tungstenite::tungstenite::http::header::SEC_WEBSOCKET_PROTOCOL;

use super::exchange::core;
use super::flights::{Flights, of_blobs};
use super::subject::{Settings, Subject};
use super::tally::{MutationOutcome, Tally, Verdict};
use crate::process::Process;

/// Real time that a client may take.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Concurrent clients, each with a server of its own.
const AT_ONCE: usize = 2;

pub(super) fn measure(settings: Settings, flights: &Flights) -> anyhow::Result<MutationOutcome> {
    let runtime = Builder::new_multi_thread().worker_threads(AT_ONCE).enable_all().build()?;
    let process = Process::own();
    runtime.block_on(async {
        let run = async |cases: Settings| {
            let mut all = Tally::default();
            for lane in join_all((0..AT_ONCE).map(|lane| run_lane(cases, lane, flights))).await {
                all.merge(&lane?);
            }
            anyhow::Ok(all)
        };
        let warm = run(settings.warm_up()).await?;
        let (before_bytes, cpu_before) = (process.memory_bytes()?, process.cpu_s()?);
        let mut tally = run(settings).await?;
        tally.add_findings(&warm);
        let cpu_s = process.cpu_s()? - cpu_before;
        Ok(tally.found(Subject::Viewers, [before_bytes, process.memory_bytes()?], cpu_s))
    })
}

/// Runs the cases of one of the parallel lanes.
async fn run_lane(cases: Settings, lane: usize, flights: &Flights) -> anyhow::Result<Tally> {
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).await?;
    let address: Address = format!("ws://{}/", listener.local_addr()?).parse()?;
    let mut tally = Tally::default();
    for case in cases.cases().skip(lane).step_by(AT_ONCE) {
        let frames = flights.damaged_frames(&mut Subject::Viewers.random(cases.seed, case));
        let begun = Instant::now();
        let client = tokio::spawn(client(address.clone().into()));
        let accepted = timeout(TIMEOUT, listener.accept()).await;
        let (stream, _) = accepted.context("the client does not come")??;
        let server = tokio::spawn(serve(stream, frames));
        let verdict = client.await.ok();
        server.abort();
        tally.note(Subject::Viewers, case, begun.elapsed(), verdict);
    }
    Ok(tally)
}

/// Sends frames and closes the connection, whatever the client sends.
async fn serve(stream: TcpStream, frames: Vec<Vec<u8>>) {
    #[expect(clippy::result_large_err, reason = "as the library wants it")]
    let protocol = |_: &Request, mut response: Response| -> Result<Response, ErrorResponse> {
        response.headers_mut().insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(ALPN));
        Ok(response)
    };
    let Ok(socket) = accept_hdr_async(stream, protocol).await else { return };
    let (mut sink, mut stream) = socket.split();
    let send = async {
        for frame in frames {
            sink.send(Message::Binary(frame.into())).await?;
        }
        sink.close().await
    };
    let hear = async { while let Some(Ok(_)) = stream.next().await {} };
    // A client that has left need not be told.
    let _ = tokio::join!(send, hear);
}

/// A client that connects once.
async fn client(server: Server) -> Verdict {
    let mut core = core();
    let retry = Retry { first_attempts: 1, first_within: TIMEOUT, reconnect: false };
    let streaming = stream_from(&server, &mut core, Clock::start(), retry, |_, _| {});
    match timeout(TIMEOUT, streaming).await {
        Err(_) => Verdict::Stuck,
        Ok(End::Left | End::Unreachable { .. }) => Verdict::refused("connection"),
        // A connection closed by the server is no refusal.
        Ok(End::Closed(close)) if close.code == CloseCode::Lost => of_blobs(&core),
        Ok(End::Closed(close)) => Verdict::refused(format!("session closed: {:?}", close.code)),
    }
}
