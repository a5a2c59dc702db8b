//! Verification of server certificates: by the fingerprint in the address, or by the certificate authorities (WebPKI).

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

/// Time limit for reading the system's certificates.
const SYSTEM_TIMEOUT: Duration = Duration::from_secs(4);

/// Why a PEM text cannot be used as a list of certificate authorities.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AuthoritiesError {
    /// The text is not valid PEM.
    #[error("it holds no readable PEM certificate: {0}")]
    Unreadable(String),
    /// The text holds no certificate.
    #[error("it holds no PEM certificate")]
    None,
    /// A certificate, by its number from 1 on, that cannot be a trust anchor.
    #[error("certificate {0} in it cannot be used as an authority: {1}")]
    Unusable(usize, String),
}

/// Certificate authorities that are trusted for servers whose address has no fingerprint.
#[derive(Clone, Debug, Default)]
pub enum Authorities {
    /// The operating system's, or those in the environment's `SSL_CERT_FILE` and `SSL_CERT_DIR`.
    #[default]
    System,
    /// Only these.
    Only(Arc<RootCertStore>),
}

impl Authorities {
    /// Trusts only the authorities whose certificates are in a PEM text.
    ///
    /// # Errors
    /// The text holds no certificate, or one that cannot be a trust anchor.
    pub fn from_pem(text: &[u8]) -> Result<Self, AuthoritiesError> {
        let mut roots = RootCertStore::empty();
        for (number, certificate) in (1..).zip(CertificateDer::pem_slice_iter(text)) {
            let certificate = certificate.map_err(|why| AuthoritiesError::Unreadable(why.to_string()))?;
            let added = roots.add(certificate);
            added.map_err(|why| AuthoritiesError::Unusable(number, why.to_string()))?;
        }
        if roots.is_empty() { Err(AuthoritiesError::None) } else { Ok(Self::Only(Arc::new(roots))) }
    }

    /// The root certificates. The system's are read on a blocking thread, which takes tens of milliseconds.
    pub(super) async fn roots(&self) -> Result<Arc<RootCertStore>, Close> {
        let close = |why: String| Close::new(CloseCode::Protocol, why);
        match self {
            Self::Only(roots) => Ok(Arc::clone(roots)),
            Self::System => match timeout(SYSTEM_TIMEOUT, spawn_blocking(system_roots)).await {
                Ok(Ok(roots)) => roots.map(Arc::new).map_err(|why| close(why.to_string())),
                Ok(Err(why)) => Err(close(why.to_string())),
                Err(_) => Err(close("the system's certificates could not be read in time".into())),
            },
        }
    }
}

/// The system has no usable certificate authority; holds the reasons.
#[derive(Debug, thiserror::Error)]
#[error(
    "the system trusts no certificate authority ({0}): install its certificates (package ca-certificates), give the \
     authority's certificate, or use an address with a fingerprint"
)]
struct NoSystemRoots(String);

fn system_roots() -> Result<RootCertStore, NoSystemRoots> {
    let loaded = rustls_native_certs::load_native_certs();
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(loaded.certs);
    if roots.is_empty() {
        let why: Vec<String> = loaded.errors.iter().take(3).map(ToString::to_string).collect();
        return Err(NoSystemRoots(if why.is_empty() { "none is installed".into() } else { why.join("; ") }));
    }
    Ok(roots)
}

/// How a server's certificate is verified.
#[derive(Clone, Debug)]
pub enum Trust {
    /// It must have this fingerprint; its names and dates are not checked.
    Pin(Pin),
    /// It must be valid now, for the name in the address, and signed by one of these authorities.
    Roots(Arc<RootCertStore>),
}

impl From<Pin> for Trust {
    fn from(pin: Pin) -> Self {
        Self::Pin(pin)
    }
}

/// Why the last certificate was rejected. Kept here because transports report only an alert number or a text for
/// developers.
#[derive(Clone, Debug, Default)]
pub(super) struct CertificateRejection(Arc<Mutex<Option<String>>>);

