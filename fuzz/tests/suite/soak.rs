//! Memory of a server over an hour of a thousand sessions in virtual time: it does not grow.
//!
//! ```sh
//! cargo test -p lodestream-fuzz --test suite soak -- --nocapture
//! ```
//!
//! Memory is counted by the allocator (`lodestream_fuzz::meter`) to the byte, so that any table which keeps an entry
//! per session is detected. Sockets and TLS are not included.

use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use lodestream_daemon::{MemoryScene, ServerState, SessionSettings, accept_http};
use lodestream_fuzz::meter::held_bytes;
use lodestream_protocol::frame::encode_client;
use lodestream_protocol::message::{ClientMessage, Hello, Want};
use lodestream_scene::BlobId;
use tokio::io::{DuplexStream, duplex};
use tokio::runtime::Builder;
use tokio::time::{Instant, interval, sleep, sleep_until, timeout_at};
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::protocol::WebSocketConfig;
use tokio_tungstenite::{WebSocketStream, client_async_with_config};

use crate::exclusive::exclusive;

const SESSIONS: u32 = 1000;
const HOUR: Duration = Duration::from_secs(3600);
/// Interval between the starts of a client's sessions, and length of a session.
const PERIOD: Duration = Duration::from_secs(600);
const LASTS: Duration = Duration::from_secs(540);
/// Interval between pings; the server closes a session after 30 s of silence.
const PING: Duration = Duration::from_secs(20);
/// Tolerance for buffers in use at the time of measurement.
const SLACK_BYTES: usize = 4 << 10;

/// An address per client.
fn address(client: u32) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::from_bits(0x0a00_0000 + client), 50_000))
}

async fn open(client: u32, state: &Arc<ServerState>) -> WebSocketStream<DuplexStream> {
    let (near, far) = duplex(8 << 10);
    tokio::spawn(accept_http(far, Arc::clone(state), address(client)));
    let config = WebSocketConfig::default().read_buffer_size(4 << 10);
    client_async_with_config("ws://server/", near, Some(config)).await.unwrap().0
}

async fn say(socket: &mut WebSocketStream<DuplexStream>, message: &ClientMessage) {
    socket.send(Message::Binary(encode_client(message).unwrap().into())).await.unwrap();
}

/// A session: `Hello`, blobs, pings; then `Bye`, a closed connection, or silence until the server closes.
async fn session(client: u32, state: &Arc<ServerState>, end: Instant) {
    let mut socket = open(client, state).await;
    say(&mut socket, &ClientMessage::Hello(Hello::new(""))).await;
    let blobs = (0..4).map(|level| Want::whole(BlobId::texture(client % 4, 0, level), level.into()));
    say(&mut socket, &ClientMessage::Want(blobs.collect())).await;
    let mut life = interval(PING);
    loop {
        tokio::select! {
            biased;
            () = sleep_until(end) => break,
            _ = life.tick() => say(&mut socket, &ClientMessage::Ping(client)).await,
            message = socket.next() => assert!(message.is_some_and(|message| message.is_ok()), "closed early"),
        }
    }
    match client % 3 {
        0 => say(&mut socket, &ClientMessage::Bye).await,
        1 => {}
        _ => {
            let gives_up = end + Duration::from_secs(45);
            while let Ok(Some(Ok(_))) = timeout_at(gives_up, socket.next()).await {}
            assert!(Instant::now() < gives_up, "silence is borne");
        }
    }
}

#[test]
fn an_hour_of_a_thousand_sessions_leaks_nothing() {
    let _exclusive = exclusive();
    let runtime = Builder::new_current_thread().enable_all().start_paused(true).build().unwrap();
    let (held, text) = runtime.block_on(async {
        let settings =
            SessionSettings { max_sessions: u64::from(SESSIONS) * 2, ..SessionSettings::default() };
        let state = ServerState::new(Arc::new(MemoryScene::new(4, 300, 2000)), settings);
        let began = Instant::now();
        for client in 0..SESSIONS {
            let state = Arc::clone(&state);
            tokio::spawn(async move {
                let mut begin = began + PERIOD * client / SESSIONS;
                while begin + LASTS < began + HOUR {
                    sleep_until(begin).await;
                    session(client, &state, begin + LASTS).await;
                    begin += PERIOD;
                }
            });
        }
        // All clients have connected once, and the first ones twice.
        let mut held = Vec::new();
        for period in 1..=4 {
            sleep_until(began + PERIOD * period + LASTS / 2).await;
            let active = state.metrics().active_sessions();
            assert!((850..=950).contains(&active), "{active} sessions");
            held.push(held_bytes());
        }
        sleep(HOUR).await;
        state.all_sessions_ended().await;
        (held, state.render_metrics())
    });
    println!("{held:?} bytes held after 15, 25, 35 and 45 minutes");
    let [first, .., last] = held[..] else { unreachable!() };
    assert!(last <= first + SLACK_BYTES, "{} bytes more after half an hour", last - first);
    for line in ["lodestream_queued_bytes 0", "lodestream_sessions{transport=\"ws\"} 0"] {
        assert!(text.lines().any(|told| told == line), "{line}: {text}");
    }
}
