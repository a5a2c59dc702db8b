//! Range requests over HTTP/1.1, on connections that are kept for later requests.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use http_body_util::{BodyExt as _, Empty};
use hyper::body::{Bytes, Incoming};
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_RANGE, HOST, LOCATION, RANGE, USER_AGENT,
};
use hyper::{Request, Response};
use hyper_util::rt::TokioIo;
use lodestream_protocol::message::{Close, CloseCode};
use rustls::RootCertStore;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::OnceCell;

use super::target::{Origin, Target};
use super::{Fetch, Report, Reports, Tasks};
use crate::net::addresses::{SystemResolver, first_to_answer, resolve};
use crate::net::server::Server;
use crate::net::steps::{STEP_TIMEOUT, open_tcp};
use crate::net::tls::Tls;
use crate::net::trust::Trust;
use crate::net::websocket::counting_in;
use crate::ranges::{ContentRange, RangeRequest, ResponseHead};

/// Most redirects that are followed.
const MAX_REDIRECTS: usize = 4;

/// A byte stream to a web server.
trait HttpStream: AsyncRead + AsyncWrite + Unpin + Send {}

impl<S: AsyncRead + AsyncWrite + Unpin + Send> HttpStream for S {}

/// Makes range requests to a web server.
#[derive(Debug)]
pub(in crate::net) struct HttpFetch {
    shared: Arc<Shared>,
    tasks: Tasks,
}

#[derive(Debug)]
struct Shared {
    scene: Target,
    /// Address and authorities of the scene's server.
    server: Server,
    received: Arc<AtomicU64>,
    /// The authorities' certificates: reading the system's takes tens of milliseconds, and there are six connections.
    roots: OnceCell<Arc<RootCertStore>>,
    /// Connections without a request.
    idle: Mutex<Vec<(Origin, SendRequest<Empty<Bytes>>)>>,
}

impl HttpFetch {
    /// Reads the published scene at `scene`.
    pub(in crate::net) fn new(scene: Target, server: Server) -> Self {
        let (received, roots, idle) = (Arc::default(), OnceCell::new(), Mutex::default());
        let shared = Shared { scene, server, received, roots, idle };
        Self { shared: Arc::new(shared), tasks: Tasks::default() }
    }
}

impl Fetch for HttpFetch {
    fn start(&mut self, request: RangeRequest, reports: Reports) {
        let shared = Arc::clone(&self.shared);
        let id = request.id;
        self.tasks.start(id, async move {
            let report = match shared.fetch(request, &reports).await {
                Ok(()) => Report::End,
                Err(close) if close.code.worth_retrying() => Report::Failed(close.reason),
                Err(close) => Report::Refused(close.reason),
            };
            let _ = reports.send((id, report)).await;
        });
    }

    fn abort(&mut self, id: u64) {
        self.tasks.abort(id);
    }

    fn ended(&mut self, id: u64) {
        self.tasks.abort(id);
    }

    fn received_bytes(&self) -> u64 {
        self.shared.received.load(Ordering::Relaxed)
    }
}

impl Shared {
    async fn fetch(&self, request: RangeRequest, reports: &Reports) -> Result<(), Close> {
        let left = || lost("the session has ended");
        let mut target = match request.object.name() {
            None => self.scene.clone(),
            Some(name) => self.scene.beside(&name),
        };
        let mut redirects = 0;
        let (connection, response) = loop {
            let (connection, response) = self.ask(&target, &request).await?;
            let location = response.headers().get(LOCATION).and_then(|value| value.to_str().ok());
            match location.filter(|_| response.status().is_redirection()) {
                Some(location) => {
                    target = target
                        .redirected(location)
                        .ok_or_else(|| lost(format!("the server redirects to {location}")))?;
                    redirects += 1;
                    if redirects > MAX_REDIRECTS {
                        return Err(lost("the server redirects too often"));
                    }
                }
                None => break (connection, response),
            }
        };
        let head = head_of(&response);
        let partial = head.status == 206;
        reports.send((request.id, Report::Head(head))).await.map_err(|_| left())?;
        if !partial {
            // Whatever follows is not read: the whole file may follow.
            return Ok(());
        }
        let mut body = response.into_body();
        while let Some(frame) = body.frame().await {
            let frame = frame.map_err(|why| reason(&why))?;
            if let Ok(bytes) = frame.into_data() {
                reports.send((request.id, Report::Body(bytes))).await.map_err(|_| left())?;
            }
        }
        self.idle().push((target.origin, connection));
        Ok(())
    }

