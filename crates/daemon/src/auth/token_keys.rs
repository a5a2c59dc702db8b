//! Keys that verify tokens, from a file: a secret, a public key, or a JSON Web Key Set.

use jsonwebtoken::errors::Result as JwtResult;
use jsonwebtoken::jwk::{AlgorithmParameters, EllipticCurve, Jwk, JwkSet, KeyAlgorithm, PublicKeyUse};
use jsonwebtoken::{Algorithm, DecodingKey};

/// Shortest secret in bytes: the length of the hash (RFC 7518, section 3.2).
const MIN_SECRET_BYTES: usize = 32;
/// Most keys in a set.
const MAX_KEYS: usize = 64;

/// A key for one algorithm; tokens with another algorithm are not verified with it.
#[derive(Clone, Debug)]
pub(crate) struct Key {
    pub(crate) id: Option<String>,
    pub(crate) algorithm: Algorithm,
    pub(crate) key: DecodingKey,
}

/// Why a file holds no usable key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum KeysError {
    #[error("it is a private key: the server needs only the public key")]
    Private,
    #[error("not a PEM public key of a supported kind (Ed25519, P-256 or RSA)")]
    Pem,
    #[error("not a JSON Web Key Set: {0}")]
    Set(String),
    #[error("no key of the set is supported: use signature keys of Ed25519, P-256 or RSA, or secrets")]
    EmptySet,
    #[error("the set has more than {MAX_KEYS} keys")]
    TooMany,
    #[error(
        "a secret of {0} bytes is too short: use at least {MIN_SECRET_BYTES}, for example from `openssl rand -base64 48`"
    )]
    ShortSecret(usize),
}

/// Parses a file of keys: JSON is a key set (RFC 7517), PEM a public key (RFC 7468), anything else a secret for HS256,
/// without its trailing line end.
pub(crate) fn read_keys(text: &[u8]) -> Result<Vec<Key>, KeysError> {
    let trimmed = text.trim_ascii();
    if trimmed.starts_with(b"{") {
        return read_set(trimmed);
    }
    if trimmed.starts_with(b"-----BEGIN ") {
        return read_pem(trimmed).map(|key| vec![key]);
    }
    let secret = text.strip_suffix(b"\n").unwrap_or(text);
    let secret = secret.strip_suffix(b"\r").unwrap_or(secret);
    let key = Key { id: None, algorithm: Algorithm::HS256, key: secret_key(secret)? };
    Ok(vec![key])
}

fn secret_key(secret: &[u8]) -> Result<DecodingKey, KeysError> {
    if secret.len() < MIN_SECRET_BYTES {
        return Err(KeysError::ShortSecret(secret.len()));
    }
    Ok(DecodingKey::from_secret(secret))
}

fn read_pem(text: &[u8]) -> Result<Key, KeysError> {
    let private = b"PRIVATE KEY-----";
    if text.windows(private.len()).any(|window| window == private) {
        return Err(KeysError::Private);
    }
    type Reader = fn(&[u8]) -> JwtResult<DecodingKey>;
    let kinds: [(Algorithm, Reader); 3] = [
        (Algorithm::EdDSA, DecodingKey::from_ed_pem),
        (Algorithm::ES256, DecodingKey::from_ec_pem),
        (Algorithm::RS256, DecodingKey::from_rsa_pem),
    ];
    let mut found = kinds.into_iter().filter_map(|(algorithm, read)| Some((algorithm, read(text).ok()?)));
    found
        .find(|(algorithm, key)| *algorithm != Algorithm::ES256 || is_p256(key))
        .map(|(algorithm, key)| Key { id: None, algorithm, key })
        .ok_or(KeysError::Pem)
}

/// Whether a key is an uncompressed P-256 point (SEC 1, section 2.3.3).
fn is_p256(key: &DecodingKey) -> bool {
    key.try_get_as_bytes().is_ok_and(|point| point.len() == 65)
}

