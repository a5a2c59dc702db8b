//! The server as a process: output, answers, how it ends.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use crate::process::KilledOnDrop;

/// Time limit of every step, far above what it takes.
const LIMIT: Duration = Duration::from_secs(60);

/// A folder with a model of one triangle.
fn folder_with_model() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_model(&folder.path().join("model.obj"));
    folder
}

fn write_model(file: &Path) {
    std::fs::write(file, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
}

/// A server that is killed at the end of the test.
struct Server {
    child: KilledOnDrop,
    /// `HOST:PORT` of the HTTP port; below, of the administration port.
    http: String,
    admin: String,
}

impl Server {
    fn start(folder: &Path) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
        command.args(["serve", "model.obj"]);
        Self::started(command, folder)
    }

    /// Starts a server by a command whose last arguments are the files to serve.
    fn started(mut command: Command, folder: &Path) -> Self {
        let page = folder.join("page");
        std::fs::create_dir_all(&page).unwrap();
        let description = r#"<script type="application/json" id="lodestream-server">{}</script>"#;
        std::fs::write(page.join("index.html"), description).unwrap();
        let mut child = command
            .args([
                "--listen",
                "127.0.0.1:0",
                "--http",
                "127.0.0.1:0",
                "--admin",
                "127.0.0.1:0",
                "--cache",
                "cache",
                "--page",
                "page",
            ])
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let mut url = |scheme: &str| {
            let line = lines.next().expect("the server has ended").unwrap();
            line.strip_prefix(scheme).unwrap_or_else(|| panic!("{line}")).to_owned()
        };
        let quic = url("quic://127.0.0.1:");
        let (_, fingerprint) = quic.split_once("#spki-sha256=").unwrap();
        assert!(fingerprint.len() == 64 && fingerprint.bytes().all(|b| b.is_ascii_hexdigit()), "{quic}");
        let http = url("ws://").trim_end_matches('/').to_owned();
        let page = url("http://");
        let admin = url("http://").trim_end_matches("/metrics").to_owned();
        assert_eq!(page, format!("{http}/"), "the page is on the HTTP port");
        Self { child: KilledOnDrop(child), http, admin }
    }

    /// Requests a page of the administration port.
    fn get(&self, path: &str) -> String {
        Self::get_from(&self.admin, path)
    }

    fn get_from(address: &str, path: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        write!(stream, "GET {path} HTTP/1.1\r\nHost: s\r\nConnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    /// Makes a request whose refusal is logged.
    fn log_a_line(&self) {
        let mut stream = TcpStream::connect(&self.http).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        let request = "GET / HTTP/1.1\r\nHost: s\r\nConnection: upgrade\r\nUpgrade: websocket\r\nOrigin: https://e\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 403"), "{answer}");
    }

    fn signal(&self, name: &str) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
    }

    /// Waits for the end; returns the exit status and standard error.
    fn ended(mut self) -> (ExitStatus, String) {
        let until = Instant::now() + LIMIT;
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < until, "the server does not end");
            std::thread::sleep(Duration::from_millis(10));
        };
        let mut errors = String::new();
        if let Some(mut stderr) = self.child.stderr.take() {
            stderr.read_to_string(&mut errors).unwrap();
        }
        (status, errors)
    }
}

