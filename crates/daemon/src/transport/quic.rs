//! The QUIC endpoint: its settings, and the loop that takes connections.
//!
//! The server speaks first. [`serve_quic`] turns each incoming connection into a session before the
//! handshake is complete (0.5-RTT), and polls the session once before it lets go of the thread, so that
//! `Welcome`, the first scene page and base meshes ride in the handshake's second flight. Until the
//! client's address is validated, QUIC itself bounds what is sent to three times what was received.

use std::future::{Future, poll_fn};
use std::net::{SocketAddr, UdpSocket};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::Poll;
use std::time::Duration;

use anyhow::Context;
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::stream::ALPN;
use quinn::crypto::rustls::{HandshakeData, NoInitialCipherSuite, QuicServerConfig};
use quinn::{
    BloomTokenLog, Connection, IdleTimeout, Incoming, TransportConfig, ValidationTokenConfig, VarInt,
    ZeroRttAccepted,
};
use rustls::server::ServerSessionMemoryCache;
use tokio::task::JoinSet;
use tokio::time::timeout;
use tracing::Instrument;

use crate::admission::leases::LeaseError;
use crate::admission::pre_auth_pool::PreAuthSlot;
use crate::metrics::Transport;
use crate::session::drive::drive;
use crate::session::guard::SessionGuard;
use crate::session::state::{Phase, ServerState};
use crate::transport::certificate::Certificate;
use crate::transport::congestion::{INITIAL_WINDOW_BYTES, bounded_queue};
use crate::transport::live_certificate::LiveCertificate;
use crate::transport::quic_stream::{QuicReceiver, QuicSender, first_send_window};

/// Silence after which QUIC itself gives up.
const IDLE_TIMEOUT_MS: u32 = 20_000;
/// Keeps bindings in address translators alive.
const KEEP_ALIVE: Duration = Duration::from_secs(7);
/// What a round trip is taken for until one was measured. A sender paces by it: after ten packets it waits for a sixth of
/// that. RFC 9002, section 6.2.2, takes 333 ms, which leaves a link of 2 Mbit/s idle for 6 ms. The first probe for what
/// may be lost comes after three of it, still later than the answer over any link.
const INITIAL_RTT: Duration = Duration::from_millis(250);
/// What a client may have in flight towards the server: control messages only.
const RECEIVE_WINDOW_BYTES: u32 = 128 * 1024;
/// UDP buffers asked for. The common default, 208 KiB, lost clients at 500 connections.
const SOCKET_BUFFER_BYTES: usize = 4 * 1024 * 1024;
/// Below this a warning is due.
const SOCKET_BUFFER_LEAST_BYTES: usize = 2 * 1024 * 1024;
/// Handshakes at once from addresses that are not validated. Beyond this, addresses are validated
/// first (Retry), which costs honest clients a round trip and forged ones everything.
const MAX_UNVALIDATED: usize = 128;
/// Sessions that can be resumed. One takes about 300 bytes.
const MAX_TICKETS: usize = 8192;
/// How long an address token is good for: as long as a ticket (rustls).
const TOKEN_LIFETIME: Duration = Duration::from_secs(24 * 60 * 60);
/// Used tokens are remembered in a Bloom filter of at most this size, made for so many; beyond them more and more
/// tokens are mistaken for used ones and ignored.
const TOKEN_LOG_BYTES: usize = 1 << 20;
const TOKENS_USED_PER_LIFETIME: u64 = 100_000;
/// How long the handshake may take of a client that is told that it comes too late.
const TURN_AWAY_TIMEOUT: Duration = Duration::from_secs(2);
/// How long the endpoint's last packets may take.
const ENDPOINT_CLOSE_TIMEOUT: Duration = Duration::from_millis(500);

/// The settings of the server's side of a QUIC connection.
///
/// # Errors
/// Fails where the certificate's key cannot be used with TLS 1.3.
pub fn server_config(certificate: &Certificate) -> anyhow::Result<quinn::ServerConfig> {
    Ok(server_config_of(tls_config(LiveCertificate::new(certificate)?)?)?)
}

/// The server's side of TLS, with what `certificate` says at each handshake.
pub(crate) fn tls_config(certificate: Arc<LiveCertificate>) -> Result<rustls::ServerConfig, rustls::Error> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut tls = rustls::ServerConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_no_client_auth()
        .with_cert_resolver(certificate);
    tls.alpn_protocols = vec![ALPN.as_bytes().to_vec()];
    // Lets clients that come back say `Hello` in their first packet. Tickets are numbers of sessions that
    // the server remembers, the oldest forgotten first, and each is good for one connection: early data that is
    // repeated is not read. And nothing that it says changes anything on the server but counters and logs.
    tls.max_early_data_size = u32::MAX;
    tls.send_tls13_tickets = 1;
    tls.session_storage = ServerSessionMemoryCache::new(MAX_TICKETS);
    Ok(tls)
}

