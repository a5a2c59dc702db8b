//! Which scenes QUIC's clients may name before `Hello`: TLS agrees on one of the names that the server lists.

use std::sync::Arc;

use lodestream_protocol::stream::ALPN;
use quinn::crypto::rustls::QuicServerConfig;

use crate::session::scenes::Scenes;
use crate::session::state::ServerState;
use crate::transport::live_certificate::LiveCertificate;
use crate::transport::quic::{server_config_of, tls_config};

/// The settings of connections. Those for other scenes share all that connections leave behind: tickets, address
/// tokens, the certificate.
pub(crate) struct QuicConfig {
    tls: rustls::ServerConfig,
    of_one: quinn::ServerConfig,
}

impl QuicConfig {
    pub(crate) fn new(certificate: Arc<LiveCertificate>) -> anyhow::Result<Self> {
        let tls = tls_config(certificate)?;
        let of_one = server_config_of(tls.clone())?;
        Ok(Self { tls, of_one })
    }

    /// For the scenes that there are now. Where they are several, a scene's own name is agreed on before the protocol's.
    pub(crate) fn naming(&self, scenes: &Scenes) -> anyhow::Result<quinn::ServerConfig> {
        let mut tls = self.tls.clone();
        let names = scenes.table();
        tls.alpn_protocols = names.alpns().map(<[u8]>::to_vec).chain([ALPN.into()]).collect();
        let mut config = self.of_one.clone();
        config.crypto = Arc::new(QuicServerConfig::try_from(tls)?);
        Ok(config)
    }
}

/// Has new connections name the scenes that there are after each exchange. Goes on as long as there are replacements.
pub(crate) async fn watch_alpns(settings: QuicConfig, endpoint: quinn::Endpoint, state: Arc<ServerState>) {
    let mut replacements = state.scenes().replacements();
    while replacements.changed().await.is_ok() {
        match settings.naming(state.scenes()) {
            Ok(config) => endpoint.set_server_config(Some(config)),
            // It went well before; `Hello` names scenes all the same.
            Err(why) => tracing::error!("scenes cannot be named over QUIC before Hello: {why:#}"),
        }
    }
}
