//! The input of a frame: camera, scene data and [`Settings`].

use lodestream_scene::placement::Placement;
use lodestream_scene::pose::Pose;
use lodestream_scene::punctual_lights::PunctualLight;
use lodestream_scene::section::SectionPlanes;

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
use crate::scene::lights::LightCulling;
use crate::scene::relief_acceleration::ReliefAcceleration;
use crate::scene::terrain::TerrainFrame;

/// Most texture lookups along a pixel's footprint.
pub const MAX_ANISOTROPY: u32 = 16;
/// Least [`Settings::render_scale`].
pub const MIN_RENDER_SCALE: f32 = 0.25;
/// Most linear steps of relief mapping.
pub const MAX_RELIEF_STEPS: u32 = 1024;

/// Most cascades of the sun's shadow maps.
pub const MAX_CASCADES: usize = 4;
/// Least and most texels along a shadow map's side.
pub const MAP_SIDES: [u32; 2] = [128, 8192];
/// Least and most snapping steps along a shadow map's side.
pub const MAP_STEPS: [u32; 2] = [4, 16];
/// Widest shadow filter.
pub const MAX_FILTER: u32 = 3;

/// An asset with its instances. Several instances make one draw call per material.
#[derive(Clone, Copy, Debug)]
pub struct Drawable<'a> {
    /// The asset.
    pub asset: &'a AssetGpu,
    /// Its placements. [`AntiAliasing::Temporal`] matches the instances of consecutive frames by index where their
    /// number is equal, and derives their motion.
    pub instances: &'a [Placement],
}

/// Shadows of the sun: cascaded shadow maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shadows {
    /// Number of cascades, 1 to [`MAX_CASCADES`]; fewer are drawn where fewer suffice. Each costs the triangles of its
    /// casters whenever one of them changes or the cascade moves.
    pub cascades: u32,
    /// Texels along a side of each map, within [`MAP_SIDES`]; four bytes each. Shadow edges are blurred by about a
    /// texel, which is one to five pixels at 720 lines and 2048 texels.
    pub map_side: u32,
    /// Filter width in texels less one, 1 to [`MAX_FILTER`]; takes this many bilinear lookups squared. A wider filter
    /// needs a larger depth bias.
    pub filter: u32,
    /// Snapping steps along a map's side, a power of two within [`MAP_STEPS`]. A map follows the eye in whole steps,
    /// and each step redraws it. With 4 steps a map covers a quarter more along its sides than with 16, and is redrawn
    /// five times less often while the camera flies.
    pub steps: u32,
    /// Frames for which a map that does not move may be out of date, for moving scenes on slow devices. With 0, a
    /// frame depends only on its own input.
    pub max_staleness: u32,
}

impl Default for Shadows {
    fn default() -> Self {
        Self { cascades: 4, map_side: 2048, filter: 2, steps: MAP_STEPS[1], max_staleness: 0 }
    }
}

impl Shadows {
    /// Clamps all values to their ranges, on a device with textures of at most `side` texels along a side. Maps move
    /// by whole texels, so sides are multiples of the most steps.
    pub(crate) fn clamped(self, side: u32) -> Self {
        let [least, most] = MAP_SIDES;
        Self {
            cascades: self.cascades.clamp(1, MAX_CASCADES as u32),
            map_side: self.map_side.clamp(least, most.min(side).max(least)) / MAP_STEPS[1] * MAP_STEPS[1],
            filter: self.filter.clamp(1, MAX_FILTER),
            ..self
        }
    }

    /// Number of snapping steps along a map's side.
    pub(crate) fn grid(self) -> f64 {
        let [least, most] = MAP_STEPS;
        let steps = self.steps.clamp(least, most);
        // Round down to a power of two.
        f64::from(1_u32 << steps.ilog2())
    }
}

