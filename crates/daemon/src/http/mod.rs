//! The HTTP port with its page and its WebSocket upgrade, and the administration port.

pub(crate) mod admin;
pub(crate) mod origin;
pub(crate) mod paced_body;
pub(crate) mod page;
pub(crate) mod page_answers;
pub(crate) mod previews;
pub(crate) mod proxy;
pub(crate) mod responses;
pub(crate) mod server;
pub(crate) mod site;
pub(crate) mod upgrade;
