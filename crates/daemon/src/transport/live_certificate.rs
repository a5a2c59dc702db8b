//! The certificate of new connections, and its reload while the server runs. Open connections keep theirs.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::SystemTime;

use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use tokio::sync::watch;

use crate::lifecycle::file_watch::watch_files;
use crate::session::state::ServerState;
use crate::transport::certificate::Certificate;

/// The certificate of new connections, over QUIC and TCP; replaceable.
#[derive(Debug)]
pub(crate) struct LiveCertificate(RwLock<Arc<CertifiedKey>>);

impl LiveCertificate {
    /// Starts with a certificate.
    ///
    /// # Errors
    /// The key is of an unsupported kind.
    pub(crate) fn new(certificate: &Certificate) -> anyhow::Result<Arc<Self>> {
        Ok(Arc::new(Self(RwLock::new(Arc::new(certificate.certified_key()?)))))
    }

    /// Replaces the certificate of new connections.
    ///
    /// # Errors
    /// The key is of an unsupported kind.
    pub(crate) fn replace(&self, certificate: &Certificate) -> anyhow::Result<()> {
        let new = Arc::new(certificate.certified_key()?);
        // A thread that panics with the lock leaves the old certificate or the new one.
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = new;
        Ok(())
    }
}

impl ResolvesServerCert for LiveCertificate {
    fn resolve(&self, _: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        Some(Arc::clone(&self.0.read().unwrap_or_else(PoisonError::into_inner)))
    }
}

/// The files of a certificate, and where it is in use.
#[derive(Debug)]
pub(crate) struct CertificateFiles {
    pub(crate) live: Arc<LiveCertificate>,
    pub(crate) chain: PathBuf,
    pub(crate) key: PathBuf,
}

/// Reloads the certificate when its files change; never returns. While a pair is being replaced, one file may be old and
/// not match the other: the certificate stays until both match.
pub(crate) async fn watch_certificate(
    files: CertificateFiles,
    state: Arc<ServerState>,
    reload_requests: watch::Receiver<u64>,
) {
    let CertificateFiles { live, chain, key } = files;
    let paths = vec![chain.clone(), key.clone()];
    watch_files("the certificate", paths, reload_requests, |texts, first| {
        let new = texts.and_then(|texts| match &texts[..] {
            [of_chain, of_key] => Certificate::from_pem(of_chain, of_key, &chain, &key),
            _ => anyhow::bail!("{} and {} were not read", chain.display(), key.display()),
        });
        match new.and_then(|new| live.replace(&new).map(|()| new)) {
            Ok(new) => {
                state.metrics().certificate_in_use(new.not_after());
                warn_if_expired(&new, SystemTime::now());
                if !first {
                    let (certificate, public) = (new.pin(), new.key_pin());
                    tracing::info!(%certificate, key = %public, "the certificate was reloaded; running sessions keep theirs");
                }
            }
            Err(why) => {
                state.metrics().certificate_refused();
                tracing::error!(
                    "the certificate is not reloaded, new connections get the old one: {why:#}; it is read again when \
                     the files change"
                );
            }
        }
    })
    .await;
}

/// Warns if a certificate has expired.
fn warn_if_expired(certificate: &Certificate, now: SystemTime) {
    if certificate.not_after().is_some_and(|end| end <= now) {
        tracing::warn!("the certificate has expired: viewers that trust its authority refuse it; renew it");
    }
}
