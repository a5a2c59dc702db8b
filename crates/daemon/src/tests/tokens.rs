//! Tokens: verification, and when sessions require, refresh and lose them.

use std::time::SystemTime;

use lodestream_protocol::message::{CloseCode, Token};
use tokio::time::Instant;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;

use super::*;
use crate::auth::access::Access;
use crate::auth::grant::TokenError;
use crate::auth::tokens::Tokens;
use crate::session::admission_settings::AdmissionSettings;

const SECRET: &[u8] = b"a secret of more than thirty-two bytes";

fn base64(bytes: &[u8]) -> String {
    data_encoding::BASE64URL_NOPAD.encode(bytes)
}

/// Signs a token, as another program would.
fn signed(secret: &[u8], header: &str, claims: &str) -> String {
    let message = format!("{}.{}", base64(header.as_bytes()), base64(claims.as_bytes()));
    let key = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, secret);
    format!("{message}.{}", base64(ring::hmac::sign(&key, message.as_bytes()).as_ref()))
}

/// Seconds since 1970, this many seconds from now.
pub(super) fn in_s(seconds: i64) -> i64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    i64::try_from(now.as_secs()).unwrap() + seconds
}

/// A token for the scene that expires in this many seconds.
fn good_for(seconds: i64) -> String {
    signed(SECRET, r#"{"alg":"HS256"}"#, &format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(seconds)))
}

/// A token with these claims, signed by the accepted key.
pub(super) fn signed_claims(claims: &str) -> String {
    signed(SECRET, r#"{"alg":"HS256"}"#, claims)
}

fn file(text: &[u8]) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), text).unwrap();
    file
}

fn keys(text: &[u8], audience: Option<&str>) -> Tokens {
    Tokens::from_file(file(text).path(), audience.map(str::to_owned)).unwrap()
}

fn verified_subject(tokens: &Tokens, token: &str) -> Result<Option<String>, TokenError> {
    tokens
        .verify(token, SystemTime::now())
        .and_then(|grant| grant.for_scene("memory"))
        .map(|grant| grant.subject)
}

fn requiring_tokens() -> Arc<ServerState> {
    let settings = SessionSettings { max_sessions: 2, ..SessionSettings::default() };
    requiring_tokens_with(MemoryScene::new(1, 100, 1000), settings)
}

/// Access by the key of [`signed_claims`].
pub(super) fn with_keys() -> Option<Arc<Access>> {
    Some(Arc::new(Access::Tokens(keys(SECRET, None))))
}

/// A server that requires tokens.
pub(super) fn requiring_tokens_with(scene: MemoryScene, settings: SessionSettings) -> Arc<ServerState> {
    let admission = AdmissionSettings { access: with_keys(), ..AdmissionSettings::default() };
    ServerState::with_admission(Arc::new(scene), settings, admission)
}

pub(super) async fn with_header(
    state: &Arc<ServerState>,
    token: &str,
) -> Result<Client<DuplexStream>, String> {
    let (near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, Arc::clone(state), peer()));
    let mut request = "ws://server/stream".into_client_request().unwrap();
    let value = HeaderValue::from_str(&format!("Bearer {token}")).unwrap();
    request.headers_mut().insert("Authorization", value);
    let opened = tokio_tungstenite::client_async(request, near).await;
    opened.map(|(socket, _)| Client(socket)).map_err(|why| why.to_string())
}

pub(super) fn token(text: String) -> ClientMessage {
    ClientMessage::Token(Token(text))
}

impl Client<DuplexStream> {
    pub(super) async fn is_welcome(&mut self) {
        let first = self.next().await;
        assert!(matches!(first, Some(ServerFrame::Message(ServerMessage::Welcome(_)))), "{first:?}");
    }

