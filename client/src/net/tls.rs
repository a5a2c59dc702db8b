//! TLS over TCP, for `wss://`.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode};
use rustls::client::Resumption;
use rustls::pki_types::ServerName;
use rustls::{ClientConfig, Error};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::timeout;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;

use super::trust::{Refusal, Trust, Verifier};

/// What is spoken within.
const HTTP: &[u8] = b"http/1.1";

/// Opens TLS connections to one server.
#[derive(Clone)]
pub(super) struct Tls {
    connector: TlsConnector,
    name: ServerName<'static>,
    refusal: Refusal,
}

impl Tls {
    /// For a server of this host name or IP address, known by `trust`.
    pub(super) fn new(host: &str, trust: Trust) -> Result<Self, Close> {
        let wrong = |why: String| Close::new(CloseCode::Protocol, why);
        let name = ServerName::try_from(host.to_owned());
        let name = name.map_err(|_| wrong(format!("{host:?} is no name that a certificate can have")))?;
        let refusal = Refusal::default();
        let config =
            config(trust, refusal.clone()).map_err(|why| wrong(format!("TLS cannot be set up: {why}")))?;
        Ok(Self { connector: TlsConnector::from(Arc::new(config)), name, refusal })
    }

    /// The handshake, over an open connection. Ends within `limit`.
    pub(super) async fn open<S>(&self, stream: S, limit: Duration) -> Result<TlsStream<S>, Close>
    where
        S: AsyncRead + AsyncWrite + Unpin,
    {
        match timeout(limit, self.connector.connect(self.name.clone(), stream)).await {
            Ok(Ok(stream)) => Ok(stream),
            Ok(Err(why)) => Err(self.refusal.reason().unwrap_or_else(|| failed(&why))),
            Err(_) => {
                let limit = limit.as_secs_f32();
                let why = format!(
                    "it accepts connections, but gave no answer to the TLS handshake within {limit} s"
                );
                Err(Close::new(CloseCode::Lost, why))
            }
        }
    }
}

/// TLS 1.3 as over QUIC. Nothing is resumed: each connection looks at the certificate anew.
fn config(trust: Trust, refusal: Refusal) -> Result<ClientConfig, Error> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let verifier = Verifier::new(trust, refusal, Arc::clone(&provider))?;
    let mut config = ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous()
        .with_custom_certificate_verifier(verifier)
        .with_no_client_auth();
    config.alpn_protocols = vec![HTTP.to_vec()];
    config.resumption = Resumption::disabled();
    Ok(config)
}

/// A handshake that failed, though not by the certificate.
fn failed(why: &io::Error) -> Close {
    match why.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
        Some(Error::InvalidMessage(_)) => Close::new(
            CloseCode::Protocol,
            "it does not speak TLS there: write ws:// where the server prints that",
        ),
        Some(why) => Close::new(CloseCode::Lost, format!("the TLS handshake failed: {why}")),
        None => Close::new(CloseCode::Lost, format!("the TLS handshake failed: {why}")),
    }
}
