//! What vertex stages look up of an asset besides its vertices.

use crate::scene::part_table::PartTable;
use crate::scene::skin_table::SkinTable;

/// States of its parts, and skins of its vertices.
#[derive(Debug, Default)]
pub(crate) struct VertexTables {
    pub(crate) states: PartTable,
    pub(crate) skins: SkinTable,
}