    /// Expects a WebSocket close frame as the first message.
    pub(super) async fn refused_at_once(&mut self) -> (u16, String) {
        match self.0.next().await {
            Some(Ok(Message::Close(Some(frame)))) => (frame.code.into(), frame.reason.to_string()),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn signatures_by_openssl_are_verified() {
    for (public, signed) in [
        (&include_bytes!("signed/ed.pem")[..], include_str!("signed/ed.jwt")),
        (include_bytes!("signed/ec.pem"), include_str!("signed/ec.jwt")),
        (include_bytes!("signed/rsa.pem"), include_str!("signed/rsa.jwt")),
    ] {
        let (tokens, signed) = (keys(public, None), signed.trim());
        assert_eq!(verified_subject(&tokens, signed), Ok(Some("somebody".into())));
        let (message, signature) = signed.rsplit_once('.').unwrap();
        let (head, claims) = message.split_once('.').unwrap();
        let other = base64(br#"{"exp":4102444800,"scene":"*"}"#);
        assert_eq!(
            verified_subject(&tokens, &format!("{head}.{other}.{signature}")),
            Err(TokenError::Signature)
        );
        assert_eq!(verified_subject(&tokens, &format!("{head}.{claims}.")), Err(TokenError::Signature));
        // Algorithm confusion: a public key must not verify an HMAC.
        let confused =
            super::tokens::signed(public, r#"{"alg":"HS256"}"#, r#"{"exp":4102444800,"scene":"*"}"#);
        assert_eq!(verified_subject(&tokens, &confused), Err(TokenError::Signature));
    }
}

#[test]
fn each_kind_of_invalid_token_has_its_error() {
    let tokens = keys(SECRET, None);
    let head = r#"{"alg":"HS256"}"#;
    let claims = |claims: String| verified_subject(&tokens, &signed(SECRET, head, &claims));
    let soon = in_s(60);
    assert_eq!(claims(format!(r#"{{"exp":{soon},"scene":["other","memory"]}}"#)), Ok(None));
    assert_eq!(claims(format!(r#"{{"exp":{soon}.5,"scene":"*"}}"#)), Ok(None));
    assert_eq!(claims(format!(r#"{{"exp":{soon},"scene":"other"}}"#)), Err(TokenError::Scene));
    assert_eq!(claims(format!(r#"{{"exp":{soon}}}"#)), Err(TokenError::Scene));
    assert_eq!(claims(r#"{"scene":"memory"}"#.into()), Err(TokenError::NoExpiry));
    assert_eq!(claims(format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(-40))), Err(TokenError::Expired));
    // Within the leeway.
    assert_eq!(claims(format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(-15))), Ok(None));
    let later = in_s(40);
    let early = claims(format!(r#"{{"exp":{later},"nbf":{later},"scene":"memory"}}"#));
    assert_eq!(early, Err(TokenError::NotYetValid));
    let aimed = format!(r#"{{"exp":{soon},"scene":"memory","aud":"us"}}"#);
    assert_eq!(claims(aimed.clone()), Err(TokenError::Audience));
    let audience = |name| verified_subject(&keys(SECRET, Some(name)), &signed(SECRET, head, &aimed));
    assert_eq!((audience("us"), audience("them")), (Ok(None), Err(TokenError::Audience)));
    // Unsigned and malformed tokens.
    let none = format!("{}.{}.", base64(br#"{"alg":"none"}"#), base64(aimed.as_bytes()));
    for nonsense in [&none[..], "", "a.b", "a.b.c", "....", &"x".repeat(9000)] {
        assert_eq!(verified_subject(&tokens, nonsense), Err(TokenError::Malformed), "{nonsense}");
    }
    for wrong in [
        r#"{"exp":"soon","scene":"*"}"#,
        r#"{"exp":1e400,"scene":"*"}"#,
        "[]",
        r#"{"exp":-1e30,"scene":"*"}"#,
    ] {
        assert!(claims(wrong.into()).is_err(), "{wrong}");
    }
    assert_eq!(verified_subject(&tokens, &signed(b"another", head, &aimed)), Err(TokenError::Signature));
}

#[test]
fn weight_and_rate_are_whole_numbers_within_bounds() {
    let tokens = keys(SECRET, None);
    let granted = |more: &str| {
        let token = signed_claims(&format!(r#"{{"exp":{},"scene":"memory"{more}}}"#, in_s(60)));
        let grant = tokens.verify(&token, SystemTime::now())?.for_scene("memory")?;
        Ok((grant.weight.get(), grant.rate_bits_per_s))
    };
    assert_eq!(granted(""), Ok((1, None)));
    assert_eq!(granted(r#","weight":null,"rate":null"#), Ok((1, None)));
    assert_eq!(granted(r#","weight":100,"rate":1000"#), Ok((100, Some(1000))));
    for weight in ["0", "101", "-1", "1.5", "1e400", "\"5\"", "[5]", "true", "18446744073709551616"] {
        let got = granted(&format!(r#","weight":{weight}"#));
        assert!(got == Err(TokenError::Weight) || (weight == "1e400" && got.is_err()), "{weight}: {got:?}");
    }
    for rate in ["0", "999", "-1", "2e6", "\"2Mbit\"", "{}"] {
        assert_eq!(granted(&format!(r#","rate":{rate}"#)), Err(TokenError::Rate), "{rate}");
    }
    let (weight, rate) = (TokenError::Weight.to_string(), TokenError::Rate.to_string());
    assert!(weight.contains("1 to 100") && rate.contains("bits per second"), "{weight}; {rate}");
}

#[tokio::test(start_paused = true)]
async fn a_clock_jump_affects_new_tokens_and_ends_no_session() {
    let (tokens, now) = (keys(SECRET, None), SystemTime::now());
    let days = |n: u64| Duration::from_secs(n * 24 * 3600);
    let (from, to) = (in_s(-60), in_s(60));
    let head = r#"{"alg":"HS256"}"#;
    let open = signed(SECRET, head, &format!(r#"{{"exp":{to},"scene":"*"}}"#));
    let framed = signed(SECRET, head, &format!(r#"{{"nbf":{from},"exp":{to},"scene":"*"}}"#));
    let left = |token: &str, at| {
        tokens.verify(token, at).map(|grant| grant.expires_at.duration_since(Instant::now()))
    };
    for later in [days(3), days(3000), days(1_000_000)] {
        assert_eq!(left(&open, now + later), Err(TokenError::Expired));
        assert_eq!(left(&framed, now + later), Err(TokenError::Expired));
    }
    let before_1970 = SystemTime::UNIX_EPOCH - days(1);
    for at in [now - days(3), now - days(3000), SystemTime::UNIX_EPOCH, before_1970] {
        // A token without nbf is valid for longer then, but not forever.
        assert!((days(3)..=days(400)).contains(&left(&open, at).unwrap()), "{at:?}");
        assert_eq!(left(&framed, at), Err(TokenError::NotYetValid), "{at:?}");
    }
    // A grant's expiry is on a monotonic clock.
    let granted = tokens.verify(&framed, now).unwrap().expires_at;
    tokio::time::advance(Duration::from_secs(80)).await;
    assert!(granted > Instant::now());
    tokio::time::advance(Duration::from_secs(20)).await;
    assert!(granted < Instant::now());
}

#[test]
fn a_key_set_is_searched_by_key_id() {
    let (one, two) =
        (b"one secret of more than thirty-two bytes", b"two secrets of more than thirty-two bytes");
    let key = |id: &str, secret: &[u8]| format!(r#"{{"kty":"oct","kid":"{id}","k":"{}"}}"#, base64(secret));
    let set = keys(format!(r#"{{"keys":[{},{}]}}"#, key("1", one), key("2", two)).as_bytes(), None);
    let claims = format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(60));
    let head = |id: &str| format!(r#"{{"alg":"HS256","kid":"{id}"}}"#);
    assert_eq!(verified_subject(&set, &signed(two, &head("2"), &claims)), Ok(None));
    assert_eq!(verified_subject(&set, &signed(two, r#"{"alg":"HS256"}"#, &claims)), Ok(None));
    assert_eq!(verified_subject(&set, &signed(two, &head("1"), &claims)), Err(TokenError::Signature));
    assert_eq!(verified_subject(&set, &signed(two, &head("3"), &claims)), Err(TokenError::Signature));
    // Invalid keys do not replace the old ones; valid keys do.
    assert!(set.set_keys(b"short").is_err());
    assert_eq!(verified_subject(&set, &signed(two, &head("2"), &claims)), Ok(None));
    set.set_keys(one).unwrap();
    assert_eq!(verified_subject(&set, &signed(two, &head("2"), &claims)), Err(TokenError::Signature));
    assert_eq!(verified_subject(&set, &signed(one, &head("2"), &claims)), Ok(None));
}

#[tokio::test(start_paused = true)]
async fn nothing_is_sent_without_a_valid_token() {
    let state = requiring_tokens();
    let unauthorised = 4000 + CloseCode::Unauthorised.number();
    for (message, reason) in [
        (hello(), "none was given"),
        (token("nonsense".into()), "not a JSON Web Token"),
        (token(good_for(-100)), "has expired"),
    ] {
        let mut client = Client::in_memory(&state).await;
        client.send(&message).await;
        let (code, why) = client.refused_at_once().await;
        assert!(code == unauthorised && why.contains(reason), "{code}: {why}");
    }
    let started = Instant::now();
    let (code, _) = Client::in_memory(&state).await.refused_at_once().await;
    assert_eq!((code, started.elapsed().as_secs()), (4000 + CloseCode::Timeout.number(), 10));
    let refused = with_header(&state, "nonsense").await.err().unwrap();
    assert!(refused.contains("401"), "{refused}");
    state.all_sessions_ended().await;
    let metrics = state.render_metrics();
    assert!(metrics.contains("lodestream_tokens_refused_total 4"), "{metrics}");
    assert!(metrics.contains("lodestream_sessions_refused_total{reason=\"token\"} 4"), "{metrics}");
    assert_eq!(state.metrics().bytes_sent(), 0);
}

#[tokio::test(start_paused = true)]
async fn clients_without_a_token_do_not_block_those_with_one() {
    let state = requiring_tokens();
    // More than there are leases.
    let mut without_token = Vec::new();
    for _ in 0..8 {
        without_token.push(Client::in_memory(&state).await);
    }
    let mut first = with_header(&state, &good_for(60)).await.unwrap();
    first.is_welcome().await;
    let mut second = Client::in_memory(&state).await;
    second.send(&token(good_for(60))).await;
    second.is_welcome().await;
    second.send(&hello()).await;
    assert_eq!(second.read_blobs(1).await.len(), 1);
}

/// A viewer may send its token to a server that requires none.
#[tokio::test(start_paused = true)]
async fn a_server_that_requires_no_token_ignores_tokens() {
    let state = state_of(MemoryScene::new(1, 100, 1000), None);
    let mut client = with_header(&state, "nonsense").await.unwrap();
    client.send(&token("nonsense".into())).await;
    client.send(&hello()).await;
    assert_eq!(client.read_blobs(1).await.len(), 1);
}

#[tokio::test(start_paused = true)]
async fn a_session_ends_with_its_token_unless_another_is_sent() {
    let state = requiring_tokens();
    // Each expiry has 30 s of leeway.
    let mut client = with_header(&state, &good_for(10)).await.unwrap();
    client.send(&hello()).await;
    let (started, mut pings) = (Instant::now(), 0);
    let close = loop {
        tokio::select! {
            frame = client.next() => {
                if let ServerFrame::Message(ServerMessage::Close(close)) = frame.expect("no Close") {
                    break close;
                }
            }
            () = tokio::time::sleep(Duration::from_secs(5)) => {
                pings += 1;
                client.send(&ClientMessage::Ping(pings)).await;
                if pings == 4 {
                    client.send(&token(good_for(60))).await;
                }
            }
        }
    };
    assert_eq!((close.code, &close.reason[..]), (CloseCode::Unauthorised, "the token has expired"));
    // The second was sent after 20 s and is valid for 90 s.
    let lasted = started.elapsed().as_secs();
    assert!((105..=112).contains(&lasted), "{lasted} s");
    assert!(!close.code.worth_retrying());

    let mut client = with_header(&state, &good_for(60)).await.unwrap();
    client.send(&hello()).await;
    client.send(&token(signed(b"another", r#"{"alg":"HS256"}"#, r#"{"exp":1,"scene":"*"}"#))).await;
    let close = client.read_until_close().await;
    assert!(close.code == CloseCode::Unauthorised && close.reason.contains("no key"), "{close}");
}

#[tokio::test(start_paused = true)]
async fn a_flood_of_tokens_is_closed() {
    let state = requiring_tokens();
    let good = good_for(600);
    let mut client = with_header(&state, &good).await.unwrap();
    client.send(&hello()).await;
    for _ in 0..60 {
        client.send(&token(good.clone())).await;
    }
    let close = client.read_until_close().await;
    assert!(close.code == CloseCode::Limit && close.reason.contains("tokens"), "{close}");
}
