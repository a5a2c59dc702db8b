//! Links and clocks in virtual time, scenarios, reports, mesh comparison.

pub mod assess;
mod bare_client;
pub mod baseline;
pub mod clock;
pub mod goodput;
mod html;
pub mod image_error;
pub mod link;
pub mod load;
pub mod measure;
pub mod models;
pub mod normals;
pub mod reproduce;
pub mod scenario;
pub mod stopwatch;
pub mod stream_pipe;
pub mod tcp;
pub mod trace;
pub mod train;
pub mod truth;
pub mod udp;

#[cfg(test)]
mod bounded_queue;
#[cfg(test)]
mod first_flight;
#[cfg(test)]
mod limiter_on_the_wire;
#[cfg(test)]
mod udp_with_quinn;
