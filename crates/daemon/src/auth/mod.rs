//! Authorisation: signed tokens, or the operator's program or URL.

pub(crate) mod access;
pub(crate) mod grant;
pub(crate) mod hook;
pub(crate) mod hook_command;
pub(crate) mod hook_url;
pub(crate) mod token_crypto;
pub(crate) mod token_keys;
pub(crate) mod tokens;
