//! SIGINT and SIGTERM (Ctrl-C and `kill`). SIGHUP keeps its default, so that `nohup` works.

use crate::local::remove_at_once;

/// Calls `handler` with the number of the first signal; the second ends the program at once.
///
/// # Errors
/// The system provides no thread, or signals cannot be caught.
pub(crate) fn on_termination(handler: impl FnOnce(u8) + Send + 'static) -> std::io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    // Signals are caught from here on, also before the thread runs.
    let mut signals = {
        let _inside = runtime.enter();
        Signals::new()?
    };
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        handler(runtime.block_on(signals.next()));
        let second = runtime.block_on(signals.next());
        remove_at_once();
        std::process::exit(128 + i32::from(second));
    })?;
    Ok(())
}

#[cfg(unix)]
struct Signals([(u8, tokio::signal::unix::Signal); 2]);

#[cfg(unix)]
impl Signals {
    fn new() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        let catch =
            |number: u8| Ok::<_, std::io::Error>((number, signal(SignalKind::from_raw(number.into()))?));
        // SIGINT and SIGTERM, whose numbers POSIX fixes.
        Ok(Self([catch(2)?, catch(15)?]))
    }

    async fn next(&mut self) -> u8 {
        let [(interrupt, a), (terminate, b)] = &mut self.0;
        tokio::select! {
            _ = a.recv() => *interrupt,
            _ = b.recv() => *terminate,
        }
    }
}

#[cfg(not(unix))]
struct Signals;

#[cfg(not(unix))]
impl Signals {
    fn new() -> std::io::Result<Self> {
        Ok(Self)
    }

    async fn next(&mut self) -> u8 {
        match tokio::signal::ctrl_c().await {
            Ok(()) => 2,
            Err(_) => std::future::pending().await,
        }
    }
}
