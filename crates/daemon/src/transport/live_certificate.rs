//! The certificate that new connections get, and its exchange while the server runs. Connections that are there keep
//! what they have.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::SystemTime;

use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use tokio::sync::watch;

use crate::lifecycle::file_watch::watch_files;
use crate::session::state::ServerState;
use crate::transport::certificate::Certificate;

/// The certificate of new connections, over QUIC and TCP.
#[derive(Debug)]
pub(crate) struct LiveCertificate(RwLock<Arc<CertifiedKey>>);

impl LiveCertificate {
    /// Begins with a certificate.
    ///
    /// # Errors
    /// Fails where its key is of no supported kind.
    pub(crate) fn new(certificate: &Certificate) -> anyhow::Result<Arc<Self>> {
        Ok(Arc::new(Self(RwLock::new(Arc::new(certificate.certified_key()?)))))
    }

    fn replace(&self, certificate: &Certificate) -> anyhow::Result<()> {
        let new = Arc::new(certificate.certified_key()?);
        // A thread that panicked while it held the lock left one or the other.
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = new;
        Ok(())
    }
}

impl ResolvesServerCert for LiveCertificate {
    fn resolve(&self, _: ClientHello<'_>) -> Option<Arc<CertifiedKey>> {
        Some(Arc::clone(&self.0.read().unwrap_or_else(PoisonError::into_inner)))
    }
}

/// CertificateFiles of a certificate that is exchanged when they change.
#[derive(Debug)]
pub(crate) struct CertificateFiles {
    pub(crate) live: Arc<LiveCertificate>,
    pub(crate) chain: PathBuf,
    pub(crate) key: PathBuf,
}

/// Exchanges the certificate when its files have changed, as far as they can be used: of a pair that is being replaced one
/// may be old, and then they do not belong together until the other has come. Goes on for ever.
pub(crate) async fn watch_certificate(
    files: CertificateFiles,
    state: Arc<ServerState>,
    asked: watch::Receiver<u64>,
) {
    let CertificateFiles { live, chain, key } = files;
    let paths = vec![chain.clone(), key.clone()];
    watch_files("the certificate", paths, asked, |texts, first| {
        let new = texts.and_then(|texts| match &texts[..] {
            [of_chain, of_key] => Certificate::from_pem(of_chain, of_key, &chain, &key),
            _ => anyhow::bail!("{} and {} were not read", chain.display(), key.display()),
        });
        match new.and_then(|new| live.replace(&new).map(|()| new)) {
            Ok(new) => {
                state.metrics().certificate_in_use(new.not_after());
                warn_of_dates(&new, SystemTime::now());
                if !first {
                    let (certificate, public) = (new.pin(), new.key_pin());
                    tracing::info!(%certificate, key = %public, "the certificate was exchanged; sessions keep theirs");
                }
            }
            Err(why) => {
                state.metrics().certificate_refused();
                tracing::error!(
                    "the certificate is not exchanged, new connections get the old one: {why:#}; it is read again when \
                     the files change"
                );
            }
        }
    })
    .await;
}

/// Says where a certificate is of no use to those who look at dates.
pub(crate) fn warn_of_dates(certificate: &Certificate, now: SystemTime) {
    if certificate.not_after().is_some_and(|end| end <= now) {
        tracing::warn!(
            "the certificate has expired: viewers that trust its authority are kept out; renew it"
        );
    }
}
