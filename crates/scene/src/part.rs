//! Parts: what a mesh is divided into, for example the objects of a building.

/// A part of an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ScenePart {
    /// Number of the instance in the scene.
    pub instance: u32,
    /// Number of the part within the instance's asset; 0 for an asset that is not divided.
    pub part: u32,
}
