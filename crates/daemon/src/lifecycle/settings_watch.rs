//! Settings that are read anew while the server runs, when that is asked for.

use std::sync::Arc;

use tokio::sync::watch;
use tokio::task::spawn_blocking;

use crate::admission::settings::AdmissionSettings;
use crate::session::settings::SessionSettings;
use crate::session::state::ServerState;

/// Reads settings and who may open sessions.
pub type SettingsReload = Arc<dyn Fn() -> anyhow::Result<(SessionSettings, AdmissionSettings)> + Send + Sync>;

/// Takes settings anew whenever that is asked for. Goes on as long as it may be.
pub(crate) async fn watch_settings(
    read: SettingsReload,
    state: Arc<ServerState>,
    mut asked: watch::Receiver<u64>,
) {
    while asked.changed().await.is_ok() {
        let read = Arc::clone(&read);
        // Disks are waited for elsewhere. It cannot fail but at the end of everything.
        match spawn_blocking(move || read()).await {
            Ok(Ok((settings, admission))) => {
                state.update_settings(settings, admission);
                tracing::info!("settings were read anew; sessions go on with the rates that they began with");
            }
            Ok(Err(why)) => tracing::error!("settings stay as they are: {why:#}"),
            Err(_) => return,
        }
    }
}
