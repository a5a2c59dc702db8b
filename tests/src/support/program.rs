//! The viewer's program, in a window of a virtual X server or headless.

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::x11::OpenWindow;

/// Time limit of a run; far above what it needs on a busy machine without a GPU.
pub(crate) const RUN_LIMIT: Duration = Duration::from_secs(240);

/// A virtual X server, or Wayland compositor, on its own display.
pub(crate) struct Display {
    server: Child,
    name: String,
    /// Runtime folder of a Wayland compositor, which holds its socket.
    runtime: Option<TempDir>,
}

impl Display {
    pub(crate) fn start() -> Self {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect(
                "these tests need Xvfb (Debian and Ubuntu: apt-get install xvfb), or LODESTREAM_SKIP_GPU=1",
            );
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        assert!(!number.trim().is_empty(), "Xvfb has ended");
        Self { server, name: format!(":{}", number.trim()), runtime: None }
    }

    /// A Wayland compositor without a screen.
    pub(crate) fn wayland() -> Self {
        let (runtime, name) = (tempfile::tempdir().unwrap(), "wayland-test");
        let mut server = Command::new("weston")
            .args(["--backend=headless-backend.so", "--idle-time=0", "--socket", name])
            .env("XDG_RUNTIME_DIR", runtime.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("these tests need weston (Debian and Ubuntu: apt-get install weston), or LODESTREAM_SKIP_GPU=1");
        let until = Instant::now() + RUN_LIMIT;
        while !runtime.path().join(name).exists() {
            assert!(server.try_wait().unwrap().is_none(), "weston has ended");
            assert!(Instant::now() < until, "weston has no socket");
            std::thread::sleep(Duration::from_millis(20));
        }
        Self { server, name: name.into(), runtime: Some(runtime) }
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// Path of a program: cargo builds it beside these tests when it tests the whole workspace.
pub(crate) fn program(name: &str) -> PathBuf {
    let tests = std::env::current_exe().unwrap();
    let folder = tests.parent().and_then(Path::parent).unwrap();
    let program = folder.join(name).with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.exists(), "{} is missing: run cargo build -p {name}", program.display());
    program
}

/// Size of the program's pictures.
pub(crate) const SIZE_PX: [u32; 2] = [320, 180];

/// A running viewer with its normal log.
pub(crate) struct Program {
    child: Child,
    display: Option<Display>,
}

impl Program {
    /// Opens a small window on a display of its own.
    pub(crate) fn in_window(address: &str, arguments: &[&str]) -> Self {
        Self::in_window_from(Path::new("."), address, arguments)
    }

    /// As [`Self::in_window`], with a current folder.
    pub(crate) fn in_window_from(folder: &Path, address: &str, arguments: &[&str]) -> Self {
        let display = Display::start();
        Self { child: spawn(folder, Some(address), arguments, Some(&display)), display: Some(display) }
    }

    /// Opens a small window of a Wayland compositor.
    pub(crate) fn under_wayland(address: &str, arguments: &[&str]) -> Self {
        let display = Display::wayland();
        Self {
            child: spawn(Path::new("."), Some(address), arguments, Some(&display)),
            display: Some(display),
        }
    }

    /// Opens a small window without anything in it.
    pub(crate) fn in_empty_window(arguments: &[&str]) -> Self {
        let display = Display::start();
        let child = spawn(Path::new("."), None, arguments, Some(&display));
        Self { child, display: Some(display) }
    }

    /// Draws into a window until settled, and writes frames into a folder and figures into a file.
    pub(crate) fn until_settled(address: &str, frames: &Path, stats: &Path) -> Self {
        let [frames, stats] = [frames, stats].map(|path| path.to_str().unwrap());
        Self::in_window(
            address,
            &["--no-overlay", "--exit-when-settled", "--frames", frames, "--stats", stats],
        )
    }

    /// Draws into a file of the same size, unless `--window` says another, headless.
    pub(crate) fn headless(address: &str, picture: &Path, arguments: &[&str]) -> Self {
        let output = ["--headless", "--output", picture.to_str().unwrap()];
        Self {
            child: spawn(Path::new("."), Some(address), &[&output[..], arguments].concat(), None),
            display: None,
        }
    }

    /// Its window, once it is open.
    pub(crate) fn window(&self) -> OpenWindow {
        let display = self.display.as_ref().expect("it has a window");
        OpenWindow::wait(&display.name, RUN_LIMIT)
    }

    /// The next line of its standard output, which is read byte by byte: the rest stays for [`Self::end`].
    pub(crate) fn line(&mut self) -> String {
        let out = self.child.stdout.as_mut().expect("it is piped");
        let (mut line, mut byte) = (Vec::new(), [0]);
        while out.read(&mut byte).unwrap() == 1 && byte != *b"\n" {
            line.extend(byte);
        }
        String::from_utf8(line).unwrap()
    }

    /// Asks the window to close, as a window manager does. Waits until there is a window.
    pub(crate) fn close(&self) {
        self.window().ask_to_close();
    }

    /// Sends SIGTERM.
    #[cfg(unix)]
    pub(crate) fn terminate(&self) {
        let id = self.child.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    }

    /// Waits until it has exited by itself.
    pub(crate) fn end(mut self) -> Output {
        let until = Instant::now() + RUN_LIMIT;
        while self.child.try_wait().unwrap().is_none() {
            if Instant::now() > until {
                self.child.kill().unwrap();
                let output = self.child.wait_with_output().unwrap();
                panic!("the viewer did not end: {}", String::from_utf8_lossy(&output.stderr));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        self.child.wait_with_output().unwrap()
    }
}

fn spawn(folder: &Path, address: Option<&str>, arguments: &[&str], display: Option<&Display>) -> Child {
    let [width, height] = SIZE_PX;
    let mut command = Command::new(program("lodestream-viewer"));
    command
        .current_dir(folder)
        .args(address)
        .args(arguments)
        // Neither the user's settings nor what they opened last.
        .env("XDG_CONFIG_HOME", "/dev/null")
        .env("XDG_STATE_HOME", "/dev/null")
        .env_remove("DISPLAY")
        .env_remove("WAYLAND_DISPLAY")
        .env_remove("RUST_LOG")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    if !arguments.contains(&"--window") {
        command.args(["--window", &format!("{width}x{height}")]);
    }
    // A missing or nonexistent runtime folder of the session is no error.
    match display {
        Some(Display { name, runtime: Some(runtime), .. }) => {
            command.env("WAYLAND_DISPLAY", name).env("XDG_RUNTIME_DIR", runtime.path())
        }
        Some(display) => command.env("DISPLAY", &display.name).env_remove("XDG_RUNTIME_DIR"),
        None => command.env("XDG_RUNTIME_DIR", "/nonexistent"),
    };
    command.spawn().unwrap()
}
