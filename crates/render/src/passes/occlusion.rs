//! Ambient occlusion in screen space: by which method, how far, how many samples.
//!
//! All methods estimate one integral, which `docs/design/occlusion.md` states, and rays compute ([`crate::rays`]).

/// Most samples of ambient occlusion per pixel.
pub const MAX_SAMPLES: u32 = 64;

/// Reach of ambient occlusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum OcclusionRadius {
    /// In world units: shading that stays put when the camera moves; needs to know the scene.
    World(f32),
    /// As a fraction of the view depth: works from millimetres to kilometres, but grows with
    /// distance.
    Depth(f32),
}

/// How occlusion is estimated from depth. Figures of each are in `docs/benchmarks/occlusion.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum OcclusionMethod {
    #[cfg(any(test, feature = "methods"))]
    /// Points in the hemisphere above the surface, evenly along the radius, each before or behind what is drawn there
    /// (Mittring 2007; Filion and McNaughton 2008).
    Ssao,
    #[cfg(any(test, feature = "methods"))]
    /// The same with points denser near the middle, each of which counts for as much more of the radius as it stands for.
    SsaoCentred,
    #[cfg(any(test, feature = "methods"))]
    /// Horizons above the tangent plane, marched along directions of the picture (Bavoil and Sainz 2008).
    Hbao,
    #[cfg(any(test, feature = "methods"))]
    /// The same within each of sixteen layers of every fourth pixel of every fourth row, whose pixels look up neighbours
    /// (Bavoil 2014): horizons of at least four pixels.
    HbaoPlus,
    #[cfg(any(test, feature = "methods"))]
    /// Points on a spiral, by how high above the tangent plane what is drawn there lies (McGuire et al. 2011 and 2012).
    Alchemy,
    /// Slices through the direction to the eye, each with a horizon to both sides, integrated in closed form (Jimenez et
    /// al. 2016; XeGTAO).
    #[default]
    Gtao,
    #[cfg(any(test, feature = "methods"))]
    /// The same slices with a mask of 32 sectors in place of horizons: what is thin hides no more than itself (Therrien
    /// et al. 2023).
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

    /// Its name for people and on command lines.
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

/// From which neighbours in the depth buffer a pixel's normal is taken: of two on each axis one may lie on another surface,
/// as beside the inner edge of two walls. Figures of each are in `docs/benchmarks/occlusion.md`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum OcclusionNormals {
    /// From the nearer in depth on each axis.
    #[default]
    Nearest,
    /// From the pair that agrees best with the normal that is drawn, smooth or out of a map. What is drawn with smooth
    /// normals over an edge, or unlit, has none to go by.
    Drawn,
    /// From the side on each axis whose next two pixels lie in line with this one in stored depth, as they do on a plane.
    /// Needs no drawn normal, and four more lookups.
    Extended,
}

impl OcclusionNormals {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::Nearest, Self::Drawn, Self::Extended];

    /// Its name for people and on command lines.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Drawn => "drawn",
            Self::Extended => "extended",
        }
    }
}

/// Screen-space ambient occlusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmbientOcclusion {
    /// How it is estimated.
    pub method: OcclusionMethod,
    /// Reach of the samples.
    pub radius: OcclusionRadius,
    /// 0 = none, 1 = as estimated; more makes up for occluders thinner than the samples' spacing.
    pub strength: f32,
    /// Lookups of depth per pixel, 1 to [`MAX_SAMPLES`]; powers of two are spread best. Most of what occlusion costs goes
    /// with them.
    pub samples: u32,
    /// From which neighbours the normals are taken that it is estimated about.
    pub normals: OcclusionNormals,
    /// Whether one pixel of each 2×2 is estimated, and the others get the mean of those around them at about their depth.
    /// Not of frames that go into a mean, and not by [`OcclusionMethod::HbaoPlus`], whose layers need every pixel: both
    /// stay whole.
    pub half: bool,
    /// How it is estimated while nothing changes, if it is then to be the mean of [`STILL_FRAMES`] frames, each with other
    /// samples. Once they are drawn occlusion costs nothing; any change begins anew. Two bytes a pixel more.
    pub still: Option<OcclusionMethod>,
}

/// Frames of which [`AmbientOcclusion::still`] is the mean: one for each rotation of the samples.
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