/// Drawing mode: the lit picture, or an intermediate result. For an intermediate result only the passes that it needs
/// run, nothing is lit, tone-mapped or smoothed, and the background is black.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DebugView {
    /// The lit materials.
    #[default]
    Material,
    /// Level of refinement, [`crate::PackedVertex::level`].
    Level,
    /// The cascade that determines the sun's shadow.
    Cascade,
    /// World normals: −1 to 1 of each axis as 0 to 255; black for unlit surfaces.
    Normal,
    /// Base colour, sRGB.
    Albedo,
    /// Roughness (red), metalness (green) and the material's ambient occlusion (blue): 0 to 1 as 0 to 255.
    Surface,
    /// View depth: a colour per power of two of world units, darkening to two fifths at its far end.
    Depth,
    /// Ambient occlusion: open is white. White without [`Settings::occlusion`].
    Occlusion,
    /// Share of the sun's light that shadows leave: white is all. White without [`Settings::shadows`].
    Sunlight,
    /// Motion since the previous frame: right red, left blue, up green, down dark, on a logarithmic scale that
    /// saturates at 64 pixels; grey for no motion.
    Motion,
    /// Number of punctual lights evaluated per pixel: blue for few, over green and yellow to red for 64; black for
    /// none.
    PunctualLights,
    /// Overdraw, counting fragments that passed the depth test: dark blue once, green four times, dark red eight times
    /// and more. Transparent fragments count where they lie before all opaque ones.
    Overdraw,
}

impl DebugView {
    /// All variants.
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

    /// Whether the picture is lit.
    pub(crate) const fn is_lit(self) -> bool {
        matches!(self, Self::Material | Self::Level | Self::Cascade)
    }

    /// Name on command lines and in the overlay.
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

/// Tone mapping: the curve from radiance to display values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ToneMapping {
    /// Narkowicz's fit of the ACES filmic curve: contrast in the mid-tones, soft highlights.
    #[default]
    Filmic,
    /// Khronos PBR Neutral: keeps base colours and compresses highlights only. For products.
    Neutral,
}

impl ToneMapping {
    /// All variants.
    pub const ALL: [Self; 2] = [Self::Filmic, Self::Neutral];

    /// Name on command lines and in the overlay.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Filmic => "filmic",
            Self::Neutral => "neutral",
        }
    }
}

/// Anti-aliasing, in order of cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum AntiAliasing {
    /// None.
    None,
    /// Post-process anti-aliasing of the finished picture. Details thinner than a pixel stay broken. A frame depends
    /// only on its own input.
    #[default]
    Spatial,
    /// Temporal anti-aliasing: blends reprojected earlier frames, each with another subpixel offset. A still picture
    /// averages up to 64 frames, a moving one about a dozen. Takes two more pictures of eight bytes a pixel, and one
    /// of four where objects move.
    Temporal,
}

impl AntiAliasing {
    /// All variants.
    pub const ALL: [Self; 3] = [Self::None, Self::Spatial, Self::Temporal];

    /// Name on command lines and in the overlay.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Spatial => "spatial",
            Self::Temporal => "temporal",
        }
    }
}

/// Search for the intersection of the view ray with a mesh's height map, cheapest first. Errors and costs are in
/// docs/benchmarks/surfaces.md.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ReliefMethod {
    #[cfg(any(test, feature = "methods"))]
    /// Parallax mapping: one lookup, no search (Welsh, "Parallax mapping with offset limiting", 2004).
    Parallax,
    #[cfg(any(test, feature = "methods"))]
    /// Linear search that takes the first sample below the surface (McGuire and McGuire, "Steep parallax mapping",
    /// 2005). Shows terraces.
    SteepParallax,
    #[cfg(any(test, feature = "methods"))]
    /// Linear search, then the intersection of the last step's chords (Tatarchuk, "Dynamic parallax occlusion
    /// mapping", 2006).
    ParallaxOcclusion,
    /// Linear search, then eight bisections (Policarpo, Oliveira and Comba, "Real-time relief mapping on arbitrary
    /// polygonal surfaces", 2005).
    #[default]
    Relief,
    #[cfg(any(test, feature = "methods"))]
    /// Relaxed cone stepping, then bisection (Policarpo and Oliveira, "Relaxed cone stepping for relief mapping",
    /// 2007). Applies to repeating height maps of at most 256² texels that are seen at about a texel a pixel or
    /// nearer; others use [`Self::Relief`]. The first frame that draws a map computes its cones, at a cost
    /// proportional to the fourth power of its side.
    RelaxedCones,
    #[cfg(any(test, feature = "methods"))]
    /// Traversal of a maximum pyramid to the exact intersection (Tevs, Ihrke and Seidel, "Maximum mipmaps", 2008;
    /// Drobot, "Quadtree displacement mapping", 2010). Applies to repeating height maps of at most 2048² texels that
    /// are seen at about a texel a pixel or nearer; others use [`Self::Relief`]. The pyramid takes 5⅓ bytes a texel on
    /// the device.
    Quadtree,
}

