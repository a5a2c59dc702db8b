//! Who may open sessions: what a daemon is told of web pages, proxies and tokens.

use std::sync::Arc;

use crate::admission::origin::AllowedOrigins;
use crate::admission::proxy::TrustedProxies;
use crate::auth::access::Access;

/// See the module; by default no web page, no proxy is believed, and nobody is asked for a token.
#[derive(Clone, Debug, Default)]
pub struct AdmissionSettings {
    /// Web pages that may open sessions over WebSocket.
    pub origins: AllowedOrigins,
    /// Proxies that are believed when they say for whom they ask.
    pub proxies: TrustedProxies,
    /// By what the tokens that sessions are asked for are judged.
    pub access: Option<Arc<Access>>,
}