impl CertificateRejection {
    fn note(&self, why: String) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(why);
    }

    /// The reason, if a certificate was rejected. Connecting again cannot help.
    pub(super) fn reason(&self) -> Option<Close> {
        let why = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        why.map(|reason| Close { code: CloseCode::Protocol, reason })
    }
}

/// Verifies certificates according to a [`Trust`].
#[derive(Debug)]
pub(super) struct Verifier {
    kind: Kind,
    rejection: CertificateRejection,
    provider: Arc<CryptoProvider>,
}

#[derive(Debug)]
enum Kind {
    Pin(Pin),
    Roots(Arc<WebPkiServerVerifier>),
}

impl Verifier {
    /// # Errors
    /// The list of roots is empty.
    pub(super) fn new(
        trust: Trust,
        rejection: CertificateRejection,
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
        Ok(Arc::new(Self { kind, rejection, provider }))
    }
}

/// SHA-256, through a cipher suite: rustls exposes its hash in no other way.
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
    fn matches(&self, certificate: &CertificateDer<'_>) -> bool {
        match self {
            Self::Certificate(digest) => sha256(certificate) == *digest,
            Self::Key(digest) => ParsedCertificate::try_from(certificate)
                .is_ok_and(|parsed| sha256(&parsed.subject_public_key_info()) == *digest),
        }
    }

    const fn mismatch(&self) -> &'static str {
        match self {
            Self::Certificate(_) => {
                "it has another certificate than the one in the address (#sha256=): copy the address that the server \
                 prints at start"
            }
            Self::Key(_) => {
                "its certificate is for another key than the one in the address (#spki-sha256=): copy the address that \
                 the server prints at start"
            }
        }
    }
}

/// Describes what is wrong with a certificate, and what to do.
fn describe(error: &Error) -> String {
    let Error::InvalidCertificate(why) = error else {
        return format!("its certificate cannot be verified: {error}");
    };
    match why {
        CertificateError::UnknownIssuer => {
            "no trusted authority has signed its certificate: use an address with the certificate's fingerprint after #, \
             which Lodestream's server prints, or trust its authority's certificate (viewer: --ca FILE)"
                .into()
        }
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
            "its certificate has expired: the server's operator must renew it, unless this machine's clock is \
             wrong"
                .into()
        }
        CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
            "its certificate is not valid yet: check this machine's clock".into()
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
            Kind::Pin(pin) if pin.matches(end_entity) => Ok(ServerCertVerified::assertion()),
            Kind::Pin(pin) => {
                self.rejection.note(pin.mismatch().into());
                Err(Error::InvalidCertificate(CertificateError::ApplicationVerificationFailure))
            }
            Kind::Roots(verifier) => verifier
                .verify_server_cert(end_entity, intermediates, server_name, ocsp_response, now)
                .inspect_err(|why| self.rejection.note(describe(why))),
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
        assert!(pin.matches(&CertificateDer::from(b"abc".to_vec())));
        assert!(!pin.matches(&CertificateDer::from(b"abd".to_vec())));
        // Bytes that are not a certificate have no key.
        let pin: Pin = format!("spki-sha256={hex}").parse().unwrap();
        assert!(!pin.matches(&CertificateDer::from(b"abc".to_vec())));
    }

    #[test]
    fn pem_without_usable_authorities_is_refused() {
        let error = |text: &[u8]| Authorities::from_pem(text).unwrap_err();
        assert_eq!(error(b""), AuthoritiesError::None);
        assert_eq!(error(b"\xff\0garbage"), AuthoritiesError::None);
        let nonsense = b"-----BEGIN CERTIFICATE-----\nYWJj\n-----END CERTIFICATE-----\n";
        assert!(matches!(error(nonsense), AuthoritiesError::Unusable(1, _)), "{:?}", error(nonsense));
        let cut = b"-----BEGIN CERTIFICATE-----\nYWJj\n";
        assert!(matches!(error(cut), AuthoritiesError::Unreadable(_)), "{:?}", error(cut));
    }
}
