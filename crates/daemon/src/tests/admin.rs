use std::path::Path;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::*;
use crate::http::admin::AdminPort;
use crate::transport::listen::listen_tcp;

async fn get(address: SocketAddr, path: &str) -> String {
    let mut stream = TcpStream::connect(address).await.unwrap();
    stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: s\r\n\r\n").as_bytes()).await.unwrap();
    let mut answer = String::new();
    timeout(REAL_TIME_LIMIT, stream.read_to_string(&mut answer)).await.unwrap().unwrap();
    answer
}

fn any() -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, 0))
}

/// A daemon that has HTTP and an admin port, and no QUIC.
fn options(folder: &Path, sessions: SessionSettings) -> DaemonOptions {
    DaemonOptions {
        listen: None,
        http: Some(any()),
        admin: AdminPort::At(any()),
        sessions,
        ..DaemonOptions::new(folder)
    }
}

#[tokio::test]
async fn idle_connections_do_not_block_health_checks() {
    let folder = tempfile::tempdir().unwrap();
    let sessions =
        SessionSettings { rate_bits_per_s: Some(2_000_000), max_sessions: 1, ..SessionSettings::default() };
    let daemon = Daemon::bind(options(folder.path(), sessions), Arc::new(MemoryScene::new(1, 100, 100)))
        .await
        .unwrap();
    let (http, admin) = (daemon.http_address().unwrap(), daemon.admin_address().unwrap());
    let (_stop, stopped) = tokio::sync::mpsc::channel(2);
    let serving = tokio::spawn(daemon.serve(stopped));
    // More than the pool of the public port holds; they send nothing.
    let mut idle = Vec::new();
    for _ in 0..400 {
        idle.push(TcpStream::connect(http).await.unwrap());
    }
    for address in [http, admin] {
        let health = get(address, "/health").await;
        assert!(health.starts_with("HTTP/1.1 200") && health.ends_with("ok\n"), "{health}");
    }
    let metrics = get(admin, "/metrics").await;
    assert!(
        metrics.starts_with("HTTP/1.1 200") && metrics.contains("text/plain; version=0.0.4"),
        "{metrics}"
    );
    assert!(metrics.contains("\nlodestream_rate_bits_per_second 2000000\n"), "{metrics}");
    let nowhere = get(admin, "/").await;
    assert!(nowhere.starts_with("HTTP/1.1 404") && nowhere.contains("/ready"), "no sessions here: {nowhere}");
    serving.abort();
}

#[tokio::test]
async fn both_ports_report_draining() {
    let folder = tempfile::tempdir().unwrap();
    let sessions = SessionSettings {
        rate_bits_per_s: Some(1_000_000),
        drain: Duration::from_secs(3600),
        ..SessionSettings::default()
    };
    let daemon =
        Daemon::bind(options(folder.path(), sessions), Arc::new(MemoryScene::new(1, 1000, 10_000_000)))
            .await
            .unwrap();
    let (http, admin) = (daemon.http_address().unwrap(), daemon.admin_address().unwrap());
    let state = daemon.state().clone();
    let (stop, stopped) = tokio::sync::mpsc::channel(2);
    let serving = tokio::spawn(daemon.serve(stopped));
    let ready = get(admin, "/ready").await;
    assert!(ready.starts_with("HTTP/1.1 200") && ready.ends_with("ready\n"), "{ready}");
    // A transfer that takes longer than this test.
    let mut client = Client::over(TcpStream::connect(http).await.unwrap()).await;
    client.send(&hello()).await;
    client.send(&want_textures(1)).await;
    client.next().await.unwrap();
    stop.send(()).await.unwrap();
    timeout(REAL_TIME_LIMIT, state.wait_for_phase(crate::session::state::Phase::Draining)).await.unwrap();
    for address in [http, admin] {
        let ready = get(address, "/ready").await;
        assert!(ready.starts_with("HTTP/1.1 503") && ready.contains("draining"), "{ready}");
        assert!(get(address, "/health").await.starts_with("HTTP/1.1 200"));
    }
    assert!(get(admin, "/metrics").await.contains("\nlodestream_draining 1\n"));
    assert!(!serving.is_finished());
    serving.abort();
}

#[tokio::test]
async fn three_hundred_connections_fit_in_the_backlog() {
    let listener = listen_tcp(any()).unwrap();
    let address = listener.local_addr().unwrap();
    // Nothing accepts them.
    let mut waiting = Vec::new();
    for n in 0..300 {
        let connecting = timeout(REAL_TIME_LIMIT, TcpStream::connect(address));
        waiting.push(connecting.await.unwrap_or_else(|_| panic!("connection {n} waits for ever")).unwrap());
    }
}

#[test]
fn addresses_are_parsed() {
    assert_eq!("off".parse(), Ok(AdminPort::Off));
    assert_eq!("[::1]:0".parse(), Ok(AdminPort::At("[::1]:0".parse().unwrap())));
    assert!("8081".parse::<AdminPort>().unwrap_err().to_string().contains("127.0.0.1:8081"));
}
