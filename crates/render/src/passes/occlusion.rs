//! Screen-space ambient occlusion: methods and settings.
//!
//! All methods estimate the integral stated in `docs/design/occlusion.md`; reference rays compute it.

/// Most samples of ambient occlusion per pixel.
pub const MAX_SAMPLES: u32 = 64;

/// Radius of ambient occlusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OcclusionRadius {
    /// In world units. Shading does not change when the camera moves, but the radius must suit the scene.
    World(f32),
    /// As a fraction of the view depth. Suits any scale, but the radius grows with distance.
    Depth(f32),
}

/// Estimator of occlusion from a depth buffer. Figures of each are in `docs/benchmarks/occlusion.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum OcclusionMethod {
    #[cfg(any(test, feature = "methods"))]
    /// SSAO: tests points in the hemisphere above the surface, evenly distributed along the radius, against the depth
    /// buffer (Mittring 2007; Filion and McNaughton 2008).
    Ssao,
    #[cfg(any(test, feature = "methods"))]
    /// SSAO with samples denser near the centre, weighted by the part of the radius that each represents.
    SsaoCentred,
    #[cfg(any(test, feature = "methods"))]
    /// HBAO: horizon angles above the tangent plane, marched along directions in screen space (Bavoil and Sainz 2008).
    Hbao,
    #[cfg(any(test, feature = "methods"))]
    /// HBAO in sixteen deinterleaved layers for cache locality (Bavoil 2014). Steps are at least four pixels.
    HbaoPlus,
    #[cfg(any(test, feature = "methods"))]
    /// Alchemy / scalable ambient obscurance: samples on a spiral, weighted by their height above the tangent plane
    /// (McGuire et al. 2011 and 2012).
    Alchemy,
    /// GTAO: slices through the view direction with a horizon on both sides, integrated in closed form (Jimenez et al.
    /// 2016; XeGTAO).
    #[default]
    Gtao,
    #[cfg(any(test, feature = "methods"))]
    /// Visibility bitmask: slices with a mask of 32 sectors instead of horizons, so that thin objects occlude only
    /// their own extent (Therrien et al. 2023).
    Bitmask,
}

impl OcclusionMethod {
    /// All methods that are compiled.
    #[cfg(not(any(test, feature = "methods")))]
    pub const ALL: [Self; 1] = [Self::Gtao];
    /// All methods that are compiled.
    #[cfg(any(test, feature = "methods"))]
    pub const ALL: [Self; 7] =
        [Self::Ssao, Self::SsaoCentred, Self::Hbao, Self::HbaoPlus, Self::Alchemy, Self::Gtao, Self::Bitmask];

    /// Name on command lines and in the overlay.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            #[cfg(any(test, feature = "methods"))]
            Self::Ssao => "ssao",
            #[cfg(any(test, feature = "methods"))]
            Self::SsaoCentred => "ssao-centred",
            #[cfg(any(test, feature = "methods"))]
            Self::Hbao => "hbao",
            #[cfg(any(test, feature = "methods"))]
            Self::HbaoPlus => "hbao-plus",
            #[cfg(any(test, feature = "methods"))]
            Self::Alchemy => "alchemy",
            Self::Gtao => "gtao",
            #[cfg(any(test, feature = "methods"))]
            Self::Bitmask => "bitmask",
        }
    }

    /// Whether the samples are those of SSAO with points denser near the middle.
    pub(crate) const fn has_centred_kernel(self) -> bool {
        #[cfg(any(test, feature = "methods"))]
        return matches!(self, Self::SsaoCentred);
        #[cfg(not(any(test, feature = "methods")))]
        return false;
    }

    /// Whether the estimate is drawn in layers, in a pass of its own.
    pub(crate) const fn is_layered(self) -> bool {
        #[cfg(any(test, feature = "methods"))]
        return matches!(self, Self::HbaoPlus);
        #[cfg(not(any(test, feature = "methods")))]
        return false;
    }
}

/// Neighbours in the depth buffer from which a pixel's normal is reconstructed. At edges one of two neighbours on an
/// axis lies on another surface. Figures of each are in `docs/benchmarks/occlusion.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum OcclusionNormals {
    /// The neighbour nearer in depth on each axis.
    #[default]
    Nearest,
    /// The pair whose normal agrees best with the G-buffer's normal. Unlit surfaces, and edges with smooth normals,
    /// have no G-buffer normal to compare with.
    Drawn,
    /// The side on each axis whose next two pixels are collinear with this one in stored depth, as on a plane. Needs
    /// no G-buffer normal, but four more lookups.
    Extended,
}

impl OcclusionNormals {
    /// All variants.
    pub const ALL: [Self; 3] = [Self::Nearest, Self::Drawn, Self::Extended];

    /// Name on command lines and in the overlay.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Drawn => "drawn",
            Self::Extended => "extended",
        }
    }

    /// Override constants that select the source of normals.
    pub(crate) fn constants(self) -> [(&'static str, f64); 1] {
        [("SIDES", f64::from(self as u8))]
    }
}

/// Settings of screen-space ambient occlusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmbientOcclusion {
    /// Estimator.
    pub method: OcclusionMethod,
    /// Radius of the samples.
    pub radius: OcclusionRadius,
    /// Factor on the occlusion: 0 = none, 1 = as estimated. More than 1 compensates for occluders thinner than the
    /// samples' spacing.
    pub strength: f32,
    /// Depth lookups per pixel, 1 to [`MAX_SAMPLES`]; powers of two are distributed best. Dominates the cost.
    pub samples: u32,
    /// Source of the normals.
    pub normals: OcclusionNormals,
    /// Half resolution: estimates one pixel of each 2×2 and upsamples by depth. Ignored for accumulated frames and for
    /// HBAO+, whose layers need every pixel.
    pub half: bool,
    /// Estimator for still pictures: while nothing changes, occlusion is averaged over [`STILL_FRAMES`] frames with
    /// different samples, and then costs nothing. Takes two more bytes a pixel.
    pub still: Option<OcclusionMethod>,
}

/// Frames averaged for [`AmbientOcclusion::still`]: one for each rotation of the samples.
pub const STILL_FRAMES: u32 = 16;

impl Default for AmbientOcclusion {
    fn default() -> Self {
        Self {
            method: OcclusionMethod::Gtao,
            radius: OcclusionRadius::Depth(0.06),
            strength: 1.5,
            samples: 16,
            normals: OcclusionNormals::Nearest,
            half: false,
            still: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_have_names_of_their_own() {
        let mut names = OcclusionMethod::ALL.map(OcclusionMethod::name).to_vec();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), OcclusionMethod::ALL.len());
        assert!(OcclusionMethod::ALL.is_sorted(), "they are numbered in their order");
        assert!(OcclusionNormals::ALL.is_sorted(), "the shader knows them by their numbers");
    }
}
