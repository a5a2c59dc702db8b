//! What a frame is made of, and what it reports.

use lodestream_scene::pose::Pose;

use crate::passes::bloom::Bloom;
#[cfg(any(test, feature = "methods"))]
use crate::passes::ink::Ink;
use crate::passes::occlusion::AmbientOcclusion;
use crate::passes::pn_triangles::PnTriangles;
use crate::passes::reflections::Reflections;
use crate::passes::sky::SkyMaps;
use crate::passes::water::Water;
use crate::resources::gpu::Gpu;
use crate::scene::asset::AssetGpu;
use crate::scene::environment::Environment;
use crate::scene::instance::Instance;
use crate::scene::lights::{Light, LightCulling};
use crate::scene::relief_acceleration::ReliefAcceleration;
use crate::scene::terrain::TerrainFrame;

/// Most lookups of a texture along a pixel's footprint.
pub const MAX_ANISOTROPY: u32 = 16;
/// Least share of a target's sides in which a picture is drawn.
pub const MIN_RENDER_SCALE: f32 = 0.25;
/// Most linear steps of relief mapping.
pub const MAX_RELIEF_STEPS: u32 = 1024;

/// Most maps of shadows.
pub const MAX_CASCADES: usize = 4;
/// Least and most texels along a side of a map of shadows.
pub const MAP_SIDES: [u32; 2] = [128, 8192];
/// Least and most steps by which a map of shadows moves along its side.
pub const MAP_STEPS: [u32; 2] = [4, 16];
/// Widest filter of shadows.
pub const MAX_FILTER: u32 = 3;

/// An asset and where it stands. Several instances make one draw call per material.
#[derive(Clone, Copy, Debug)]
pub struct Drawable<'a> {
    /// The asset.
    pub asset: &'a AssetGpu,
    /// Its placements. [`AntiAliasing::Temporal`] takes those of two frames for the same ones where as many stand in the
    /// same order, and tells their motion from it.
    pub instances: &'a [Instance],
}

/// Shadows of the sun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shadows {
    /// Ranges of distance with a map of their own, 1 to [`MAX_CASCADES`]; fewer are drawn where fewer suffice. Each costs
    /// the triangles that may cast shadows into it, whenever one of them changes or it moves on.
    pub cascades: u32,
    /// Texels along a side of each map, within [`MAP_SIDES`]; four bytes each. Edges of shadows are blurred by about a
    /// texel, which is one to five pixels at 720 lines and 2048 texels.
    pub map_side: u32,
    /// Texels over which an edge is blurred, less one: this many bilinear lookups squared, 1 to [`MAX_FILTER`]. The wider
    /// it is, the further from what casts them shadows begin.
    pub filter: u32,
    /// Steps that a map's side has: it moves with the eye by whole ones, and is drawn anew then. A power of two within
    /// [`MAP_STEPS`]. With few a map must show more than what is around the eye, a quarter more along its sides with 4
    /// than with 16, and is drawn five times less often while a camera flies.
    pub steps: u32,
    /// Frames for which a map may show things as they were while it stays in its place, for cameras that move on slow
    /// devices. With 0 a frame is a function of what it is made of.
    pub max_staleness: u32,
}

impl Default for Shadows {
    fn default() -> Self {
        Self { cascades: 4, map_side: 2048, filter: 2, steps: MAP_STEPS[1], max_staleness: 0 }
    }
}

impl Shadows {
    /// The same within their ranges, on a device whose textures have at most `side` texels along a side. Maps move by
    /// whole texels, so their sides are multiples of the most steps.
    pub(crate) fn clamped(self, side: u32) -> Self {
        let [least, most] = MAP_SIDES;
        Self {
            cascades: self.cascades.clamp(1, MAX_CASCADES as u32),
            map_side: self.map_side.clamp(least, most.min(side).max(least)) / MAP_STEPS[1] * MAP_STEPS[1],
            filter: self.filter.clamp(1, MAX_FILTER),
            ..self
        }
    }

    /// How often a map's step goes into its side.
    pub(crate) fn grid(self) -> f64 {
        let [least, most] = MAP_STEPS;
        let steps = self.steps.clamp(least, most);
        // The power of two that is not more.
        f64::from(1_u32 << steps.ilog2())
    }
}