    /// Sends a request; over a kept connection if there is one, and anew if that has been closed.
    async fn ask(
        &self,
        target: &Target,
        request: &RangeRequest,
    ) -> Result<(SendRequest<Empty<Bytes>>, Response<Incoming>), Close> {
        while let Some(mut kept) = self.take_idle(&target.origin) {
            if kept.ready().await.is_err() {
                continue;
            }
            if let Ok(response) = kept.send_request(message(target, request)?).await {
                return Ok((kept, response));
            }
        }
        let stream = self.connect(&target.origin).await?;
        let (mut connection, run) = handshake(TokioIo::new(stream)).await.map_err(|why| reason(&why))?;
        tokio::spawn(async move {
            if let Err(why) = run.await {
                tracing::debug!("a connection ended: {why}");
            }
        });
        let response =
            connection.send_request(message(target, request)?).await.map_err(|why| reason(&why))?;
        Ok((connection, response))
    }

    /// Opens a connection to an origin, over TLS if it says so.
    async fn connect(&self, origin: &Origin) -> Result<Box<dyn HttpStream>, Close> {
        let mut address = self.server.address.clone();
        let redirected = address.host != origin.host || address.port != origin.port;
        (address.host, address.port) = (origin.host.clone(), origin.port);
        let servers = resolve(&address, &SystemResolver).await?;
        let stream = first_to_answer(&address, &servers, open_tcp).await?;
        let stream = counting_in(stream, &self.received);
        if !origin.tls {
            return Ok(Box::new(stream));
        }
        // The fingerprint is of the address's own certificate.
        let trust = match self.server.address.pin.filter(|_| !redirected) {
            Some(pin) => pin.into(),
            None => {
                let roots = self.roots.get_or_try_init(|| self.server.authorities.roots()).await?;
                Trust::Roots(Arc::clone(roots))
            }
        };
        let tls = Tls::new(&origin.host, trust)?;
        Ok(Box::new(tls.open(stream, STEP_TIMEOUT).await?))
    }

    fn idle(&self) -> std::sync::MutexGuard<'_, Vec<(Origin, SendRequest<Empty<Bytes>>)>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take_idle(&self, origin: &Origin) -> Option<SendRequest<Empty<Bytes>>> {
        let mut idle = self.idle();
        let at = idle.iter().rposition(|(of, _)| of == origin)?;
        Some(idle.swap_remove(at).1)
    }
}

fn message(target: &Target, request: &RangeRequest) -> Result<Request<Empty<Bytes>>, Close> {
    let mut builder = Request::get(&target.path)
        .header(HOST, target.origin.authority())
        .header(RANGE, format!("bytes={}-{}", request.range.start, request.range.end.saturating_sub(1)))
        // Compressed bytes would not be the object's.
        .header(ACCEPT_ENCODING, "identity")
        .header(USER_AGENT, concat!("lodestream/", env!("CARGO_PKG_VERSION")));
    if request.reload {
        builder = builder.header(CACHE_CONTROL, "no-cache");
    }
    builder.body(Empty::new()).map_err(|why| lost(format!("{}: {why}", target.path)))
}

fn head_of(response: &Response<Incoming>) -> ResponseHead {
    let header = |name| response.headers().get(name).and_then(|value| value.to_str().ok());
    ResponseHead {
        status: response.status().as_u16(),
        content_range: header(CONTENT_RANGE).and_then(ContentRange::parse),
        encoded: header(CONTENT_ENCODING).is_some_and(|encoding| !encoding.eq_ignore_ascii_case("identity")),
    }
}

/// A failure that may pass.
fn lost(why: impl Into<String>) -> Close {
    Close::new(CloseCode::Lost, why)
}

/// An error with its cause, which alone tells what happened.
fn reason(why: &hyper::Error) -> Close {
    match std::error::Error::source(why) {
        Some(cause) => lost(format!("{why}: {cause}")),
        None => lost(why.to_string()),
    }
}