#[test]
fn a_server_starts_from_its_cache_and_ends_on_a_signal() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("model.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    )
    .unwrap();
    for (signal, prepares) in [("-TERM", true), ("-INT", false)] {
        let server = Server::start(folder.path());
        assert!(server.get("/health").starts_with("HTTP/1.1 200"));
        let page = Server::get_from(&server.http, "/");
        assert!(page.starts_with("HTTP/1.1 200") && page.contains(r#""scene":"model""#), "{page}");
        assert!(server.get("/metrics").contains("lodestream_sessions{transport=\"quic\"} 0"));
        assert!(Server::get_from(&server.http, "/health").starts_with("HTTP/1.1 200"));
        assert!(
            Server::get_from(&server.http, "/metrics").starts_with("HTTP/1.1 404"),
            "not for untrusted peers"
        );
        server.signal(signal);
        let (status, errors) = server.ended();
        assert!(status.success(), "{signal}: {status}: {errors}");
        assert_eq!(errors.contains("prepared in"), prepares, "{signal}: {errors}");
    }
}

#[test]
fn an_unread_log_does_not_block_the_server() {
    let folder = folder_with_model();
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.args(["serve", "model.obj", "--log-limit", "off"]);
    let server = Server::started(command, folder.path());
    // More lines than the pipe and the server's queue hold.
    for _ in 0..2500 {
        server.log_a_line();
    }
    assert!(server.get("/health").starts_with("HTTP/1.1 200"));
    let metrics = server.get("/metrics");
    let dropped = metrics.lines().find_map(|line| line.strip_prefix("lodestream_dropped_log_lines "));
    assert!(dropped.is_some_and(|count| count.parse::<u64>().unwrap() > 0), "{dropped:?}");
    server.signal("-TERM");
    let (status, _) = server.ended();
    assert!(status.success(), "{status}");
}

#[test]
fn log_format_json_writes_one_object_per_line() {
    let folder = folder_with_model();
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.args(["serve", "model.obj", "--log-limit", "1"]).env("LODESTREAM_LOG_FORMAT", "json");
    let server = Server::started(command, folder.path());
    for _ in 0..10 {
        server.log_a_line();
    }
    server.signal("-TERM");
    let (status, errors) = server.ended();
    assert!(status.success(), "{status}: {errors}");
    // Preparation prints lines before the log begins.
    let lines = errors.lines().skip_while(|line| !line.starts_with('{'));
    let lines: Vec<serde_json::Value> = lines.map(|line| serde_json::from_str(line).unwrap()).collect();
    let said = |text: &str| lines.iter().filter(|line| line["fields"]["message"] == text).count();
    assert_eq!((said("serving"), said("shut down")), (1, 1), "{errors}");
    // Each of the ten refusals is a line or counted in one.
    let refused = said("session refused: a web page that --allow-origin does not name");
    let counted = lines.iter().filter_map(|line| line["fields"]["left_out"].as_u64()).sum::<u64>();
    assert_eq!(refused as u64 + counted, 10, "{errors}");
}

#[test]
fn a_closed_log_pipe_does_not_end_the_server() {
    let folder = folder_with_model();
    let mut server = Server::start(folder.path());
    drop(server.child.stderr.take());
    for _ in 0..20 {
        server.log_a_line();
    }
    assert!(server.get("/health").starts_with("HTTP/1.1 200"));
    server.signal("-TERM");
    let (status, _) = server.ended();
    assert!(status.success(), "{status}");
}

#[test]
fn an_address_in_use_is_an_error_of_one_line() {
    let folder = folder_with_model();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = Command::new(env!("CARGO_BIN_EXE_lodestream-server"))
        .args([
            "serve",
            "model.obj",
            "--listen",
            "127.0.0.1:0",
            "--http",
            &address,
            "--admin",
            "off",
            "--cache",
            "cache",
        ])
        .current_dir(folder.path())
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    let errors: Vec<&str> = errors.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(output.status.code(), Some(2), "{errors:?}");
    assert!(errors.len() == 1 && errors[0].contains(&address), "{errors:?}");
}

#[test]
fn a_scene_with_more_assets_than_open_files_is_served() {
    let folder = tempfile::tempdir().unwrap();
    let names: Vec<String> = (0..200).map(|i| format!("{i}.obj")).collect();
    for name in &names {
        write_model(&folder.path().join(name));
    }
    let mut command = Command::new("sh");
    command.args([
        "-c",
        "ulimit -n 160 && exec \"$0\" serve \"$@\"",
        env!("CARGO_BIN_EXE_lodestream-server"),
    ]);
    command.args(&names);
    let server = Server::started(command, folder.path());
    assert!(server.get("/health").starts_with("HTTP/1.1 200"));
    server.signal("-TERM");
    let (status, errors) = server.ended();
    assert!(status.success(), "{status}: {errors}");
}

#[test]
fn a_hangup_does_not_end_the_server() {
    let folder = folder_with_model();
    let server = Server::start(folder.path());
    server.signal("-HUP");
    assert!(server.get("/health").starts_with("HTTP/1.1 200"));
    server.signal("-HUP");
    server.signal("-TERM");
    let (status, errors) = server.ended();
    assert!(status.success(), "{status}: {errors}");
    assert!(errors.contains("SIGHUP"), "{errors}");
}

#[test]
fn sighup_applies_a_changed_configuration_and_ignores_an_invalid_one() {
    let folder = folder_with_model();
    let write = |text: &str| std::fs::write(folder.path().join("server.toml"), text).unwrap();
    write("files = 'model.obj'\nrate = '2Mbit'\n");
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.args(["serve", "--config", "server.toml"]);
    let server = Server::started(command, folder.path());
    let until = |line: &str| {
        let began = Instant::now();
        while !server.get("/metrics").lines().any(|l| l == line) {
            assert!(began.elapsed() < LIMIT, "{line}");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    until("lodestream_rate_bits_per_second 2000000");
    write("files = 'model.obj'\nrate = 'fast'\n");
    server.signal("-HUP");
    write("files = 'model.obj'\nrate = '4Mbit'\ntotal-rate = '9Mbit'\nallow-origin = 'https://e'\n");
    server.signal("-HUP");
    until("lodestream_rate_bits_per_second 4000000");
    until("lodestream_total_rate_bits_per_second 9000000");
    write("files = 'model.obj'\nno-such-key = 1\n");
    server.signal("-HUP");
    server.signal("-TERM");
    let (status, errors) = server.ended();
    assert!(status.success(), "{status}: {errors}");
    assert!(errors.contains("settings reloaded"), "{errors}");
}

#[cfg(target_os = "linux")]
#[test]
fn the_soft_limit_of_open_files_is_raised() {
    let folder = folder_with_model();
    let mut command = Command::new("sh");
    let serve = "ulimit -S -n 64 && exec \"$0\" serve \"$@\"";
    command.args(["-c", serve, env!("CARGO_BIN_EXE_lodestream-server"), "model.obj"]);
    let server = Server::started(command, folder.path());
    let limits = std::fs::read_to_string(format!("/proc/{}/limits", server.child.id())).unwrap();
    let files = limits.lines().find_map(|line| line.strip_prefix("Max open files")).unwrap();
    let mut files = files.split_whitespace().map(|number| number.parse().unwrap_or(u64::MAX));
    let (soft, hard) = (files.next().unwrap(), files.next().unwrap());
    assert_eq!(soft, hard.min(65_536), "{limits}");
}

/// On a full disk the server loses log lines, but sessions and signals are handled.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_while_serving_loses_only_log_lines() {
    for (limit, log) in [("ulimit -f 8 && ", "log"), ("", "/dev/full")] {
        let folder = folder_with_model();
        let serve = format!("{limit}exec \"$0\" serve \"$@\" 2>{log}");
        let mut command = Command::new("sh");
        command.args(["-c", &serve, env!("CARGO_BIN_EXE_lodestream-server"), "model.obj"]);
        command.args(["--log-limit", "off"]);
        let server = Server::started(command, folder.path());
        let full = || log == "/dev/full" || std::fs::metadata(folder.path().join(log)).unwrap().len() >= 4096;
        let begun = Instant::now();
        let mut after = 0;
        while after < 50 {
            assert!(begun.elapsed() < LIMIT, "nothing is logged");
            assert!(server.get("/health").starts_with("HTTP/1.1 200"), "{log}");
            server.log_a_line();
            after += u32::from(full());
        }
        server.signal("-TERM");
        let (status, errors) = server.ended();
        assert!(status.success(), "{log}: {status}: {errors}");
    }
}

/// A caller that does not need the addresses may close standard output, before or while they are printed.
#[test]
fn a_closed_standard_output_does_not_end_the_server() {
    let folder = folder_with_model();
    for closed in [">&-", ">/dev/full"] {
        let serve = format!(
            "exec \"$0\" serve model.obj --listen 127.0.0.1:0 --http 127.0.0.1:0 --admin off --cache cache {closed}"
        );
        let mut child = Command::new("sh")
            .args(["-c", &serve, env!("CARGO_BIN_EXE_lodestream-server")])
            .current_dir(folder.path())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let serving = lines.find(|line| {
            line.as_ref().unwrap().contains("serving") || line.as_ref().unwrap().contains("panicked")
        });
        let _ = child.kill();
        let _ = child.wait();
        let serving = serving.expect("it has ended").unwrap();
        assert!(serving.contains("serving"), "{closed}: {serving}");
    }
}

/// A unit of `Type=notify` waits for this notification and shows the status.
#[test]
fn the_service_manager_is_notified_of_readiness_and_draining() {
    let folder = folder_with_model();
    let path = folder.path().join("notify");
    let manager = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    manager.set_read_timeout(Some(LIMIT)).unwrap();
    let hear = || {
        let mut bytes = [0; 4096];
        let length = manager.recv(&mut bytes).expect("nothing is told");
        String::from_utf8(bytes[..length].to_vec()).unwrap()
    };
    let mut command = Command::new(env!("CARGO_BIN_EXE_lodestream-server"));
    command.args(["serve", "model.obj", "--drain", "7"]).env("NOTIFY_SOCKET", &path);
    let server = Server::started(command, folder.path());
    assert_eq!(hear(), "READY=1\n");
    assert!(server.get("/ready").starts_with("HTTP/1.1 200"));
    server.signal("-TERM");
    let told = hear();
    // Seven seconds to drain, and two for last messages.
    for line in ["STOPPING=1", "STATUS=draining", "EXTEND_TIMEOUT_USEC=9000000"] {
        assert!(told.lines().any(|told| told == line), "{line} of {told}");
    }
    let (status, errors) = server.ended();
    assert!(status.success(), "{status}: {errors}");
}
