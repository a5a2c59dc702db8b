//! Pipelines that meshes are drawn with: each is compiled when it is needed first, or before ([`crate::frame::compiler`]).

use std::sync::OnceLock;

use crate::passes::gbuffer::{GeometryPass, shader};
use crate::passes::pn_triangles::{GRID_VERTEX, ReadOnlyLists};
use crate::resources::gpu::Gpu;
use crate::resources::vertex::{PackedVertex, VERTEX_ATTRIBUTES};
use crate::scene::instance::{BEFORE_ATTRIBUTES, INSTANCE_ATTRIBUTES, InstanceRaw};
use crate::scene::lights::PunctualLightPass;
use crate::scene::material_bindings::{Features, MaterialKit};
use crate::scene::relief_acceleration::ReliefAcceleration;

/// Texts of shaders.
#[derive(Debug)]
struct Texts {
    surface: &'static str,
    motion: &'static str,
    /// What is lit where it is drawn, without punctual lights and with.
    transparent: [&'static str; 2],
}

/// A text from those of its own files; `$found`: where relief is met, `$vertex`: what vertices are made of.
macro_rules! text {
    ($found:literal, [$($vertex:literal),+] $(, $more:literal)*) => {
        concat!(
            include_str!("../shaders/common.wgsl"),
            include_str!("../shaders/targets.wgsl"),
            include_str!("../shaders/anisotropic.wgsl"),
            include_str!("../shaders/gbuffer.wgsl"),
            include_str!("../shaders/relief.wgsl"),
            include_str!(concat!("../shaders/", $found, ".wgsl")),
            include_str!("../shaders/placement.wgsl"),
            $(include_str!(concat!("../shaders/", $vertex, ".wgsl")),)+
            $(include_str!(concat!("../shaders/", $more, ".wgsl")),)*
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
const CURVED: Texts = texts!(["pn_patch", "pn_vertex"], "pn_motion");
#[cfg(any(test, feature = "methods"))]
/// Surfaces by what is known of their height map: of triangles as they are alone, since lists of patches take its group.
const AIDED: [&str; ReliefAcceleration::COUNT] =
    [text!("relief_cones", ["mesh_vertex"]), text!("relief_quadtree", ["mesh_vertex"])];
#[cfg(not(any(test, feature = "methods")))]
const AIDED: [&str; ReliefAcceleration::COUNT] = [];

/// What draws surfaces that are lit where they are drawn.
#[derive(Debug)]
struct Lit {
    /// Group 0: frame, shadow maps, sky, and perhaps punctual lights.
    light: wgpu::BindGroupLayout,
    /// That and the material.
    layout: wgpu::PipelineLayout,
    /// Water has the same light without this.
    module: OnceLock<wgpu::ShaderModule>,
    /// Without maps and with.
    pipelines: [OnceLock<[wgpu::RenderPipeline; 2]>; 2],
}

/// How relief is met, beyond equal steps that leave depth as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ReliefDraw {
    /// What is known of the height map.
    pub(crate) aid: Option<ReliefAcceleration>,
    /// Depth is that of what it shows.
    pub(crate) deep: bool,
}

/// See the module.
#[derive(Debug)]
pub(crate) struct MeshPipelines {
    texts: &'static Texts,
    /// Vertices, in passes but for that of motion, and in that.
    buffers: [&'static [Option<wgpu::VertexBufferLayout<'static>>]; 2],
    /// Group 2: lists of patches, where vertices are on those.
    lists: Option<ReadOnlyLists>,
    module: OnceLock<wgpu::ShaderModule>,
    /// Frame and material.
    layout: wgpu::PipelineLayout,
    /// Of materials.
    material: wgpu::BindGroupLayout,
    /// Without punctual lights and with: not every device can have those.
    lit: [OnceLock<Lit>; 2],
    /// By relief, maps and mask.
    surfaces: [OnceLock<wgpu::RenderPipeline>; 8],
    /// With relief that is found with an aid.
    aided: [OnceLock<wgpu::ShaderModule>; ReliefAcceleration::COUNT],
    /// With relief: without an aid and by aid; leaving depth and with its own; by maps and mask.
    reliefs: [[[OnceLock<wgpu::RenderPipeline>; 4]; 2]; 1 + ReliefAcceleration::COUNT],
    /// Without holes and with.
    sunken_casters: [OnceLock<wgpu::RenderPipeline>; 2],
    /// Frame, material and aid.
    aided_layout: wgpu::PipelineLayout,
    /// `None` where the device cannot draw triangles as lines.
    wire: OnceLock<Option<wgpu::RenderPipeline>>,
    caster: OnceLock<wgpu::RenderPipeline>,
    caster_layout: wgpu::PipelineLayout,
    pierced_caster: OnceLock<wgpu::RenderPipeline>,
    motion: OnceLock<wgpu::RenderPipeline>,
    emission: OnceLock<wgpu::RenderPipeline>,
    /// Of what is solid, what has holes, and what is seen through.
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
    // Where instances were in the frame before.
    Some(wgpu::VertexBufferLayout {
        array_stride: size_of::<InstanceRaw>() as u64,
        step_mode: wgpu::VertexStepMode::Instance,
        attributes: &BEFORE_ATTRIBUTES,
    }),
];

static GRID: [Option<wgpu::VertexBufferLayout<'_>>; 1] = [Some(GRID_VERTEX)];

/// What is compiled in.
fn constants([relief, maps, mask]: [bool; 3]) -> [(&'static str, f64); 3] {
    [("RELIEF", relief), ("MAPS", maps), ("MASK", mask)].map(|(name, on)| (name, f64::from(u8::from(on))))
}

fn layout(gpu: &Gpu, label: &str, groups: &[Option<&wgpu::BindGroupLayout>]) -> wgpu::PipelineLayout {
    gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some(label),
        bind_group_layouts: groups,
        immediate_size: 0,
    })
}

impl MeshPipelines {
    /// Of triangles as they are.
    pub(crate) fn new(gpu: &Gpu, kit: &MaterialKit, frame_layout: &wgpu::BindGroupLayout) -> Self {
        Self::of(gpu, (&MESH, [&BUFFERS[..2], &BUFFERS]), None, (kit, frame_layout))
    }

    /// Of [`super::PnTriangles`].
    pub(crate) fn curved(gpu: &Gpu, kit: &MaterialKit, frame_layout: &wgpu::BindGroupLayout) -> Self {
        let lists = Some(ReadOnlyLists::new(gpu));
        Self::of(gpu, (&CURVED, [&GRID; 2]), lists, (kit, frame_layout))
    }

    fn of(
        gpu: &Gpu,
        (texts, buffers): (&'static Texts, [&'static [Option<wgpu::VertexBufferLayout<'static>>]; 2]),
        lists: Option<ReadOnlyLists>,
        (kit, frame): (&MaterialKit, &wgpu::BindGroupLayout),
    ) -> Self {
        let material = &kit.layout;
        let with_lists = |label, groups: [Option<&wgpu::BindGroupLayout>; 2]| {
            let groups = [groups[0], groups[1], lists.as_ref().map(|lists| &lists.layout)];
            let count = groups.iter().rposition(Option::is_some).map_or(0, |last| last + 1);
            layout(gpu, label, &groups[..count])
        };
        Self {
            layout: with_lists("meshes", [Some(frame), Some(material)]),
            caster_layout: with_lists("casters", [Some(frame), None]),
            material: material.clone(),
            texts,
            buffers,
            lists,
            lit: Default::default(),
            module: OnceLock::new(),
            surfaces: Default::default(),
            aided: Default::default(),
            reliefs: Default::default(),
            sunken_casters: Default::default(),
            aided_layout: layout(
                gpu,
                "meshes with relief's aid",
                &[Some(frame), Some(material), Some(&kit.aid_layout)],
            ),
            wire: OnceLock::new(),
            caster: OnceLock::new(),
            pierced_caster: OnceLock::new(),
            motion: OnceLock::new(),
            emission: OnceLock::new(),
            overdraw: Default::default(),
        }
    }

    /// What vertices read of lists of patches, where they are on those.
    pub(crate) fn lists(&self) -> Option<&ReadOnlyLists> {
        self.lists.as_ref()
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

    /// What draws with materials.
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

    /// Edges; `None` where the device cannot draw triangles as lines.
    pub(crate) fn wire(&self, gpu: &Gpu) -> Option<&wgpu::RenderPipeline> {
        self.wire.get_or_init(|| self.pass(gpu).wire(gpu, ["vs_wire", "fs_wire"])).as_ref()
    }

    /// Into maps of shadows.
    pub(crate) fn caster(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.caster
            .get_or_init(|| self.pass_of(self.module(gpu), &self.caster_layout).caster(gpu, "vs_caster"))
    }

    /// Compiles what a material will be drawn with beyond what settings alone ask for; nothing where that is done.
    pub(crate) fn ensure(&self, gpu: &Gpu, material: Features) {
        if material.blend {
            // With punctual lights when there are some.
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

    /// Into the G-buffer; `relief` says whether height maps are honoured.
    pub(crate) fn surface(&self, gpu: &Gpu, material: Features, relief: bool) -> &wgpu::RenderPipeline {
        self.variant(gpu, [relief && material.relief, material.maps, material.mask])
    }

    /// Whether surfaces take what is known of height maps.
    pub(crate) fn takes_aid(&self) -> bool {
        self.lists.is_none()
    }

    /// Into the G-buffer, of a material with relief; what is known of its height map is group 2.
    pub(crate) fn relief(&self, gpu: &Gpu, material: Features, how: ReliefDraw) -> &wgpu::RenderPipeline {
        let ReliefDraw { aid, deep } = how;
        if aid.is_none() && !deep {
            return self.surface(gpu, material, true);
        }
        let at = usize::from(material.maps) | usize::from(material.mask) << 1;
        self.reliefs[aid.map_or(0, |aid| 1 + aid.number())][usize::from(deep)][at].get_or_init(|| {
            let module = aid.map_or_else(|| self.module(gpu), |aid| self.aided(gpu, aid));
            let layout = if aid.is_some() { &self.aided_layout } else { &self.layout };
            let fragment = if deep { "fs_deep_surface" } else { "fs_surface" };
            let constants = constants([true, material.maps, material.mask]);
            self.pass_of(module, layout).surface(gpu, ["vs_surface", fragment], &constants)
        })
    }

    fn aided(&self, gpu: &Gpu, aid: ReliefAcceleration) -> &wgpu::ShaderModule {
        let at = aid.number();
        self.aided[at].get_or_init(|| shader(gpu, "gbuffer with relief's aid", AIDED[at]))
    }

    /// Into maps of shadows, of materials whose relief is in depth; with their group 1.
    pub(crate) fn sunken_caster(&self, gpu: &Gpu, material: Features) -> &wgpu::RenderPipeline {
        self.sunken_casters[usize::from(material.mask)].get_or_init(|| {
            let constants = constants([false, false, material.mask]);
            self.pass(gpu).sunken_caster(gpu, ["vs_surface", "fs_sunken"], &constants)
        })
    }

    /// Into maps of shadows, of materials with holes; with their group 1.
    pub(crate) fn pierced_caster(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.pierced_caster.get_or_init(|| self.pass(gpu).pierced_caster(gpu, ["vs_pierced", "fs_pierced"]))
    }

    /// How far things have come since the frame before, which a third buffer tells of instances.
    pub(crate) fn motion(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.motion.get_or_init(|| {
            let module = shader(gpu, "motion", self.texts.motion);
            let layout = &self.caster_layout;
            let pass = GeometryPass { module: &module, layout, buffers: self.buffers[1] };
            pass.motion(gpu, ["vs_motion", "fs_motion"])
        })
    }

    /// Onto the lit picture.
    pub(crate) fn emission(&self, gpu: &Gpu) -> &wgpu::RenderPipeline {
        self.emission.get_or_init(|| self.pass(gpu).emission(gpu, ["vs_surface", "fs_emission"]))
    }

    fn lit(&self, gpu: &Gpu, punctual_lights: bool) -> &Lit {
        self.lit[usize::from(punctual_lights)].get_or_init(|| {
            let light = light_layout(gpu, punctual_lights);
            let lists = self.lists.as_ref().map(|lists| Some(&lists.layout));
            let groups: Vec<_> = [Some(&light), Some(&self.material)].into_iter().chain(lists).collect();
            Lit {
                layout: layout(gpu, "lit meshes", &groups),
                light,
                module: OnceLock::new(),
                pipelines: Default::default(),
            }
        })
    }

    /// Group 0 of what is lit where it is drawn, by punctual lights too or not.
    pub(crate) fn light_layout(&self, gpu: &Gpu, punctual_lights: bool) -> &wgpu::BindGroupLayout {
        &self.lit(gpu, punctual_lights).light
    }

    /// Over the lit picture: faces that face away, and those that face the eye; lit by punctual lights too or not.
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

    /// Counts how often pixels are drawn.
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

/// Group 0 of what is lit where it is drawn: the frame, the shadow maps with how they are looked up, and the sky's; perhaps
/// the punctual lights.
fn light_layout(gpu: &Gpu, punctual_lights: bool) -> wgpu::BindGroupLayout {
    let entry = |binding, visibility, ty| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let block = buffer(wgpu::BufferBindingType::Uniform);
    let maps = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Depth,
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let texture = |view_dimension| wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: true },
        view_dimension,
        multisampled: false,
    };
    let fragment = wgpu::ShaderStages::FRAGMENT;
    let mut entries = vec![
        entry(0, wgpu::ShaderStages::VERTEX_FRAGMENT, block),
        entry(2, fragment, maps),
        entry(3, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison)),
        entry(4, fragment, block),
        entry(10, fragment, texture(wgpu::TextureViewDimension::D2)),
        entry(11, fragment, texture(wgpu::TextureViewDimension::D2Array)),
        entry(12, fragment, wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering)),
        entry(13, fragment, texture(wgpu::TextureViewDimension::D2)),
    ];
    if punctual_lights {
        entries.extend(PunctualLightPass::LAYOUT.map(|(binding, ty)| entry(binding, fragment, buffer(ty))));
    }
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("light"),
        entries: &entries,
    })
}
