//! Settings of PN triangles.

/// Most segments per edge.
pub const MAX_PN_LEVEL: u32 = 64;

/// Draws meshes' triangles as cubic patches from their corners and normals (Vlachos et al. 2001). An edge bends at an
/// end only if all wedges of the vertex have one normal ([`crate::PackedVertex::smooth`]), so creases and flat faces
/// are kept. Terrain is not affected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PnTriangles {
    /// Largest distance in pixels between a chord and the curve of its edge, > 0. An edge is divided into the least
    /// power of two of segments that satisfies it; half the error costs up to twice the triangles.
    pub error_px: f32,
    /// Most segments per edge, 1 to [`MAX_PN_LEVEL`], rounded down to a power of two. 1 draws flat triangles.
    pub most: u32,
}

impl Default for PnTriangles {
    fn default() -> Self {
        Self { error_px: 0.25, most: MAX_PN_LEVEL }
    }
}

impl PnTriangles {
    /// A number that differs between settings.
    pub(crate) fn key(self) -> u64 {
        u64::from(self.error_px.to_bits()) << 32 | u64::from(self.most)
    }

    /// Logarithm of the most segments.
    pub(crate) fn most_step(self) -> u32 {
        self.most.clamp(1, MAX_PN_LEVEL).ilog2()
    }

    /// The error, clamped to a finite positive value.
    pub(crate) fn error(self) -> f32 {
        // NaN too.
        if self.error_px >= MIN_ERROR_PX { self.error_px } else { MIN_ERROR_PX }
    }
}

/// Least error: a finer one is invisible.
const MIN_ERROR_PX: f32 = 1.0 / 64.0;
