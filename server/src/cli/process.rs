//! What the process asks of the system before it does anything.

/// Files that a process may have open, as far as the system lets it: a socket for each session over WebSocket, the
/// connections that wait, packs. More than the defaults of most shells, which date from `select(2)`.
#[cfg(unix)]
const OPEN_FILES: u64 = 65_536;

/// Raises the soft limit of open files, and has a file that grows over `ulimit -f` be an error like a full disk, which
/// leaves nothing behind, where it would end the process. What cannot be had is done without.
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

/// A handler, once set, stays: writing then fails with EFBIG. Tokio sets handlers without unsafe code here, and needs a
/// runtime only to tell of signals, which nobody waits for.
#[cfg(unix)]
fn survive_file_size_limit() {
    use rustix::process::Signal;
    use tokio::signal::unix::{SignalKind, signal};
    let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_io().build() else { return };
    let _entered = runtime.enter();
    let _ = signal(SignalKind::from_raw(Signal::XFSZ.as_raw()));
}