impl ReliefMethod {
    /// All methods that are compiled.
    pub const ALL: [Self; Self::COUNT] = [
        #[cfg(any(test, feature = "methods"))]
        Self::Parallax,
        #[cfg(any(test, feature = "methods"))]
        Self::SteepParallax,
        #[cfg(any(test, feature = "methods"))]
        Self::ParallaxOcclusion,
        Self::Relief,
        #[cfg(any(test, feature = "methods"))]
        Self::RelaxedCones,
        #[cfg(any(test, feature = "methods"))]
        Self::Quadtree,
    ];
    const COUNT: usize = if cfg!(any(test, feature = "methods")) { 6 } else { 1 };

    /// Name on command lines and in the overlay.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            #[cfg(any(test, feature = "methods"))]
            Self::Parallax => "parallax",
            #[cfg(any(test, feature = "methods"))]
            Self::SteepParallax => "steep-parallax",
            #[cfg(any(test, feature = "methods"))]
            Self::ParallaxOcclusion => "parallax-occlusion",
            Self::Relief => "relief",
            #[cfg(any(test, feature = "methods"))]
            Self::RelaxedCones => "relaxed-cones",
            #[cfg(any(test, feature = "methods"))]
            Self::Quadtree => "quadtree",
        }
    }

    /// The acceleration texture that the search needs, if any.
    pub(crate) const fn acceleration(self) -> Option<ReliefAcceleration> {
        match self {
            #[cfg(any(test, feature = "methods"))]
            Self::RelaxedCones => Some(ReliefAcceleration::Cones),
            #[cfg(any(test, feature = "methods"))]
            Self::Quadtree => Some(ReliefAcceleration::Pyramid),
            _ => None,
        }
    }
}

