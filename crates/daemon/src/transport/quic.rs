//! The QUIC endpoint: its settings, and the accept loop.
//!
//! The server sends first. [`serve_quic`] starts a session on each incoming connection before the handshake is complete
//! (0.5-RTT), and polls the session once before it yields, so that `Welcome`, the first scene page and base meshes travel
//! in the handshake's second flight. Until the client's address is validated, QUIC limits the bytes sent to three times
//! the bytes received.

use std::future::{Future, poll_fn};
use std::net::{SocketAddr, UdpSocket};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::Poll;
use std::time::Duration;

use anyhow::Context;
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::stream::ALPN;
use lodestream_transport::quic;
use quinn::crypto::rustls::{HandshakeData, NoInitialCipherSuite, QuicServerConfig};
use quinn::{
    BloomTokenLog, Connection, IdleTimeout, Incoming, TransportConfig, ValidationTokenConfig, VarInt,
    ZeroRttAccepted,
};
use rustls::server::ServerSessionMemoryCache;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};
use tracing::Instrument;

use crate::limits::leases::LeaseError;
use crate::limits::pre_auth_pool::PreAuthSlot;
use crate::metrics::Transport;
use crate::session::drive::drive;
use crate::session::guard::SessionGuard;
use crate::session::state::{Phase, ServerState};
use crate::transport::certificate::Certificate;
use crate::transport::congestion::{INITIAL_WINDOW_BYTES, bounded_queue};
use crate::transport::live_certificate::LiveCertificate;
use crate::transport::quic_stream::{ClientStreams, QuicReceiver, QuicSender, first_send_window};
use crate::transport::web_transport::{self, H3_ALPN};

/// QUIC's idle timeout.
const IDLE_TIMEOUT_MS: u32 = 20_000;
/// Interval of keep-alive packets, which keep NAT bindings open.
const KEEP_ALIVE: Duration = Duration::from_secs(7);
/// Assumed round-trip time before the first measurement. The pacer uses it: after ten packets the sender waits for a sixth
/// of it. The 333 ms of RFC 9002, section 6.2.2, leave a link of 2 Mbit/s idle for 6 ms. The first loss probe is sent after
/// three times this value, later than the response over any usual link.
const INITIAL_RTT: Duration = Duration::from_millis(250);
/// Flow-control window for the client, which sends only control messages.
const RECEIVE_WINDOW_BYTES: u32 = 128 * 1024;
/// Requested size of UDP buffers. The usual default of 208 KiB lost clients at 500 connections.
const SOCKET_BUFFER_BYTES: usize = 4 * 1024 * 1024;
/// Smaller UDP buffers cause a warning.
const MIN_SOCKET_BUFFER_BYTES: usize = 2 * 1024 * 1024;
/// Most handshakes at once from addresses that are not validated. Beyond this, addresses are validated first (Retry): that
/// costs real clients a round trip and stops forged addresses.
const MAX_UNVALIDATED: usize = 128;
/// Most TLS sessions that can be resumed, about 300 bytes each.
const MAX_TICKETS: usize = 8192;
/// Lifetime of an address token: that of a ticket in rustls.
const TOKEN_LIFETIME: Duration = Duration::from_secs(24 * 60 * 60);
/// Size of the Bloom filter of used address tokens, and the number of tokens it is dimensioned for. Beyond that, more and
/// more unused tokens are ignored.
const TOKEN_LOG_BYTES: usize = 1 << 20;
const TOKENS_USED_PER_LIFETIME: u64 = 100_000;
/// Time limit of the handshake with a client that is refused during shutdown.
const REFUSAL_TIMEOUT: Duration = Duration::from_secs(2);
/// Pauses between looks at a handshake that has not come to its protocol. QUIC's idle timeout ends it.
const FIRST_PAUSE: Duration = Duration::from_millis(1);
const LONGEST_PAUSE: Duration = Duration::from_millis(100);
/// Time limit for closing the endpoint.
const ENDPOINT_CLOSE_TIMEOUT: Duration = Duration::from_millis(500);

