//! Names of scenes as ALPN names: with them, a QUIC client chooses its scene before `Hello`.

use std::sync::Arc;

use lodestream_protocol::stream::ALPN;
use quinn::crypto::rustls::QuicServerConfig;

use crate::session::scenes::Scenes;
use crate::session::state::ServerState;
use crate::transport::live_certificate::LiveCertificate;
use crate::transport::quic::{server_config_of, tls_config};
use crate::transport::web_transport::H3_ALPN;

/// Settings of the QUIC endpoint. After a change of scenes, tickets, address tokens and the certificate stay valid.
pub(crate) struct QuicConfig {
    tls: rustls::ServerConfig,
    base: quinn::ServerConfig,
}

impl QuicConfig {
    /// Settings with a certificate that may be replaced.
    pub(crate) fn new(certificate: Arc<LiveCertificate>) -> anyhow::Result<Self> {
        let tls = tls_config(certificate)?;
        let base = server_config_of(tls.clone(), true)?;
        Ok(Self { tls, base })
    }

    /// The settings for the current scenes. With several, their ALPN names are preferred over the protocol's. Browsers
    /// come with HTTP/3's.
    pub(crate) fn server_config(&self, scenes: &Scenes) -> anyhow::Result<quinn::ServerConfig> {
        let mut tls = self.tls.clone();
        let names = scenes.table();
        let others = [ALPN.into(), H3_ALPN.to_vec()];
        tls.alpn_protocols = names.alpns().map(<[u8]>::to_vec).chain(others).collect();
        let mut config = self.base.clone();
        config.crypto = Arc::new(QuicServerConfig::try_from(tls)?);
        Ok(config)
    }
}

/// Updates the endpoint's ALPN names after each change of scenes.
pub(crate) async fn watch_alpns(settings: QuicConfig, endpoint: quinn::Endpoint, state: Arc<ServerState>) {
    let mut replacements = state.scenes().replacements();
    while replacements.changed().await.is_ok() {
        match settings.server_config(state.scenes()) {
            Ok(config) => endpoint.set_server_config(Some(config)),
            // Not expected, since it succeeded at start. `Hello` can still name the scene.
            Err(why) => tracing::error!("ALPN names of scenes are not updated: {why:#}"),
        }
    }
}