/// What colours the surfaces: what they look like, or what passes hand on. Of the latter only the passes that make it
/// run, nothing is lit, tone-mapped or smoothed, and where there is no surface the picture is black.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DebugView {
    /// Their materials.
    #[default]
    Material,
    /// Their level of refinement, [`super::PackedVertex::level`].
    Level,
    /// The cascade whose map says whether the sun reaches them.
    Cascade,
    /// World normals: −1 to 1 of each axis as 0 to 255; black for what is unlit.
    Normal,
    /// Their colour without light, sRGB.
    Albedo,
    /// Roughness as red, metal as green, and how open to the sky materials say that they are as blue: 0 to 1 as 0 to
    /// 255 each.
    Surface,
    /// View depth: a colour for each power of two of world units, down to two fifths as bright at its far end.
    Depth,
    /// Ambient occlusion: open is white. White without [`Settings::occlusion`].
    Occlusion,
    /// Share of the sun's light that shadows leave: white is all. White without [`Settings::shadows`].
    Sunlight,
    /// How far what a pixel shows has come since the frame before: right red, left blue, up green, down dark, by a
    /// logarithm that is full from 64 pixels on; grey for what stands.
    Motion,
    /// How many punctual lights are looked at for a pixel: blue for few, over green and yellow to red for 64; black for none.
    PunctualLights,
    /// How often a pixel was drawn, each time before what was there: dark blue once, green four times, dark red eight
    /// times and more. What is seen through counts where it lies before all that is not.
    Overdraw,
}

impl DebugView {
    /// All there are.
    pub const ALL: [Self; 12] = [
        Self::Material,
        Self::Level,
        Self::Cascade,
        Self::Normal,
        Self::Albedo,
        Self::Surface,
        Self::Depth,
        Self::Occlusion,
        Self::Sunlight,
        Self::Motion,
        Self::PunctualLights,
        Self::Overdraw,
    ];

    /// Whether it is a lit picture.
    pub(crate) const fn is_lit(self) -> bool {
        matches!(self, Self::Material | Self::Level | Self::Cascade)
    }

    /// Its name for people and on command lines.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Material => "material",
            Self::Level => "level",
            Self::Cascade => "cascade",
            Self::Normal => "normal",
            Self::Albedo => "albedo",
            Self::Surface => "surface",
            Self::Depth => "depth",
            Self::Occlusion => "occlusion",
            Self::Sunlight => "sunlight",
            Self::Motion => "motion",
            Self::PunctualLights => "punctual-lights",
            Self::Overdraw => "overdraw",
        }
    }
}

/// From radiance to what a display shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToneMapping {
    /// Narkowicz's fit of the ACES curve, as films have it: contrast in the middle, soft highlights.
    #[default]
    Filmic,
    /// Khronos' neutral one: base colours come out as they are, highlights alone are compressed. For products.
    Neutral,
}

impl ToneMapping {
    /// All there are.
    pub const ALL: [Self; 2] = [Self::Filmic, Self::Neutral];

    /// What people call it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Filmic => "filmic",
            Self::Neutral => "neutral",
        }
    }
}

/// How edges are smoothed; the later, the more it costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum AntiAliasing {
    /// Not at all.
    None,
    /// In the finished picture, which knows no more than itself: what is thinner than a pixel stays broken. A frame is a
    /// function of what it is made of.
    #[default]
    Spatial,
    /// By what earlier frames saw through other points of their pixels, fetched from where it was. A picture that stands
    /// is a mean of up to 64 frames; one that moves goes by the last dozen, and depends on them. Two more pictures of
    /// eight bytes a pixel, and one of four where things move by themselves.
    Temporal,
}

impl AntiAliasing {
    /// All there are.
    pub const ALL: [Self; 3] = [Self::None, Self::Spatial, Self::Temporal];

    /// Its name for people and on command lines.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Spatial => "spatial",
            Self::Temporal => "temporal",
        }
    }
}

/// How relief mapping looks for where the eye's ray meets a mesh's height map, the cheapest first. How far off each is, and
/// what it costs: docs/benchmarks/surfaces.md.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ReliefMethod {
    /// Not at all: one lookup says how far the surface slides (Welsh, "Parallax mapping with offset limiting", 2004).
    Parallax,
    /// The first of equal steps that lies below (McGuire and McGuire, "Steep parallax mapping", 2005): terraces.
    SteepParallax,
    /// The same, then where the chords of the last step cross (Tatarchuk, "Dynamic parallax occlusion mapping", 2006).
    ParallaxOcclusion,
    /// The same, then eight halvings (Policarpo, Oliveira and Comba, "Real-time relief mapping on arbitrary polygonal
    /// surfaces", 2005).
    #[default]
    Relief,
    #[cfg(any(test, feature = "methods"))]
    /// Steps to the edge of cones that a ray may pierce once, then halvings (Policarpo and Oliveira, "Relaxed cone stepping
    /// for relief mapping", 2007). Of height maps that repeat, have at most 256² texels, and are seen at about a texel a
    /// pixel or nearer; else as [`Self::Relief`]. The first frame that draws a map so looks for its cones, at a
    /// cost of the fourth power of its side.
    RelaxedCones,
    #[cfg(any(test, feature = "methods"))]
    /// Over cells of a pyramid of largest heights, to the exact hit (Tevs, Ihrke and Seidel, "Maximum mipmaps", 2008;
    /// Drobot, "Quadtree displacement mapping", 2010). Of height maps that repeat, have at most 2048² texels, and are
    /// seen so; else as [`Self::Relief`]. The pyramid takes 5⅓ bytes a texel on the device.
    Quadtree,
}

