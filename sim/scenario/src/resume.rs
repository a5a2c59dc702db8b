//! Resumed connections: gives client and server the state of an earlier session.
//!
//! Tickets and address tokens are part of the settings of client and server ([`lodestream_client::net::client_config`],
//! [`lodestream_daemon::server_config`]). A run over a resumed connection is therefore preceded by a
//! session with the same settings, over another network and in virtual time of its own. The run itself starts at time
//! zero, over a fresh link, with a client that has no byte of the scene.

use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use lodestream_client::net::{self, Pin};
use lodestream_daemon::{Certificate, ServerState, SessionSettings, serve_quic, server_config};
use lodestream_netsim::clock::{VirtualClock, virtual_runtime};
use lodestream_netsim::link::{IP_UDP_BYTES, LinkSettings};
use lodestream_netsim::udp::UdpNetwork;
use lodestream_protocol::message::CloseCode;
use lodestream_protocol::source::SceneSource;
use tokio::time::{sleep, timeout};

use super::network::{CLIENT, CLOSE_TIMEOUT, SERVER};

/// The link of the first session: 1 Gbit/s, 1 ms each way, and a queue that never fills.
const FIRST_LINK: (NonZeroU64, u64, u64) = (NonZeroU64::new(1_000_000_000).unwrap(), 1_000_000, 1 << 20);
/// Length of the first session. Ticket and token arrive with the answer to the client's second flight.
const FIRST_SESSION: Duration = Duration::from_millis(100);

/// Settings of a server and of a client that pins its certificate.
#[derive(Clone, Debug)]
pub(super) struct QuicSettings {
    pub(super) server: quinn::ServerConfig,
    pub(super) client: quinn::ClientConfig,
}

impl QuicSettings {
    /// Settings of a server and a client without an earlier session.
    pub(super) fn new(certificate: &Certificate) -> anyhow::Result<Self> {
        let client = net::client_config(Pin::Certificate(certificate.fingerprint()))?;
        Ok(Self { server: server_config(certificate)?, client })
    }

    /// Settings after a first session. Must not be called within a runtime.
    pub(super) fn after_first_session(
        scene: &Arc<dyn SceneSource>,
        certificate: &Certificate,
    ) -> anyhow::Result<Self> {
        let settings = Self::new(certificate)?;
        virtual_runtime()
            .context("no runtime for virtual time")?
            .block_on(settings.run_first_session(scene))?;
        Ok(settings)
    }

    async fn run_first_session(&self, scene: &Arc<dyn SceneSource>) -> anyhow::Result<()> {
        let network = UdpNetwork::new(VirtualClock::start());
        let (rate, delay_ns, queue_bytes) = FIRST_LINK;
        for (from, to) in [(SERVER, CLIENT), (CLIENT, SERVER)] {
            let link = LinkSettings::constant(rate, delay_ns, queue_bytes, IP_UDP_BYTES);
            network.connect(from, to, link, 0);
        }
        let server = network.endpoint(SERVER, Some(self.server.clone()), [1; 32])?;
        let client = network.endpoint(CLIENT, None, [2; 32])?;
        let state = ServerState::new(Arc::clone(scene), SessionSettings::default());
        let serving = tokio::spawn(serve_quic(server, Arc::clone(&state)));
        let connecting = client.connect_with(self.client.clone(), SERVER, "localhost")?;
        let connection = connecting.await.context("the first of two sessions failed")?;
        sleep(FIRST_SESSION).await;
        connection.close(CloseCode::Normal.number().into(), b"");
        client.wait_idle().await;
        state.stop();
        let _ = timeout(CLOSE_TIMEOUT, serving).await;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
