//! The server's certificate: self-signed for development, or given as PEM files.
//!
//! The development certificate is created at the first start and stored, and renewed with the same key
//! ([`crate::transport::development_certificate`]). Viewers pin the key: the SHA-256 of its DER, as 64 lowercase
//! hexadecimal digits in the viewer's URL, `quic://HOST:PORT#spki-sha256=FINGERPRINT`. A pin of the certificate itself
//! (`#sha256=`) lasts as long as the certificate.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use lodestream_compress::whole_file::write_privately;
use pem::{EncodeConfig, LineEnding, Pem};
use rustls::CertificateError;
use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::ServerCertVerifier;
use rustls::crypto::ring::cipher_suite::TLS13_AES_128_GCM_SHA256;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, PrivatePkcs8KeyDer, ServerName, UnixTime};
use rustls::server::ParsedCertificate;
use rustls::sign::CertifiedKey;

use crate::lifecycle::file_watch::read_small_file;

/// Name of the file, in the state folder, that holds the development certificate and its key.
pub(crate) const FILE_NAME: &str = "development-certificate.pem";

/// Subject of self-signed certificates. Viewers that pin a fingerprint ignore it.
const SUBJECT: &str = "localhost";
const DAY: Duration = Duration::from_secs(24 * 3600);
/// Certificates are valid from a day before they are made, for clients with slow clocks.
const BACKDATED: Duration = DAY;
/// How long a self-signed certificate for simulations and tests is valid.
const VALIDITY: Duration = Duration::from_secs(2 * 365 * 24 * 3600);
/// How long a development certificate is valid: with the day before it was made, less than the 14 days that browsers admit.
const DEVELOPMENT_VALIDITY: Duration = Duration::from_secs(13 * 24 * 3600 - 1);
/// A development certificate that expires within this time is replaced at start.
const RENEW_BEFORE: Duration = DAY;

/// A certificate chain with its private key.
#[derive(Debug)]
pub struct Certificate {
    chain: Vec<CertificateDer<'static>>,
    key: PrivateKeyDer<'static>,
}

impl Certificate {
    /// Creates a self-signed certificate, valid from a day before `now` for two years. Its key is Ed25519: signatures
    /// have a constant length, so simulated handshakes have reproducible byte counts. Browsers do not accept it.
    ///
    /// # Errors
    /// The system provides no random numbers.
    pub fn self_signed(now: SystemTime) -> anyhow::Result<Self> {
        Self::self_signed_until(&rcgen::KeyPair::generate_for(&rcgen::PKCS_ED25519)?, now, now + VALIDITY)
    }

    /// Creates a development certificate with a new key, valid from a day before `now` for less than 14 days.
    fn development(now: SystemTime) -> anyhow::Result<Self> {
        let key = rcgen::KeyPair::generate_for(&rcgen::PKCS_ECDSA_P256_SHA256)?;
        Self::self_signed_until(&key, now, now + DEVELOPMENT_VALIDITY)
    }

    /// A new development certificate for the key of this one.
    ///
    /// # Errors
    /// The key is not ECDSA P-256, which browsers demand.
    pub(crate) fn renewed(&self, now: SystemTime) -> anyhow::Result<Self> {
        let PrivateKeyDer::Pkcs8(key) = &self.key else { bail!("its key is not in PKCS #8") };
        let key = rcgen::KeyPair::from_pkcs8_der_and_sign_algo(key, &rcgen::PKCS_ECDSA_P256_SHA256)
            .context("its key is not ECDSA P-256, which browsers demand")?;
        Self::self_signed_until(&key, now, now + DEVELOPMENT_VALIDITY)
    }