impl ReliefMethod {
    /// All methods that are compiled.
    pub const ALL: [Self; Self::COUNT] = [
        Self::Parallax,
        Self::SteepParallax,
        Self::ParallaxOcclusion,
        Self::Relief,
        #[cfg(any(test, feature = "methods"))]
        Self::RelaxedCones,
        #[cfg(any(test, feature = "methods"))]
        Self::Quadtree,
    ];
    const COUNT: usize = if cfg!(any(test, feature = "methods")) { 6 } else { 4 };

    /// Its name for people and on command lines.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Parallax => "parallax",
            Self::SteepParallax => "steep-parallax",
            Self::ParallaxOcclusion => "parallax-occlusion",
            Self::Relief => "relief",
            #[cfg(any(test, feature = "methods"))]
            Self::RelaxedCones => "relaxed-cones",
            #[cfg(any(test, feature = "methods"))]
            Self::Quadtree => "quadtree",
        }
    }

    /// What of a height map must be known beforehand.
    pub(crate) const fn aid(self) -> Option<ReliefAcceleration> {
        match self {
            #[cfg(any(test, feature = "methods"))]
            Self::RelaxedCones => Some(ReliefAcceleration::Cones),
            #[cfg(any(test, feature = "methods"))]
            Self::Quadtree => Some(ReliefAcceleration::Pyramid),
            _ => None,
        }
    }
}

