//! Tests of whole runs, and of server and client code over simulated links.

mod bounded_queue;
mod extremes;
mod first_flight;
mod limiter_on_the_wire;
mod runs;
