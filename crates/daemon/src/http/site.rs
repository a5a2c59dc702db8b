//! What the daemon tells its page.

use std::sync::{PoisonError, RwLock};

use crate::http::page::PageSetting;

/// Where the page reaches the server by WebTransport.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct WebTransportOffer {
    /// UDP port.
    pub(crate) port: u16,
    /// SHA-256 of the certificates that the browser shall accept, in hexadecimal digits; empty if an authority has
    /// signed it.
    pub(crate) certificate_hashes: Vec<String>,
}

/// The page, and what it is told.
#[derive(Debug, Default)]
pub(crate) struct Site {
    pub(crate) page: PageSetting,
    /// Port of the HTTP listener.
    pub(crate) http_port: Option<u16>,
    webtransport: RwLock<Option<WebTransportOffer>>,
}

impl Site {
    pub(crate) fn new(page: PageSetting, http_port: Option<u16>) -> Self {
        Self { page, http_port, webtransport: RwLock::new(None) }
    }

    /// Sets where WebTransport is offered.
    pub(crate) fn offer_webtransport(&self, offer: WebTransportOffer) {
        *self.webtransport.write().unwrap_or_else(PoisonError::into_inner) = Some(offer);
    }

    /// Replaces the hashes of the certificates, if WebTransport is offered.
    pub(crate) fn set_certificate_hashes(&self, hashes: Vec<String>) {
        if let Some(offer) = &mut *self.webtransport.write().unwrap_or_else(PoisonError::into_inner) {
            offer.certificate_hashes = hashes;
        }
    }

    /// Where WebTransport is offered.
    pub(crate) fn webtransport(&self) -> Option<WebTransportOffer> {
        self.webtransport.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether pages of this server may open sessions: whether it serves one.
    pub(crate) const fn has_page(&self) -> bool {
        matches!(self.page, PageSetting::Loaded(_))
    }
}
