//! Outcome of a reproduction: each section's, and the machine.

use serde::Serialize;

use super::compare::{Difference, RowsLeftOut};

/// Outcome of a section.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Name of the section.
    pub name: String,
    /// Reason why it was not run.
    pub left_out: Option<String>,
    /// Its time in seconds.
    pub seconds: f64,
    /// Figures that differ from the committed ones beyond the tolerance.
    pub differences: Vec<Difference>,
    /// Tables on pages that differ from the figures.
    pub stale_tables: Vec<String>,
    /// Rows that could not be reproduced; they are not compared.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rows_left_out: Vec<RowsLeftOut>,
}

/// Outcome of a reproduction.
#[derive(Clone, Debug, Serialize)]
pub struct Reproduction {
    /// Version of this program.
    pub version: String,
    /// Processor architecture and operating system.
    pub machine: String,
    /// Number of processors.
    pub processors: usize,
    /// Models that were read: file name and BLAKE3 hash.
    pub models: Vec<(String, String)>,
    /// Sections, in the list's order.
    pub sections: Vec<Outcome>,
}

impl Reproduction {
    /// Whether everything that ran agrees with the committed figures and pages.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.sections.iter().all(|s| s.differences.is_empty() && s.stale_tables.is_empty())
    }
}
