//! What vertex stages look up of an asset besides its vertices.

use crate::scene::attribute_table::AttributeTable;
use crate::scene::part_table::PartTable;

/// States of its parts, and attributes of some vertices.
#[derive(Debug, Default)]
pub(crate) struct VertexTables {
    pub(crate) states: PartTable,
    pub(crate) attributes: AttributeTable,
}