/// The settings over this side of TLS.
pub(crate) fn server_config_of(
    tls: rustls::ServerConfig,
) -> Result<quinn::ServerConfig, NoInitialCipherSuite> {
    let mut transport = TransportConfig::default();
    transport
        .congestion_controller_factory(bounded_queue())
        .send_window(first_send_window(INITIAL_WINDOW_BYTES))
        .receive_window(VarInt::from_u32(RECEIVE_WINDOW_BYTES))
        .stream_receive_window(VarInt::from_u32(RECEIVE_WINDOW_BYTES))
        // The client's control stream.
        .max_concurrent_uni_streams(VarInt::from_u32(1))
        .max_concurrent_bidi_streams(VarInt::from_u32(0))
        .datagram_receive_buffer_size(None)
        .max_idle_timeout(Some(IdleTimeout::from(VarInt::from_u32(IDLE_TIMEOUT_MS))))
        .keep_alive_interval(Some(KEEP_ALIVE))
        .initial_rtt(INITIAL_RTT)
        // Streams of one priority are finished one after the other: a whole blob is of use, two halves
        // are not.
        .send_fairness(false);

    // What lets a client that comes back be sent more than three times what it sent before its address is validated
    // again: sealed, for one address, good once. The key is made at start.
    let mut tokens = ValidationTokenConfig::default();
    let log = BloomTokenLog::new_expected_items(TOKEN_LOG_BYTES, TOKENS_USED_PER_LIFETIME);
    tokens.lifetime(TOKEN_LIFETIME).log(Arc::new(log));

    let mut config = quinn::ServerConfig::with_crypto(Arc::new(QuicServerConfig::try_from(tls)?));
    config
        .transport_config(Arc::new(transport))
        .validation_token_config(tokens)
        .max_incoming(1024)
        .incoming_buffer_size(16 * 1024)
        .incoming_buffer_size_total(4 * 1024 * 1024);
    Ok(config)
}

/// Binds a UDP socket with large buffers. Warns where the system gives less.
///
/// # Errors
/// Fails where the address cannot be had.
pub fn bind_udp(address: SocketAddr) -> anyhow::Result<UdpSocket> {
    let about = || format!("cannot listen on UDP {address}");
    let socket = socket2::Socket::new(socket2::Domain::for_address(address), socket2::Type::DGRAM, None)
        .with_context(about)?;
    // The system may refuse or halve these; what came of it is read back.
    let _ = socket.set_recv_buffer_size(SOCKET_BUFFER_BYTES);
    let _ = socket.set_send_buffer_size(SOCKET_BUFFER_BYTES);
    let got = socket.recv_buffer_size().unwrap_or(0).min(socket.send_buffer_size().unwrap_or(0));
    if got < SOCKET_BUFFER_LEAST_BYTES {
        tracing::warn!(
            "UDP buffers are only {got} bytes; with hundreds of clients packets will be lost: \
             raise net.core.rmem_max and net.core.wmem_max to {SOCKET_BUFFER_BYTES}"
        );
    }
    if address.is_ipv6() && address.ip().is_unspecified() {
        // All addresses are those of IPv4 too, whatever the system's habit.
        let _ = socket.set_only_v6(false);
    }
    socket.bind(&address.into()).with_context(about)?;
    socket.set_nonblocking(true).with_context(about)?;
    Ok(socket.into())
}

/// Takes connections of an endpoint and runs a session on each. While the daemon drains, newcomers are told to come again
/// later. When it stops, the endpoint is closed.
///
/// Works on any endpoint with [`server_config`], also one over a simulated network in paused time.
pub async fn serve_quic(endpoint: quinn::Endpoint, state: Arc<ServerState>) {
    let mut sessions = JoinSet::new();
    let unvalidated = Arc::new(AtomicUsize::new(0));
    loop {
        tokio::select! {
            biased;
            () = state.wait_for_phase(Phase::Stopped) => break,
            Some(_) = sessions.join_next() => {}
            incoming = endpoint.accept() => {
                let Some(incoming) = incoming else { break };
                if let Some(mut session) = accept(incoming, &state, &unvalidated) {
                    // Polled once here and now: the connection's driver has not run yet, so what the
                    // session writes shares packets with the handshake.
                    let polled = poll_fn(|context| Poll::Ready(session.as_mut().poll(context))).await;
                    if polled.is_pending() {
                        sessions.spawn(session);
                    }
                }
            }
        }
    }
    endpoint.close(VarInt::from(CloseCode::ShuttingDown.number()), b"the server has shut down");
    let _ = timeout(ENDPOINT_CLOSE_TIMEOUT, endpoint.wait_idle()).await;
}

