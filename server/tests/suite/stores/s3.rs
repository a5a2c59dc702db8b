//! An S3 server (`s3s-fs` over a folder, verifying signatures) on loopback, whose answers can be made slow, short or
//! wrong.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bytes::Bytes;
use http_body_util::{BodyExt as _, Full};
use hyper::body::Incoming;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use s3s::auth::SimpleAuth;
use s3s::service::{S3Service, S3ServiceBuilder};
use tempfile::TempDir;
use tokio::runtime::Runtime;

const KEY: &str = "operator";
const SECRET: &str = "the-secret-of-a-test";

/// Fault of answers to reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    Nothing,
    /// Answers are late.
    Slow,
    /// Answers end early.
    Short,
    /// A byte is changed.
    Wrong,
    /// A byte is changed, in this many answers.
    WrongFor(u32),
    /// The store answers "come again later", this many times.
    BusyFor(u32),
    /// The object is missing.
    Missing,
}

/// The S3 server; it ends with the test.
pub(crate) struct S3 {
    pub(crate) root: TempDir,
    pub(crate) address: SocketAddr,
    fault: Arc<Mutex<Fault>>,
    reads: Arc<AtomicU64>,
    _runtime: Runtime,
}

impl S3 {
    /// Starts a server with one bucket, "bucket".
    pub(crate) fn start() -> Self {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("bucket")).unwrap();
        let mut service = S3ServiceBuilder::new(s3s_fs::FileSystem::new(root.path()).unwrap());
        service.set_auth(SimpleAuth::from_single(KEY, SECRET));
        let service = service.build();
        let (fault, reads) = (Arc::new(Mutex::new(Fault::Nothing)), Arc::new(AtomicU64::new(0)));
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let listener = runtime.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
        let address = listener.local_addr().unwrap();
        let shared = (Arc::clone(&fault), Arc::clone(&reads));
        runtime.spawn(async move {
            loop {
                let Ok((stream, _)) = listener.accept().await else { continue };
                let (service, (fault, reads)) = (service.clone(), shared.clone());
                let answer =
                    service_fn(move |request| answer(service.clone(), request, fault.clone(), reads.clone()));
                let connection = hyper::server::conn::http1::Builder::new();
                tokio::spawn(async move {
                    let _ = connection.serve_connection(TokioIo::new(stream), answer).await;
                });
            }
        });
        Self { root, address, fault, reads, _runtime: runtime }
    }

    pub(crate) fn set(&self, fault: Fault) {
        *self.fault.lock().unwrap() = fault;
    }

    /// Number of reads of objects or parts of them so far.
    pub(crate) fn reads(&self) -> u64 {
        self.reads.load(Ordering::SeqCst)
    }

    /// Environment variables that make a program use this server.
    pub(crate) fn environment(&self) -> [(&'static str, String); 5] {
        environment_of(&format!("http://{}", self.address))
    }
}

/// The same for an endpoint.
pub(crate) fn environment_of(endpoint: &str) -> [(&'static str, String); 5] {
    [
        ("AWS_ENDPOINT", endpoint.into()),
        ("AWS_ALLOW_HTTP", "true".into()),
        ("AWS_REGION", "us-east-1".into()),
        ("AWS_ACCESS_KEY_ID", KEY.into()),
        ("AWS_SECRET_ACCESS_KEY", SECRET.into()),
    ]
}

async fn answer(
    service: S3Service,
    request: Request<Incoming>,
    fault: Arc<Mutex<Fault>>,
    reads: Arc<AtomicU64>,
) -> Result<Response<Full<Bytes>>, Infallible> {
    let object = request.uri().path().matches('/').count() > 1;
    let read = request.method() == Method::GET && object;
    let now = if read { *fault.lock().unwrap() } else { Fault::Nothing };
    if read {
        reads.fetch_add(1, Ordering::SeqCst);
    }
    let plain = |status| {
        let mut answer = Response::new(Full::default());
        *answer.status_mut() = status;
        answer
    };
    match now {
        Fault::Missing => return Ok(plain(StatusCode::NOT_FOUND)),
        Fault::BusyFor(left) => {
            *fault.lock().unwrap() = if left > 1 { Fault::BusyFor(left - 1) } else { Fault::Nothing };
            return Ok(plain(StatusCode::SERVICE_UNAVAILABLE));
        }
        Fault::WrongFor(left) => {
            *fault.lock().unwrap() = if left > 1 { Fault::WrongFor(left - 1) } else { Fault::Nothing };
        }
        Fault::Slow => tokio::time::sleep(Duration::from_millis(300)).await,
        _ => {}
    }
    let Ok(answered) = service.call(request.map(s3s::Body::from)).await else {
        return Ok(plain(StatusCode::INTERNAL_SERVER_ERROR));
    };
    let (mut head, body) = answered.into_parts();
    let Ok(body) = body.collect().await else { return Ok(plain(StatusCode::INTERNAL_SERVER_ERROR)) };
    let mut body = body.to_bytes().to_vec();
    match now {
        Fault::Short if !body.is_empty() => {
            // Fewer bytes than requested, with a length that says that these are all.
            body.truncate(body.len() / 2);
            head.headers.insert("content-length", body.len().into());
        }
        Fault::Wrong | Fault::WrongFor(_) => {
            if let Some(last) = body.last_mut() {
                *last ^= 1;
            }
        }
        _ => {}
    }
    Ok(Response::from_parts(head, Full::new(Bytes::from(body))))
}
