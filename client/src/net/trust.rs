//! Which certificates of servers are believed: the one that the address names by its fingerprint, or any that an
//! authority vouches for.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use lodestream_protocol::message::{Close, CloseCode};
use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::ring::cipher_suite::TLS13_AES_128_GCM_SHA256;
use rustls::crypto::{CryptoProvider, verify_tls12_signature, verify_tls13_signature};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::ParsedCertificate;
use rustls::{CertificateError, DigitallySignedStruct, Error, RootCertStore, SignatureScheme};
use tokio::task::spawn_blocking;
use tokio::time::timeout;

use super::pin::Pin;

/// Time that reading the system's certificates may take.
const SYSTEM_TIMEOUT: Duration = Duration::from_secs(4);

/// Authorities that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AuthoritiesError {
    /// No PEM text.
    #[error("it holds no readable PEM certificate: {0}")]
    Unreadable(String),
    /// PEM text without one.
    #[error("it holds no PEM certificate")]
    None,
    /// A certificate that cannot vouch for others.
    #[error("certificate {0} in it cannot be an authority's: {1}")]
    Unusable(usize, String),
}

/// Who may vouch for servers whose address has no fingerprint.
#[derive(Clone, Debug, Default)]
pub enum Authorities {
    /// Those that the operating system trusts, or the environment's `SSL_CERT_FILE` and `SSL_CERT_DIR` name.
    #[default]
    System,
    /// These alone.
    These(Arc<RootCertStore>),
}

impl Authorities {
    /// The authorities whose certificates are in a PEM text; they alone are trusted then.
    ///
    /// # Errors
    /// Fails where it holds none, or one that cannot be used.
    pub fn from_pem(text: &[u8]) -> Result<Self, AuthoritiesError> {
        let mut roots = RootCertStore::empty();
        for (number, certificate) in (1..).zip(CertificateDer::pem_slice_iter(text)) {
            let certificate = certificate.map_err(|why| AuthoritiesError::Unreadable(why.to_string()))?;
            let added = roots.add(certificate);
            added.map_err(|why| AuthoritiesError::Unusable(number, why.to_string()))?;
        }
        if roots.is_empty() { Err(AuthoritiesError::None) } else { Ok(Self::These(Arc::new(roots))) }
    }

    /// Their certificates. The system's are read now, which takes tens of milliseconds of another thread.
    pub(super) async fn roots(&self) -> Result<Arc<RootCertStore>, Close> {
        let lost = |why: String| Close::new(CloseCode::Protocol, why);
        match self {
            Self::These(roots) => Ok(Arc::clone(roots)),
            Self::System => match timeout(SYSTEM_TIMEOUT, spawn_blocking(system_roots)).await {
                Ok(Ok(roots)) => roots.map(Arc::new).map_err(lost),
                Ok(Err(why)) => Err(lost(why.to_string())),
                Err(_) => Err(lost("the system's certificates could not be read in time".into())),
            },
        }
    }
}

fn system_roots() -> Result<RootCertStore, String> {
    let found = rustls_native_certs::load_native_certs();
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(found.certs);
    if roots.is_empty() {
        let why: Vec<String> = found.errors.iter().take(3).map(ToString::to_string).collect();
        let why = if why.is_empty() { "it has none".into() } else { why.join("; ") };
        return Err(format!(
            "the system names no authority that may vouch for servers ({why}): install its certificates \
             (ca-certificates), name one (--ca FILE), or use an address with a fingerprint"
        ));
    }
    Ok(roots)
}

/// What a server's certificate must be.
#[derive(Clone, Debug)]
pub enum Trust {
    /// One with this fingerprint, whatever its names and dates.
    Pin(Pin),
    /// One for the name in the address, valid now, that one of these vouches for.
    Roots(Arc<RootCertStore>),
}

impl From<Pin> for Trust {
    fn from(pin: Pin) -> Self {
        Self::Pin(pin)
    }
}

/// Why the last certificate was refused: transports tell an alert's number or a text for developers at best.
#[derive(Clone, Debug, Default)]
pub(super) struct Refusal(Arc<Mutex<Option<String>>>);

impl Refusal {
    fn note(&self, why: String) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(why);
    }

    /// The reason, if a certificate was refused; not worth another try.
    pub(super) fn reason(&self) -> Option<Close> {
        let why = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        why.map(|reason| Close { code: CloseCode::Protocol, reason })
    }
}

/// Verifies as a [`Trust`] says.
#[derive(Debug)]
pub(super) struct Verifier {
    kind: Kind,
    refusal: Refusal,
    provider: Arc<CryptoProvider>,
}

#[derive(Debug)]
enum Kind {
    Pin(Pin),
    Roots(Arc<WebPkiServerVerifier>),
}

