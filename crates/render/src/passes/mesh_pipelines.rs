//! Pipelines that draw meshes. Each is compiled on first use, or ahead of it ([`crate::frame::compiler`]).

use std::sync::OnceLock;

use crate::passes::gbuffer::{ADD, GeometryPass, MULTIPLY, Steps, shader};
use crate::resources::descriptors::{
    buffer_binding, group_layout, layout_entry, pipeline_layout, texture_binding, wgsl,
};
use crate::resources::gpu::Gpu;
use crate::resources::vertex::{PackedVertex, VERTEX_ATTRIBUTES};
use crate::scene::bound_material::Features;
use crate::scene::lights::PunctualLightPass;
use crate::scene::material_bindings::MaterialBindings;
use crate::scene::placement::{BEFORE_ATTRIBUTES, INSTANCE_ATTRIBUTES, InstanceRaw};
use crate::scene::relief_acceleration::ReliefAcceleration;

/// Shader sources.
#[derive(Debug)]
struct Texts {
    surface: &'static str,
    motion: &'static str,
    /// Forward-lit surfaces, without and with punctual lights.
    transparent: [&'static str; 2],
}

#[cfg(any(test, feature = "methods"))]
/// Searches of relief mapping without an acceleration texture.
macro_rules! relief_searches {
    () => {
        wgsl!("relief_methods")
    };
}
#[cfg(not(any(test, feature = "methods")))]
macro_rules! relief_searches {
    () => {
        wgsl!("relief_bisection")
    };
}

/// Concatenates a shader source. `$found`: file with the relief search; `$vertex`: files of the vertex stage.
macro_rules! text {
    ($found:literal, [$($vertex:literal),+] $(, $more:literal)*) => {
        concat!(
            wgsl!("common", "section", "targets", "anisotropic", "gbuffer", "attributes", "tiled", "relief"),
            relief_searches!(),
            wgsl!($found, "placement", $($vertex,)+ $($more),*)
        )
    };
}

macro_rules! texts {
    ([$($vertex:literal),+], $motion:literal) => {
        Texts {
            surface: text!("relief_steps", [$($vertex),+]),
            motion: text!("relief_steps", [$($vertex),+], "motion", "moved", $motion),
            transparent: [
                text!("relief_steps", [$($vertex),+], "shadows", "sky", "brdf", "no_punctual_lights", "forward"),
                text!("relief_steps", [$($vertex),+], "shadows", "sky", "brdf", "punctual_light", "lights", "forward"),
            ],
        }
    };
}

const MESH: Texts = texts!(["mesh_vertex"], "mesh_motion");
#[cfg(any(test, feature = "methods"))]
const CURVED: Texts = texts!(["pn_patch", "pn_vertex"], "pn_motion");
#[cfg(any(test, feature = "methods"))]
/// Surfaces with a relief acceleration texture. For flat triangles only: PN triangles use its bind group for their
/// lists.
const ACCELERATED: [&str; ReliefAcceleration::COUNT] =
    [text!("relief_cones", ["mesh_vertex"]), text!("relief_quadtree", ["mesh_vertex"])];
#[cfg(not(any(test, feature = "methods")))]
const ACCELERATED: [&str; ReliefAcceleration::COUNT] = [];

/// Layouts and pipelines of forward-lit surfaces.
#[derive(Debug)]
struct ForwardPipelines {
    /// Group 0: frame, shadow maps, sky and, if compiled in, punctual lights.
    light: wgpu::BindGroupLayout,
    /// `light`, the material and tiles.
    layout: wgpu::PipelineLayout,
    /// Not needed by water, which shares `light`.
    module: OnceLock<wgpu::ShaderModule>,
    /// By [`variant`], without alpha test; without and with specular reflection of their own, and twice that with
    /// transmission.
    pipelines: [[OnceLock<[Steps; 2]>; VARIANTS]; 4],
}

/// Variant of relief mapping, if it is not a linear search that keeps the mesh's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReliefDraw {
    /// Acceleration texture of the height map.
    pub(crate) acceleration: Option<ReliefAcceleration>,
    /// Writes the relief's depth.
    pub(crate) deep: bool,
}

