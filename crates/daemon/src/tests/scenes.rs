//! Several scenes of one daemon: choice by path, ALPN name or `Hello`, and which names a client learns.

use lodestream_protocol::message::{CloseCode, Token, Welcome};
use lodestream_protocol::source::SceneSource;
use lodestream_protocol::stream::{ALPN, alpn_of_scene};
use tokio::io::{AsyncReadExt, AsyncWriteExt};

use super::quic::{Arrival, QuicClient, certificate, trusting};
use super::tokens::{in_s, signed_claims, with_keys};
use super::*;
use crate::session::admission_settings::AdmissionSettings;
use crate::session::scenes::Scenes;

fn scene(name: &str, assets: u32) -> Arc<dyn SceneSource> {
    Arc::new(MemoryScene::named(name, assets, 1500, 1000))
}

/// Two scenes, with one asset and with two.
pub(super) fn two() -> Scenes {
    Scenes::new(vec![scene("one", 1), scene("two", 2)]).unwrap()
}

fn state(admission: AdmissionSettings) -> Arc<ServerState> {
    ServerState::with_admission(two(), SessionSettings::default(), admission)
}

pub(super) fn hello_for(scene: &str) -> ClientMessage {
    ClientMessage::Hello(Hello::new(scene))
}

pub(super) async fn at(state: &Arc<ServerState>, path: &str) -> Result<Client<DuplexStream>, String> {
    let (near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, Arc::clone(state), peer()));
    let opened = tokio_tungstenite::client_async(format!("ws://server{path}"), near).await;
    opened.map(|(socket, _)| Client(socket)).map_err(|why| why.to_string())
}

pub(super) async fn get(state: &Arc<ServerState>, path: &str, token: Option<&str>) -> String {
    let (mut near, far) = duplex(64 * 1024);
    tokio::spawn(accept_http(far, Arc::clone(state), peer()));
    let token = token.map(|token| format!("Authorization: Bearer {token}\r\n")).unwrap_or_default();
    near.write_all(format!("GET {path} HTTP/1.1\r\nHost: s\r\n{token}\r\n").as_bytes()).await.unwrap();
    let mut text = String::new();
    near.read_to_string(&mut text).await.unwrap();
    text
}

impl Client<DuplexStream> {
    pub(super) async fn welcome(&mut self) -> Welcome {
        match self.next().await {
            Some(ServerFrame::Message(ServerMessage::Welcome(welcome))) => welcome,
            other => panic!("{other:?}"),
        }
    }

    pub(super) async fn closed(&mut self) -> (u16, String) {
        match self.0.next().await {
            Some(Ok(Message::Close(Some(frame)))) => (frame.code.into(), frame.reason.to_string()),
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test(start_paused = true)]
async fn the_path_names_the_scene_and_the_server_sends_first() {
    let state = state(AdmissionSettings::default());
    for (path, assets) in [("/one", 1), ("/two", 2), ("/t%77o", 2)] {
        let mut client = at(&state, path).await.unwrap();
        assert_eq!(client.welcome().await.scene.asset_count, assets, "{path}");
        client.send(&hello()).await;
    }
    for path in ["/three", "/one/", "/one?x", "/favicon.ico", "/%ff"] {
        let refused = at(&state, path).await;
        let opened = path == "/one?x";
        assert_eq!(refused.is_ok(), opened, "{path}: {:?}", refused.err());
    }
    assert!(
        get(&state, "/three", None).await.contains("there is no scene 'three'; this server has 'one', 'two'")
    );
}

#[tokio::test(start_paused = true)]
async fn without_a_path_hello_names_the_scene() {
    let state = state(AdmissionSettings::default());
    let mut client = at(&state, "/").await.unwrap();
    client.send(&ClientMessage::Ping(1)).await;
    client.send(&hello_for("two")).await;
    client.send(&want_textures(2)).await;
    assert_eq!(client.welcome().await.scene.name, "two");
    assert_eq!(client.read_blobs(2 + 16).await.len(), 2 + 16);
    for (named, message) in [("", "the address must name a scene"), ("three", "there is no scene 'three'")] {
        let mut client = at(&state, "/stream").await.unwrap();
        client.send(&hello_for(named)).await;
        let (code, reason) = client.closed().await;
        assert_eq!(code, 4000 + CloseCode::NoSuchScene.number());
        assert!(reason.contains(message) && reason.contains("'one', 'two'"), "{reason}");
    }
    // Path and Hello must name the same scene.
    let mut client = at(&state, "/one").await.unwrap();
    client.send(&hello_for("two")).await;
    assert_eq!(client.read_until_close().await.code, CloseCode::NoSuchScene);
    // A silent client times out.
    let mut client = at(&state, "/").await.unwrap();
    let (code, reason) = client.closed().await;
    assert_eq!(code, 4000 + CloseCode::Timeout.number(), "{reason}");
    let refused = state.render_metrics();
    assert!(refused.contains("lodestream_sessions_refused_total{reason=\"scene\"} 2"), "{refused}");
}

#[tokio::test]
async fn over_quic_the_scene_is_sent_before_hello() {
    let folder = tempfile::tempdir().unwrap();
    let any = Some(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)));
    let options = DaemonOptions { listen: any, http: None, ..DaemonOptions::new(folder.path()) };
    let daemon = Daemon::bind(options, two()).await.unwrap();
    assert!(daemon.urls()[0].contains("/one#spki-sha256=") && daemon.urls()[1].contains("/two#spki-sha256="));
    let (address, state) = (daemon.quic_address().unwrap(), Arc::clone(daemon.state()));
    let (_stop, stopped) = tokio::sync::mpsc::channel(1);
    tokio::spawn(daemon.serve(stopped));
    let certificate = certificate(&folder);
    let naming = |scene: &str| {
        let both = [alpn_of_scene(scene), ALPN.to_owned()];
        trusting(&certificate, &both.each_ref().map(String::as_str))
    };
    for (name, assets) in [("one", 1), ("two", 2)] {
        let mut client = QuicClient::connect_as(address, naming(name)).await;
        loop {
            if let Arrival::Message(ServerMessage::Welcome(welcome)) = client.next().await {
                break assert_eq!(welcome.scene.asset_count, assets);
            }
        }
    }
    // A name that the server does not know is agreed on as none, and then Hello says it in full.
    let mut client = QuicClient::connect_as(address, naming("three")).await;
    client.send(&hello_for("three")).await;
    let close = client.closed().await;
    assert_eq!(close.code, CloseCode::NoSuchScene, "{close}");
    assert!(close.reason.contains("'three'"), "{close}");
    // A scene that comes while the daemon runs can be named as well.
    state.scenes().replace(vec![scene("one", 1), scene("two", 2), scene("three", 3)]).unwrap();
    let mut tries = 0;
    loop {
        let mut client = QuicClient::connect_as(address, naming("three")).await;
        let first = tokio::time::timeout(Duration::from_millis(500), client.next()).await;
        if let Ok(Arrival::Message(ServerMessage::Welcome(welcome))) = first {
            break assert_eq!(welcome.scene.asset_count, 3);
        }
        tries += 1;
        assert!(tries < 60, "never named");
    }
}

