//! Happy Eyeballs (Schinazi and Pauly, RFC 8305): resolves a name and tries all its addresses, starting the next while
//! earlier ones have not answered. Many names have an address that is not served: `localhost` resolves to `::1` first
//! although the server may listen on 127.0.0.1 only.

use std::future::Future;
use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use futures_util::StreamExt;
use futures_util::stream::FuturesUnordered;
use lodestream_protocol::message::{Close, CloseCode};
use tokio::net::lookup_host;
use tokio::time::{Instant, sleep_until, timeout};

use super::address::Address;

/// Time limit of a name lookup.
const LOOKUP_TIMEOUT: Duration = Duration::from_secs(4);
/// Connection attempt delay: time until the next address is tried as well (RFC 8305, section 5).
const ATTEMPT_DELAY: Duration = Duration::from_millis(250);
/// Most addresses of a name that are tried; names usually have two to four.
const MAX_ADDRESSES: usize = 8;

/// Resolves names to addresses.
pub(super) trait Resolver {
    /// The addresses of `HOST:PORT`, in order of preference.
    fn resolve(&self, authority: &str) -> impl Future<Output = io::Result<Vec<SocketAddr>>>;
}

/// The system's resolver.
pub(super) struct SystemResolver;

impl Resolver for SystemResolver {
    async fn resolve(&self, authority: &str) -> io::Result<Vec<SocketAddr>> {
        Ok(lookup_host(authority).await?.collect())
    }
}

/// The addresses of a server without duplicates, in the resolver's order.
pub(super) async fn resolve(address: &Address, resolver: &impl Resolver) -> Result<Vec<SocketAddr>, Close> {
    let authority = address.authority();
    let lost = |why: String| Close::new(CloseCode::Lost, format!("{authority} cannot be found: {why}"));
    let resolved = match timeout(LOOKUP_TIMEOUT, resolver.resolve(&authority)).await {
        Ok(Ok(resolved)) => resolved,
        Ok(Err(why)) => return Err(lost(why.to_string())),
        Err(_) => {
            let limit = LOOKUP_TIMEOUT.as_secs();
            return Err(lost(format!("no answer to the name lookup within {limit} s; is there a network?")));
        }
    };
    let mut addresses: Vec<SocketAddr> = Vec::new();
    for resolved in resolved {
        if !addresses.contains(&resolved) && addresses.len() < MAX_ADDRESSES {
            addresses.push(resolved);
        }
    }
    if addresses.is_empty() { Err(lost("the name has no address".into())) } else { Ok(addresses) }
}

/// Opens a connection to the first of `servers` that answers. They are tried in order; the next attempt starts when one
/// fails, or after [`ATTEMPT_DELAY`]. The first success cancels the others. `open` must end in bounded time.
pub(super) async fn first_to_answer<T, F>(
    address: &Address,
    servers: &[SocketAddr],
    open: impl Fn(SocketAddr) -> F,
) -> Result<T, Close>
where
    F: Future<Output = Result<T, Close>>,
{
    let mut waiting = servers.iter().copied();
    let mut trying = FuturesUnordered::new();
    let mut failed = Vec::new();
    loop {
        let mut more = false;
        if let Some(server) = waiting.next() {
            let attempt = open(server);
            trying.push(async move { (server, attempt.await) });
            more = waiting.len() > 0;
        }
        let next = Instant::now() + ATTEMPT_DELAY;
        tokio::select! {
            biased;
            Some((server, opened)) = trying.next() => match opened {
                Ok(connection) => return Ok(connection),
                Err(why) => failed.push((server, why)),
            },
            () = sleep_until(next), if more => {}
            else => return Err(combined_reason(address, failed)),
        }
    }
}