/// Pipelines for one kind of vertices: meshes, or patches of PN triangles.
#[derive(Debug)]
pub(crate) struct MeshPipelines {
    texts: &'static Texts,
    /// Section planes cut what is drawn.
    cut: bool,
    /// Vertex buffer layouts: of all passes but motion, and of the motion pass.
    buffers: [&'static [Option<wgpu::VertexBufferLayout<'static>>]; 2],
    /// Layout of group 3: patch lists, for PN triangles.
    lists: Option<wgpu::BindGroupLayout>,
    module: OnceLock<wgpu::ShaderModule>,
    /// Groups of frame, material and tiles.
    layout: wgpu::PipelineLayout,
    /// Groups of materials and of tiles of textures.
    material: wgpu::BindGroupLayout,
    tiles: wgpu::BindGroupLayout,
    /// Without and with punctual lights, which not every device supports.
    lit: [OnceLock<ForwardPipelines>; 2],
    /// Indexed by relief and [`variant`].
    surfaces: [[OnceLock<wgpu::RenderPipeline>; VARIANTS]; 2],
    /// Modules with a relief acceleration texture.
    accelerated: [OnceLock<wgpu::ShaderModule>; ReliefAcceleration::COUNT],
    /// Surfaces with relief: by acceleration (none first), by depth written or not, by [`variant`].
    reliefs: [[[OnceLock<wgpu::RenderPipeline>; VARIANTS]; 2]; 1 + ReliefAcceleration::COUNT],
    /// By [`variant`], without maps.
    sunken_casters: [OnceLock<wgpu::RenderPipeline>; VARIANTS],
    /// Groups of frame, material, tiles and acceleration texture.
    accelerated_layout: wgpu::PipelineLayout,
    /// `None` where the device cannot draw triangles as lines.
    wire: [OnceLock<Option<wgpu::RenderPipeline>>; 2],
    /// By states of parts, as are `wire` and `motion`.
    caster: [OnceLock<wgpu::RenderPipeline>; 2],
    /// By [`plain_variant`], as are `emission` and the last of `overdraw`.
    pierced_caster: [OnceLock<wgpu::RenderPipeline>; PLAIN_VARIANTS],
    motion: [OnceLock<wgpu::RenderPipeline>; 2],
    /// Without and with maps or relief, and twice that with states of parts.
    specular: [OnceLock<wgpu::RenderPipeline>; 4],
    emission: [OnceLock<wgpu::RenderPipeline>; PLAIN_VARIANTS],
    /// Opaque, transparent, both with states of parts, and alpha-tested.
    overdraw: [OnceLock<wgpu::RenderPipeline>; 4 + PLAIN_VARIANTS],
}

static BUFFERS: [Option<wgpu::VertexBufferLayout<'_>>; 3] = [
    Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<PackedVertex>() as u64,
        step_mode: wgpu::VertexStepMode::Vertex,
        attributes: &VERTEX_ATTRIBUTES,
    }),
    Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<InstanceRaw>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &INSTANCE_ATTRIBUTES,
    }),
    // Instances of the previous frame.
    Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<InstanceRaw>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &BEFORE_ATTRIBUTES,
    }),
];

/// Variants of a shader besides relief.
const VARIANTS: usize = 4 * PLAIN_VARIANTS;
/// The same of shaders that look only at colour or emission.
const PLAIN_VARIANTS: usize = 8;

/// Number of a material's variant.
fn variant(of: Features) -> usize {
    usize::from(of.maps) | usize::from(of.mask) << 1 | plain_variant(of) << 2
}

fn plain_variant(of: Features) -> usize {
    usize::from(of.tiled) | usize::from(of.second_uv) << 1 | usize::from(of.states) << 2
}

