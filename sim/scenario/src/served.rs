//! The shipped daemon in a child process, with memory, processor time and panics of its own.

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use anyhow::Context as _;
use lodestream_client::net::Pin;
use lodestream_daemon::{Daemon, DaemonOptions, SessionSettings};
use lodestream_protocol::source::SceneSource;
use tokio::runtime::Builder;
use tokio::sync::mpsc;

use crate::bare_sender::serve_bare;
use crate::process::Process;

/// The server in the child process, and its session limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Serving {
    /// The shipped daemon.
    Shipped,
    /// The daemon without the session limit per address: all clients are on this machine.
    Lifted,
    /// A bare sender (`crate::bare_sender`).
    Bare,
}

/// Serves a scene until standard input ends. Prints the listeners' addresses and the certificate's fingerprint on one
/// line.
///
/// # Errors
/// A daemon that cannot be started.
pub fn serve(scene: Arc<dyn SceneSource>, rate_bits_per_s: u64, serving: Serving) -> anyhow::Result<()> {
    if serving == Serving::Bare {
        return serve_bare(&scene, rate_bits_per_s);
    }
    let folder = tempfile::tempdir().context("no folder for the certificate")?;
    let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let defaults = SessionSettings::default();
    let sessions = match serving {
        Serving::Shipped | Serving::Bare => defaults,
        // No address may use the eighth that is reserved for others.
        Serving::Lifted => SessionSettings {
            max_sessions: defaults.max_sessions * 2,
            max_sessions_per_address: Some(defaults.max_sessions),
            ..defaults
        },
    };
    let sessions = SessionSettings { rate_bits_per_s: Some(rate_bits_per_s), ..sessions };
    let options =
        DaemonOptions { listen: Some(any), http: Some(any), sessions, ..DaemonOptions::new(folder.path()) };
    let runtime = Builder::new_multi_thread().enable_all().build()?;
    let daemon = runtime.block_on(Daemon::bind(options, scene))?;
    println!("{}", daemon.urls().join(" "));
    let (stop, stopped) = mpsc::channel(2);
    let daemon = runtime.spawn(daemon.serve(stopped));
    // Ends with the parent process, even if that is killed.
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
    let _ = (stop.try_send(()), stop.try_send(()));
    let _ = runtime.block_on(daemon);
    Ok(())
}

/// A server in a child process.
pub(crate) struct Server {
    child: Child,
    quic: SocketAddr,
    http: SocketAddr,
    pin: Pin,
    panics: Arc<AtomicU32>,
}

/// Addresses of a server.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Address {
    pub(crate) quic: SocketAddr,
    pub(crate) http: SocketAddr,
    pub(crate) pin: Pin,
}

impl Server {
    pub(crate) fn at(&self) -> Address {
        Address { quic: self.quic, http: self.http, pin: self.pin }
    }

    pub(crate) fn start(
        scene: &str,
        cache: Option<&Path>,
        rate_bits_per_s: u64,
        serving: Serving,
    ) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("this program cannot be found")?;
        let mut command = Command::new(&program);
        command.args(["load", scene, "--serve", "--rate-bits-per-s", &rate_bits_per_s.to_string()]);
        match serving {
            Serving::Shipped => drop(command.arg("--shipped-limits")),
            Serving::Lifted => {}
            Serving::Bare => drop(command.arg("--bare")),
        }
        if let Some(cache) = cache {
            command.arg("--cache").arg(cache);
        }
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("{} cannot be run", program.display()))?;
        let panics = Arc::new(AtomicU32::new(0));
        if let Some(said) = child.stderr.take() {
            let panics = Arc::clone(&panics);
            std::thread::Builder::new().name("server's log".into()).spawn(move || pass_on(said, &panics))?;
        }
        let mut line = String::new();
        if let Some(said) = child.stdout.take() {
            BufReader::new(said).read_line(&mut line)?;
        }
        match addresses(&line) {
            Some((quic, http, pin)) => Ok(Self { child, quic, http, pin, panics }),
            None => {
                let _ = child.kill();
                let _ = child.wait();
                anyhow::bail!("the server did not start")
            }
        }
    }

    /// Resident memory in bytes.
    pub(crate) fn memory_bytes(&self) -> anyhow::Result<u64> {
        Process::of(self.child.id()).memory_bytes()
    }

    /// Processor time so far, in seconds.
    pub(crate) fn cpu_s(&self) -> anyhow::Result<f64> {
        Process::of(self.child.id()).cpu_s()
    }

    /// Wake-ups of its threads so far.
    pub(crate) fn wake_ups(&self) -> anyhow::Result<u64> {
        Process::of(self.child.id()).wake_ups()
    }

    /// Panics of threads and tasks so far, counted on its standard error.
    pub(crate) fn panics(&self) -> u32 {
        self.panics.load(Ordering::Relaxed)
    }

    /// Whether the process still runs.
    pub(crate) fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Closes its standard input.
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

/// Forwards a server's standard error and counts the panics in it.
fn pass_on(said: ChildStderr, panics: &AtomicU32) {
    for line in BufReader::new(said).lines().map_while(Result::ok) {
        panics.fetch_add(u32::from(tells_a_panic(&line)), Ordering::Relaxed);
        eprintln!("{line}");
    }
}

/// Whether a line is the standard library's report of a panic: `thread 'main' (123) panicked at src/main.rs:1:2:`.
fn tells_a_panic(line: &str) -> bool {
    line.trim_start().starts_with("thread '") && line.contains(" panicked at ")
}

/// Parses the line that a server prints: `quic://HOST:PORT#PIN ws://HOST:PORT/`.
fn addresses(line: &str) -> Option<(SocketAddr, SocketAddr, Pin)> {
    let (quic, http) = line.trim().split_once(' ')?;
    let (quic, pin) = quic.strip_prefix("quic://")?.split_once('#')?;
    let http = http.strip_prefix("ws://")?.strip_suffix('/')?;
    Some((quic.parse().ok()?, http.parse().ok()?, pin.parse().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_are_recognised_in_log_lines() {
        assert!(tells_a_panic("thread 'tokio-runtime-worker' (4) panicked at server/src/lib.rs:1:2:"));
        assert!(
            !tells_a_panic("note: run with `RUST_BACKTRACE=1`") && !tells_a_panic("a session panicked at x")
        );
    }

    #[test]
    fn a_server_is_found_by_its_printed_addresses() {
        let digits = "0f".repeat(32);
        for (kind, expected) in [("sha256", Pin::Certificate([15; 32])), ("spki-sha256", Pin::Key([15; 32]))]
        {
            let line = format!("quic://127.0.0.1:4433#{kind}={digits} ws://127.0.0.1:8080/\n");
            let (quic, http, pin) = addresses(&line).unwrap();
            assert_eq!((quic.port(), http.port(), pin), (4433, 8080, expected));
            assert!(addresses(&line.replace("0f", "0")).is_none());
        }
        assert!(addresses("").is_none());
    }
}