/// How to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// What colours the surfaces.
    pub shade: DebugView,
    /// Draw the edges of the triangles over the lit surface. Needs a device that can (most can);
    /// elsewhere it is left out and a warning logged.
    pub wireframe: bool,
    /// Ambient occlusion; `None` saves two passes.
    pub occlusion: Option<AmbientOcclusion>,
    /// Shadows of the sun; `None` saves two passes.
    pub shadows: Option<Shadows>,
    /// How punctual lights are told from those that do not reach a pixel; `None` leaves punctual lights out.
    pub lights: Option<LightCulling>,
    /// Haze, where an environment has some. Without, the sky below the horizon is the ground's: its maps are other ones.
    pub haze: bool,
    /// Light that surfaces give off.
    pub emission: bool,
    /// What is seen through; without, it is not drawn.
    pub transparency: bool,
    /// How edges are smoothed, before a picture is enlarged. Left out for targets with depth or with something in them,
    /// whose host may do it when all is drawn.
    pub anti_aliasing: AntiAliasing,
    /// Lookups of a texture along the footprint of a pixel that sees its surface at a grazing angle, 1 to
    /// [`MAX_ANISOTROPY`]: fewer are blurred along. Of drivers in software and those without such a filter; others have
    /// eight.
    pub anisotropy: u32,
    /// Relief mapping for materials with a height map.
    pub relief: bool,
    /// Steps of relief mapping's linear search at grazing angles, 1 to [`MAX_RELIEF_STEPS`]: details thinner than a step
    /// may be jumped over. Looking straight down a quarter as many are taken, and on the ground five twelfths.
    pub relief_steps: u32,
    /// How relief mapping of meshes looks for the hit; the ground's is always [`ReliefMethod::Relief`].
    pub relief_method: ReliefMethod,
    /// Whether the sun leaves dark what heights of a mesh's relief hide from it; the ground's hide nothing. Takes as many
    /// lookups again as the search by equal steps, less where the sun is high.
    pub relief_shadows: bool,
    /// Whether depth is that of what a mesh's relief shows, so that things which stand in it or reach through it meet it
    /// where they should, and ambient occlusion sees it. Not of what gives off light. Shadows of such surfaces in the sun's
    /// maps then begin at the deepest of the relief, its own heights hide the sun by [`Self::relief_shadows`] alone, and
    /// the depth test comes after their fragments.
    pub relief_in_depth: bool,
    /// Meshes' triangles as curved patches; `None` draws them flat. A device without storage in vertex shaders always does,
    /// and a warning is logged.
    pub pn_triangles: Option<PnTriangles>,
    /// Water, where a frame has some.
    pub water: bool,
    /// What smooth surfaces and water mirror of the picture; `None` leaves them the sky, and saves two passes.
    pub reflections: Option<Reflections>,
    /// Light that spreads around what is bright; `None` saves a pass.
    pub bloom: Option<Bloom>,
    #[cfg(any(test, feature = "methods"))]
    /// Strokes along contours, and light in levels; `None` saves two passes. Triangles are then flat, whatever
    /// [`Self::pn_triangles`] says: contours are those of flat ones. A device without storage in vertex shaders draws none,
    /// and a warning is logged.
    pub ink: Option<Ink>,
    /// Distance of the near plane in world units, > 0: the depth that is stored is `near / view depth`. Reversed
    /// floating-point depth has the same relative precision everywhere, so this may be tiny: a thousandth of the
    /// smallest thing worth looking at costs nothing.
    pub near: f64,
    /// Factor on radiance before tone mapping.
    pub exposure: f32,
    /// From radiance to what is shown.
    pub tone_mapping: ToneMapping,
    /// Noise of half a step of 256 against bands in even gradients, the same in each frame.
    pub dither: bool,
    /// Seconds that a new vertex takes to its position; 0 = at once.
    pub morph_s: f32,
    /// Share of the target's sides in which the picture is drawn, [`MIN_RENDER_SCALE`] to 1, before it is enlarged
    /// (bilinear): half of it costs a quarter per pixel. Targets with depth, and those that keep what is in them, are
    /// always drawn in full.
    pub render_scale: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            shade: DebugView::Material,
            wireframe: false,
            occlusion: Some(AmbientOcclusion::default()),
            shadows: Some(Shadows::default()),
            lights: Some(LightCulling::default()),
            haze: true,
            emission: true,
            transparency: true,
            anti_aliasing: AntiAliasing::Spatial,
            anisotropy: 4,
            relief: true,
            relief_steps: 48,
            relief_method: ReliefMethod::default(),
            relief_shadows: false,
            relief_in_depth: false,
            pn_triangles: None,
            water: true,
            reflections: None,
            bloom: None,
            #[cfg(any(test, feature = "methods"))]
            ink: None,
            near: 1e-4,
            exposure: 1.0,
            tone_mapping: ToneMapping::Filmic,
            dither: true,
            morph_s: 0.25,
            render_scale: 1.0,
        }
    }
}

impl Settings {
    /// How meshes are curved, where a device can and nothing speaks against it.
    pub(crate) fn curves(&self, gpu: &Gpu) -> Option<PnTriangles> {
        self.pn_triangles.filter(|_| gpu.can_curve() && !self.draws_ink(gpu))
    }

    /// Whether ink is requested and the device can draw it.
    pub(crate) fn draws_ink(&self, gpu: &Gpu) -> bool {
        self.asks_for_ink() && gpu.can_ink()
    }

    /// Whether ink is requested. Without the feature `methods` it cannot be.
    pub(crate) fn asks_for_ink(&self) -> bool {
        #[cfg(any(test, feature = "methods"))]
        return self.ink.is_some();
        #[cfg(not(any(test, feature = "methods")))]
        return false;
    }
}

/// One picture to draw.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Where from.
    pub camera: Pose,
    /// What.
    pub drawables: &'a [Drawable<'a>],
    /// On which ground.
    pub terrain: Option<TerrainFrame<'a>>,
    /// Under which water.
    pub water: Option<Water>,
    /// Lit by which punctual lights, beside sun and sky; of more than [`super::MAX_LIGHTS`] in view the furthest are left out. A
    /// device without compute shaders leaves all out.
    pub lights: &'a [Light],
    /// In which light.
    pub environment: Environment,
    /// The maps of its sky, where somebody has computed them; else the first frame in this light does.
    pub sky: Option<&'a SkyMaps>,
    /// How.
    pub settings: Settings,
    /// Now, in seconds of the clock of [`super::PackedVertex::birth_s`].
    pub time_s: f32,
}

impl<'a> Frame<'a> {
    /// A frame with default light and settings, at a time when every morph is over.
    #[must_use]
    pub fn new(camera: Pose, drawables: &'a [Drawable<'a>]) -> Self {
        Self {
            camera,
            drawables,
            terrain: None,
            water: None,
            lights: &[],
            environment: Environment::default(),
            sky: None,
            settings: Settings::default(),
            time_s: f32::MAX,
        }
    }
}
