//! Links and clocks in virtual time, scenarios, reports, mesh comparison.

pub mod measure;
