//! How triangles are drawn as curved patches.

/// Most pieces that an edge is cut into.
pub const MAX_PN_LEVEL: u32 = 64;

/// Triangles of meshes as cubic patches from their corners and normals (Vlachos et al. 2001). Creases and what is flat stay
/// as they are: an edge bends at its end only where all wedges of the vertex there have one normal
/// ([`crate::PackedVertex::smooth`]). The ground stays as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PnTriangles {
    /// How far, in pixels of the picture that is drawn, chords of an edge may lie off its curve, > 0. An edge is cut into
    /// the least power of two of pieces that hold it; half the error costs up to twice the triangles.
    pub error_px: f32,
    /// Most pieces of an edge, 1 to [`MAX_PN_LEVEL`]; the power of two that is not more. With 1 triangles are drawn flat.
    pub most: u32,
}

impl Default for PnTriangles {
    fn default() -> Self {
        Self { error_px: 0.25, most: MAX_PN_LEVEL }
    }
}

impl PnTriangles {
    /// Of the most pieces, the power of two.
    pub(crate) fn most_step(self) -> u32 {
        self.most.clamp(1, MAX_PN_LEVEL).ilog2()
    }

    /// The error, such that no setting asks for what is not a number or without bound.
    pub(crate) fn error(self) -> f32 {
        // NaN too.
        if self.error_px >= MIN_ERROR_PX { self.error_px } else { MIN_ERROR_PX }
    }
}

/// Least error that is held: finer is not seen.
const MIN_ERROR_PX: f32 = 1.0 / 64.0;
