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

use super::trust::{CertificateRejection, Trust, Verifier};

/// ALPN protocol: WebSocket starts with an HTTP/1.1 request.
const HTTP: &[u8] = b"http/1.1";

/// Opens TLS connections to one server.
#[derive(Clone)]
pub(super) struct Tls {
    connector: TlsConnector,
    name: ServerName<'static>,
    rejection: CertificateRejection,
}

impl Tls {
    /// Prepares connections to a host name or IP address, whose certificate is verified by `trust`.
    pub(super) fn new(host: &str, trust: Trust) -> Result<Self, Close> {
        let wrong = |why: String| Close::new(CloseCode::Protocol, why);
        let name = ServerName::try_from(host.to_owned());
        let name = name.map_err(|_| wrong(format!("{host:?} is not a name that a certificate can have")))?;
        let rejection = CertificateRejection::default();
        let config =
            config(trust, rejection.clone()).map_err(|why| wrong(format!("TLS cannot be set up: {why}")))?;
        Ok(Self { connector: TlsConnector::from(Arc::new(config)), name, rejection })
    }

    /// Performs the handshake over an open connection. Ends within `limit`.
    pub(super) async fn open<S>(&self, stream: S, limit: Duration) -> Result<TlsStream<S>, Close>
    where
        S: AsyncRead + AsyncWrite + Unpin,
    {
        match timeout(limit, self.connector.connect(self.name.clone(), stream)).await {
            Ok(Ok(stream)) => Ok(stream),
            Ok(Err(why)) => Err(self.rejection.reason().unwrap_or_else(|| failed(&why))),
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

/// TLS 1.3, as over QUIC. Sessions are not resumed: each connection verifies the certificate.
fn config(trust: Trust, rejection: CertificateRejection) -> Result<ClientConfig, Error> {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let verifier = Verifier::new(trust, rejection, Arc::clone(&provider))?;
    let mut config = ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous()
        .with_custom_certificate_verifier(verifier)
        .with_no_client_auth();
    config.alpn_protocols = vec![HTTP.to_vec()];
    config.resumption = Resumption::disabled();
    Ok(config)
}

/// The close of a handshake that failed for another reason than the certificate.
fn failed(why: &io::Error) -> Close {
    match why.get_ref().and_then(|inner| inner.downcast_ref::<Error>()) {
        Some(Error::InvalidMessage(_)) => Close::new(
            CloseCode::Protocol,
            "the server does not use TLS on this port: write ws:// if the server prints that, and http:// for a \
             published scene",
        ),
        Some(why) => Close::new(CloseCode::Lost, format!("the TLS handshake failed: {why}")),
        None => Close::new(CloseCode::Lost, format!("the TLS handshake failed: {why}")),
    }
}
