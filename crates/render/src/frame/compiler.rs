//! Compilation of pipelines ahead of the first frame that needs them.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::frame::pipelines::{FullscreenPass, OcclusionOutput, OcclusionVariant, Pipelines};
use crate::frame::settings::{AntiAliasing, Settings};
use crate::passes::occlusion::OcclusionMethod;
#[cfg(any(test, feature = "methods"))]
use crate::passes::occlusion::OcclusionNormals;
use crate::passes::pn_triangles::{PatchPipelines, PnTriangles};
use crate::passes::reflections::ReflectionMethod;
use crate::passes::temporal::Resolve;
use crate::resources::gpu::Gpu;
use crate::scene::bound_material::Features;

/// A unit of compilation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    Surface {
        relief: bool,
    },
    /// Pipelines that build patch lists.
    Patches,
    Caps,
    Caster,
    Ground {
        relief: bool,
    },
    GroundCaster,
    /// Ground of a studio.
    Floor,
    FullscreenPass(FullscreenPass),
    Water {
        by_cells: Option<bool>,
    },
    Bloom,
    #[cfg(any(test, feature = "methods"))]
    Ink,
    #[cfg(any(test, feature = "methods"))]
    /// HBAO+.
    Layers(OcclusionNormals),
    Wire,
    GroundWire,
    /// Motion vectors and temporal resolve.
    Motion,
    Mean,
}

/// Compiles the pipelines that some settings need before the first frame. A frame compiles what it lacks, which takes
/// milliseconds per pipeline. Clones share the work: each thread that calls [`Compiler::compile`] takes tasks that no
/// other has begun.
///
/// Pipelines that only some materials need (textures, alpha test, transparency, specular reflection) are compiled with
/// the first such asset, those of punctual lights with the first light.
#[derive(Clone, Debug)]
pub struct Compiler {
    gpu: Gpu,
    pipelines: Arc<Pipelines>,
    tasks: Arc<[Task]>,
    /// Settings of PN triangles, if they are drawn.
    curved: Option<PnTriangles>,
    /// Whether there are section planes.
    cut: bool,
    next: Arc<AtomicUsize>,
}

impl Compiler {
    pub(crate) fn new(gpu: &Gpu, pipelines: &Arc<Pipelines>, settings: &Settings, ground: bool) -> Self {
        Self {
            gpu: gpu.clone(),
            pipelines: Arc::clone(pipelines),
            tasks: tasks(gpu, settings, ground).into(),
            curved: settings.curves(gpu),
            cut: !settings.sections.is_empty(),
            next: Arc::default(),
        }
    }

    /// Compiles until no task is left. Errors are reported by the next frame.
    pub fn compile(&self) {
        while let Some(task) = self.tasks.get(self.next.fetch_add(1, Ordering::Relaxed)) {
            self.make(*task);
        }
    }

    fn make(&self, task: Task) {
        let (gpu, pipelines) = (&self.gpu, &*self.pipelines);
        let patches = self.curved.map(|settings| pipelines.patches(gpu, settings, self.cut));
        let meshes = patches.map_or_else(|| pipelines.meshes_of(gpu, self.cut), PatchPipelines::meshes);
        match task {
            Task::Surface { relief } => {
                meshes.surface(gpu, Features { relief, ..Features::default() }, relief);
            }
            Task::Patches => {
                let whole = self.curved.map(|settings| pipelines.patches(gpu, settings, false));
                whole.into_iter().for_each(|patches| patches.compile_makers(gpu));
            }
            Task::Caps => {
                pipelines.caps(gpu);
            }
            Task::Caster => {
                meshes.caster(gpu, Features::default());
            }
            Task::Ground { relief } => {
                pipelines.terrain(gpu).surface(gpu, relief);
            }
            Task::GroundCaster => {
                pipelines.terrain(gpu).caster(gpu);
            }
            Task::Floor => {
                pipelines.floor(gpu);
            }
            Task::FullscreenPass(pass) => {
                pipelines.fullscreen(gpu, pass);
            }
            Task::Water { by_cells } => {
                pipelines.water(gpu, by_cells);
            }
            #[cfg(any(test, feature = "methods"))]
            Task::Layers(normals) => {
                pipelines.layers(gpu, normals);
            }
            Task::Bloom => {
                pipelines.bloom(gpu);
            }
            #[cfg(any(test, feature = "methods"))]
            Task::Ink => {
                pipelines.ink(gpu);
            }
            Task::Wire => {
                meshes.wire(gpu, Features::default());
            }
            Task::GroundWire => {
                pipelines.terrain(gpu).wire(gpu);
            }
            Task::Motion => {
                meshes.motion(gpu, Features::default());
            }
            Task::Mean => {
                pipelines.resolve.get_or_init(|| Resolve::new(gpu));
            }
        }
    }
}

