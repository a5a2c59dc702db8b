//! A certificate authority, and certificate files for a server.

use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use lodestream_client::net::Authorities;
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, IsCa, KeyPair, KeyUsagePurpose,
    PKCS_ED25519, date_time_ymd,
};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;

pub(crate) const DAY: Duration = Duration::from_secs(24 * 3600);

/// A certificate authority.
pub(crate) struct Authority(CertifiedIssuer<'static, KeyPair>);

/// A new key.
pub(crate) fn new_key() -> KeyPair {
    KeyPair::generate_for(&PKCS_ED25519).unwrap()
}

impl Authority {
    pub(crate) fn new(name: &str) -> Self {
        let mut params = CertificateParams::default();
        params.is_ca = IsCa::Ca(BasicConstraints::Unconstrained);
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
        params.distinguished_name.push(DnType::CommonName, name);
        Self(CertifiedIssuer::self_signed(params, new_key()).unwrap())
    }

    /// Its certificate.
    pub(crate) fn pem(&self) -> String {
        self.0.pem()
    }

    /// The authorities that a viewer trusts with it.
    pub(crate) fn trusted(&self) -> Authorities {
        Authorities::from_pem(self.pem().as_bytes()).unwrap()
    }

    /// Writes a certificate for a name and key that is valid for the four days before `end`.
    pub(crate) fn write(&self, files: &Files, name: &str, key: &KeyPair, end: SystemTime) {
        let mut params = CertificateParams::new(vec![name.to_owned()]).unwrap();
        let time = |time: SystemTime| date_time_ymd(1970, 1, 1) + time.duration_since(UNIX_EPOCH).unwrap();
        (params.not_before, params.not_after) = (time(end - 4 * DAY), time(end));
        let certificate = params.signed_by(key, &self.0).unwrap();
        std::fs::write(&files.chain, certificate.pem()).unwrap();
        std::fs::write(&files.key, key.serialize_pem()).unwrap();
    }
}

/// Paths of a server's certificate and key.
#[derive(Clone)]
pub(crate) struct Files {
    pub(crate) chain: PathBuf,
    pub(crate) key: PathBuf,
}

impl Files {
    pub(crate) fn within(folder: &Path) -> Self {
        Self { chain: folder.join("chain.pem"), key: folder.join("key.pem") }
    }

    /// Fingerprint of the certificate: hexadecimal digits of its SHA-256.
    pub(crate) fn pin(&self) -> String {
        let certificate = CertificateDer::from_pem_file(&self.chain).unwrap();
        let digest = ring::digest::digest(&ring::digest::SHA256, &certificate);
        data_encoding::HEXLOWER.encode(digest.as_ref())
    }
}
