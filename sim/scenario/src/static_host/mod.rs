//! A published scene on a static host, in virtual time: the shipped client over requests for byte ranges.
//!
//! Modelled like HTTP/2 without TLS over one TCP connection, as content delivery networks serve browsers: requests and
//! response heads have a constant length, bodies take turns in frames. Not modelled: TLS (a round trip more, as for a
//! server), the six connections of HTTP/1.1, and the host's disk.

mod frames;
mod objects;

use std::sync::Arc;
use std::time::Duration;

use lodestream_client::net;
use lodestream_protocol::message::{Close, CloseCode};
use lodestream_protocol::source::SceneSource;
use tokio::time::timeout;

use crate::network::{CLOSE_TIMEOUT, TcpNetwork, Traffic, end_of};
use crate::plan::Case;
use crate::viewer::Viewer;
use objects::Objects;

/// Runs a case.
pub(crate) async fn run(
    case: &Case,
    scene: &dyn SceneSource,
    seed: u64,
    limit: Duration,
    viewer: &mut Viewer<'_>,
) -> anyhow::Result<(Close, Traffic)> {
    let objects = Arc::new(Objects::publish(scene)?);
    let serve = move |server| frames::serve(server, objects);
    let TcpNetwork { client, in_time, serving, counters } =
        TcpNetwork::open(&case.link, seed, limit, serve).await?;
    let close = if in_time {
        let clock = viewer.clock();
        let fetch = frames::Connection::new(client, counters.clone());
        end_of(net::run_published(fetch, viewer, clock), limit).await
    } else {
        Close::new(CloseCode::Lost, "no connection within the time limit")
    };
    let traffic = Traffic::over_tcp(&counters);
    let _ = timeout(CLOSE_TIMEOUT, serving).await;
    Ok((close, traffic))
}

#[cfg(test)]
mod tests {
    use crate::testing::{parse, results_of};

    #[test]
    fn a_static_host_shows_what_a_server_shows() {
        let plan = parse(
            "ttq_px = [1]",
            "transport = \"ws\"\ntechnique = [\"lodestream\", \"published\"]\nrate_bits_per_s = 2_000_000\nrtt_ms = 50\nqueue_bytes = 65536",
        );
        let results = results_of(&plan);
        let [server, host] = &results[..] else { panic!("{results:?}") };
        assert_eq!((&host.ended[..], host.applied_faces), ("settled", server.applied_faces));
        let requests = host.requests.unwrap();
        assert!(requests > 3 && server.requests.is_none(), "{requests}");
        let (first, of_server) = (host.ttff_ms.unwrap(), server.ttff_ms.unwrap());
        assert!(first <= of_server + 100.0, "{first} ms, not {of_server}");
        let again = results_of(&plan);
        assert_eq!(again[1].trace, host.trace);
    }
}