    fn self_signed_until(key: &rcgen::KeyPair, now: SystemTime, end: SystemTime) -> anyhow::Result<Self> {
        let mut params = rcgen::CertificateParams::new(vec![SUBJECT.to_owned()])?;
        params.distinguished_name.push(rcgen::DnType::CommonName, "Lodestream development server");
        let epoch = rcgen::date_time_ymd(1970, 1, 1);
        let since_epoch = |time: SystemTime| time.duration_since(UNIX_EPOCH).unwrap_or_default();
        params.not_before = epoch + since_epoch(now).saturating_sub(BACKDATED);
        params.not_after = epoch + since_epoch(end);
        let certificate = params.self_signed(key)?;
        Ok(Self {
            chain: vec![certificate.der().clone()],
            key: PrivateKeyDer::Pkcs8(PrivatePkcs8KeyDer::from(key.serialize_der())),
        })
    }

    /// Loads the development certificate from `folder`. Creates it, and the folder, if there is none; renews it, with the
    /// same key, if it expires within a day; replaces it with a warning if it is damaged or browsers refuse its key.
    ///
    /// # Errors
    /// The folder cannot be written.
    pub fn load_or_create(folder: &Path, now: SystemTime) -> anyhow::Result<Self> {
        let path = folder.join(FILE_NAME);
        if path.exists() {
            let kept = Self::from_pem_files(&path, &path);
            match kept.and_then(|kept| kept.renewed(now).map(|renewed| (kept, renewed))) {
                Ok((kept, _)) if kept.check_validity(now).is_ok() => return Ok(kept),
                Ok((_, renewed)) => return renewed.store(folder).map(|()| renewed),
                Err(why) => tracing::warn!(
                    path = %path.display(),
                    "the development certificate is replaced ({why:#}); viewers need the new URL"
                ),
            }
        }
        let new = Self::development(now)?;
        new.store(folder).map(|()| new)
    }

    /// Loads a certificate chain and its key from PEM files, which may be the same file.
    ///
    /// # Errors
    /// A file cannot be read or holds no such item, or the key does not match the certificate.
    pub fn from_pem_files(chain: &Path, key: &Path) -> anyhow::Result<Self> {
        Self::from_pem(&read_small_file(chain)?, &read_small_file(key)?, chain, key)
    }

    /// Parses the contents of PEM files; the paths are for messages.
    pub(crate) fn from_pem(
        chain_text: &[u8],
        key_text: &[u8],
        chain: &Path,
        key: &Path,
    ) -> anyhow::Result<Self> {
        let certificates = CertificateDer::pem_slice_iter(chain_text)
            .collect::<Result<Vec<_>, _>>()
            .with_context(|| format!("{} holds no readable PEM certificate", chain.display()))?;
        if certificates.is_empty() {
            bail!("{} holds no PEM certificate", chain.display());
        }
        let private = PrivateKeyDer::from_pem_slice(key_text)
            .with_context(|| format!("{} holds no readable PEM private key", key.display()))?;
        let loaded = Self { chain: certificates, key: private };
        let certified = loaded.certified_key().with_context(|| format!("in {}", key.display()))?;
        certified.keys_match().with_context(|| {
            format!("the certificate in {} and the key in {} do not match", chain.display(), key.display())
        })?;
        Ok(loaded)
    }

    /// The certificate and key for rustls.
    pub(crate) fn certified_key(&self) -> anyhow::Result<CertifiedKey> {
        let signing = rustls::crypto::ring::sign::any_supported_type(&self.key)
            .context("the private key is of an unsupported kind")?;
        Ok(CertifiedKey::new(self.chain.clone(), signing))
    }

    /// The chain, with the server's own certificate first.
    #[must_use]
    pub fn chain(&self) -> &[CertificateDer<'static>] {
        &self.chain
    }

