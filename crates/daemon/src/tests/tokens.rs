//! Who shows which token when, and what comes of it.

use std::time::SystemTime;

use lodestream_protocol::message::{CloseCode, Token};
use tokio::time::Instant;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::http::HeaderValue;

use super::*;
use crate::admission::settings::AdmissionSettings;
use crate::auth::access::Access;
use crate::auth::grant::TokenError;
use crate::auth::tokens::Tokens;

const SECRET: &[u8] = b"a secret of more than thirty-two bytes";

fn base64(bytes: &[u8]) -> String {
    data_encoding::BASE64URL_NOPAD.encode(bytes)
}

/// A token as another program makes it.
fn signed(secret: &[u8], header: &str, claims: &str) -> String {
    let message = format!("{}.{}", base64(header.as_bytes()), base64(claims.as_bytes()));
    let key = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, secret);
    format!("{message}.{}", base64(ring::hmac::sign(&key, message.as_bytes()).as_ref()))
}

/// Seconds since 1970, in so many.
pub(super) fn in_s(seconds: i64) -> i64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap();
    i64::try_from(now.as_secs()).unwrap() + seconds
}

/// A token for the scene that ends in so many seconds.
fn good_for(seconds: i64) -> String {
    signed(SECRET, r#"{"alg":"HS256"}"#, &format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(seconds)))
}

/// A token with these claims, by a key that is taken.
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

fn told(tokens: &Tokens, token: &str) -> Result<Option<String>, TokenError> {
    tokens
        .verify(token, SystemTime::now())
        .and_then(|grant| grant.for_scene("memory"))
        .map(|grant| grant.subject)
}

fn asking() -> Arc<ServerState> {
    let settings = SessionSettings { max_sessions: 2, ..SessionSettings::default() };
    asking_with(MemoryScene::new(1, 100, 1000), settings)
}

/// What takes tokens of [`signed_claims`].
pub(super) fn with_keys() -> Option<Arc<Access>> {
    Some(Arc::new(Access::Tokens(keys(SECRET, None))))
}

/// A server that asks for tokens.
pub(super) fn asking_with(scene: MemoryScene, settings: SessionSettings) -> Arc<ServerState> {
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

    /// The WebSocket's own close, before which nothing came.
    pub(super) async fn turned_away(&mut self) -> (u16, String) {
        match self.0.next().await {
            Some(Ok(Message::Close(Some(frame)))) => (frame.code.into(), frame.reason.to_string()),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn what_openssl_signs_is_taken_and_nothing_that_is_changed() {
    for (public, signed) in [
        (&include_bytes!("signed/ed.pem")[..], include_str!("signed/ed.jwt")),
        (include_bytes!("signed/ec.pem"), include_str!("signed/ec.jwt")),
        (include_bytes!("signed/rsa.pem"), include_str!("signed/rsa.jwt")),
    ] {
        let (tokens, signed) = (keys(public, None), signed.trim());
        assert_eq!(told(&tokens, signed), Ok(Some("somebody".into())));
        let (message, signature) = signed.rsplit_once('.').unwrap();
        let (head, claims) = message.split_once('.').unwrap();
        let other = base64(br#"{"exp":4102444800,"scene":"*"}"#);
        assert_eq!(told(&tokens, &format!("{head}.{other}.{signature}")), Err(TokenError::Signature));
        assert_eq!(told(&tokens, &format!("{head}.{claims}.")), Err(TokenError::Signature));
        // A public key is no secret: what is signed by it as one is signed by nobody.
        let confused =
            super::tokens::signed(public, r#"{"alg":"HS256"}"#, r#"{"exp":4102444800,"scene":"*"}"#);
        assert_eq!(told(&tokens, &confused), Err(TokenError::Signature));
    }
}

#[test]
fn each_way_in_which_a_token_is_bad_has_its_words() {
    let tokens = keys(SECRET, None);
    let head = r#"{"alg":"HS256"}"#;
    let claims = |claims: String| told(&tokens, &signed(SECRET, head, &claims));
    let soon = in_s(60);
    assert_eq!(claims(format!(r#"{{"exp":{soon},"scene":["other","memory"]}}"#)), Ok(None));
    assert_eq!(claims(format!(r#"{{"exp":{soon}.5,"scene":"*"}}"#)), Ok(None));
    assert_eq!(claims(format!(r#"{{"exp":{soon},"scene":"other"}}"#)), Err(TokenError::Scene));
    assert_eq!(claims(format!(r#"{{"exp":{soon}}}"#)), Err(TokenError::Scene));
    assert_eq!(claims(r#"{"scene":"memory"}"#.into()), Err(TokenError::NoExpiry));
    assert_eq!(claims(format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(-40))), Err(TokenError::Expired));
    // Clocks differ a little.
    assert_eq!(claims(format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(-15))), Ok(None));
    let later = in_s(40);
    let early = claims(format!(r#"{{"exp":{later},"nbf":{later},"scene":"memory"}}"#));
    assert_eq!(early, Err(TokenError::NotYetValid));
    let aimed = format!(r#"{{"exp":{soon},"scene":"memory","aud":"us"}}"#);
    assert_eq!(claims(aimed.clone()), Err(TokenError::Audience));
    let audience = |name| told(&keys(SECRET, Some(name)), &signed(SECRET, head, &aimed));
    assert_eq!((audience("us"), audience("them")), (Ok(None), Err(TokenError::Audience)));
    // Some that take short cuts.
    let none = format!("{}.{}.", base64(br#"{"alg":"none"}"#), base64(aimed.as_bytes()));
    for nonsense in [&none[..], "", "a.b", "a.b.c", "....", &"x".repeat(9000)] {
        assert_eq!(told(&tokens, nonsense), Err(TokenError::Malformed), "{nonsense}");
    }
    for wrong in [
        r#"{"exp":"soon","scene":"*"}"#,
        r#"{"exp":1e400,"scene":"*"}"#,
        "[]",
        r#"{"exp":-1e30,"scene":"*"}"#,
    ] {
        assert!(claims(wrong.into()).is_err(), "{wrong}");
    }
    assert_eq!(told(&tokens, &signed(b"another", head, &aimed)), Err(TokenError::Signature));
}

#[test]
fn a_token_says_weight_and_rate_as_whole_numbers_within_bounds() {
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
async fn a_clock_that_jumps_judges_new_tokens_and_ends_no_session() {
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
        // A token that says nothing of its beginning is good for longer then, and not for ever.
        assert!((days(3)..=days(400)).contains(&left(&open, at).unwrap()), "{at:?}");
        assert_eq!(left(&framed, at), Err(TokenError::NotYetValid), "{at:?}");
    }
    // What a session was granted is counted by a clock that nobody sets.
    let granted = tokens.verify(&framed, now).unwrap().expires_at;
    tokio::time::advance(Duration::from_secs(80)).await;
    assert!(granted > Instant::now());
    tokio::time::advance(Duration::from_secs(20)).await;
    assert!(granted < Instant::now());
}

#[test]
fn a_set_has_the_key_that_a_token_names() {
    let (one, two) =
        (b"one secret of more than thirty-two bytes", b"two secrets of more than thirty-two bytes");
    let key = |id: &str, secret: &[u8]| format!(r#"{{"kty":"oct","kid":"{id}","k":"{}"}}"#, base64(secret));
    let set = keys(format!(r#"{{"keys":[{},{}]}}"#, key("1", one), key("2", two)).as_bytes(), None);
    let claims = format!(r#"{{"exp":{},"scene":"memory"}}"#, in_s(60));
    let head = |id: &str| format!(r#"{{"alg":"HS256","kid":"{id}"}}"#);
    assert_eq!(told(&set, &signed(two, &head("2"), &claims)), Ok(None));
    assert_eq!(told(&set, &signed(two, r#"{"alg":"HS256"}"#, &claims)), Ok(None));
    assert_eq!(told(&set, &signed(two, &head("1"), &claims)), Err(TokenError::Signature));
    assert_eq!(told(&set, &signed(two, &head("3"), &claims)), Err(TokenError::Signature));
    // Exchanged for another, and not for nonsense.
    assert!(set.set_keys(b"short").is_err());
    assert_eq!(told(&set, &signed(two, &head("2"), &claims)), Ok(None));
    set.set_keys(one).unwrap();
    assert_eq!(told(&set, &signed(two, &head("2"), &claims)), Err(TokenError::Signature));
    assert_eq!(told(&set, &signed(one, &head("2"), &claims)), Ok(None));
}

#[tokio::test(start_paused = true)]
async fn nothing_is_sent_to_who_shows_no_token() {
    let state = asking();
    let unauthorised = 4000 + CloseCode::Unauthorised.number();
    for (message, reason) in [
        (hello(), "none was given"),
        (token("nonsense".into()), "not a JSON Web Token"),
        (token(good_for(-100)), "has expired"),
    ] {
        let mut client = Client::in_memory(&state).await;
        client.send(&message).await;
        let (code, why) = client.turned_away().await;
        assert!(code == unauthorised && why.contains(reason), "{code}: {why}");
    }
    let started = Instant::now();
    let (code, _) = Client::in_memory(&state).await.turned_away().await;
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
async fn those_without_a_token_kept_no_place_from_those_with_one() {
    let state = asking();
    // As many as there are leases, and more.
    let mut untrusted_peers = Vec::new();
    for _ in 0..8 {
        untrusted_peers.push(Client::in_memory(&state).await);
    }
    let mut first = with_header(&state, &good_for(60)).await.unwrap();
    first.is_welcome().await;
    let mut second = Client::in_memory(&state).await;
    second.send(&token(good_for(60))).await;
    second.is_welcome().await;
    second.send(&hello()).await;
    assert_eq!(second.read_blobs(1).await.len(), 1);
}

/// As a viewer would that is not asked: servers that want no token take none amiss.
#[tokio::test(start_paused = true)]
async fn a_server_that_asks_for_none_passes_tokens_over() {
    let state = state_of(MemoryScene::new(1, 100, 1000), None);
    let mut client = with_header(&state, "nonsense").await.unwrap();
    client.send(&token("nonsense".into())).await;
    client.send(&hello()).await;
    assert_eq!(client.read_blobs(1).await.len(), 1);
}

#[tokio::test(start_paused = true)]
async fn a_session_ends_with_its_token_unless_another_is_shown() {
    let state = asking();
    // Half a minute of leeway behind each.
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
    // The second was shown after 20 s, for 90 s.
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
async fn tokens_without_end_are_a_flood() {
    let state = asking();
    let good = good_for(600);
    let mut client = with_header(&state, &good).await.unwrap();
    client.send(&hello()).await;
    for _ in 0..60 {
        client.send(&token(good.clone())).await;
    }
    let close = client.read_until_close().await;
    assert!(close.code == CloseCode::Limit && close.reason.contains("tokens"), "{close}");
}
