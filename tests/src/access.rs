//! Tokens: admission with a token, and the messages without a valid one.

use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

use lodestream_client::core::Config;
use lodestream_daemon::{Access, Hook, SessionSettings, Tokens};
use lodestream_protocol::message::Token;

use crate::support::LIMIT;
use crate::support::daemon::{Server, Transport};
use crate::support::scene::TestScene;
use crate::support::viewer::{Viewer, config};

const SECRET: &[u8] = b"a secret of more than thirty-two bytes";

/// A token for a scene that expires in `seconds`.
fn token(secret: &[u8], scene: &str, seconds: i64) -> Token {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs();
    let base64 = |bytes: &[u8]| data_encoding::BASE64URL_NOPAD.encode(bytes);
    let claims = serde_json::json!({"exp": i64::try_from(now).unwrap() + seconds, "scene": scene});
    let message = format!("{}.{}", base64(br#"{"alg":"HS256"}"#), base64(claims.to_string().as_bytes()));
    let key = ring::hmac::Key::new(ring::hmac::HMAC_SHA256, secret);
    Token(format!("{message}.{}", base64(ring::hmac::sign(&key, message.as_bytes()).as_ref())))
}

fn showing(token: Option<Token>) -> Config {
    let mut config = config();
    config.session.token = token;
    config
}

#[test]
fn viewers_without_a_valid_token_receive_the_reason() {
    let scene = TestScene::small();
    let name = scene.source().header().name.clone();
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), SECRET).unwrap();
    let access = Arc::new(Access::Tokens(Tokens::from_file(file.path(), None).unwrap()));
    let server = Server::start_with(scene.source(), SessionSettings::default(), |options| {
        options.admission.access = Some(access);
    });
    for transport in Transport::BOTH {
        let address = server.address(transport);
        for (shown, why) in [
            (None, "none was given"),
            (Some(token(SECRET, &name, -100)), "has expired"),
            (Some(token(SECRET, "another", 100)), "not for this scene"),
            (Some(token(b"another", &name, 100)), "no key that the server knows"),
        ] {
            let told = Viewer::start(&address, showing(shown)).end(LIMIT);
            assert!(told.contains(why), "{transport:?}: {told}");
        }
        let mut viewer = Viewer::start(&address, showing(Some(token(SECRET, &name, 100))));
        let status = viewer.settle();
        assert!(status.stats.applied_chunks > 0, "{:?}", status.stats);
        // A new token is presented while the session runs: it continues, or ends with the reason.
        viewer.show(token(SECRET, &name, 200));
        viewer.show(token(b"another", &name, 300));
        let told = viewer.end(LIMIT);
        assert!(told.contains("no key that the server knows"), "{transport:?}: {told}");
    }
    server.assert_healthy();
}

/// The example program of docs/operating.md, as a shell script.
#[cfg(unix)]
const PROGRAM: &str = r#"#!/bin/sh
read -r asked
case "$asked" in
    *'"token":"open sesame","scene":"'*) echo '{"active": true}' ;;
    *'"token":"for others"'*) echo '{"active": true, "scene": "another"}' ;;
    *'"token":"broken"'*) exit 1 ;;
    *) echo '{"active": false}' ;;
esac
"#;

#[cfg(unix)]
#[test]
fn an_operators_program_decides_on_admission() {
    let folder = tempfile::tempdir().unwrap();
    let (text, program) = (folder.path().join("text"), folder.path().join("may-see"));
    std::fs::write(&text, PROGRAM).unwrap();
    // Another process writes the script: a file that is open for writing here cannot be executed by a concurrent test.
    let written = std::process::Command::new("install").args(["-m", "700"]).args([&text, &program]).status();
    assert!(written.unwrap().success());
    let hook = Hook::from_command(&program).unwrap();
    let access = Arc::new(Access::Hook { hook, authorization: None });
    let server = Server::start_with(TestScene::small().source(), SessionSettings::default(), |options| {
        options.admission.access = Some(access);
    });
    let shown = |text: &str| showing(Some(Token(text.to_owned())));
    for transport in Transport::BOTH {
        let address = server.address(transport);
        for (token, why) in [("nobody", "refused"), ("for others", "not for this scene")] {
            let told = Viewer::start(&address, shown(token)).end(LIMIT);
            assert!(told.contains(why), "{transport:?}: {told}");
        }
        let mut viewer = Viewer::start(&address, shown("open sesame"));
        let status = viewer.settle();
        assert!(status.stats.applied_chunks > 0, "{:?}", status.stats);
        // A failed check ends no session; the next check does.
        viewer.show(Token("broken".to_owned()));
        viewer.show(Token("nobody".to_owned()));
        let told = viewer.end(LIMIT);
        assert!(told.contains("the token is refused"), "{transport:?}: {told}");
    }
    server.assert_healthy();
}