    /// The private key.
    #[must_use]
    pub fn key(&self) -> PrivateKeyDer<'static> {
        self.key.clone_key()
    }

    /// SHA-256 of the certificate's DER.
    #[must_use]
    pub fn fingerprint(&self) -> [u8; 32] {
        self.chain.first().map_or([0; 32], |der| sha256(der))
    }

    /// The same as 64 lowercase hexadecimal digits.
    pub(crate) fn fingerprint_hex(&self) -> String {
        hex(&self.fingerprint())
    }

    /// Pin of this certificate in viewers' URLs: `sha256=` and 64 lowercase hexadecimal digits.
    #[must_use]
    pub fn pin(&self) -> String {
        format!("sha256={}", self.fingerprint_hex())
    }

    /// Pin of the key in viewers' URLs, which stays valid for a renewed certificate with the same key: `spki-sha256=` and
    /// the SHA-256 of the SubjectPublicKeyInfo's DER.
    #[must_use]
    pub fn key_pin(&self) -> String {
        let parsed = self.chain.first().map(ParsedCertificate::try_from);
        let digest = match parsed {
            Some(Ok(parsed)) => sha256(&parsed.subject_public_key_info()),
            // Not reached: rustls refuses such a certificate.
            _ => [0; 32],
        };
        format!("spki-sha256={}", hex(&digest))
    }

    /// Expiry of the certificate; `None` if it cannot be parsed.
    #[must_use]
    pub fn not_after(&self) -> Option<SystemTime> {
        // rustls reports the expiry only in the error for an expired certificate.
        let end_of_time = UnixTime::since_unix_epoch(Duration::from_secs(u64::from(u32::MAX) << 8));
        match self.verify_at(end_of_time)? {
            Err(rustls::Error::InvalidCertificate(CertificateError::ExpiredContext {
                not_after, ..
            })) => UNIX_EPOCH.checked_add(Duration::from_secs(not_after.as_secs())),
            _ => None,
        }
    }

    /// Verifies the certificate at a time, as its own authority; `None` if it cannot be parsed.
    fn verify_at(&self, time: UnixTime) -> Option<Result<(), rustls::Error>> {
        let own = self.chain.first()?;
        let mut roots = rustls::RootCertStore::empty();
        roots.add(own.clone()).ok()?;
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let verifier = WebPkiServerVerifier::builder_with_provider(Arc::new(roots), provider).build().ok()?;
        let name = ServerName::try_from(SUBJECT).ok()?;
        Some(verifier.verify_server_cert(own, &[], &name, &[], time).map(drop))
    }

    /// Checks that a self-signed certificate is valid now and for another day. One that is not valid yet passes: the clock
    /// may be unset until the network is up, and viewers that pin a certificate ignore its dates.
    fn check_validity(&self, now: SystemTime) -> anyhow::Result<()> {
        for time in [now, now + RENEW_BEFORE] {
            let time = UnixTime::since_unix_epoch(time.duration_since(UNIX_EPOCH).unwrap_or_default());
            match self.verify_at(time).context("it cannot be read")? {
                Err(rustls::Error::InvalidCertificate(
                    CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. },
                )) => {}
                verified => verified?,
            }
        }
        Ok(())
    }

    /// Stores this as the development certificate of `folder`.
    pub(crate) fn store(&self, folder: &Path) -> anyhow::Result<()> {
        let path = folder.join(FILE_NAME);
        self.write(folder, &path)
            .with_context(|| format!("cannot store the development certificate in {}", path.display()))
    }

    /// Writes certificate and key into one file, atomically, readable only by the owner.
    fn write(&self, folder: &Path, path: &Path) -> anyhow::Result<()> {
        std::fs::create_dir_all(folder)?;
        write_privately(path, |out| {
            for certificate in &self.chain {
                out.write_all(pem_text("CERTIFICATE", certificate).as_bytes())?;
            }
            out.write_all(pem_text("PRIVATE KEY", self.key.secret_der()).as_bytes())
        })?;
        Ok(())
    }
}

