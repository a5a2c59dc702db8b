//! The certificate that new connections get, and its exchange while the server runs. Connections that are there keep
//! what they have.

use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::{Duration, SystemTime};

use rustls::server::{ClientHello, ResolvesServerCert};
use rustls::sign::CertifiedKey;
use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::sleep;

use super::certificate::{Certificate, read_pem};
use super::state::ServerState;

/// Time between two looks at the files. To read two small files costs less than to be told of changes on every kind of
/// file system, through links that are exchanged too.
const LOOK_EVERY: Duration = Duration::from_secs(10);

/// The certificate of new connections, over QUIC and TCP.
#[derive(Debug)]
pub struct LiveCertificate(RwLock<Arc<CertifiedKey>>);

impl LiveCertificate {
    /// Begins with a certificate.
    ///
    /// # Errors
    /// Fails where its key is of no supported kind.
    pub fn new(certificate: &Certificate) -> anyhow::Result<Arc<Self>> {
        Ok(Arc::new(Self(RwLock::new(Arc::new(certificate.certified_key()?)))))
    }

    fn exchange(&self, certificate: &Certificate) -> anyhow::Result<()> {
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

/// Files of a certificate that is exchanged when they change.
#[derive(Debug)]
pub(super) struct Files {
    pub(super) live: Arc<LiveCertificate>,
    pub(super) chain: PathBuf,
    pub(super) key: PathBuf,
}

/// What is in the files: the certificate and a hash by which a change is seen, or why they cannot be read.
struct Found {
    seen: Result<blake3::Hash, String>,
    certificate: anyhow::Result<Certificate>,
}

/// Reads a certificate chain and its key. Of a pair that is being replaced one may be old; then they do not belong
/// together, and are read again when the other has come.
fn find(chain: &Path, key: &Path) -> Found {
    let texts = read_pem(chain).and_then(|text| Ok((text, read_pem(key)?)));
    match texts {
        Ok((of_chain, of_key)) => {
            let mut hasher = blake3::Hasher::new();
            // The length parts them.
            hasher.update(&(of_chain.len() as u64).to_le_bytes()).update(&of_chain).update(&of_key);
            let certificate = Certificate::from_pem(&of_chain, &of_key, chain, key);
            Found { seen: Ok(hasher.finalize()), certificate }
        }
        Err(why) => Found { seen: Err(format!("{why:#}")), certificate: Err(why) },
    }
}

/// Exchanges the certificate when its files have changed, as far as they can be used: looked at every [`LOOK_EVERY`],
/// and when `asked` changes. Goes on for ever.
pub(super) async fn renew(files: Files, state: Arc<ServerState>, mut asked: watch::Receiver<u64>) {
    let Files { live, chain, key } = files;
    // What was read at start is read again, so that nothing is missed that changed since.
    let mut seen = None;
    let mut first = true;
    loop {
        let told = !first
            && tokio::select! {
                biased;
                changed = asked.changed() => changed.is_ok(),
                () = sleep(LOOK_EVERY) => false,
            };
        let (of_chain, of_key) = (chain.clone(), key.clone());
        // Disks are waited for elsewhere. It cannot fail but at the end of everything.
        let Ok(found) = spawn_blocking(move || find(&of_chain, &of_key)).await else { return };
        let known = seen.as_ref() == Some(&found.seen);
        seen = Some(found.seen);
        if known {
            if told {
                tracing::info!("the certificate's files are as they were");
            }
            continue;
        }
        match found.certificate.and_then(|new| live.exchange(&new).map(|()| new)) {
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
        first = false;
    }
}

/// Says where a certificate is of no use to those who look at dates.
pub(super) fn warn_of_dates(certificate: &Certificate, now: SystemTime) {
    if certificate.not_after().is_some_and(|end| end <= now) {
        tracing::warn!(
            "the certificate has expired: viewers that trust its authority are kept out; renew it"
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::certificate::FILE_NAME;

    fn kept(now: SystemTime) -> (tempfile::TempDir, PathBuf, Certificate) {
        let folder = tempfile::tempdir().unwrap();
        let certificate = Certificate::load_or_create(folder.path(), now).unwrap();
        let path = folder.path().join(FILE_NAME);
        (folder, path, certificate)
    }

    #[test]
    fn a_change_of_either_file_is_seen_and_half_a_change_is_no_certificate() {
        let now = SystemTime::now();
        let ((_a, first, of_first), (_b, second, of_second)) = (kept(now), kept(now));
        let (one, mixed, other) = (find(&first, &first), find(&second, &first), find(&second, &second));
        assert_eq!(one.certificate.unwrap().pin(), of_first.pin());
        assert_eq!(other.certificate.unwrap().pin(), of_second.pin());
        assert!(format!("{:#}", mixed.certificate.unwrap_err()).contains("do not belong together"));
        assert!(one.seen != mixed.seen && mixed.seen != other.seen && one.seen != other.seen);
        std::fs::remove_file(&second).unwrap();
        let gone = find(&second, &second);
        assert!(gone.seen.is_err() && gone.certificate.is_err());
    }
}
