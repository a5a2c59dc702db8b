//! Pipelines that draw meshes. Each is compiled on first use, or ahead of it ([`crate::frame::compiler`]).

use std::sync::OnceLock;

use crate::passes::gbuffer::{GeometryPass, shader};
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
            wgsl!("common", "targets", "anisotropic", "gbuffer", "relief"),
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
    /// `light` and the material.
    layout: wgpu::PipelineLayout,
    /// Not needed by water, which shares `light`.
    module: OnceLock<wgpu::ShaderModule>,
    /// Without and with textures of the material.
    pipelines: [OnceLock<[wgpu::RenderPipeline; 2]>; 2],
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
    /// Vertex buffer layouts: of all passes but motion, and of the motion pass.
    buffers: [&'static [Option<wgpu::VertexBufferLayout<'static>>]; 2],
    /// Layout of group 2: patch lists, for PN triangles.
    lists: Option<wgpu::BindGroupLayout>,
    module: OnceLock<wgpu::ShaderModule>,
    /// Groups of frame and material.
    layout: wgpu::PipelineLayout,
    /// Group of materials.
    material: wgpu::BindGroupLayout,
    /// Without and with punctual lights, which not every device supports.
    lit: [OnceLock<ForwardPipelines>; 2],
    /// Indexed by relief, maps and mask.
    surfaces: [OnceLock<wgpu::RenderPipeline>; 8],
    /// Modules with a relief acceleration texture.
    accelerated: [OnceLock<wgpu::ShaderModule>; ReliefAcceleration::COUNT],
    /// Surfaces with relief: by acceleration (none first), by depth written or not, by maps and mask.
    reliefs: [[[OnceLock<wgpu::RenderPipeline>; 4]; 2]; 1 + ReliefAcceleration::COUNT],
    /// Without and with alpha test.
    sunken_casters: [OnceLock<wgpu::RenderPipeline>; 2],
    /// Groups of frame, material and acceleration texture.
    accelerated_layout: wgpu::PipelineLayout,
    /// `None` where the device cannot draw triangles as lines.
    wire: OnceLock<Option<wgpu::RenderPipeline>>,
    caster: OnceLock<wgpu::RenderPipeline>,
    pierced_caster: OnceLock<wgpu::RenderPipeline>,
    motion: OnceLock<wgpu::RenderPipeline>,
    emission: OnceLock<wgpu::RenderPipeline>,
    /// Opaque, alpha-tested and transparent.
    overdraw: [OnceLock<wgpu::RenderPipeline>; 3],
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

