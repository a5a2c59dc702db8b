//! Metrics in Prometheus' text format.

use lodestream_protocol::message::CloseCode;
use lodestream_protocol::source::CacheUse;

use super::*;
use crate::limits::refusal::Refusal;
use crate::metrics::{Metrics, Rates, Transport};

#[test]
fn counters_show_up_in_the_text() {
    let metrics = Metrics::default();
    metrics.session_started(Transport::Quic);
    metrics.session_started(Transport::WebSocket);
    metrics.session_ended(Transport::WebSocket, CloseCode::Timeout);
    metrics.piece_sent(&BlobId::chunk(0, 3), 1000, false);
    metrics.piece_sent(&BlobId::chunk(0, 3), 500, true);
    for (why, count) in Refusal::ALL.into_iter().zip(1..) {
        (0..count).for_each(|_| metrics.session_refused(why));
    }
    metrics.first_byte(Duration::from_millis(2));
    metrics.queued_changed(0, 5000);
    metrics.queued_changed(5000, 1200);
    metrics.bases_sent(Duration::from_millis(60));
    metrics.bases_sent(Duration::from_secs(60));
    let before = metrics.render(Rates::default(), false, Some(CacheUse { hits: 4, misses: 1 }));
    assert!(before.contains("lodestream_cache_hits_total 4\n"), "{before}");
    let rates = Rates {
        per_session_bits_per_s: Some(2_000_000),
        per_address_bits_per_s: Some(8_000_000),
        total_bits_per_s: Some(1_000_000_000),
        assigned_bits_per_s: 3_000_000,
    };
    let text = metrics.render(rates, false, Some(CacheUse { hits: 7, misses: 2 }));
    for line in [
        "lodestream_sessions{transport=\"quic\"} 1",
        "lodestream_sessions{transport=\"ws\"} 0",
        "lodestream_sessions_total{transport=\"ws\"} 1",
        "lodestream_sessions_ended_total{reason=\"Timeout\"} 1",
        "lodestream_sent_bytes_total{kind=\"chunk\"} 1500",
        "lodestream_sent_total{kind=\"chunk\"} 1",
        "lodestream_bases_sent_seconds_bucket{le=\"0.05\"} 0",
        "lodestream_bases_sent_seconds_bucket{le=\"0.1\"} 1",
        "lodestream_bases_sent_seconds_bucket{le=\"+Inf\"} 2",
        "lodestream_bases_sent_seconds_sum 60.06",
        "lodestream_bases_sent_seconds_count 2",
        "lodestream_sessions_refused_total{reason=\"full\"} 1",
        "lodestream_sessions_refused_total{reason=\"address\"} 2",
        "lodestream_sessions_refused_total{reason=\"rate\"} 3",
        "lodestream_sessions_refused_total{reason=\"draining\"} 4",
        "lodestream_sessions_refused_total{reason=\"token\"} 5",
        "lodestream_sessions_refused_total{reason=\"origin\"} 6",
        "lodestream_first_byte_seconds_bucket{le=\"0.001\"} 0",
        "lodestream_first_byte_seconds_bucket{le=\"0.0025\"} 1",
        "lodestream_first_byte_seconds_count 1",
        "lodestream_queued_bytes 1200",
        "lodestream_cache_hits_total 7",
        "lodestream_cache_misses_total 2",
        "# TYPE lodestream_queued_bytes gauge",
        "# TYPE lodestream_cache_hits_total counter",
        "# TYPE lodestream_first_byte_seconds histogram",
        "lodestream_rate_bits_per_second 2000000",
        "lodestream_rate_per_address_bits_per_second 8000000",
        "lodestream_total_rate_bits_per_second 1000000000",
        "lodestream_given_rate_bits_per_second 3000000",
        "lodestream_draining 0",
        "lodestream_dropped_log_lines 0",
        "# TYPE lodestream_sessions gauge",
        "# TYPE lodestream_sessions_total counter",
        "# TYPE lodestream_bases_sent_seconds histogram",
        "# HELP lodestream_sessions Open sessions.",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}\n{text}");
    }
    assert_eq!(metrics.active_sessions(), 1);
}

#[tokio::test(start_paused = true)]
async fn queued_bytes_are_reported_while_they_are_queued() {
    // Two seconds' worth at 2 Mbit/s.
    let state = state_of(MemoryScene::new(1, 1000, 60_000), Some(2_000_000));
    let mut client = Client::requesting_textures(&state).await;
    while state.metrics().waiting_bytes() < 100_000 {
        client.next().await.expect("closed before its data was queued");
    }
    while client.next().await.unwrap() != ServerFrame::Message(ServerMessage::Done) {}
    assert_eq!(state.metrics().waiting_bytes(), 0);
    let text = state.render_metrics();
    assert!(text.contains("\nlodestream_first_byte_seconds_count 1\n"), "{text}");
    // The queued bytes of a session end with it.
    let mut client = Client::requesting_textures(&state).await;
    while state.metrics().waiting_bytes() < 100_000 {
        client.next().await.expect("closed before its data was queued");
    }
    drop(client);
    state.all_sessions_ended().await;
    assert_eq!(state.metrics().waiting_bytes(), 0);
}

#[tokio::test(start_paused = true)]
async fn refusals_are_counted_by_their_reason() {
    use crate::tests::http::exchange;
    let settings = SessionSettings { max_sessions: 1, ..SessionSettings::default() };
    let state = ServerState::new(Arc::new(MemoryScene::new(1, 100, 100)), settings);
    let upgrade = "GET / HTTP/1.1\r\nHost: s\r\nConnection: upgrade\r\nUpgrade: websocket\r\n\
                   Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let refused = |reason: &str, count: u32| {
        let line = format!("lodestream_sessions_refused_total{{reason=\"{reason}\"}} {count}\n");
        let text = state.render_metrics();
        assert!(text.contains(&line), "{line}{text}");
    };
    refused("full", 0);
    let page = format!("{upgrade}Origin: https://a.example\r\n\r\n");
    assert!(exchange(&state, page.as_bytes()).await.starts_with("HTTP/1.1 403"));
    refused("origin", 1);
    let mut first = Client::in_memory(&state).await;
    first.send(&hello()).await;
    first.next().await.unwrap();
    first.read_blobs(1).await;
    assert!(exchange(&state, format!("{upgrade}\r\n").as_bytes()).await.starts_with("HTTP/1.1 503"));
    refused("full", 1);
    state.drain();
    assert!(exchange(&state, format!("{upgrade}\r\n").as_bytes()).await.starts_with("HTTP/1.1 503"));
    refused("draining", 1);
    refused("token", 0);
}

#[tokio::test(start_paused = true)]
async fn turns_of_sessions_and_timers_are_counted() {
    let state = state_of(MemoryScene::new(1, 100, 20_000), Some(1_000_000));
    let counted = || {
        let text = state.render_metrics();
        ["turns", "timers"].map(|what| {
            let name = format!("\nlodestream_session_{what}_total ");
            let (_, rest) = text.split_once(&name).unwrap();
            rest.lines().next().unwrap().parse::<u64>().unwrap()
        })
    };
    assert_eq!(counted(), [0, 0]);
    let mut client = Client::requesting_textures(&state).await;
    client.read_blobs(3).await;
    client.send(&ClientMessage::Bye).await;
    state.all_sessions_ended().await;
    // Timers wait for the rate limiter, and not for messages.
    let [turns, timers] = counted();
    assert!(timers > 20 && turns > timers + 3, "{turns} turns, {timers} by timers");
}
