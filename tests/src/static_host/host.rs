//! A web server for files, with the faults that hosts have.

use std::io::{BufRead as _, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use rustls::pki_types::pem::PemObject as _;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::{ServerConfig, ServerConnection, StreamOwned};

use crate::support::authority::Files;

/// First byte of a TLS connection.
const TLS_HANDSHAKE: u8 = 22;

/// What the host does with a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// Sends the whole file with status 200.
    NoRanges,
    /// Sends another range than it was asked for, and says so.
    OtherRange,
    /// Says one range and sends fewer bytes.
    Short,
    /// Sends the body as gzip, or says so.
    Gzip,
    /// Redirects to the same path below `/moved`.
    Redirect,
    /// Closes the connection after each response.
    Close,
    /// Closes the connection instead of a response.
    HangUp,
    /// Does not allow pages of other origins.
    NoCors,
}

/// The host; it stops with the process.
pub(crate) struct Host {
    pub(crate) address: SocketAddr,
    tls: bool,
    shared: Arc<Shared>,
}

struct Shared {
    folder: PathBuf,
    fault: Mutex<Option<Fault>>,
    /// Whether packs only have the fault.
    packs_only: AtomicBool,
    open: AtomicUsize,
    most_open: AtomicUsize,
    accepted: AtomicUsize,
    requests: Mutex<Vec<String>>,
}

impl Host {
    pub(crate) fn start(folder: &Path) -> Self {
        Self::start_with(folder, None)
    }

    /// Over TLS, with a certificate and key from files.
    pub(crate) fn start_tls(folder: &Path, files: &Files) -> Self {
        let certificate = CertificateDer::from_pem_file(&files.chain).unwrap();
        let key = PrivateKeyDer::from_pem_file(&files.key).unwrap();
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let config = ServerConfig::builder_with_provider(provider)
            .with_safe_default_protocol_versions()
            .unwrap()
            .with_no_client_auth()
            .with_single_cert(vec![certificate], key)
            .unwrap();
        Self::start_with(folder, Some(Arc::new(config)))
    }

    fn start_with(folder: &Path, tls: Option<Arc<ServerConfig>>) -> Self {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let address = listener.local_addr().unwrap();
        let shared = Arc::new(Shared {
            folder: folder.to_owned(),
            fault: Mutex::new(None),
            packs_only: AtomicBool::new(false),
            open: AtomicUsize::new(0),
            most_open: AtomicUsize::new(0),
            accepted: AtomicUsize::new(0),
            requests: Mutex::default(),
        });
        let (host, is_tls) = (Arc::clone(&shared), tls.is_some());
        std::thread::spawn(move || {
            while let Ok((stream, _)) = listener.accept() {
                let (host, tls) = (Arc::clone(&host), tls.clone());
                host.accepted.fetch_add(1, Ordering::SeqCst);
                std::thread::spawn(move || {
                    let open = host.open.fetch_add(1, Ordering::SeqCst) + 1;
                    host.most_open.fetch_max(open, Ordering::SeqCst);
                    let _ = match tls {
                        None => host.serve(stream),
                        Some(config) => {
                            host.serve(StreamOwned::new(ServerConnection::new(config).unwrap(), stream))
                        }
                    };
                    host.open.fetch_sub(1, Ordering::SeqCst);
                });
            }
        });
        Self { address, tls: is_tls, shared }
    }

    pub(crate) fn with(self, fault: Fault) -> Self {
        self.set(Some(fault));
        self
    }

    pub(crate) fn set(&self, fault: Option<Fault>) {
        *self.shared.fault.lock().unwrap() = fault;
    }

    /// Packs alone have the fault.
    pub(crate) fn in_packs(self) -> Self {
        self.shared.packs_only.store(true, Ordering::SeqCst);
        self
    }

    pub(crate) fn requests(&self) -> Vec<String> {
        self.shared.requests.lock().unwrap().clone()
    }

    /// Most connections that were open at once.
    pub(crate) fn most_connections(&self) -> usize {
        self.shared.most_open.load(Ordering::SeqCst)
    }

    /// Number of connections so far.
    pub(crate) fn connections(&self) -> usize {
        self.shared.accepted.load(Ordering::SeqCst)
    }

    /// Address of a file. Certificates of tests are for the name.
    pub(crate) fn url(&self, name: &str) -> String {
        if self.tls {
            return format!("https://localhost:{}/{name}", self.address.port());
        }
        format!("http://{}/{name}", self.address)
    }

