//! The shipped daemon in a child process, whose memory and processor time are its own. They come from Linux's `/proc`.

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;

use anyhow::Context as _;
use lodestream_client::net::Pin;
use lodestream_protocol::source::SceneSource;
use lodestream_server::daemon::{Daemon, DaemonOptions, SessionSettings};
use tokio::runtime::Builder;
use tokio::sync::mpsc;

/// Ticks of processor time in a second, as `/proc` counts them on every Linux (`USER_HZ`).
const TICKS_PER_S: f64 = 100.0;

/// How many sessions there may be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Limits {
    /// As the daemon is shipped.
    Shipped,
    /// As many for one address as for all: every client is on this machine.
    Lifted,
}

/// Serves a scene until standard input ends. Prints the listeners' addresses and the certificate's fingerprint, on
/// one line.
///
/// # Errors
/// What keeps the daemon from being started.
pub fn serve(scene: Arc<dyn SceneSource>, rate_bits_per_s: u64, limits: Limits) -> anyhow::Result<()> {
    let folder = tempfile::tempdir().context("no folder for the certificate")?;
    let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let defaults = SessionSettings::default();
    let sessions = match limits {
        Limits::Shipped => defaults,
        // None may use the eighth that is kept for others.
        Limits::Lifted => SessionSettings {
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
    let serving = runtime.spawn(daemon.serve(stopped));
    // Ends with the parent, however that ends.
    let _ = std::io::stdin().read_to_end(&mut Vec::new());
    let _ = (stop.try_send(()), stop.try_send(()));
    let _ = runtime.block_on(serving);
    Ok(())
}

/// A server in a process of its own.
pub(crate) struct Server {
    child: Child,
    quic: SocketAddr,
    http: SocketAddr,
    pin: Pin,
}

/// Where a server is reached.
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
        limits: Limits,
    ) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("this program cannot be found")?;
        let mut command = Command::new(&program);
        command.args(["load", scene, "--serve", "--rate-bits-per-s", &rate_bits_per_s.to_string()]);
        if limits == Limits::Shipped {
            command.arg("--shipped-limits");
        }
        if let Some(cache) = cache {
            command.arg("--cache").arg(cache);
        }
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("{} cannot be run", program.display()))?;
        let mut line = String::new();
        if let Some(said) = child.stdout.take() {
            BufReader::new(said).read_line(&mut line)?;
        }
        match addresses(&line) {
            Some((quic, http, pin)) => Ok(Self { child, quic, http, pin }),
            None => {
                let _ = child.kill();
                let _ = child.wait();
                anyhow::bail!("the server did not start")
            }
        }
    }

    /// Resident memory in bytes.
    pub(crate) fn memory_bytes(&self) -> anyhow::Result<u64> {
        let file = format!("/proc/{}/status", self.child.id());
        let text = std::fs::read_to_string(&file).with_context(|| format!("{file}: this needs Linux"))?;
        let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = line.and_then(|line| line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
        Ok(kib.with_context(|| format!("{file}: there is no VmRSS"))? * 1024)
    }

    /// Processor time so far, in seconds.
    pub(crate) fn cpu_s(&self) -> anyhow::Result<f64> {
        let file = format!("/proc/{}/stat", self.child.id());
        let text = std::fs::read_to_string(&file).with_context(|| format!("{file}: this needs Linux"))?;
        // The program's name stands in parentheses and may hold anything; utime and stime are fields 14 and 15.
        let fields = text.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
        let ticks = fields.map(|field| field.parse::<f64>().ok()).collect::<Option<Vec<f64>>>();
        let ticks =
            ticks.filter(|ticks| ticks.len() == 2).with_context(|| format!("{file}: is not understood"))?;
        Ok(ticks.iter().sum::<f64>() / TICKS_PER_S)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Its standard input ends here.
        drop(self.child.stdin.take());
        let _ = self.child.wait();
    }
}

/// What a server says of itself: `quic://HOST:PORT#sha256=… ws://HOST:PORT/`.
fn addresses(line: &str) -> Option<(SocketAddr, SocketAddr, Pin)> {
    let (quic, http) = line.trim().split_once(' ')?;
    let (quic, fingerprint) = quic.strip_prefix("quic://")?.split_once("#sha256=")?;
    let digits = data_encoding::HEXLOWER.decode(fingerprint.as_bytes()).ok()?;
    let http = http.strip_prefix("ws://")?.strip_suffix('/')?;
    Some((quic.parse().ok()?, http.parse().ok()?, Pin::Certificate(digits.try_into().ok()?)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_is_found_by_what_it_says() {
        let digits = "0f".repeat(32);
        let line = format!("quic://127.0.0.1:4433#sha256={digits} ws://127.0.0.1:8080/\n");
        let (quic, http, pin) = addresses(&line).unwrap();
        assert_eq!((quic.port(), http.port(), pin), (4433, 8080, Pin::Certificate([15; 32])));
        assert!(addresses("").is_none() && addresses(&line.replace("0f", "0")).is_none());
    }
}
