//! The streaming daemon: QUIC and WebSocket listeners, admission, authorisation, metrics, shutdown.
//!
//! | module | contents |
//! |---|---|
//! | `daemon` | the whole daemon: sockets, reload, drain |
//! | `transport` | QUIC, WebSocket, TLS, certificates, congestion control |
//! | `http` | the HTTP port, its page, its checks of origins and trusted proxies, and the administration port |
//! | `session` | scenes and their versions; admission; the loop between a sans-IO session and its transport |
//! | `limits` | limits on connections and sessions: pre-auth pool, leases, rates of sessions, messages and bytes |
//! | `auth` | which clients may see a scene: signed tokens, or the operator's program or URL |
//! | `lifecycle` | signals, reload, notifications to the service manager |
//! | `metrics` | counters and gauges |
//!
//! [`run`] is the whole daemon. Its parts take any endpoint ([`serve_quic`]) and any byte stream ([`accept_http`]), and
//! read no clock but tokio's, so a simulator runs them unchanged in paused time.

mod auth;
mod daemon;
mod http;
mod lifecycle;
mod limits;
mod metrics;
mod session;
#[cfg(test)]
mod tests;
mod transport;

pub use crate::auth::access::Access;
pub use crate::auth::hook::Hook;
pub use crate::auth::hook_url::Authorization;
pub use crate::auth::tokens::Tokens;
pub use crate::daemon::{Daemon, DaemonOptions, run};
pub use crate::http::admin::AdminPort;
pub use crate::http::origin::{AllowedOrigins, Origin};
pub use crate::http::page::{Page, PageError, PageSetting};
pub use crate::http::proxy::{Network, TrustedProxies};
pub use crate::http::server::accept_http;
pub use crate::lifecycle::settings_watch::SettingsReload;
pub use crate::lifecycle::shutdown::StopRequests;
pub use crate::limits::invalid_setting::InvalidSetting;
pub use crate::limits::session_rate::SessionRateLimit;
pub use crate::metrics::Metrics;
pub use crate::session::admission_settings::AdmissionSettings;
pub use crate::session::memory_scene::{MemoryScene, TEXTURE_LEVELS};
pub use crate::session::scene_watch::{SceneProvider, SceneUpdate};
pub use crate::session::scenes::{SceneChanges, SceneVersion, Scenes, ScenesError};
pub use crate::session::settings::{DRAIN_SECONDS, SessionSettings};
pub use crate::session::state::{Phase, ServerState};
pub use crate::transport::certificate::Certificate;
pub use crate::transport::congestion::bounded_queue;
pub use crate::transport::quic::{bind_udp, serve_quic, server_config};
