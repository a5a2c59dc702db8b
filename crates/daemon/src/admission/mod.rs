//! Admission: which connections may become sessions, and how many.

pub(crate) mod byte_rate;
pub(crate) mod gate;
pub(crate) mod leases;
pub(crate) mod message_rate;
pub(crate) mod pre_auth_pool;
pub(crate) mod refusal;
pub mod session_rate;
pub mod settings;