#[tokio::test(start_paused = true)]
async fn a_session_finishes_on_the_version_that_it_began_with() {
    let state = state(AdmissionSettings::default());
    let mut old = at(&state, "/two").await.unwrap();
    assert_eq!(old.welcome().await.scene.asset_count, 2);
    old.send(&hello()).await;
    let done = state.scenes().replace(vec![scene("two", 3), scene("four", 4)]).unwrap();
    assert_eq!((done.added.len(), done.changed.len(), done.removed.len()), (1, 1, 1));
    let mut new = at(&state, "/two").await.unwrap();
    assert_eq!(new.welcome().await.scene.asset_count, 3);
    assert!(at(&state, "/one").await.is_err());
    // Asset 2 is in the new one alone.
    old.send(&want_textures(2)).await;
    assert_eq!(old.read_blobs(2 + 16).await.len(), 2 + 16);
    let ids = vec![lodestream_protocol::message::Want::whole(BlobId::base(2), 1)];
    old.send(&ClientMessage::Want(ids)).await;
    loop {
        match old.next().await.unwrap() {
            ServerFrame::Message(ServerMessage::Refused(refused)) => {
                break assert_eq!(refused.id, BlobId::base(2));
            }
            ServerFrame::Message(ServerMessage::RefusedMany(many)) => {
                break assert_eq!(many[0].id, BlobId::base(2));
            }
            _ => {}
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_token_for_one_scene_reveals_no_other() {
    let admission = AdmissionSettings { access: with_keys(), ..AdmissionSettings::default() };
    let state = state(admission);
    let of = |scene: &str| signed_claims(&format!(r#"{{"exp":{},"scene":"{scene}"}}"#, in_s(60)));
    // The response is the same whether the scene exists or not.
    for path in ["/two", "/three"] {
        let mut client = at(&state, path).await.unwrap();
        client.send(&ClientMessage::Token(Token(of("one")))).await;
        let (code, reason) = client.closed().await;
        assert_eq!(code, 4000 + CloseCode::Unauthorised.number());
        assert_eq!(reason, "the token is not for this scene");
    }
    let mut client = at(&state, "/").await.unwrap();
    client.send(&ClientMessage::Token(Token(of("one")))).await;
    client.send(&hello_for("two")).await;
    assert_eq!(client.closed().await.0, 4000 + CloseCode::Unauthorised.number());
    let mut client = at(&state, "/").await.unwrap();
    client.send(&ClientMessage::Token(Token(of("one")))).await;
    client.send(&hello_for("")).await;
    assert_eq!(client.closed().await.1, "the address must name a scene, as in ws://HOST:PORT/NAME");
    let mut client = at(&state, "/").await.unwrap();
    client.send(&ClientMessage::Token(Token(of("two")))).await;
    client.send(&hello_for("two")).await;
    assert_eq!(client.welcome().await.scene.name, "two");
    // The list holds the scenes that the token covers.
    assert!(get(&state, "/scenes", None).await.starts_with("HTTP/1.1 401"));
    let list = get(&state, "/scenes", Some(&of("two"))).await;
    assert!(list.contains("\"two\"") && !list.contains("\"one\""), "{list}");
}

#[tokio::test(start_paused = true)]
async fn scenes_are_listed() {
    let list = get(&state(AdmissionSettings::default()), "/scenes", None).await;
    let (head, body) = list.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("application/json"), "{head}");
    let list: serde_json::Value = serde_json::from_str(body).unwrap();
    assert_eq!(list["scenes"][1]["name"], "two");
    assert_eq!(list["scenes"][1]["assets"], 2);
}