/// Override constants of the vertex stage.
fn vertex_constants(of: Features) -> [(&'static str, f64); 2] {
    [("STATES", of.states), ("SECOND_UV", of.second_uv)].map(|(name, on)| (name, f64::from(u8::from(on))))
}

/// Override constants of shaders that look only at colour or emission.
fn plain_constants(of: Features) -> [(&'static str, f64); 2] {
    [("TILED", of.tiled), ("SECOND_UV", of.second_uv)].map(|(name, on)| (name, f64::from(u8::from(on))))
}

impl MeshPipelines {
    /// Pipelines for flat triangles; `cut`: by section planes.
    pub(crate) fn new(gpu: &Gpu, layouts: (&MaterialBindings, &wgpu::BindGroupLayout), cut: bool) -> Self {
        Self::of(gpu, (&MESH, [&BUFFERS[..2], &BUFFERS]), None, layouts, cut)
    }

    #[cfg(any(test, feature = "methods"))]
    /// Pipelines for PN triangles, with the vertices of their grids and the layout of their lists.
    pub(crate) fn curved(
        gpu: &Gpu,
        layouts: (&MaterialBindings, &wgpu::BindGroupLayout),
        grid: &'static [Option<wgpu::VertexBufferLayout<'static>>],
        lists: wgpu::BindGroupLayout,
        cut: bool,
    ) -> Self {
        Self::of(gpu, (&CURVED, [grid; 2]), Some(lists), layouts, cut)
    }

    fn of(
        gpu: &Gpu,
        (texts, buffers): (&'static Texts, [&'static [Option<wgpu::VertexBufferLayout<'static>>]; 2]),
        lists: Option<wgpu::BindGroupLayout>,
        (kit, frame): (&MaterialBindings, &wgpu::BindGroupLayout),
        cut: bool,
    ) -> Self {
        let material = &kit.layout;
        let tiles = &kit.tiles.layout;
        let groups = [Some(frame), Some(material), Some(tiles), lists.as_ref()];
        let groups = if lists.is_some() { &groups[..] } else { &groups[..3] };
        Self {
            layout: pipeline_layout(gpu, "meshes", groups),
            material: material.clone(),
            tiles: tiles.clone(),
            texts,
            cut,
            buffers,
            lists,
            lit: Default::default(),
            module: OnceLock::new(),
            surfaces: Default::default(),
            accelerated: Default::default(),
            reliefs: Default::default(),
            sunken_casters: Default::default(),
            accelerated_layout: pipeline_layout(
                gpu,
                "meshes with relief acceleration",
                &[Some(frame), Some(material), Some(tiles), Some(&kit.acceleration_layout)],
            ),
            wire: Default::default(),
            caster: Default::default(),
            pierced_caster: Default::default(),
            motion: Default::default(),
            specular: Default::default(),
            emission: Default::default(),
            overdraw: Default::default(),
        }
    }

    /// Override constants of a variant.
    fn constants(&self, relief: bool, of: Features) -> [(&'static str, f64); 8] {
        let Features { maps, mask, tiled, specular, transmits, second_uv, .. } = of;
        [
            ("RELIEF", relief),
            ("MAPS", maps),
            ("MASK", mask),
            ("TILED", tiled),
            ("SPECULAR", specular),
            ("TRANSMITS", transmits),
            ("SECOND_UV", second_uv),
            ("SECTIONS", self.cut),
        ]
        .map(|(name, on)| (name, f64::from(u8::from(on))))
    }

    fn module(&self, gpu: &Gpu) -> &wgpu::ShaderModule {
        self.module.get_or_init(|| shader(gpu, "gbuffer", self.texts.surface))
    }

    /// A geometry pass, with the [`vertex_constants`] of a material.
    fn pass_of<'a>(
        &self,
        module: &'a wgpu::ShaderModule,
        layout: &'a wgpu::PipelineLayout,
        vertex_constants: &'a [(&'a str, f64)],
    ) -> GeometryPass<'a> {
        GeometryPass { module, layout, buffers: self.buffers[0], vertex_constants }
    }

    /// What `make` makes of the geometry pass with a material.
    fn with_pass<R>(&self, gpu: &Gpu, material: Features, make: impl FnOnce(&GeometryPass<'_>) -> R) -> R {
        make(&self.pass_of(self.module(gpu), &self.layout, &vertex_constants(material)))
    }

    /// Wireframe; `None` where the device cannot draw triangles as lines.
    pub(crate) fn wire(&self, gpu: &Gpu, material: Features) -> Option<&wgpu::RenderPipeline> {
        let entry = ["vs_wire", if self.cut { "fs_cut_wire" } else { "fs_wire" }];
        let make = || self.with_pass(gpu, material, |pass| pass.wire(gpu, entry));
        self.wire[usize::from(material.states)].get_or_init(make).as_ref()
    }

    /// Opaque shadow casters; needs group 1 for the states of parts.
    pub(crate) fn caster(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        let material = Features { states: material.states, ..Features::default() };
        self.caster[usize::from(material.states)].get_or_init(|| match self.cut {
            false => self.with_pass(gpu, material, |pass| pass.caster(gpu, "vs_caster")),
            true => self.cut_caster(gpu, material),
        })
    }

    /// Shadow casters that section planes cut.
    fn cut_caster(&self, gpu: &Gpu, material: Features) -> wgpu::RenderPipeline {
        let constants = self.constants(false, material);
        let entry = ["vs_surface", "fs_cut_caster"];
        self.with_pass(gpu, material, |pass| pass.pierced_caster(gpu, entry, &constants))
    }

    /// Compiles the pipelines that a material needs beyond those of the settings alone.
    pub(crate) fn ensure(&self, gpu: &Gpu, material: Features) {
        if material.blend {
            // The variant with punctual lights is compiled when there are some.
            self.transparent(gpu, material, false);
            return;
        }
        if material.maps || material.mask || material.tiled || material.second_uv {
            self.surface(gpu, material, true);
        }
        if material.mask {
            self.pierced_caster(gpu, material);
        }
        if material.emits {
            self.emission(gpu, material);
        }
        if material.specular {
            self.specular(gpu, material);
        }
    }

    /// Surfaces into the G-buffer; `relief` enables relief mapping.
    pub(crate) fn surface(&self, gpu: &Gpu, material: Features, relief: bool) -> &wgpu::RenderPipeline {
        let relief = relief && material.relief;
        self.surfaces[usize::from(relief)][variant(material)].get_or_init(|| {
            let constants = self.constants(relief, material);
            self.with_pass(gpu, material, |pass| pass.surface(gpu, ["vs_surface", "fs_surface"], &constants))
        })
    }

    /// Whether surfaces can use relief acceleration textures.
    pub(crate) fn supports_acceleration(&self) -> bool {
        self.lists.is_none()
    }

    /// Surfaces with relief into the G-buffer; the acceleration texture is group 3.
    pub(crate) fn relief(&self, gpu: &Gpu, material: Features, how: ReliefDraw) -> &wgpu::RenderPipeline {
        let ReliefDraw { acceleration, deep } = how;
        if acceleration.is_none() && !deep {
            return self.surface(gpu, material, true);
        }
        self.reliefs[acceleration.map_or(0, |acceleration| 1 + acceleration.number())][usize::from(deep)]
            [variant(material)]
        .get_or_init(|| {
            let module = acceleration
                .map_or_else(|| self.module(gpu), |acceleration| self.accelerated(gpu, acceleration));
            let layout = if acceleration.is_some() { &self.accelerated_layout } else { &self.layout };
            let fragment = if deep { "fs_deep_surface" } else { "fs_surface" };
            self.pass_of(module, layout, &vertex_constants(material)).surface(
                gpu,
                ["vs_surface", fragment],
                &self.constants(true, material),
            )
        })
    }

    fn accelerated(&self, gpu: &Gpu, acceleration: ReliefAcceleration) -> &wgpu::ShaderModule {
        let at = acceleration.number();
        self.accelerated[at].get_or_init(|| shader(gpu, "gbuffer with relief acceleration", ACCELERATED[at]))
    }

    /// Shadow casters of materials whose relief writes depth; needs group 1.
    pub(crate) fn sunken_caster(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        let material = Features { maps: false, ..material };
        self.sunken_casters[variant(material)].get_or_init(|| {
            let (entry, constants) = (["vs_surface", "fs_sunken"], self.constants(false, material));
            self.with_pass(gpu, material, |pass| pass.sunken_caster(gpu, entry, &constants))
        })
    }

    /// Alpha-tested shadow casters; needs group 1.
    pub(crate) fn pierced_caster(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        self.pierced_caster[plain_variant(material)].get_or_init(|| match self.cut {
            false => {
                let (entry, constants) = (["vs_pierced", "fs_pierced"], plain_constants(material));
                self.with_pass(gpu, material, |pass| pass.pierced_caster(gpu, entry, &constants))
            }
            true => self.cut_caster(gpu, material),
        })
    }

    /// Motion vectors; needs group 1; a third buffer holds the previous instances.
    pub(crate) fn motion(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        self.motion[usize::from(material.states)].get_or_init(|| {
            let module = shader(gpu, "motion", self.texts.motion);
            let of = vertex_constants(material);
            let pass = GeometryPass { buffers: self.buffers[1], ..self.pass_of(&module, &self.layout, &of) };
            pass.motion(gpu, ["vs_motion", "fs_motion"])
        })
    }

    /// Specular reflection that is not the usual.
    pub(crate) fn specular(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        let maps = material.maps || material.relief;
        self.specular[usize::from(maps) | usize::from(material.states) << 1].get_or_init(|| {
            let (entry, constants) = (["vs_surface", "fs_specular"], [("MAPS", f64::from(u8::from(maps)))]);
            self.with_pass(gpu, material, |pass| pass.specular(gpu, entry, &constants))
        })
    }

    /// Emission, added to the lit picture.
    pub(crate) fn emission(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        self.emission[plain_variant(material)].get_or_init(|| {
            let (entry, constants) = (["vs_surface", "fs_emission"], plain_constants(material));
            self.with_pass(gpu, material, |pass| pass.emission(gpu, entry, &constants))
        })
    }

    fn lit(&self, gpu: &Gpu, punctual_lights: bool) -> &ForwardPipelines {
        self.lit[usize::from(punctual_lights)].get_or_init(|| {
            let light = light_layout(gpu, punctual_lights);
            let lists = self.lists.as_ref().map(Some);
            let groups = [Some(&light), Some(&self.material), Some(&self.tiles)];
            let groups: Vec<_> = groups.into_iter().chain(lists).collect();
            ForwardPipelines {
                layout: pipeline_layout(gpu, "lit meshes", &groups),
                light,
                module: OnceLock::new(),
                pipelines: Default::default(),
            }
        })
    }

    /// Layout of group 0 of forward-lit surfaces, with or without punctual lights.
    pub(crate) fn light_layout(&self, gpu: &Gpu, punctual_lights: bool) -> &wgpu::BindGroupLayout {
        &self.lit(gpu, punctual_lights).light
    }

    /// Transparent surfaces over the lit picture: back faces, then front faces; with or without punctual lights.
    pub(crate) fn transparent(&self, gpu: &Gpu, material: Features, punctual_lights: bool) -> &[Steps; 2] {
        let lit = self.lit(gpu, punctual_lights);
        let material = Features { mask: false, ..material };
        let number = usize::from(material.specular) | usize::from(material.transmits) << 1;
        lit.pipelines[number][variant(material)].get_or_init(|| {
            let constants = self.constants(false, material);
            let text = self.texts.transparent[usize::from(punctual_lights)];
            let module = lit.module.get_or_init(|| shader(gpu, "transparent", text));
            let blended = wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING;
            let steps: &[_] = match material.transmits {
                true => &[("fs_left", MULTIPLY), ("fs_transparent", ADD)],
                false => &[("fs_transparent", blended)],
            };
            let of = vertex_constants(material);
            self.pass_of(module, &lit.layout, &of).transparent(gpu, "vs_surface", steps, &constants)
        })
    }

    /// Overdraw counters.
    pub(crate) fn overdraw(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        let states = usize::from(material.states) << 1;
        let number = match material {
            Features { blend: true, .. } => 1 | states,
            Features { mask: true, .. } => 4 + plain_variant(material),
            _ => states,
        };
        let make = |pass: &GeometryPass<'_>| match material {
            Features { blend, .. } if self.cut => {
                let entry = ["vs_surface", "fs_cut_overdraw"];
                pass.cut_overdraw(gpu, entry, &self.constants(false, material), !blend)
            }
            Features { blend: true, .. } => pass.transparent_overdraw(gpu, "vs_caster"),
            Features { mask: true, .. } => {
                let entry = ["vs_pierced", "fs_pierced_overdraw"];
                pass.pierced_overdraw(gpu, entry, &plain_constants(material))
            }
            _ => pass.overdraw(gpu, "vs_caster"),
        };
        self.overdraw[number].get_or_init(|| self.with_pass(gpu, material, make))
    }
}

/// Layout of group 0 of forward-lit surfaces: frame, shadow maps with their sampler, sky maps and, optionally,
/// punctual lights.
fn light_layout(gpu: &Gpu, punctual_lights: bool) -> wgpu::BindGroupLayout {
    let block = buffer_binding(wgpu::BufferBindingType::Uniform);
    let maps = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let texture = |view_dimension| texture_binding(true, view_dimension);
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let mut entries = vec![
        layout_entry(0, wgpu::ShaderStages::VERTEX_FRAGMENT, block),
        layout_entry(2, fragment, maps),
        layout_entry(3, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)),
        layout_entry(4, fragment, block),
        layout_entry(10, fragment, texture(wgpu::TextureViewDimension::D2)),
        layout_entry(11, fragment, texture(wgpu::TextureViewDimension::D2Array)),
        layout_entry(12, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        layout_entry(13, fragment, texture(wgpu::TextureViewDimension::D2)),
    ];
    if punctual_lights {
        entries.extend(
            PunctualLightPass::LAYOUT
                .map(|(binding, ty)| layout_entry(binding, fragment, buffer_binding(ty))),
        );
    }
    group_layout(gpu, "light", &entries)
}