/// The tasks for some settings, longest first, so that threads finish together.
fn tasks(gpu: &Gpu, settings: &Settings, ground: bool) -> Vec<Task> {
    let relief = settings.relief;
    let shadows = settings.shadows.is_some();
    let ambient = settings.occlusion.filter(|occlusion| occlusion.strength > 0.0);
    let occlusion = ambient.is_some();
    let mut tasks = vec![Task::Surface { relief: false }];
    let mut also = |needed: bool, more: &[Task]| tasks.extend(more.iter().filter(|_| needed));
    also(settings.curves(gpu).is_some(), &[Task::Patches]);
    also(!settings.sections.is_empty(), &[Task::Caps]);
    also(ground, &[Task::Ground { relief }]);
    also(relief, &[Task::Surface { relief: true }]);
    also(true, &[Task::FullscreenPass(FullscreenPass::Lighting { occlusion, shadows, specular: false })]);
    let by_cells = settings.reflections.map(|reflections| reflections.method == ReflectionMethod::HiZ);
    also(ground && settings.water, &[Task::Water { by_cells }]);
    if let Some(by_cells) = by_cells {
        let specular = false;
        also(true, &[Task::FullscreenPass(FullscreenPass::Reflections { occlusion, by_cells, specular })]);
        also(by_cells, &[Task::FullscreenPass(FullscreenPass::DepthPyramid)]);
    }
    also(settings.bloom.is_some(), &[Task::Bloom]);
    #[cfg(any(test, feature = "methods"))]
    also(settings.draws_ink(gpu), &[Task::Ink]);
    also(shadows, &[Task::FullscreenPass(FullscreenPass::Sunlight), Task::Caster]);
    also(shadows && ground, &[Task::GroundCaster, Task::Floor]);
    if let Some(ambient) = ambient {
        let normals = ambient.normals;
        let estimate = |method: OcclusionMethod, into| match method {
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::HbaoPlus => Task::Layers(normals),
            method => {
                Task::FullscreenPass(FullscreenPass::Occlusion(OcclusionVariant { method, normals, into }))
            }
        };
        let half = ambient.half && !ambient.method.is_layered();
        if half {
            also(
                true,
                &[
                    estimate(ambient.method, OcclusionOutput::Half),
                    Task::FullscreenPass(FullscreenPass::Upsample),
                ],
            );
        } else {
            also(true, &[estimate(ambient.method, OcclusionOutput::Frame)]);
        }
        also(!half || ambient.still.is_some(), &[Task::FullscreenPass(FullscreenPass::Blur)]);
        if let Some(still) = ambient.still {
            also(true, &[estimate(still, OcclusionOutput::Mean)]);
        }
    }
    match settings.anti_aliasing {
        AntiAliasing::None if settings.render_scale < 1.0 => also(
            true,
            &[
                Task::FullscreenPass(FullscreenPass::ToneMapDisplay),
                Task::FullscreenPass(FullscreenPass::Enlarge),
            ],
        ),
        AntiAliasing::None => also(true, &[Task::FullscreenPass(FullscreenPass::ToneMap)]),
        AntiAliasing::Spatial => {
            also(true, &[Task::FullscreenPass(FullscreenPass::ToneMapDisplay)]);
            if settings.render_scale < 1.0 {
                also(
                    true,
                    &[
                        Task::FullscreenPass(FullscreenPass::AntiAliasSmall),
                        Task::FullscreenPass(FullscreenPass::Enlarge),
                    ],
                );
            } else {
                also(true, &[Task::FullscreenPass(FullscreenPass::AntiAlias)]);
            }
        }
        AntiAliasing::Temporal => {
            also(true, &[Task::Mean, Task::Motion, Task::FullscreenPass(FullscreenPass::ToneMapTemporal)]);
        }
    }
    also(settings.wireframe, &[Task::Wire, Task::FullscreenPass(FullscreenPass::Wireframe)]);
    also(settings.wireframe && ground, &[Task::GroundWire]);
    tasks
}
