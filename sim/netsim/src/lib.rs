//! Simulated links in virtual time: UDP for quinn, TCP as byte streams.
//!
//! The crate is independent of the protocol. A [`link`] computes each packet's arrival time or loss; [`udp`] and
//! [`tcp`] send packets over it, and [`stream_pipe`] gives TCP the interface of a tokio stream. All wait on one
//! [`clock`], tokio's paused clock.

pub mod clock;
pub mod link;
pub mod stream_pipe;
pub mod tcp;
pub mod trace;
pub mod udp;

#[cfg(test)]
mod udp_with_quinn;
