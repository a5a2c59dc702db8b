//! Frame graph: selects the passes that a frame needs, from the resources that they read and write.
//!
//! Passes are declared in execution order. Planning walks back from the wanted resources and keeps a pass only if
//! something reads its output; textures are allocated for planned passes only.

/// A pass of the frame graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum PassId {
    /// Builds the patch lists of PN triangles, by tessellation level.
    Patches,
    /// Overdraw per pixel, in place of the surfaces.
    Overdraw,
    /// Draws surfaces into depth, normal and albedo.
    GBuffer,
    /// Depth of the caps of solids that section planes cut.
    Caps,
    /// Draws specular reflection of dielectrics, where materials set it.
    Specular,
    /// Ambient occlusion by one of [`crate::OcclusionMethod`], in 16 rotations.
    Occlusion,
    /// 4×4 blur that removes the rotation's pattern.
    OcclusionBlur,
    /// Draws shadow casters into the cascades; maps without changes are kept.
    ShadowMaps,
    /// Shadow lookup: share of the sun's light per pixel.
    Sunlight,
    /// Sun and ambient light on the surfaces, sky elsewhere.
    Lighting,
    /// Shadows on the ground of a studio, over its background; its maps are redrawn when the objects change.
    Floor,
    /// Sky alone, when there is no surface.
    Sky,
    /// Culls punctual lights by tile and adds their light.
    PunctualLights,
    /// Emission of surfaces.
    Emission,
    /// Depth pyramid for hierarchical ray tracing.
    DepthPyramid,
    /// Screen-space reflections on smooth surfaces.
    Reflections,
    /// Water over the lit picture.
    Water,
    /// Transparent surfaces over the lit picture, back to front.
    Transparency,
    /// Extracts the visible strokes of ink.
    Strokes,
    /// Composes blurred strokes over the lit picture with quantised light.
    Ink,
    /// Triangle edges, counted per pixel.
    Edges,
    /// Blends the edges over the lit picture where they are not too dense.
    Wireframe,
    /// Bloom.
    Bloom,
    /// Motion vectors of moving objects.
    Motion,
    /// Temporal anti-aliasing: blends the picture with its history.
    Temporal,
    /// Radiance to display values.
    ToneMap,
    /// Post-process anti-aliasing.
    AntiAlias,
    /// Upscales the picture to the target's size.
    Enlarge,
    /// Composes the picture into a host's targets: with depth, or over existing content.
    Composite,
    /// Shows an intermediate result in place of the picture.
    Debug,
}

impl PassId {
    /// Name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Patches => "patches",
            Self::Overdraw => "overdraw",
            Self::GBuffer => "g_buffer",
            Self::Caps => "caps",
            Self::Specular => "specular",
            Self::Occlusion => "occlusion",
            Self::OcclusionBlur => "occlusion_blur",
            Self::ShadowMaps => "shadow_maps",
            Self::Sunlight => "sunlight",
            Self::Lighting => "lighting",
            Self::Floor => "floor",
            Self::Sky => "sky",
            Self::PunctualLights => "punctual_lights",
            Self::Emission => "emission",
            Self::DepthPyramid => "depth_pyramid",
            Self::Reflections => "reflections",
            Self::Water => "water",
            Self::Transparency => "transparency",
            Self::Strokes => "strokes",
            Self::Ink => "ink",
            Self::Edges => "edges",
            Self::Wireframe => "wireframe",
            Self::Bloom => "bloom",
            Self::Motion => "motion",
            Self::Temporal => "temporal",
            Self::ToneMap => "tone_map",
            Self::AntiAlias => "anti_alias",
            Self::Enlarge => "enlarge",
            Self::Composite => "composite",
            Self::Debug => "debug",
        }
    }
}

