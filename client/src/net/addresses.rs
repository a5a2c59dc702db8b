//! From a name to a connection: all addresses of a name are tried, the next one beside those that have not answered
//! ("Happy Eyeballs": Schinazi and Pauly, RFC 8305). Many names have an address that leads nowhere: `localhost` is
//! `::1` first where the server listens on 127.0.0.1 only.

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

/// Time that a name lookup may take.
const LOOKUP_TIMEOUT: Duration = Duration::from_secs(4);
/// Time after which the next address is tried as well (RFC 8305, section 5).
const NEXT_AFTER: Duration = Duration::from_millis(250);
/// Most addresses of a name that are tried; real names have two to four.
const MAX_ADDRESSES: usize = 8;

/// Who knows the addresses of a name.
pub(super) trait Resolver {
    /// The addresses of `HOST:PORT`, those to be preferred first.
    fn resolve(&self, authority: &str) -> impl Future<Output = io::Result<Vec<SocketAddr>>>;
}

/// The system's resolver.
pub(super) struct System;

impl Resolver for System {
    async fn resolve(&self, authority: &str) -> io::Result<Vec<SocketAddr>> {
        Ok(lookup_host(authority).await?.collect())
    }
}

/// The addresses of a server, each once, in the resolver's order.
pub(super) async fn find(address: &Address, resolver: &impl Resolver) -> Result<Vec<SocketAddr>, Close> {
    let authority = address.authority();
    let lost = |why: String| Close::new(CloseCode::Lost, format!("{authority} cannot be found: {why}"));
    let found = match timeout(LOOKUP_TIMEOUT, resolver.resolve(&authority)).await {
        Ok(Ok(found)) => found,
        Ok(Err(why)) => return Err(lost(why.to_string())),
        Err(_) => {
            let limit = LOOKUP_TIMEOUT.as_secs();
            return Err(lost(format!("the name was not looked up within {limit} s; is there a network?")));
        }
    };
    let mut addresses: Vec<SocketAddr> = Vec::new();
    for one in found {
        if !addresses.contains(&one) && addresses.len() < MAX_ADDRESSES {
            addresses.push(one);
        }
    }
    if addresses.is_empty() { Err(lost("the name has no address".into())) } else { Ok(addresses) }
}

/// Opens a connection to the first of `servers` that answers. They are tried in order, each once the one before has
/// failed or has not answered for [`NEXT_AFTER`]; the others are given up once one has answered. `open` must end in
/// bounded time.
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
        let next = Instant::now() + NEXT_AFTER;
        tokio::select! {
            biased;
            Some((server, opened)) = trying.next() => match opened {
                Ok(connection) => return Ok(connection),
                Err(why) => failed.push((server, why)),
            },
            () = sleep_until(next), if more => {}
            else => return Err(none_answered(address, failed)),
        }
    }
}

/// One reason of many. Worth another try if one of them is.
fn none_answered(address: &Address, failed: Vec<(SocketAddr, Close)>) -> Close {
    let all: Vec<String> = failed
        .iter()
        .map(|(server, why)| match failed.len() {
            1 if server.to_string() == address.authority() => why.reason.clone(),
            _ => format!("{server}: {}", why.reason),
        })
        .collect();
    let worth = failed.iter().map(|(_, why)| why.code).find(|code| code.worth_retrying());
    let code = worth.or(failed.first().map(|(_, why)| why.code)).unwrap_or(CloseCode::Lost);
    // Never sent, so as long as it needs to be.
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

    /// Answers of servers by their last character: `1` refuses, `2` is silent for 4 s, `3` answers after 1 s, `4` at once.
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
    async fn a_name_whose_first_address_leads_nowhere_is_reached_at_its_second() {
        let (refused, tried, after) = ask(&["[::1]:8080", "127.0.0.4:8080"]).await;
        assert_eq!((refused.unwrap().to_string().as_str(), tried.len()), ("127.0.0.4:8080", 2));
        assert!(after < NEXT_AFTER, "a refusal is not waited on: {after:?}");
        let (silent, _, after) = ask(&["[::2]:8080", "127.0.0.4:8080"]).await;
        assert_eq!(silent.unwrap().to_string(), "127.0.0.4:8080");
        assert!(after >= NEXT_AFTER && after < 2 * NEXT_AFTER, "{after:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn the_first_address_is_preferred_and_a_slow_one_is_not_given_up() {
        let (at_once, tried, _) = ask(&["127.0.0.4:1", "127.0.0.14:1"]).await;
        assert_eq!((at_once.unwrap().port(), tried.len()), (1, 1), "nobody else is asked");
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
        let literal = none_answered(
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
        assert_eq!(find(&address(), &twice).await.unwrap(), servers(&["[::1]:1", "127.0.0.1:1"]));
        let many = Fixed(Ok((0..99).map(|i| ([10, 0, 0, i], 1).into()).collect()));
        assert_eq!(find(&address(), &many).await.unwrap().len(), MAX_ADDRESSES);
        let unknown = find(&address(), &Fixed(Err(io::Error::other("no such host")))).await.unwrap_err();
        assert_eq!(unknown.reason, "localhost:8080 cannot be found: no such host");
        let silent = find(&address(), &Fixed(Ok(Vec::new()))).await.unwrap_err();
        assert!(silent.reason.contains("not looked up within 4 s"), "{silent}");
    }
}