/// Settings of the renderer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Drawing mode.
    pub debug_view: DebugView,
    /// Draws triangle edges over the lit surface. Most devices support it; others omit the edges and log a warning.
    pub wireframe: bool,
    /// Ambient occlusion; `None` saves two passes.
    pub occlusion: Option<AmbientOcclusion>,
    /// Shadows of the sun; `None` saves two passes.
    pub shadows: Option<Shadows>,
    /// How punctual lights are culled; `None` omits them.
    pub lights: Option<LightCulling>,
    /// Draws the environment's haze, but not in parallel projection. Without haze, the sky below the horizon shows the
    /// ground, so it needs other sky maps.
    pub haze: bool,
    /// Emission of surfaces.
    pub emission: bool,
    /// Draws transparent surfaces.
    pub transparency: bool,
    /// Anti-aliasing, applied before upscaling. Omitted for targets with depth and for targets whose content is kept:
    /// the host may smooth the picture after its own drawing.
    pub anti_aliasing: AntiAliasing,
    /// Texture lookups along the footprint of a pixel at a grazing angle, 1 to [`MAX_ANISOTROPY`]; with fewer,
    /// textures blur. Applies to software drivers and devices without anisotropic filtering; others use eight. With 1,
    /// levels of tiled textures are not mixed.
    pub anisotropy: u32,
    /// Relief mapping for materials with a height map.
    pub relief: bool,
    /// Linear search steps of relief mapping at grazing angles, 1 to [`MAX_RELIEF_STEPS`]. Details thinner than a step
    /// may be missed. Head-on views take a quarter of the steps, terrain five twelfths.
    pub relief_steps: u32,
    /// Search method of relief mapping for meshes; terrain always uses [`ReliefMethod::Relief`].
    pub relief_method: ReliefMethod,
    /// Self-shadowing of relief by the sun, for meshes only. Takes as many lookups again as the linear search, fewer
    /// where the sun is high.
    pub relief_shadows: bool,
    /// Writes the depth of the relief rather than of the mesh, so that intersecting objects and ambient occlusion meet
    /// the relief. Does not apply to emissive surfaces. Such surfaces cast shadows from the deepest point of the
    /// relief, shadow themselves through [`Self::relief_shadows`] only, and lose the early depth test.
    pub relief_in_depth: bool,
    #[cfg(any(test, feature = "methods"))]
    /// PN triangles: draws meshes' triangles as curved patches; `None` draws them flat. A device without storage
    /// buffers in vertex shaders draws them flat and logs a warning.
    pub pn_triangles: Option<PnTriangles>,
    /// Section planes: what lies beyond one is cut away from meshes, and casts no shadow. Where a plane cuts a closed mesh
    /// whose faces are wound counterclockwise seen from outside, a cap in the material's mean colour fills it; of open
    /// meshes, the inside shows as a cap too. Transparent surfaces are cut without caps; terrain and water are not cut.
    /// The first frame with planes compiles pipelines.
    pub sections: SectionPlanes,
    /// Radiance, in red, green and blue, that is shown where there is no surface, in place of the sky, which lights and is
    /// mirrored all the same.
    pub background: Option<[f32; 3]>,
    /// Draws the frame's water.
    pub water: bool,
    /// Screen-space reflections on smooth surfaces and water; `None` reflects the sky only and saves two passes.
    pub reflections: Option<Reflections>,
    /// Bloom; `None` saves a pass.
    pub bloom: Option<Bloom>,
    #[cfg(any(test, feature = "methods"))]
    /// Ink: strokes along contours and quantised light; `None` saves two passes. Ink overrides [`Self::pn_triangles`],
    /// because contours are computed on flat triangles. A device without storage buffers in vertex shaders draws no
    /// ink and logs a warning.
    pub ink: Option<Ink>,
    /// Distance of the near plane in world units, > 0. Stored depth is `near / view depth`. Reversed floating-point
    /// depth has the same relative precision everywhere, so a small value costs nothing: a thousandth of the smallest
    /// object is fine.
    pub near: f64,
    /// Factor on radiance before tone mapping.
    pub exposure: f32,
    /// Tone mapping curve.
    pub tone_mapping: ToneMapping,
    /// Dithers by half a step of 8 bits against banding; the same noise in each frame.
    pub dither: bool,
    /// Seconds over which a new vertex morphs to its position; 0 = at once.
    pub morph_s: f32,
    /// Share of the target's width and height at which the picture is drawn, [`MIN_RENDER_SCALE`] to 1, before
    /// bilinear upscaling: 0.5 quarters the cost per pixel. Targets with depth, and targets whose content is kept, are
    /// always drawn in full.
    pub render_scale: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            debug_view: DebugView::Material,
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
            #[cfg(any(test, feature = "methods"))]
            pn_triangles: None,
            sections: SectionPlanes::NONE,
            background: None,
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
    /// The settings of PN triangles, if they are requested, supported and not overridden by ink.
    pub(crate) fn curves(&self, gpu: &Gpu) -> Option<PnTriangles> {
        self.asks_for_curves().filter(|_| gpu.can_curve() && !self.draws_ink(gpu))
    }

    /// The settings of PN triangles, if they are requested. Without the feature `methods` they cannot be.
    pub(crate) fn asks_for_curves(&self) -> Option<PnTriangles> {
        #[cfg(any(test, feature = "methods"))]
        return self.pn_triangles;
        #[cfg(not(any(test, feature = "methods")))]
        return None;
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

/// One picture to draw: the scene as one camera sees it.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Camera.
    pub camera: Pose,
    /// Assets and their instances.
    pub drawables: &'a [Drawable<'a>],
    /// Terrain.
    pub terrain: Option<TerrainFrame<'a>>,
    /// Water.
    pub water: Option<Water>,
    /// Punctual lights; they cast no shadows. An intensity of π times [`crate::GradientSky::sun`] lights a surface at
    /// distance 1 as the sun does. Of more than [`crate::MAX_LIGHTS`] in view, the farthest are omitted. A device
    /// without compute shaders omits all.
    pub lights: &'a [PunctualLight],
    /// Sun, sky and haze.
    pub environment: Environment,
    /// Precomputed sky maps of the environment. Without them, the first frame in this environment computes them.
    pub sky: Option<&'a SkyMaps>,
    /// Settings.
    pub settings: Settings,
    /// Current time, in seconds of the clock of [`crate::PackedVertex::birth_s`].
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