fn hex(digest: &[u8; 32]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// SHA-256 by a cipher suite, the only public access to rustls's hash.
fn sha256(bytes: &[u8]) -> [u8; 32] {
    let mut out = [0; 32];
    // Always: the suite is a constant of TLS 1.3.
    if let Some(suite) = TLS13_AES_128_GCM_SHA256.tls13() {
        out.copy_from_slice(suite.common.hash_provider.hash(bytes).as_ref());
    }
    out
}

/// PEM text (RFC 7468) with LF line ends on every system.
fn pem_text(label: &str, der: &[u8]) -> String {
    let config = EncodeConfig::new().set_line_ending(LineEnding::LF);
    pem::encode_config(&Pem::new(label, der), config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_certificate_is_stored_and_private() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::now();
        let first = Certificate::load_or_create(&folder.path().join("deep/er"), now).unwrap();
        let again = Certificate::load_or_create(&folder.path().join("deep/er"), now).unwrap();
        assert_eq!(first.fingerprint(), again.fingerprint());
        assert_eq!((first.pin().len(), first.key_pin().len()), (7 + 64, 12 + 64));
        let lasts = first.not_after().unwrap().duration_since(now).unwrap();
        // From the day before, so 14 days at most.
        assert!(lasts + BACKDATED <= 14 * DAY && lasts > 12 * DAY, "{lasts:?}");
        assert_eq!(first.key().secret_der(), again.key().secret_der());
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let meta = std::fs::metadata(folder.path().join("deep/er").join(FILE_NAME)).unwrap();
            assert_eq!(meta.permissions().mode() & 0o777, 0o600);
        }
    }

    #[test]
    fn expired_and_damaged_certificates_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE_NAME);
        let now = SystemTime::now();
        let refused_by_browsers = Certificate::self_signed(now).unwrap();
        refused_by_browsers.store(folder.path()).unwrap();
        let first = Certificate::load_or_create(folder.path(), now).unwrap();
        assert_ne!(first.fingerprint(), refused_by_browsers.fingerprint());
        let much_later = now + 2 * VALIDITY;
        let second = Certificate::load_or_create(folder.path(), much_later).unwrap();
        assert_ne!(second.fingerprint(), first.fingerprint());
        assert_eq!(second.key_pin(), first.key_pin(), "a renewed certificate has the same key");

        let good = std::fs::read(&path).unwrap();
        for damaged in [&b""[..], b"\xff\0garbage", &good[..good.len() / 2]] {
            std::fs::write(&path, damaged).unwrap();
            let replaced = Certificate::load_or_create(folder.path(), much_later).unwrap();
            assert_ne!(replaced.fingerprint(), second.fingerprint());
        }
    }

    #[test]
    fn a_clock_set_back_keeps_the_certificate() {
        let folder = tempfile::tempdir().unwrap();
        let now = SystemTime::now();
        let kept = Certificate::load_or_create(folder.path(), now).unwrap();
        let days = |n: u64| Duration::from_secs(n * 24 * 3600);
        for then in [now - days(3), now - days(3000), UNIX_EPOCH, UNIX_EPOCH - days(1), now + days(11)] {
            let again = Certificate::load_or_create(folder.path(), then).unwrap();
            assert_eq!(again.fingerprint(), kept.fingerprint(), "{then:?}");
        }
        let later =
            Certificate::load_or_create(folder.path(), now + days(12) + Duration::from_secs(3600)).unwrap();
        assert_ne!(later.fingerprint(), kept.fingerprint(), "its last day");
    }

    #[test]
    fn a_foreign_key_is_refused() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        for folder in [&a, &b] {
            Certificate::load_or_create(folder.path(), SystemTime::now()).unwrap();
        }
        let refused =
            Certificate::from_pem_files(&a.path().join(FILE_NAME), &b.path().join(FILE_NAME)).unwrap_err();
        assert!(format!("{refused:#}").contains("do not match"), "{refused:#}");
        assert!(Certificate::from_pem_files(Path::new("/nowhere"), Path::new("/nowhere")).is_err());
    }

    #[test]
    fn the_fingerprint_is_sha256() {
        // FIPS 180-2, appendix B.1.
        let fake = Certificate {
            chain: vec![CertificateDer::from(b"abc".to_vec())],
            key: Certificate::self_signed(SystemTime::now()).unwrap().key(),
        };
        assert_eq!(fake.pin(), "sha256=ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