/// Textures and buffers between passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) enum Resource {
    /// Patch lists; allocated by their own pass.
    Patches,
    Depth,
    Normal,
    Albedo,
    /// Specular reflection of dielectrics, if a material sets it.
    Specular,
    OcclusionRaw,
    /// Occlusion at half resolution.
    OcclusionHalf,
    /// Occlusion accumulated over frames.
    OcclusionMean,
    Occlusion,
    /// Cascades; of fixed size, allocated by their own pass.
    ShadowMaps,
    Sunlight,
    /// Coverage of each pixel by strokes.
    Strokes,
    /// Number of triangle edges per pixel.
    Edges,
    Radiance,
    /// Copy of the lit picture, from before reflections or ink.
    Lit,
    /// Depth pyramid; allocated by its own pass.
    Pyramid,
    /// Motion of moving objects since the previous frame.
    Motion,
    /// Accumulated picture of temporal anti-aliasing; allocated by its own pass.
    History,
    /// Display values before anti-aliasing.
    Display,
    /// Display values before upscaling.
    Smoothed,
    /// Overdraw per pixel.
    Overdraw,
    /// The caller's target; not allocated here.
    Target,
}

/// A pass with what it reads and writes. A pass that draws over something lists it in both.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pass {
    pub(crate) id: PassId,
    reads: &'static [Resource],
    /// Read besides `reads`.
    also: &'static [Resource],
    writes: &'static [Resource],
}

impl Pass {
    /// Whether it reads a resource.
    pub(crate) fn reads(&self, resource: Resource) -> bool {
        self.inputs().any(|read| read == resource)
    }

    fn inputs(&self) -> impl Iterator<Item = Resource> {
        self.reads.iter().chain(self.also).copied()
    }

    /// Whether it writes a resource.
    pub(crate) fn writes(&self, resource: Resource) -> bool {
        self.writes.contains(&resource)
    }
}

/// What a frame requires of the graph.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Needs {
    pub(crate) geometry: bool,
    /// There are section planes.
    pub(crate) sections: bool,
    /// PN triangles are drawn.
    pub(crate) curved: bool,
    /// Materials set the specular reflection of dielectrics.
    pub(crate) specular: bool,
    pub(crate) occlusion: bool,
    /// Occlusion reads the G-buffer's normals.
    pub(crate) drawn_normals: bool,
    /// Occlusion at half resolution, unless it is accumulated.
    pub(crate) half_occlusion: bool,
    /// Occlusion is accumulated over frames; `Some(true)` if all frames are done.
    pub(crate) still: Option<bool>,
    pub(crate) shadows: bool,
    /// There is the ground of a studio.
    pub(crate) floor: bool,
    pub(crate) punctual_lights: bool,
    pub(crate) emission: bool,
    /// Screen-space reflections; `Some(true)` with the depth pyramid.
    pub(crate) reflections: Option<bool>,
    pub(crate) bloom: bool,
    pub(crate) water: bool,
    pub(crate) transparency: bool,
    /// Ink is drawn.
    pub(crate) ink: bool,
    pub(crate) wireframe: bool,
    /// Objects move.
    pub(crate) motion: bool,
    /// Temporal anti-aliasing.
    pub(crate) temporal: bool,
    /// Post-process anti-aliasing.
    pub(crate) antialias: bool,
    /// The picture is upscaled.
    pub(crate) enlarged: bool,
    /// The target has depth.
    pub(crate) depth: bool,
    /// The target's content is kept where no surface is.
    pub(crate) keep: bool,
    /// Resources that the debug view reads, if one is shown.
    pub(crate) shown: Option<&'static [Resource]>,
}

