//! Simulated links in virtual time: UDP for quinn, TCP as streams of bytes.
//!
//! It knows nothing of what is sent. A [`link`] says of each packet when it arrives, or that it is lost; [`udp`] and
//! [`tcp`] send packets over it, and [`stream_pipe`] gives TCP the shape of a tokio stream. All wait on one
//! [`clock`], which is tokio's paused one.

pub mod clock;
pub mod link;
pub mod stream_pipe;
pub mod tcp;
pub mod trace;
pub mod udp;

#[cfg(test)]
mod udp_with_quinn;
