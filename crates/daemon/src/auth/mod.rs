//! Authorisation: signed tokens, and the operator's program or URL.

pub mod access;
pub(crate) mod grant;
pub mod hook;
pub(crate) mod hook_command;
pub mod hook_url;
pub(crate) mod token_crypto;
pub(crate) mod token_keys;
pub mod tokens;
