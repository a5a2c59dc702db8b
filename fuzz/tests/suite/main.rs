//! Tests of the fuzz targets, and of memory that the counting allocator measures: one binary.
//!
//! | module | what it checks |
//! |---|---|
//! | `replay` | every committed input and every seed, in every target |
//! | `compressed` | truncated and damaged Draco and meshoptimizer streams |
//! | `mutated` | damaged packs and first flights: verdicts, memory, steps, nothing leaked |
//! | `client_that_never_reads` | memory that a client which requests and never reads can occupy |
//! | `soak` | memory of a server after an hour of a thousand sessions in virtual time |
#![allow(clippy::unwrap_used, reason = "clippy exempts #[test] functions only, not their helpers")]

mod client_that_never_reads;
mod compressed;
mod exclusive;
mod mutated;
mod replay;
mod soak;