/// Combines the reasons of all attempts. Worth retrying if one of them is.
fn combined_reason(address: &Address, failed: Vec<(SocketAddr, Close)>) -> Close {
    let all: Vec<String> = failed
        .iter()
        .map(|(server, why)| match failed.len() {
            1 if server.to_string() == address.authority() => why.reason.clone(),
            _ => format!("{server}: {}", why.reason),
        })
        .collect();
    let worth = failed.iter().map(|(_, why)| why.code).find(|code| code.worth_retrying());
    let code = worth.or(failed.first().map(|(_, why)| why.code)).unwrap_or(CloseCode::Lost);
    // Never sent to a peer, so its length is not bounded.
    Close { code, reason: format!("{address} cannot be reached: {}", all.join("; ")) }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::future::pending;

    use super::*;

    fn servers(text: &[&str]) -> Vec<SocketAddr> {
        text.iter().map(|one| one.parse().unwrap()).collect()
    }

    fn address() -> Address {
        "ws://localhost:8080".parse().unwrap()
    }

    /// Answers of servers by their last character: `1` refuses, `2` is silent for 4 s, `3` answers after 1 s, `4` at
    /// once.
    async fn answer(server: SocketAddr) -> Result<SocketAddr, Close> {
        match server.ip().to_string().as_bytes().last() {
            Some(b'1') => Err(Close::new(CloseCode::Lost, "connection refused")),
            Some(b'2') => match timeout(Duration::from_secs(4), pending()).await {
                Ok(()) => unreachable!(),
                Err(_) => Err(Close::new(CloseCode::Lost, "no answer within 4 s")),
            },
            Some(b'3') => {
                tokio::time::sleep(Duration::from_secs(1)).await;
                Ok(server)
            }
            _ => Ok(server),
        }
    }

    async fn ask(of: &[&str]) -> (Result<SocketAddr, Close>, Vec<String>, Duration) {
        let tried = RefCell::new(Vec::new());
        let start = Instant::now();
        let result = first_to_answer(&address(), &servers(of), |server| {
            tried.borrow_mut().push(server.to_string());
            answer(server)
        })
        .await;
        (result, tried.into_inner(), start.elapsed())
    }

    #[tokio::test(start_paused = true)]
    async fn a_name_whose_first_address_is_unreachable_connects_to_its_second() {
        let (refused, tried, after) = ask(&["[::1]:8080", "127.0.0.4:8080"]).await;
        assert_eq!((refused.unwrap().to_string().as_str(), tried.len()), ("127.0.0.4:8080", 2));
        assert!(after < ATTEMPT_DELAY, "a refused attempt is followed at once: {after:?}");
        let (silent, _, after) = ask(&["[::2]:8080", "127.0.0.4:8080"]).await;
        assert_eq!(silent.unwrap().to_string(), "127.0.0.4:8080");
        assert!(after >= ATTEMPT_DELAY && after < 2 * ATTEMPT_DELAY, "{after:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn the_first_address_is_preferred_and_a_slow_one_is_not_given_up() {
        let (at_once, tried, _) = ask(&["127.0.0.4:1", "127.0.0.14:1"]).await;
        assert_eq!((at_once.unwrap().port(), tried.len()), (1, 1), "no other address is tried");
        let (slow, tried, after) = ask(&["127.0.0.3:1", "[::2]:1", "[::1]:1"]).await;
        assert_eq!((slow.unwrap().to_string().as_str(), tried.len()), ("127.0.0.3:1", 3));
        assert!(after >= Duration::from_secs(1) && after < Duration::from_secs(2), "{after:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn the_error_names_every_address_that_was_tried() {
        let (none, tried, after) = ask(&["[::1]:8080", "127.0.0.2:8080", "127.0.0.1:8080"]).await;
        let why = none.unwrap_err();
        assert_eq!(
            why.reason,
            "ws://localhost:8080 cannot be reached: [::1]:8080: connection refused; 127.0.0.1:8080: connection refused; \
             127.0.0.2:8080: no answer within 4 s"
        );
        assert!(why.code.worth_retrying() && tried.len() == 3);
        assert!(after >= Duration::from_secs(4) && after < Duration::from_secs(5), "{after:?}");
        let literal = combined_reason(
            &"ws://[::1]:8080".parse().unwrap(),
            vec![(servers(&["[::1]:8080"])[0], Close::new(CloseCode::Protocol, "it answers 404"))],
        );
        assert_eq!(literal.reason, "ws://[::1]:8080 cannot be reached: it answers 404");
        assert!(!literal.code.worth_retrying());
    }

    struct Fixed(io::Result<Vec<SocketAddr>>);

    impl Resolver for Fixed {
        async fn resolve(&self, _: &str) -> io::Result<Vec<SocketAddr>> {
            match &self.0 {
                Ok(all) if all.is_empty() => pending().await,
                Ok(all) => Ok(all.clone()),
                Err(why) => Err(io::Error::new(why.kind(), why.to_string())),
            }
        }
    }

    #[tokio::test(start_paused = true)]
    async fn names_are_looked_up_in_bounded_time_and_addresses_taken_once() {
        let twice = Fixed(Ok(servers(&["[::1]:1", "127.0.0.1:1", "[::1]:1"])));
        assert_eq!(resolve(&address(), &twice).await.unwrap(), servers(&["[::1]:1", "127.0.0.1:1"]));
        let many = Fixed(Ok((0..99).map(|i| ([10, 0, 0, i], 1).into()).collect()));
        assert_eq!(resolve(&address(), &many).await.unwrap().len(), MAX_ADDRESSES);
        let unknown = resolve(&address(), &Fixed(Err(io::Error::other("no such host")))).await.unwrap_err();
        assert_eq!(unknown.reason, "localhost:8080 cannot be found: no such host");
        let silent = resolve(&address(), &Fixed(Ok(Vec::new()))).await.unwrap_err();
        assert!(silent.reason.contains("name lookup within 4 s"), "{silent}");
    }
}
