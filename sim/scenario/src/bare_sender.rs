//! A server without sessions, for comparison: quinn or tungstenite with a token bucket.
//!
//! It uses the shipped server's transport settings and sends the same blobs in pieces of the same length under the same
//! rate limit, over one stream per client with QUIC. It reads no messages, schedules nothing and records no metrics.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::SystemTime;

use anyhow::Context as _;
use bytes::Bytes;
use futures_util::SinkExt as _;
use lodestream_daemon::{Certificate, bind_udp, server_config};
use lodestream_protocol::Time;
use lodestream_protocol::limiter::SendLimiter;
use lodestream_protocol::server::ServerConfig;
use lodestream_protocol::source::SceneSource;
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Builder;
use tokio::time::{Instant, sleep_until};
use tokio_tungstenite::tungstenite::Message;

use crate::bare_client::chunks;

/// Sends a scene's chunks to every client until standard input ends. Prints its addresses in the format of
/// [`crate::served::serve`].
///
/// # Errors
/// A listener or endpoint that cannot be opened.
pub(crate) fn serve_bare(scene: &Arc<dyn SceneSource>, rate_bits_per_s: u64) -> anyhow::Result<()> {
    let blobs: Vec<Bytes> = chunks(scene).iter().filter_map(|id| scene.read(id).ok()).collect();
    let blobs: Arc<[Bytes]> = blobs.into();
    let certificate = Certificate::self_signed(SystemTime::now())?;
    let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let runtime = Builder::new_multi_thread().enable_all().build()?;
    let (endpoint, listener) = runtime.block_on(async {
        let endpoint = quinn::Endpoint::new(
            quinn::EndpointConfig::default(),
            Some(server_config(&certificate)?),
            bind_udp(any)?,
            Arc::new(quinn::TokioRuntime),
        )?;
        anyhow::Ok((endpoint, TcpListener::bind(any).await?))
    })?;
    println!("quic://{}#{} ws://{}/", endpoint.local_addr()?, certificate.pin(), listener.local_addr()?);
    let (quic, websocket) =
        (ServerConfig::quic(Some(rate_bits_per_s)), ServerConfig::websocket(Some(rate_bits_per_s)));
    let of_quic = Arc::clone(&blobs);
    runtime.spawn(async move {
        while let Some(incoming) = endpoint.accept().await {
            let pieces = Pieces::new(&quic, Arc::clone(&of_quic));
            tokio::spawn(over_quic(incoming, pieces));
        }
    });
    runtime.spawn(async move {
        while let Ok((stream, _)) = listener.accept().await {
            let pieces = Pieces::new(&websocket, Arc::clone(&blobs));
            tokio::spawn(over_websocket(stream, pieces));
        }
    });
    // Ends with the parent process, even if that is killed.
    let _ = std::io::copy(&mut std::io::stdin(), &mut std::io::sink());
    Ok(())
}

/// The paced pieces for one client.
struct Pieces {
    blobs: Arc<[Bytes]>,
    /// Index of the current blob, and bytes of it that were sent.
    at: (usize, usize),
    piece_bytes: usize,
    limiter: SendLimiter,
    began: Instant,
}

impl Pieces {
    fn new(config: &ServerConfig, blobs: Arc<[Bytes]>) -> Self {
        let (limiter, piece_bytes) = (SendLimiter::new(config.limiter), config.piece_bytes as usize);
        Self { blobs, at: (0, 0), piece_bytes, limiter, began: Instant::now() }
    }

    /// The next piece, once the rate limit admits it; starts over after the last.
    async fn next(&mut self) -> Option<Bytes> {
        let (blob, from) = self.at;
        let bytes = self.blobs.get(blob)?;
        let to = bytes.len().min(from + self.piece_bytes);
        self.at = if to < bytes.len() { (blob, to) } else { ((blob + 1) % self.blobs.len(), 0) };
        let piece = bytes.slice(from..to);
        let now = || Time::from(self.began.elapsed());
        if !self.limiter.admits(now()) {
            sleep_until(self.began + std::time::Duration::from(self.limiter.ready_at())).await;
        }
        let now = now();
        self.limiter.spend(now, piece.len());
        Some(piece)
    }
}

async fn over_quic(incoming: quinn::Incoming, mut pieces: Pieces) -> anyhow::Result<()> {
    let connection = incoming.await?;
    let mut stream = connection.open_uni().await?;
    while let Some(piece) = pieces.next().await {
        stream.write_all(&piece).await?;
    }
    Ok(())
}

async fn over_websocket(stream: TcpStream, mut pieces: Pieces) -> anyhow::Result<()> {
    stream.set_nodelay(true)?;
    let mut socket = tokio_tungstenite::accept_async(stream).await.context("no handshake")?;
    while let Some(piece) = pieces.next().await {
        socket.send(Message::Binary(piece)).await?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn pieces_are_those_of_the_blobs_and_come_as_the_limiter_admits_them() {
        let blobs: Arc<[Bytes]> =
            [vec![1; 3000], vec![2; 100], vec![3; 2800]].map(Bytes::from).to_vec().into();
        let config = ServerConfig::websocket(Some(2_000_000));
        let mut pieces = Pieces::new(&config, blobs);
        let (mut lengths, mut wire) = (Vec::new(), 0);
        while pieces.began.elapsed().as_millis() < 3000 {
            let piece = pieces.next().await.unwrap();
            lengths.push(piece.len());
            wire += config.limiter.wire_bytes(piece.len());
        }
        assert_eq!(lengths[..6], [2800, 200, 100, 2800, 2800, 200]);
        let ratio = wire as f64 * 8.0 / (3.0 * 2e6);
        assert!((0.98..=1.02).contains(&ratio), "{ratio}");
    }
}