impl Verifier {
    /// # Errors
    /// Fails where there are no roots.
    pub(super) fn new(
        trust: Trust,
        refusal: Refusal,
        provider: Arc<CryptoProvider>,
    ) -> Result<Arc<Self>, Error> {
        let kind = match trust {
            Trust::Pin(pin) => Kind::Pin(pin),
            Trust::Roots(roots) => Kind::Roots(
                WebPkiServerVerifier::builder_with_provider(roots, Arc::clone(&provider))
                    .build()
                    .map_err(|why| Error::General(why.to_string()))?,
            ),
        };
        Ok(Arc::new(Self { kind, refusal, provider }))
    }
}

/// SHA-256, by way of a cipher suite: rustls gives no shorter way to its hash.
fn sha256(bytes: &[u8]) -> [u8; 32] {
    let mut digest = [0; 32];
    // The suite is a constant.
    if let Some(suite) = TLS13_AES_128_GCM_SHA256.tls13() {
        digest.copy_from_slice(suite.common.hash_provider.hash(bytes).as_ref());
    }
    digest
}

impl Pin {
    /// Whether a certificate (DER) has this fingerprint.
    fn fits(&self, certificate: &CertificateDer<'_>) -> bool {
        match self {
            Self::Certificate(digest) => sha256(certificate) == *digest,
            Self::Key(digest) => ParsedCertificate::try_from(certificate)
                .is_ok_and(|parsed| sha256(&parsed.subject_public_key_info()) == *digest),
        }
    }

    const fn mismatch(&self) -> &'static str {
        match self {
            Self::Certificate(_) => {
                "it has another certificate than the address names after #sha256=: copy the address that the server \
                 prints at start"
            }
            Self::Key(_) => {
                "its certificate is for another key than the address names after #spki-sha256=: copy the address that \
                 the server prints at start"
            }
        }
    }
}

/// What is wrong with a certificate, and what to do.
fn in_words(error: &Error) -> String {
    let Error::InvalidCertificate(why) = error else {
        return format!("its certificate cannot be verified: {error}");
    };
    match why {
        CertificateError::UnknownIssuer => {
            "no authority that is trusted here vouches for its certificate: copy the address that the server prints, \
             with what stands behind #, or name its authority's certificate (--ca FILE)"
                .into()
        }
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
            "its certificate has expired: whoever runs the server must renew it; or is the clock of this machine \
             wrong?"
                .into()
        }
        CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
            "its certificate is not valid yet: is the clock of this machine wrong?".into()
        }
        CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. } => {
            let names = match why {
                CertificateError::NotValidForNameContext { presented, .. } if !presented.is_empty() => {
                    format!(" (it is for {})", presented.join(", "))
                }
                _ => String::new(),
            };
            format!("its certificate is for another name than the address has{names}")
        }
        why => format!("its certificate cannot be trusted: {why}"),
    }
}

impl ServerCertVerifier for Verifier {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        server_name: &ServerName<'_>,
        ocsp_response: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        match &self.kind {
            Kind::Pin(pin) if pin.fits(end_entity) => Ok(ServerCertVerified::assertion()),
            Kind::Pin(pin) => {
                self.refusal.note(pin.mismatch().into());
                Err(Error::InvalidCertificate(CertificateError::ApplicationVerificationFailure))
            }
            Kind::Roots(verifier) => verifier
                .verify_server_cert(end_entity, intermediates, server_name, ocsp_response, now)
                .inspect_err(|why| self.refusal.note(in_words(why))),
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls12_signature(message, cert, dss, &self.provider.signature_verification_algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        verify_tls13_signature(message, cert, dss, &self.provider.signature_verification_algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.provider.signature_verification_algorithms.supported_schemes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pin_is_the_sha256_of_the_certificate() {
        // FIPS 180-2, appendix B.1.
        let hex = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015AD";
        let pin: Pin = format!("sha256={hex}").parse().unwrap();
        assert!(pin.fits(&CertificateDer::from(b"abc".to_vec())));
        assert!(!pin.fits(&CertificateDer::from(b"abd".to_vec())));
        // What is no certificate has no key.
        let pin: Pin = format!("spki-sha256={hex}").parse().unwrap();
        assert!(!pin.fits(&CertificateDer::from(b"abc".to_vec())));
    }

    #[test]
    fn what_holds_no_authority_is_said_so() {
        let error = |text: &[u8]| Authorities::from_pem(text).unwrap_err();
        assert_eq!(error(b""), AuthoritiesError::None);
        assert_eq!(error(b"\xff\0garbage"), AuthoritiesError::None);
        let nonsense = b"-----BEGIN CERTIFICATE-----\nYWJj\n-----END CERTIFICATE-----\n";
        assert!(matches!(error(nonsense), AuthoritiesError::Unusable(1, _)), "{:?}", error(nonsense));
        let cut = b"-----BEGIN CERTIFICATE-----\nYWJj\n";
        assert!(matches!(error(cut), AuthoritiesError::Unreadable(_)), "{:?}", error(cut));
    }
}
