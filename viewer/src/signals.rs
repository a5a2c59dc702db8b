//! The end that a user or the system asks for: Ctrl-C or `kill`. A terminal that is closed ends the program as ever, unless
//! `nohup` says otherwise.

/// Calls `tell` with the number of the first signal that asks for the end; the second ends the program at once.
///
/// # Errors
/// Fails where the system gives no thread, or lets no signal be caught.
pub(crate) fn on_end(tell: impl FnOnce(u8) + Send + 'static) -> std::io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    // From here on signals are caught: what comes before the thread runs is not lost.
    let mut signals = {
        let _inside = runtime.enter();
        Signals::new()?
    };
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        tell(runtime.block_on(signals.next()));
        let second = runtime.block_on(signals.next());
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