/// Counts a handshake from an address that is not validated, until dropped.
struct Unvalidated(Arc<AtomicUsize>);

impl Drop for Unvalidated {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// What is done about a connection.
type Task = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Begins a session on an incoming connection; `None` where it is refused at once.
fn accept(incoming: Incoming, state: &Arc<ServerState>, unvalidated: &Arc<AtomicUsize>) -> Option<Task> {
    let peer = incoming.remote_address();
    let counted = if incoming.remote_address_validated() {
        None
    } else if unvalidated.load(Ordering::Relaxed) < MAX_UNVALIDATED {
        unvalidated.fetch_add(1, Ordering::Relaxed);
        Some(Unvalidated(unvalidated.clone()))
    } else {
        // Fails only for validated addresses.
        let _ = incoming.retry();
        return None;
    };
    let guard = match SessionGuard::begin(state, Transport::Quic, peer) {
        Ok(guard) => guard,
        Err(why @ LeaseError::Draining) => {
            tracing::info!(%peer, "connection refused: {why}");
            return Some(Box::pin(turn_away(incoming, counted, state.enter_pre_auth(peer))));
        }
        Err(why) => {
            tracing::info!(%peer, "connection refused: {why}");
            incoming.refuse();
            return None;
        }
    };
    let opened = incoming.accept().map_err(|why| why.to_string()).and_then(|connecting| {
        // On servers this always succeeds.
        connecting.into_0rtt().map_err(|_| "no early data".to_owned())
    });
    match opened {
        Ok((connection, handshake)) => {
            let span = tracing::info_span!("session", id = guard.id, transport = "quic", %peer);
            Some(Box::pin(run_session(connection, handshake, guard, counted).instrument(span)))
        }
        Err(why) => {
            tracing::info!(%peer, "handshake failed: {why}");
            state.metrics().handshake_failed();
            None
        }
    }
}

/// Tells a client that it comes too late. QUIC can refuse a connection only without a reason, and a client cannot tell that
/// from a server that is not there: the handshake is done first.
async fn turn_away(incoming: Incoming, _counted: Option<Unvalidated>, slot: PreAuthSlot) {
    let told = async {
        let Ok(connecting) = incoming.accept() else { return };
        if let Ok(Ok(connection)) = timeout(TURN_AWAY_TIMEOUT, connecting).await {
            connection.close(
                VarInt::from(CloseCode::ShuttingDown.number()),
                LeaseError::Draining.to_string().as_bytes(),
            );
        }
    };
    tokio::select! {
        biased;
        () = told => {}
        () = slot.evicted() => {}
    }
}

/// The scene that the client's ALPN names. Known at once but where its first message takes more than a packet.
fn scene_asked(connection: &Connection, state: &ServerState) -> Option<String> {
    let data = connection.handshake_data()?.downcast::<HandshakeData>().ok()?;
    state.scenes().table().named(&data.protocol?).map(str::to_owned)
}

async fn run_session(
    connection: Connection,
    handshake: ZeroRttAccepted,
    mut guard: SessionGuard,
    mut counted: Option<Unvalidated>,
) {
    guard.requested_scene = scene_asked(&connection, &guard.state);
    let state = guard.state.clone();
    let started = tokio::time::Instant::now();
    let rate_bits_per_s = state.config(Transport::Quic).limiter.rate_bits_per_s;
    let mut receiver = QuicReceiver::new(connection.clone(), state.clone());
    let mut sender = QuicSender::new(connection.clone(), rate_bits_per_s);
    let proof = async {
        // A token proves an address too, but not that somebody there goes on; what it says is of no meaning to servers.
        handshake.await;
        if connection.close_reason().is_some() {
            // Over before it was complete: the session hears of it elsewhere.
            std::future::pending().await
        }
        counted = None;
    };
    let close = drive(&mut guard, proof, &mut receiver, &mut sender).await;
    if counted.is_some() {
        state.metrics().handshake_failed();
    }
    tracing::info!(
        scene = guard.scene_name(),
        udp_bytes = connection.stats().udp_tx.bytes,
        lost_packets = connection.stats().path.lost_packets,
        seconds = started.elapsed().as_secs_f32(),
        "session ended: {close}"
    );
    sender.finish(&close).await;
}
