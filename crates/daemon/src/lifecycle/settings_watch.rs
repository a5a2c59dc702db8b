//! Reload of settings while the server runs, on request.

use std::sync::Arc;

use tokio::sync::watch;
use tokio::task::spawn_blocking;

use crate::session::admission_settings::AdmissionSettings;
use crate::session::settings::SessionSettings;
use crate::session::state::ServerState;

/// Reads the settings of sessions and admission again.
pub type SettingsReload = Arc<dyn Fn() -> anyhow::Result<(SessionSettings, AdmissionSettings)> + Send + Sync>;

/// Reloads the settings on each request, until the sender of `reload_requests` is dropped.
pub(crate) async fn watch_settings(
    read: SettingsReload,
    state: Arc<ServerState>,
    mut reload_requests: watch::Receiver<u64>,
) {
    while reload_requests.changed().await.is_ok() {
        let read = Arc::clone(&read);
        // Fails only when the runtime shuts down.
        match spawn_blocking(move || read()).await {
            Ok(Ok((settings, admission))) => {
                state.update_settings(settings, admission);
                tracing::info!("settings reloaded; running sessions keep their own rates");
            }
            Ok(Err(why)) => tracing::error!("settings are not reloaded: {why:#}"),
            Err(_) => return,
        }
    }
}
