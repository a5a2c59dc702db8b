//! Limits on connections, sessions, messages and received bytes, in all and per address.

pub(crate) mod byte_rate;
pub(crate) mod invalid_setting;
pub(crate) mod leases;
pub(crate) mod message_rate;
pub(crate) mod pre_auth_pool;
pub(crate) mod refusal;
pub(crate) mod session_rate;
pub(crate) mod token_bucket;