    pub(crate) fn scene(&self) -> lodestream_client::net::Address {
        self.url("small.lss").parse().unwrap()
    }
}

impl Shared {
    fn serve(&self, stream: impl Read + Write) -> std::io::Result<()> {
        let mut reader = BufReader::new(stream);
        if reader.fill_buf()?.first() == Some(&TLS_HANDSHAKE) {
            return reader.get_mut().write_all(b"HTTP/1.1 400 Bad Request\r\nconnection: close\r\n\r\n");
        }
        loop {
            let (mut path, mut range) = (String::new(), None);
            loop {
                let mut line = String::new();
                if reader.read_line(&mut line)? == 0 {
                    return Ok(());
                }
                let line = line.trim_end().to_ascii_lowercase();
                if let Some(rest) = line.strip_prefix("get ") {
                    path = rest.split(' ').next().unwrap_or_default().to_owned();
                } else if let Some(bytes) = line.strip_prefix("range: bytes=") {
                    let (start, last) = bytes.split_once('-').unwrap();
                    range = Some((start.parse::<usize>().unwrap(), last.parse::<usize>().unwrap()));
                } else if line.is_empty() {
                    break;
                }
            }
            self.requests.lock().unwrap().push(path.clone());
            if !self.answer(reader.get_mut(), &path, range)? {
                return Ok(());
            }
        }
    }

    /// Answers a request; returns whether the connection stays open.
    fn answer(
        &self,
        stream: &mut impl Write,
        path: &str,
        range: Option<(usize, usize)>,
    ) -> std::io::Result<bool> {
        let applies = !self.packs_only.load(Ordering::SeqCst) || path.contains("/packs/");
        let fault = self.fault.lock().unwrap().filter(|_| applies);
        if fault == Some(Fault::HangUp) {
            return Ok(false);
        }
        if fault == Some(Fault::Redirect) && !path.starts_with("/moved") {
            write!(stream, "HTTP/1.1 302 Found\r\nlocation: /moved{path}\r\ncontent-length: 0\r\n\r\n")?;
            return Ok(true);
        }
        let name = path.strip_prefix("/moved").unwrap_or(path).trim_start_matches('/');
        let Ok(file) = std::fs::read(self.folder.join(name)) else {
            let allowed =
                if fault == Some(Fault::NoCors) { "" } else { "access-control-allow-origin: *\r\n" };
            write!(stream, "HTTP/1.1 404 Not Found\r\n{allowed}content-length: 9\r\n\r\nnot found")?;
            return Ok(true);
        };
        let total = file.len();
        let mut headers = format!("content-type: {}\r\n", content_type(name));
        if fault != Some(Fault::NoCors) {
            headers += "access-control-allow-origin: *\r\n";
        }
        let (Some((start, last)), false) = (range, fault == Some(Fault::NoRanges)) else {
            write!(stream, "HTTP/1.1 200 OK\r\ncontent-length: {total}\r\n{headers}\r\n")?;
            stream.write_all(&file)?;
            return Ok(true);
        };
        let shift = usize::from(fault == Some(Fault::OtherRange));
        let (start, end) = (start + shift, (last + 1 + shift).min(total));
        if start >= end {
            write!(stream, "HTTP/1.1 416 Range Not Satisfiable\r\n{headers}content-length: 0\r\n\r\n")?;
            return Ok(true);
        }
        if fault == Some(Fault::Gzip) {
            headers += "content-encoding: gzip\r\n";
        }
        write!(
            stream,
            "HTTP/1.1 206 Partial Content\r\ncontent-length: {}\r\ncontent-range: bytes {start}-{}/{total}\r\n{headers}\r\n",
            end - start,
            end - 1
        )?;
        let sent = if fault == Some(Fault::Short) { start + (end - start) / 2 } else { end };
        stream.write_all(&file[start..sent])?;
        Ok(!matches!(fault, Some(Fault::Short | Fault::Close)))
    }
}

/// Content types that browsers need for pages.
fn content_type(name: &str) -> &'static str {
    match name.rsplit_once('.').map(|(_, extension)| extension) {
        Some("html") => "text/html",
        Some("js") => "text/javascript",
        Some("css") => "text/css",
        Some("wasm") => "application/wasm",
        _ => "application/octet-stream",
    }
}