/// The passes that could run, in order.
pub(crate) fn candidates(needs: Needs) -> Vec<Pass> {
    use Resource::{
        Albedo, Depth, Display, Edges, History, Lit, Motion, Normal, Occlusion, OcclusionHalf, OcclusionMean,
        OcclusionRaw, Overdraw, Patches, Pyramid, Radiance, ShadowMaps, Smoothed, Specular, Strokes,
        Sunlight, Target,
    };
    let pass = |id, reads, writes| Pass { id, reads, also: &[], writes };
    let also: &[Resource] = if needs.specular { &[Specular] } else { &[] };
    let lit = |id, reads, writes| Pass { also, ..pass(id, reads, writes) };
    let mut passes = Vec::new();
    if needs.geometry {
        let drawn_by: &[Resource] = if needs.curved { &[Patches] } else { &[] };
        passes.push(pass(PassId::Patches, &[], &[Patches]));
        passes.push(pass(PassId::GBuffer, drawn_by, &[Depth, Normal, Albedo]));
        if needs.sections {
            passes.push(pass(PassId::Caps, &[Depth, Normal], &[Depth]));
        }
        if needs.specular {
            passes.push(pass(PassId::Specular, &[Depth], &[Specular]));
        }
        if needs.shown.is_some_and(|shown| shown.contains(&Overdraw)) {
            // Drawn with its own depth test, from cleared depth.
            passes.push(pass(PassId::Overdraw, drawn_by, &[Depth, Overdraw]));
        }
        match needs.still {
            None => {
                let seen_by: &[Resource] = if needs.drawn_normals { &[Depth, Normal] } else { &[Depth] };
                let (estimate, blurred): (&[Resource], &[Resource]) = match needs.half_occlusion {
                    false => (&[OcclusionRaw], &[Depth, OcclusionRaw]),
                    true => (&[OcclusionHalf], &[Depth, OcclusionHalf]),
                };
                passes.push(pass(PassId::Occlusion, seen_by, estimate));
                passes.push(pass(PassId::OcclusionBlur, blurred, &[Occlusion]));
            }
            Some(false) => {
                let seen_by: &[Resource] = if needs.drawn_normals {
                    &[Depth, Normal, OcclusionMean]
                } else {
                    &[Depth, OcclusionMean]
                };
                passes.push(pass(PassId::Occlusion, seen_by, &[OcclusionMean]));
                passes.push(pass(PassId::OcclusionBlur, &[Depth, OcclusionMean], &[Occlusion]));
            }
            // The accumulated result is reused.
            Some(true) => {}
        }
        passes.push(pass(PassId::ShadowMaps, &[], &[ShadowMaps]));
        passes.push(pass(PassId::Sunlight, &[Depth, Normal, ShadowMaps], &[Sunlight]));
        let lit_by: &[Resource] = match (needs.occlusion, needs.shadows) {
            (false, false) => &[Depth, Normal, Albedo],
            (true, false) => &[Depth, Normal, Albedo, Occlusion],
            (false, true) => &[Depth, Normal, Albedo, Sunlight],
            (true, true) => &[Depth, Normal, Albedo, Occlusion, Sunlight],
        };
        passes.push(lit(PassId::Lighting, lit_by, &[Radiance]));
        if needs.floor {
            passes.push(pass(PassId::Floor, &[Depth, Radiance], &[Radiance]));
        }
        if needs.punctual_lights {
            passes.push(lit(PassId::PunctualLights, &[Depth, Normal, Albedo, Radiance], &[Radiance]));
        }
        if needs.emission {
            passes.push(pass(PassId::Emission, &[Depth, Radiance], &[Radiance]));
        }
        if let Some(by_cells) = needs.reflections {
            if by_cells {
                passes.push(pass(PassId::DepthPyramid, &[Depth], &[Pyramid]));
            }
            let mirrored: &[Resource] = match (needs.occlusion, by_cells) {
                (false, false) => &[Depth, Normal, Albedo, Radiance],
                (true, false) => &[Depth, Normal, Albedo, Radiance, Occlusion],
                (false, true) => &[Depth, Normal, Albedo, Radiance, Pyramid],
                (true, true) => &[Depth, Normal, Albedo, Radiance, Occlusion, Pyramid],
            };
            passes.push(lit(PassId::Reflections, mirrored, &[Lit, Radiance]));
        }
        let seen_by: &[Resource] =
            if needs.shadows { &[Depth, Radiance, ShadowMaps] } else { &[Depth, Radiance] };
        if needs.water {
            let water_by: &[Resource] = match (needs.reflections, needs.shadows) {
                (None, _) => seen_by,
                (Some(false), false) => &[Depth, Radiance, Lit],
                (Some(false), true) => &[Depth, Radiance, Lit, ShadowMaps],
                (Some(true), false) => &[Depth, Radiance, Lit, Pyramid],
                (Some(true), true) => &[Depth, Radiance, Lit, Pyramid, ShadowMaps],
            };
            passes.push(pass(PassId::Water, water_by, &[Radiance]));
        }
        if needs.transparency {
            passes.push(pass(PassId::Transparency, seen_by, &[Radiance]));
        }
        if needs.ink {
            passes.push(pass(PassId::Strokes, &[Depth], &[Strokes]));
            passes.push(pass(PassId::Ink, &[Depth, Albedo, Radiance, Strokes], &[Lit, Radiance]));
        }
        if needs.wireframe {
            passes.push(pass(PassId::Edges, &[Depth], &[Edges]));
            passes.push(pass(PassId::Wireframe, &[Edges, Radiance], &[Radiance]));
        }
        if needs.bloom {
            passes.push(pass(PassId::Bloom, &[Radiance], &[Radiance]));
        }
        if needs.motion {
            passes.push(pass(PassId::Motion, &[Depth], &[Motion]));
        }
        if needs.temporal {
            let seen_by: &[Resource] =
                if needs.motion { &[Radiance, Depth, Motion] } else { &[Radiance, Depth] };
            passes.push(pass(PassId::Temporal, seen_by, &[History]));
        }
    } else if !needs.keep {
        passes.push(pass(PassId::Sky, &[], &[Radiance]));
    }
    if let (Some(shown), true) = (needs.shown, needs.geometry) {
        passes.push(pass(PassId::Debug, shown, &[Target]));
    } else if needs.geometry && (needs.depth || needs.keep) {
        passes.push(pass(PassId::Composite, &[Radiance, Depth], &[Target]));
    } else if needs.temporal && needs.geometry {
        passes.push(pass(PassId::ToneMap, &[History], &[Target]));
    } else if needs.antialias && needs.geometry {
        passes.push(pass(PassId::ToneMap, &[Radiance], &[Display]));
        let into: &[Resource] = if needs.enlarged { &[Smoothed] } else { &[Target] };
        passes.push(pass(PassId::AntiAlias, &[Display], into));
        if needs.enlarged {
            passes.push(pass(PassId::Enlarge, &[Smoothed], &[Target]));
        }
    } else if needs.enlarged && needs.geometry && !needs.keep {
        // Tone mapping takes longer than enlarging what is tone mapped.
        passes.push(pass(PassId::ToneMap, &[Radiance], &[Smoothed]));
        passes.push(pass(PassId::Enlarge, &[Smoothed], &[Target]));
    } else if !needs.keep {
        // Sky alone needs no anti-aliasing.
        passes.push(pass(PassId::ToneMap, &[Radiance], &[Target]));
    }
    passes
}