/// Override constants of a variant.
fn constants([relief, maps, mask]: [bool; 3]) -> [(&'static str, f64); 3] {
    [("RELIEF", relief), ("MAPS", maps), ("MASK", mask)].map(|(name, on)| (name, f64::from(u8::from(on))))
}

impl MeshPipelines {
    /// Pipelines for flat triangles.
    pub(crate) fn new(gpu: &Gpu, kit: &MaterialBindings, frame_layout: &wgpu::BindGroupLayout) -> Self {
        Self::of(gpu, (&MESH, [&BUFFERS[..2], &BUFFERS]), None, (kit, frame_layout))
    }

    #[cfg(any(test, feature = "methods"))]
    /// Pipelines for PN triangles, with the vertices of their grids and the layout of their lists.
    pub(crate) fn curved(
        gpu: &Gpu,
        kit: &MaterialBindings,
        frame_layout: &wgpu::BindGroupLayout,
        grid: &'static [Option<wgpu::VertexBufferLayout<'static>>],
        lists: wgpu::BindGroupLayout,
    ) -> Self {
        Self::of(gpu, (&CURVED, [grid; 2]), Some(lists), (kit, frame_layout))
    }

    fn of(
        gpu: &Gpu,
        (texts, buffers): (&'static Texts, [&'static [Option<wgpu::VertexBufferLayout<'static>>]; 2]),
        lists: Option<wgpu::BindGroupLayout>,
        (kit, frame): (&MaterialBindings, &wgpu::BindGroupLayout),
    ) -> Self {
        let material = &kit.layout;
        let groups = [Some(frame), Some(material), lists.as_ref()];
        let groups = if lists.is_some() { &groups[..] } else { &groups[..2] };
        Self {
            layout: pipeline_layout(gpu, "meshes", groups),
            material: material.clone(),
            texts,
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
                &[Some(frame), Some(material), Some(&kit.acceleration_layout)],
            ),
            wire: OnceLock::new(),
            caster: OnceLock::new(),
            pierced_caster: OnceLock::new(),
            motion: OnceLock::new(),
            emission: OnceLock::new(),
            overdraw: Default::default(),
        }
    }

    fn module(&self, gpu: &Gpu) -> &wgpu::ShaderModule {
        self.module.get_or_init(|| shader(gpu, "gbuffer", self.texts.surface))
    }

    fn pass_of<'a>(
        &self,
        module: &'a wgpu::ShaderModule,
        layout: &'a wgpu::PipelineLayout,
    ) -> GeometryPass<'a> {
        GeometryPass { module, layout, buffers: self.buffers[0] }
    }

    /// Geometry pass with materials.
    fn pass(&self, gpu: &Gpu) -> GeometryPass<'_> {
        self.pass_of(self.module(gpu), &self.layout)
    }

    fn variant(&self, gpu: &Gpu, [relief, maps, mask]: [bool; 3]) -> &wgpu::RenderPipeline {
        let at = usize::from(relief) | usize::from(maps) << 1 | usize::from(mask) << 2;
        self.surfaces[at].get_or_init(|| {
            let constants = constants([relief, maps, mask]);
            self.pass(gpu).surface(gpu, ["vs_surface", "fs_surface"], &constants)
        })
    }

    /// Wireframe; `None` where the device cannot draw triangles as lines.
    pub(crate) fn wire(&self, gpu: &Gpu) -> Option<&wgpu::RenderPipeline> {
        self.wire.get_or_init(|| self.pass(gpu).wire(gpu, ["vs_wire", "fs_wire"])).as_ref()
    }

    /// Opaque shadow casters; needs group 1 for the states of parts.
    pub(crate) fn caster(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.caster.get_or_init(|| self.pass(gpu).caster(gpu, "vs_caster"))
    }

    /// Compiles the pipelines that a material needs beyond those of the settings alone.
    pub(crate) fn ensure(&self, gpu: &Gpu, material: Features) {
        if material.blend {
            // The variant with punctual lights is compiled when there are some.
            self.transparent(gpu, material, false);
            return;
        }
        if material.maps || material.mask {
            self.surface(gpu, material, true);
        }
        if material.mask {
            self.pierced_caster(gpu);
        }
        if material.emits {
            self.emission(gpu);
        }
    }

    /// Surfaces into the G-buffer; `relief` enables relief mapping.
    pub(crate) fn surface(&self, gpu: &Gpu, material: Features, relief: bool) -> &wgpu::RenderPipeline {
        self.variant(gpu, [relief && material.relief, material.maps, material.mask])
    }

    /// Whether surfaces can use relief acceleration textures.
    pub(crate) fn supports_acceleration(&self) -> bool {
        self.lists.is_none()
    }

    /// Surfaces with relief into the G-buffer; the acceleration texture is group 2.
    pub(crate) fn relief(&self, gpu: &Gpu, material: Features, how: ReliefDraw) -> &wgpu::RenderPipeline {
        let ReliefDraw { acceleration, deep } = how;
        if acceleration.is_none() && !deep {
            return self.surface(gpu, material, true);
        }
        let at = usize::from(material.maps) | usize::from(material.mask) << 1;
        self.reliefs[acceleration.map_or(0, |acceleration| 1 + acceleration.number())][usize::from(deep)][at]
            .get_or_init(|| {
                let module = acceleration
                    .map_or_else(|| self.module(gpu), |acceleration| self.accelerated(gpu, acceleration));
                let layout = if acceleration.is_some() { &self.accelerated_layout } else { &self.layout };
                let fragment = if deep { "fs_deep_surface" } else { "fs_surface" };
                let constants = constants([true, material.maps, material.mask]);
                self.pass_of(module, layout).surface(gpu, ["vs_surface", fragment], &constants)
            })
    }

    fn accelerated(&self, gpu: &Gpu, acceleration: ReliefAcceleration) -> &wgpu::ShaderModule {
        let at = acceleration.number();
        self.accelerated[at].get_or_init(|| shader(gpu, "gbuffer with relief acceleration", ACCELERATED[at]))
    }

    /// Shadow casters of materials whose relief writes depth; needs group 1.
    pub(crate) fn sunken_caster(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        self.sunken_casters[usize::from(material.mask)].get_or_init(|| {
            let constants = constants([false, false, material.mask]);
            self.pass(gpu).sunken_caster(gpu, ["vs_surface", "fs_sunken"], &constants)
        })
    }

    /// Alpha-tested shadow casters; needs group 1.
    pub(crate) fn pierced_caster(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.pierced_caster.get_or_init(|| self.pass(gpu).pierced_caster(gpu, ["vs_pierced", "fs_pierced"]))
    }

    /// Motion vectors; needs group 1; a third buffer holds the previous instances.
    pub(crate) fn motion(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.motion.get_or_init(|| {
            let module = shader(gpu, "motion", self.texts.motion);
            let layout = &self.layout;
            let pass = GeometryPass { module: &module, layout, buffers: self.buffers[1] };
            pass.motion(gpu, ["vs_motion", "fs_motion"])
        })
    }

    /// Emission, added to the lit picture.
    pub(crate) fn emission(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.emission.get_or_init(|| self.pass(gpu).emission(gpu, ["vs_surface", "fs_emission"]))
    }

    fn lit(&self, gpu: &Gpu, punctual_lights: bool) -> &ForwardPipelines {
        self.lit[usize::from(punctual_lights)].get_or_init(|| {
            let light = light_layout(gpu, punctual_lights);
            let lists = self.lists.as_ref().map(Some);
            let groups: Vec<_> = [Some(&light), Some(&self.material)].into_iter().chain(lists).collect();
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
    pub(crate) fn transparent(
        &self,
        gpu: &Gpu,
        material: Features,
        punctual_lights: bool,
    ) -> &[wgpu::RenderPipeline; 2] {
        let lit = self.lit(gpu, punctual_lights);
        lit.pipelines[usize::from(material.maps)].get_or_init(|| {
            let maps = [("MAPS", f64::from(u8::from(material.maps)))];
            let text = self.texts.transparent[usize::from(punctual_lights)];
            let module = lit.module.get_or_init(|| shader(gpu, "transparent", text));
            self.pass_of(module, &lit.layout).transparent(gpu, ["vs_surface", "fs_transparent"], &maps)
        })
    }

    /// Overdraw counters.
    pub(crate) fn overdraw(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        let pass = self.pass(gpu);
        match material {
            Features { blend: true, .. } => {
                self.overdraw[2].get_or_init(|| pass.transparent_overdraw(gpu, "vs_caster"))
            }
            Features { mask: true, .. } => self.overdraw[1]
                .get_or_init(|| pass.pierced_overdraw(gpu, ["vs_pierced", "fs_pierced_overdraw"])),
            _ => self.overdraw[0].get_or_init(|| pass.overdraw(gpu, "vs_caster")),
        }
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
