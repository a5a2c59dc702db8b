//! Who may open sessions over HTTP: what a daemon is told of web pages and proxies.

use super::origin::AllowedOrigins;
use super::proxy::TrustedProxies;

/// See the module; by default no web page, and no proxy is believed.
#[derive(Clone, Debug, Default)]
pub struct Admission {
    /// Web pages that may open sessions over WebSocket.
    pub origins: AllowedOrigins,
    /// Proxies that are believed when they say for whom they ask.
    pub proxies: TrustedProxies,
}