fn read_set(text: &[u8]) -> Result<Vec<Key>, KeysError> {
    let set: JwkSet = serde_json::from_slice(text).map_err(|why| KeysError::Set(why.to_string()))?;
    if set.keys.len() > MAX_KEYS {
        return Err(KeysError::TooMany);
    }
    let mut keys = Vec::with_capacity(set.keys.len());
    for jwk in &set.keys {
        // Key sets may hold keys of other kinds for other programs.
        let Some(algorithm) = algorithm_of(jwk) else { continue };
        let Ok(key) = DecodingKey::from_jwk(jwk) else { continue };
        if algorithm == Algorithm::HS256 {
            key.try_get_as_bytes().map_or(Err(KeysError::EmptySet), secret_key)?;
        }
        keys.push(Key { id: jwk.common.key_id.clone(), algorithm, key });
    }
    if keys.is_empty() { Err(KeysError::EmptySet) } else { Ok(keys) }
}

/// Algorithm of a key in a set; `None` if it is not supported.
fn algorithm_of(jwk: &Jwk) -> Option<Algorithm> {
    if matches!(jwk.common.public_key_use, Some(PublicKeyUse::Encryption)) {
        return None;
    }
    let of_kind = match &jwk.algorithm {
        AlgorithmParameters::RSA(_) => Algorithm::RS256,
        AlgorithmParameters::EllipticCurve(key) if key.curve == EllipticCurve::P256 => Algorithm::ES256,
        AlgorithmParameters::OctetKeyPair(key) if key.curve == EllipticCurve::Ed25519 => Algorithm::EdDSA,
        AlgorithmParameters::OctetKey(_) => Algorithm::HS256,
        _ => return None,
    };
    let stated = match jwk.common.key_algorithm {
        None => of_kind,
        Some(KeyAlgorithm::RS256) => Algorithm::RS256,
        Some(KeyAlgorithm::ES256) => Algorithm::ES256,
        Some(KeyAlgorithm::EdDSA) => Algorithm::EdDSA,
        Some(KeyAlgorithm::HS256) => Algorithm::HS256,
        Some(_) => return None,
    };
    (stated == of_kind).then_some(of_kind)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(text: &str) -> KeysError {
        read_keys(text.as_bytes()).unwrap_err()
    }

    #[test]
    fn unusable_keys_are_refused() {
        assert_eq!(error("secret\n"), KeysError::ShortSecret(6));
        assert_eq!(error(""), KeysError::ShortSecret(0));
        assert!(matches!(error("{"), KeysError::Set(_)));
        assert_eq!(error("{\"keys\":[]}"), KeysError::EmptySet);
        assert_eq!(error("-----BEGIN PUBLIC KEY-----\nYWJj\n-----END PUBLIC KEY-----"), KeysError::Pem);
        assert_eq!(error("-----BEGIN PRIVATE KEY-----\nYWJj\n-----END PRIVATE KEY-----"), KeysError::Private);
        let short = "{\"keys\":[{\"kty\":\"oct\",\"k\":\"c2VjcmV0\"}]}";
        assert_eq!(error(short), KeysError::ShortSecret(6));
        let other = "{\"keys\":[{\"kty\":\"OKP\",\"crv\":\"Ed25519\",\"x\":\"YWJj\",\"use\":\"enc\"}]}";
        assert_eq!(error(other), KeysError::EmptySet);
        let many = format!("{{\"keys\":[{}]}}", vec!["{\"kty\":\"oct\",\"k\":\"c2VjcmV0\"}"; 65].join(","));
        assert_eq!(error(&many), KeysError::TooMany);
    }

    #[test]
    fn a_key_has_one_algorithm() {
        let secret = read_keys(&[b'x'; 32]).unwrap();
        assert_eq!((secret.len(), secret[0].algorithm), (1, Algorithm::HS256));
        let set = "{\"keys\":[{\"kty\":\"OKP\",\"crv\":\"Ed25519\",\"x\":\"YWJj\",\"kid\":\"a\"},
            {\"kty\":\"OKP\",\"crv\":\"Ed25519\",\"x\":\"YWJj\",\"alg\":\"HS256\"},
            {\"kty\":\"RSA\",\"n\":\"YWJj\",\"e\":\"AQAB\"}, {\"kty\":\"RSA\",\"n\":\"YWJj\",\"e\":\"AQAB\",\"alg\":\"PS256\"}]}";
        let set = read_keys(set.as_bytes()).unwrap();
        let found: Vec<_> = set.iter().map(|key| (key.id.as_deref(), key.algorithm)).collect();
        assert_eq!(found, [(Some("a"), Algorithm::EdDSA), (None, Algorithm::RS256)]);
    }
}