/// Settings of the server's side of QUIC connections.
///
/// # Errors
/// The certificate's key cannot be used with TLS 1.3.
pub fn server_config(certificate: &Certificate) -> anyhow::Result<quinn::ServerConfig> {
    Ok(server_config_of(tls_config(LiveCertificate::new(certificate)?)?, false)?)
}

/// TLS settings, with the certificate that `certificate` resolves at each handshake.
pub(crate) fn tls_config(certificate: Arc<LiveCertificate>) -> Result<rustls::ServerConfig, rustls::Error> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut tls = rustls::ServerConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_no_client_auth()
        .with_cert_resolver(certificate);
    tls.alpn_protocols = vec![ALPN.as_bytes().to_vec()];
    // Returning clients may send `Hello` in their first packet (0-RTT). A ticket names a session stored by the server and
    // is valid once, so replayed early data is not read. It could change nothing but counters and logs anyway.
    tls.max_early_data_size = u32::MAX;
    tls.send_tls13_tickets = 1;
    tls.session_storage = ServerSessionMemoryCache::new(MAX_TICKETS);
    Ok(tls)
}

/// QUIC settings over these TLS settings; `web_transport` tells whether browsers may connect too. What they need applies to
/// all connections, since limits are told before the protocol is negotiated; our own sessions still read one stream.
pub(crate) fn server_config_of(
    tls: rustls::ServerConfig,
    web_transport: bool,
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
        // Streams of equal priority are sent one after the other: one complete blob is more useful than two halves.
        .send_fairness(false);

    if web_transport {
        transport
            .max_concurrent_uni_streams(VarInt::from_u32(web_transport::UNIDIRECTIONAL_STREAMS))
            .max_concurrent_bidi_streams(VarInt::from_u32(web_transport::BIDIRECTIONAL_STREAMS))
            .datagram_receive_buffer_size(Some(web_transport::DATAGRAM_BYTES));
    }

    // Address tokens (NEW_TOKEN) validate a returning client's address at once, which lifts the limit of three times the
    // bytes received. A token is encrypted with a key created at start, bound to one address, and valid once.
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

/// Binds a UDP socket with large buffers. Warns if the system provides smaller ones.
///
/// # Errors
/// The address cannot be bound.
pub fn bind_udp(address: SocketAddr) -> anyhow::Result<UdpSocket> {
    let about = || format!("cannot listen on UDP {address}");
    let socket = socket2::Socket::new(socket2::Domain::for_address(address), socket2::Type::DGRAM, None)
        .with_context(about)?;
    // The system may refuse or reduce these: the sizes are read back.
    let _ = socket.set_recv_buffer_size(SOCKET_BUFFER_BYTES);
    let _ = socket.set_send_buffer_size(SOCKET_BUFFER_BYTES);
    let got = socket.recv_buffer_size().unwrap_or(0).min(socket.send_buffer_size().unwrap_or(0));
    if got < MIN_SOCKET_BUFFER_BYTES {
        tracing::warn!(
            "UDP buffers are only {got} bytes; with hundreds of clients packets will be lost: \
             raise net.core.rmem_max and net.core.wmem_max to {SOCKET_BUFFER_BYTES}"
        );
    }
    if address.is_ipv6() && address.ip().is_unspecified() {
        // Accept IPv4 too, whatever the system's default.
        let _ = socket.set_only_v6(false);
    }
    socket.bind(&address.into()).with_context(about)?;
    socket.set_nonblocking(true).with_context(about)?;
    Ok(socket.into())
}

/// Accepts connections of an endpoint and runs a session on each. While the daemon drains, new clients are told to retry
/// later. When it stops, the endpoint is closed.
///
/// Works with any endpoint that uses [`server_config`], including one over a simulated network in virtual time.
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
                    // Polled once before the connection's driver runs, so that the session's data shares packets with
                    // the handshake.
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

/// The task of a connection.
type Task = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Starts a session on an incoming connection; `None` if it is refused at once.
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
            return Some(Box::pin(refuse_draining(incoming, counted, state.enter_pre_auth(peer))));
        }
        Err(why) => {
            tracing::info!(%peer, "connection refused: {why}");
            incoming.refuse();
            return None;
        }
    };
    let opened = incoming.accept().map_err(|why| why.to_string()).and_then(|connecting| {
        // On servers this always succeeds.
        connecting.into_0rtt().map_err(|_| "0.5-RTT is not available".to_owned())
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

/// Tells a client that the server is shutting down. A refused QUIC connection carries no reason and looks like an absent
/// server to the client, so the handshake is completed first.
async fn refuse_draining(incoming: Incoming, _counted: Option<Unvalidated>, slot: PreAuthSlot) {
    let refusal = async {
        let Ok(connecting) = incoming.accept() else { return };
        if let Ok(Ok(connection)) = timeout(REFUSAL_TIMEOUT, connecting).await {
            connection.close(
                VarInt::from(CloseCode::ShuttingDown.number()),
                LeaseError::Draining.to_string().as_bytes(),
            );
        }
    };
    tokio::select! {
        biased;
        () = refusal => {}
        () = slot.evicted() => {}
    }
}

/// The protocol that was negotiated by ALPN; waits if the client's first TLS message takes more than one packet, as those
/// of browsers with keys against quantum computers do. Empty if the handshake fails.
async fn negotiated(connection: &Connection) -> Vec<u8> {
    let mut pause = FIRST_PAUSE;
    loop {
        if let Some(data) = connection.handshake_data() {
            return data.downcast::<HandshakeData>().ok().and_then(|data| data.protocol).unwrap_or_default();
        }
        if connection.close_reason().is_some() {
            return Vec::new();
        }
        // quinn tells of this event only where the session's first data would be late.
        sleep(pause).await;
        pause = (2 * pause).min(LONGEST_PAUSE);
    }
}

async fn run_session(
    connection: Connection,
    handshake: ZeroRttAccepted,
    mut guard: SessionGuard,
    mut counted: Option<Unvalidated>,
) {
    let state = guard.state.clone();
    let protocol = tokio::select! {
        biased;
        protocol = negotiated(&connection) => protocol,
        () = state.wait_for_phase(Phase::Draining) => {
            let why = LeaseError::Draining.to_string();
            return quic::close(&connection, &Close::new(CloseCode::ShuttingDown, why));
        }
        why = guard.evicted() => return quic::close(&connection, &Close::new(CloseCode::Busy, why)),
    };
    guard.requested_scene = state.scenes().table().named(&protocol).map(str::to_owned);
    let started = tokio::time::Instant::now();
    let rate_bits_per_s = state.config(Transport::Quic).limiter.rate_bits_per_s;
    let validation = async {
        // The handshake's end validates the address, and shows that the client is still there, which an address token does
        // not. The result (whether 0-RTT was accepted) has no meaning for servers.
        handshake.await;
        if connection.close_reason().is_some() {
            // The handshake failed: the session's receiver reports it.
            std::future::pending().await
        }
        counted = None;
    };
    let peer = || Some(connection.remote_address());
    let log_end = |guard: &SessionGuard, close: &Close| {
        tracing::info!(
            scene = guard.scene_name(),
            udp_bytes = connection.stats().udp_tx.bytes,
            lost_packets = connection.stats().path.lost_packets,
            seconds = started.elapsed().as_secs_f32(),
            "session ended: {close}"
        );
    };
    if protocol == H3_ALPN {
        let session = web_transport::accept(&connection, &mut guard, validation).await;
        if counted.is_some() {
            state.metrics().handshake_failed();
        }
        let Some(session) = session else { return };
        state.metrics().web_transport_session();
        let (mut receiver, mut sender, end) = session.halves(state.clone(), rate_bits_per_s);
        let close = drive(&mut guard, std::future::ready(()), peer, &mut receiver, &mut sender).await;
        log_end(&guard, &close);
        sender.finish_control(&close).await;
        return end.close(&close).await;
    }
    let streams = ClientStreams::All(connection.clone());
    let mut receiver = QuicReceiver::new(streams, state.clone());
    let mut sender = QuicSender::new(connection.clone(), rate_bits_per_s);
    let close = drive(&mut guard, validation, peer, &mut receiver, &mut sender).await;
    if counted.is_some() {
        state.metrics().handshake_failed();
    }
    log_end(&guard, &close);
    sender.finish(&close).await;
}
