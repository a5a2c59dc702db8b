//! Printed addresses, and the warning about public ones.

use std::net::Ipv6Addr;

use super::tokens::with_keys;
use super::*;
use crate::http::admin::AdminPort;

/// A daemon with all ports at one address.
async fn at(ip: std::net::IpAddr, set: impl FnOnce(&mut DaemonOptions)) -> (Daemon, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let any = SocketAddr::new(ip, 0);
    let mut options = DaemonOptions {
        listen: Some(any),
        http: Some(any),
        admin: AdminPort::At(any),
        ..DaemonOptions::new(folder.path())
    };
    set(&mut options);
    (Daemon::bind(options, Arc::new(MemoryScene::new(1, 10, 10))).await.unwrap(), folder)
}

#[tokio::test]
async fn unspecified_addresses_are_not_printed() {
    let mut all: Vec<std::net::IpAddr> = vec![Ipv4Addr::UNSPECIFIED.into()];
    // Not every machine has IPv6.
    if std::net::UdpSocket::bind((Ipv6Addr::UNSPECIFIED, 0)).is_ok() {
        all.push(Ipv6Addr::UNSPECIFIED.into());
    }
    for ip in all {
        let (daemon, _folder) = at(ip, |_| {}).await;
        let urls = [daemon.urls(), daemon.metrics_urls()].concat();
        for scheme in ["quic://", "ws://", "http://"] {
            assert!(urls.iter().any(|url| url.starts_with(scheme)), "{urls:?}");
        }
        assert!(!urls.iter().any(|url| url.contains("0.0.0.0") || url.contains("[::]")), "{urls:?}");
        let pinned = urls.iter().filter(|url| url.starts_with("quic://"));
        assert!(pinned.clone().all(|url| url.contains("#spki-sha256=")), "{urls:?}");
        let port = daemon.quic_address().unwrap().port();
        assert!(pinned.clone().all(|url| url.contains(&format!(":{port}#"))), "{urls:?}");
    }
}

#[tokio::test]
async fn a_public_address_without_tokens_or_tls_is_warned_about() {
    let (loopback, _folder) = at(Ipv4Addr::LOCALHOST.into(), |_| {}).await;
    assert_eq!(loopback.exposure_warning(), None);
    let (public, _folder) = at(Ipv4Addr::UNSPECIFIED.into(), |_| {}).await;
    let warning = public.exposure_warning().unwrap();
    assert!(warning.contains("without a token") && warning.contains("--token-keys"), "{warning}");
    // One public port is enough.
    let (half, _folder) = at(Ipv4Addr::LOCALHOST.into(), |options| {
        options.http = Some(SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)));
    })
    .await;
    assert!(half.exposure_warning().unwrap().contains("0.0.0.0:"), "the port is named as it was given");
    let asking = |options: &mut DaemonOptions| options.admission.access = with_keys();
    let (plain, _folder) = at(Ipv4Addr::UNSPECIFIED.into(), asking).await;
    assert!(plain.exposure_warning().unwrap().contains("--http-tls"));
    let (safe, _folder) = at(Ipv4Addr::UNSPECIFIED.into(), |options| {
        asking(options);
        options.http_tls = true;
    })
    .await;
    assert_eq!(safe.exposure_warning(), None);
}
