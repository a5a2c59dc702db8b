//! Limits of the process, set at the start.

/// Open files that the process requests: a socket per WebSocket session, pending connections, packs. The default soft
/// limit of most shells, 1024, dates from `select(2)`.
#[cfg(unix)]
const OPEN_FILES: u64 = 65_536;

/// Raises the soft limit of open files. Makes a write beyond `ulimit -f` fail like a write to a full disk, where the
/// signal would end the process and leave a partial file. Failures are ignored.
pub(super) fn set_up() {
    #[cfg(unix)]
    {
        raise_open_files();
        survive_file_size_limit();
    }
}

#[cfg(unix)]
fn raise_open_files() {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    let wanted = maximum.map_or(OPEN_FILES, |most| most.min(OPEN_FILES));
    if current.is_some_and(|current| current < wanted) {
        let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), maximum });
    }
}

/// With a handler for SIGXFSZ, which stays set, the write fails with EFBIG. Tokio sets the handler without unsafe code
/// here; it needs the runtime only to deliver signals, and nothing waits for this one.
#[cfg(unix)]
fn survive_file_size_limit() {
    use rustix::process::Signal;
    use tokio::signal::unix::{SignalKind, signal};
    let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_io().build() else { return };
    let _entered = runtime.enter();
    let _ = signal(SignalKind::from_raw(Signal::XFSZ.as_raw()));
}
