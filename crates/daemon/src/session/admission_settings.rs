//! Settings of admission: allowed web pages, trusted proxies, tokens.

use std::sync::Arc;

use crate::auth::access::Access;
use crate::http::origin::AllowedOrigins;
use crate::http::proxy::TrustedProxies;

/// Allowed web pages, trusted proxies and required tokens; by default none of them.
#[derive(Clone, Debug, Default)]
pub struct AdmissionSettings {
    /// Web pages that may open sessions over WebSocket.
    pub origins: AllowedOrigins,
    /// Proxies whose `X-Forwarded-For` is trusted.
    pub proxies: TrustedProxies,
    /// Verifies clients' tokens; `None` requires no token.
    pub access: Option<Arc<Access>>,
}
