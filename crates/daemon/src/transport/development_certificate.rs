//! The development certificate: self-signed, of one key that lasts, and renewed while the server runs.
//!
//! A page can make a browser accept it by its hash only if it is of an ECDSA P-256 key and valid for at most 14 days
//! (W3C WebTransport, `serverCertificateHashes`). So it is replaced every five days, and viewers pin what does not change: the
//! key ([`Certificate::key_pin`]). Two days before the next certificate is used, its hash is told to pages beside the
//! present one's; the old hash is told until the certificate after that. A page that was opened before, and connects again
//! later, is refused by its browser and goes on over WebSocket.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use tokio::time::sleep;

use crate::session::state::ServerState;
use crate::transport::certificate::Certificate;
use crate::transport::live_certificate::LiveCertificate;

/// Interval at which the certificate's age is checked. Short, since the computer may have slept.
const CHECK_INTERVAL: Duration = Duration::from_secs(3600);
const DAY: Duration = Duration::from_secs(24 * 3600);
/// The next certificate is made when the present one expires within this time, and used when it expires within the
/// second.
const ANNOUNCE_BEFORE: Duration = DAY.saturating_mul(8);
const USE_BEFORE: Duration = DAY.saturating_mul(6);

/// The certificate in use, and the one before or after it.
#[derive(Debug)]
pub(crate) struct DevelopmentCertificate {
    folder: PathBuf,
    current: Certificate,
    /// Made, and not yet used.
    next: Option<Certificate>,
    /// Used before.
    previous: Option<Certificate>,
}

impl DevelopmentCertificate {
    /// Loads the certificate from `folder`, or creates it.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub(crate) fn load_or_create(folder: &Path, now: SystemTime) -> anyhow::Result<Self> {
        let current = Certificate::load_or_create(folder, now)?;
        let mut loaded = Self { folder: folder.to_owned(), current, next: None, previous: None };
        loaded.renew(now)?;
        Ok(loaded)
    }

    pub(crate) const fn current(&self) -> &Certificate {
        &self.current
    }

    /// SHA-256 of the certificates that a page may meet in the next days, in hexadecimal digits.
    pub(crate) fn hashes(&self) -> Vec<String> {
        let all = [Some(&self.current), self.next.as_ref(), self.previous.as_ref()];
        all.into_iter().flatten().map(Certificate::fingerprint_hex).collect()
    }

    /// Makes or uses the next certificate if it is time; returns whether [`Self::hashes`] have changed.
    ///
    /// # Errors
    /// The certificate cannot be made or stored; the present one stays in use.
    pub(crate) fn renew(&mut self, now: SystemTime) -> anyhow::Result<bool> {
        let expires_within = |time: Duration| self.current.not_after().is_none_or(|end| end <= now + time);
        if !expires_within(ANNOUNCE_BEFORE) {
            return Ok(false);
        }
        let uses = expires_within(USE_BEFORE);
        let made = self.next.is_none();
        let next = match self.next.take() {
            Some(next) => next,
            None => self.current.renewed(now)?,
        };
        if !uses {
            self.next = Some(next);
            return Ok(made);
        }
        if let Err(why) = next.store(&self.folder) {
            self.next = Some(next);
            return Err(why);
        }
        self.previous = Some(std::mem::replace(&mut self.current, next));
        Ok(true)
    }
}

/// Renews the certificate while the server runs; never returns. Open connections keep theirs.
pub(crate) async fn keep_valid(
    mut certificate: DevelopmentCertificate,
    live: Arc<LiveCertificate>,
    state: Arc<ServerState>,
) {
    loop {
        sleep(CHECK_INTERVAL).await;
        let renewed = certificate.renew(SystemTime::now()).and_then(|changed| {
            if changed {
                live.replace(certificate.current())?;
                state.metrics().certificate_in_use(certificate.current().not_after());
                state.site().set_certificate_hashes(certificate.hashes());
                tracing::info!(hashes = ?certificate.hashes(), "the development certificate is renewed");
            }
            Ok(())
        });
        if let Err(why) = renewed {
            state.metrics().certificate_refused();
            tracing::error!(
                "the development certificate is not renewed: {why:#}; this is tried again in an hour"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_next_certificate_is_told_before_it_is_used_and_has_the_same_key() {
        let folder = tempfile::tempdir().unwrap();
        let start = SystemTime::now();
        let mut certificate = DevelopmentCertificate::load_or_create(folder.path(), start).unwrap();
        let pin = certificate.current().key_pin();
        let mut told_since = std::collections::BTreeMap::new();
        let mut changes = 0;
        // Ten weeks, hour by hour.
        for hour in 0..70 * 24_u32 {
            let now = start + CHECK_INTERVAL * hour;
            let before = certificate.current().fingerprint_hex();
            let hashes = certificate.hashes();
            let changed = certificate.renew(now).unwrap();
            assert_eq!(changed, certificate.hashes() != hashes, "hour {hour}");
            for hash in certificate.hashes() {
                told_since.entry(hash).or_insert(hour);
            }
            let current = certificate.current();
            assert!(current.not_after().unwrap() > now + 5 * DAY, "hour {hour}");
            assert_eq!(current.key_pin(), pin);
            if current.fingerprint_hex() != before {
                changes += 1;
                assert!(hour - told_since[&current.fingerprint_hex()] >= 47, "hour {hour}: not told before");
                assert!(certificate.hashes().contains(&before), "hour {hour}: the old one is not told");
                let stored = Certificate::load_or_create(folder.path(), now).unwrap();
                assert_eq!(stored.fingerprint(), current.fingerprint());
            }
        }
        assert_eq!(changes, 13, "after a week, then every five days");
    }

    #[test]
    fn a_certificate_that_cannot_be_stored_is_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let start = SystemTime::now();
        let mut certificate = DevelopmentCertificate::load_or_create(folder.path(), start).unwrap();
        let first = certificate.current().fingerprint();
        // A file in the folder's place.
        let blocked = folder.path().join("file");
        std::fs::write(&blocked, "").unwrap();
        let good = std::mem::replace(&mut certificate.folder, blocked);
        assert!(certificate.renew(start + 8 * DAY).is_err());
        assert_eq!(certificate.current().fingerprint(), first);
        certificate.folder = good;
        assert!(certificate.renew(start + 8 * DAY).unwrap());
        assert_ne!(certificate.current().fingerprint(), first);
    }
}
