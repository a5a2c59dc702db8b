//! Who may open sessions: what a daemon is told of web pages, proxies and tokens.

use std::sync::Arc;

use super::origin::AllowedOrigins;
use super::proxy::TrustedProxies;
use super::tokens::Tokens;

/// See the module; by default no web page, no proxy is believed, and nobody is asked for a token.
#[derive(Clone, Debug, Default)]
pub struct Admission {
    /// Web pages that may open sessions over WebSocket.
    pub origins: AllowedOrigins,
    /// Proxies that are believed when they say for whom they ask.
    pub proxies: TrustedProxies,
    /// Tokens that sessions are asked for.
    pub tokens: Option<Arc<Tokens>>,
}