/// The candidates that `wanted` depends on, in their order.
pub(crate) fn plan(candidates: &[Pass], wanted: &[Resource]) -> Vec<Pass> {
    let mut needed = wanted.to_vec();
    let mut kept: Vec<Pass> = Vec::new();
    for pass in candidates.iter().rev() {
        if pass.writes.iter().any(|w| needed.contains(w)) {
            needed.retain(|r| !pass.writes.contains(r));
            needed.extend(pass.inputs());
            kept.push(*pass);
        }
    }
    kept.reverse();
    kept
}

/// The resources that the planned passes touch.
pub(crate) fn resources(plan: &[Pass]) -> Vec<Resource> {
    let mut all: Vec<_> = plan.iter().flat_map(|p| p.inputs().chain(p.writes.iter().copied())).collect();
    all.sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(needs: Needs, wanted: &[Resource]) -> Vec<PassId> {
        plan(&candidates(needs), wanted).iter().map(|p| p.id).collect()
    }

    #[test]
    fn nothing_to_draw_needs_only_the_sky() {
        let needs = Needs { occlusion: true, wireframe: true, ..Needs::default() };
        assert_eq!(ids(needs, &[Resource::Target]), [PassId::Sky, PassId::ToneMap]);
        assert_eq!(
            resources(&plan(&candidates(needs), &[Resource::Target])),
            [Resource::Radiance, Resource::Target]
        );
    }

    #[test]
    fn passes_without_a_reader_are_dropped() {
        let needs = Needs { geometry: true, ..Needs::default() };
        assert_eq!(ids(needs, &[Resource::Target]), [PassId::GBuffer, PassId::Lighting, PassId::ToneMap]);
        assert_eq!(ids(needs, &[Resource::Depth]), [PassId::GBuffer]);
        assert_eq!(ids(needs, &[Resource::OcclusionRaw]), [PassId::GBuffer, PassId::Occlusion]);
    }

    #[test]
    fn all_requested_passes_run_in_order() {
        let needs = Needs {
            geometry: true,
            occlusion: true,
            shadows: true,
            specular: true,
            punctual_lights: true,
            emission: true,
            reflections: Some(true),
            bloom: true,
            water: true,
            transparency: true,
            wireframe: true,
            antialias: true,
            ..Needs::default()
        };
        assert_eq!(
            ids(needs, &[Resource::Target]),
            [
                PassId::GBuffer,
                PassId::Specular,
                PassId::Occlusion,
                PassId::OcclusionBlur,
                PassId::ShadowMaps,
                PassId::Sunlight,
                PassId::Lighting,
                PassId::PunctualLights,
                PassId::Emission,
                PassId::DepthPyramid,
                PassId::Reflections,
                PassId::Water,
                PassId::Transparency,
                PassId::Edges,
                PassId::Wireframe,
                PassId::Bloom,
                PassId::ToneMap,
                PassId::AntiAlias
            ]
        );
    }

    #[test]
    fn accumulated_occlusion_continues_from_itself_and_ends() {
        use PassId::{GBuffer, Lighting, Occlusion, OcclusionBlur, ToneMap};
        let with = |still| {
            ids(Needs { geometry: true, occlusion: true, still, ..Needs::default() }, &[Resource::Target])
        };
        let all = [GBuffer, Occlusion, OcclusionBlur, Lighting, ToneMap];
        assert_eq!((with(None), with(Some(false))), (all.to_vec(), all.to_vec()));
        assert_eq!(with(Some(true)), [GBuffer, Lighting, ToneMap]);
    }

    #[test]
    fn anti_aliasing_runs_before_upscaling() {
        use PassId::{AntiAlias, Enlarge, GBuffer, Lighting, Temporal, ToneMap};
        let needs = Needs { geometry: true, enlarged: true, antialias: true, ..Needs::default() };
        let spatial = ids(needs, &[Resource::Target]);
        assert_eq!(spatial, [GBuffer, Lighting, ToneMap, AntiAlias, Enlarge]);
        let none = Needs { antialias: false, ..needs };
        assert_eq!(ids(none, &[Resource::Target]), [GBuffer, Lighting, ToneMap, Enlarge]);
        // Passes that read a mean of frames upscale it themselves.
        let mean = Needs { temporal: true, ..none };
        assert_eq!(ids(mean, &[Resource::Target]), [GBuffer, Lighting, Temporal, ToneMap]);
    }

    #[test]
    fn a_host_that_keeps_its_picture_gets_no_sky() {
        let needs = Needs { keep: true, ..Needs::default() };
        assert_eq!(ids(needs, &[Resource::Target]), []);
        let needs = Needs { geometry: true, ..needs };
        assert_eq!(ids(needs, &[Resource::Target]), [PassId::GBuffer, PassId::Lighting, PassId::Composite]);
        let needs = Needs { depth: true, ..Needs::default() };
        assert_eq!(ids(needs, &[Resource::Target]), [PassId::Sky, PassId::ToneMap]);
    }

    #[test]
    fn a_debug_view_runs_only_the_passes_that_it_needs() {
        use PassId::{Debug, GBuffer, Occlusion, OcclusionBlur, Overdraw, ShadowMaps, Sunlight};
        use Resource::{Albedo, Depth, Normal};
        let all = Needs {
            geometry: true,
            occlusion: true,
            shadows: true,
            punctual_lights: true,
            emission: true,
            water: true,
            transparency: true,
            wireframe: true,
            antialias: true,
            ..Needs::default()
        };
        let shown = |shown| ids(Needs { shown: Some(shown), ..all }, &[Resource::Target]);
        assert_eq!(shown(&[Depth, Normal]), [GBuffer, Debug]);
        assert_eq!(shown(&[Depth, Normal, Albedo]), [GBuffer, Debug]);
        assert_eq!(shown(&[Depth]), [GBuffer, Debug]);
        assert_eq!(shown(&[Depth, Resource::Occlusion]), [GBuffer, Occlusion, OcclusionBlur, Debug]);
        assert_eq!(shown(&[Depth, Resource::Sunlight]), [GBuffer, ShadowMaps, Sunlight, Debug]);
        assert_eq!(shown(&[Depth, Resource::Overdraw]), [Overdraw, Debug]);
        let sky = Needs { shown: Some(&[Depth, Normal]), ..Needs::default() };
        assert_eq!(ids(sky, &[Resource::Target]), [PassId::Sky, PassId::ToneMap]);
    }

    #[test]
    fn every_read_was_written_before() {
        let shown: [Option<&'static [Resource]>; 8] = [
            None,
            Some(&[Resource::Depth]),
            Some(&[Resource::Depth, Resource::Normal]),
            Some(&[Resource::Depth, Resource::Albedo]),
            Some(&[Resource::Depth, Resource::Normal, Resource::Albedo]),
            Some(&[Resource::Depth, Resource::Occlusion]),
            Some(&[Resource::Depth, Resource::Sunlight]),
            Some(&[Resource::Depth, Resource::Overdraw]),
        ];
        for (bits, shown) in (0..2_097_152).flat_map(|bits| shown.map(|shown| (bits, shown))) {
            let bit = |n: u32| bits >> n & 1 != 0;
            let needs = Needs {
                shown,
                geometry: bit(0),
                occlusion: bit(1),
                specular: bit(7),
                // This pass reads what an earlier frame wrote.
                still: None,
                wireframe: bit(2),
                depth: bit(3),
                keep: bit(4),
                shadows: bit(5),
                floor: bit(5),
                antialias: bit(6),
                emission: bit(7),
                transparency: bit(8),
                punctual_lights: bit(9),
                motion: bit(10),
                temporal: bit(11),
                water: bit(12),
                enlarged: bit(13),
                reflections: bit(14).then_some(bit(15)),
                bloom: bit(16),
                curved: bit(17),
                drawn_normals: bit(18),
                half_occlusion: bit(19),
                ink: bit(20),
                // Reads and writes what the pass before it does.
                sections: bit(17),
            };
            let mut written = Vec::new();
            for pass in plan(&candidates(needs), &[Resource::Target]) {
                assert!(pass.inputs().all(|r| written.contains(&r)), "{needs:?} {pass:?}");
                written.extend_from_slice(pass.writes);
            }
            // The target is not written only if there is no geometry and its content is kept.
            assert_eq!(written.contains(&Resource::Target), needs.geometry || !needs.keep, "{needs:?}");
        }
    }
}
