//! Pipelines that are compiled before a frame needs them.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::frame::pipelines::{Estimate, Estimated, Pipelines, Whole};
use crate::frame::settings::{AntiAliasing, Settings};
use crate::passes::occlusion::OcclusionMethod;
#[cfg(any(test, feature = "methods"))]
use crate::passes::occlusion::OcclusionNormals;
use crate::passes::reflections::ReflectionMethod;
use crate::passes::temporal::Resolve;
use crate::resources::gpu::Gpu;
use crate::scene::material_bindings::Features;

/// Something that is compiled by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Task {
    Surface {
        relief: bool,
    },
    /// What makes lists of curved patches, which are drawn in place of what is flat.
    Patches,
    Caster,
    Ground {
        relief: bool,
    },
    GroundCaster,
    Whole(Whole),
    Water {
        by_cells: Option<bool>,
    },
    Bloom,
    #[cfg(any(test, feature = "methods"))]
    Ink,
    #[cfg(any(test, feature = "methods"))]
    /// Of occlusion.
    Layers(OcclusionNormals),
    Wire,
    GroundWire,
    /// How far things move, and means over time.
    Motion,
    Mean,
}

/// What frames of some settings are drawn with, to be compiled before the first of them; a frame compiles else what it
/// lacks, and that takes milliseconds a pipeline. Clones share the work: each thread that calls [`Compiler::compile`] takes
/// what no other has begun.
///
/// What only some materials need (maps, holes, what is seen through) is compiled when an asset has such a one, punctual lights'
/// pipelines when there is one.
#[derive(Clone, Debug)]
pub struct Compiler {
    gpu: Gpu,
    pipelines: Arc<Pipelines>,
    tasks: Arc<[Task]>,
    /// Meshes are drawn as curved patches.
    curved: bool,
    next: Arc<AtomicUsize>,
}

impl Compiler {
    pub(crate) fn new(gpu: &Gpu, pipelines: &Arc<Pipelines>, settings: &Settings, ground: bool) -> Self {
        Self {
            gpu: gpu.clone(),
            pipelines: Arc::clone(pipelines),
            tasks: tasks(gpu, settings, ground).into(),
            curved: settings.curves(gpu).is_some(),
            next: Arc::default(),
        }
    }

    /// Compiles until nothing is left that no thread has begun. What refuses is told by the next frame.
    pub fn compile(&self) {
        while let Some(task) = self.tasks.get(self.next.fetch_add(1, Ordering::Relaxed)) {
            self.make(*task);
        }
    }

    fn make(&self, task: Task) {
        let (gpu, pipelines) = (&self.gpu, &*self.pipelines);
        let meshes = if self.curved { pipelines.curved(gpu) } else { &pipelines.meshes };
        match task {
            Task::Surface { relief } => {
                meshes.surface(gpu, Features { relief, ..Features::default() }, relief);
            }
            Task::Patches => {
                pipelines.list_makers(gpu);
            }
            Task::Caster => {
                meshes.caster(gpu);
            }
            Task::Ground { relief } => {
                pipelines.terrain(gpu).surface(gpu, relief);
            }
            Task::GroundCaster => {
                pipelines.terrain(gpu).caster(gpu);
            }
            Task::Whole(pass) => {
                pipelines.whole(gpu, pass);
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
                meshes.wire(gpu);
            }
            Task::GroundWire => {
                pipelines.terrain(gpu).wire(gpu);
            }
            Task::Motion => {
                meshes.motion(gpu);
            }
            Task::Mean => {
                pipelines.resolve.get_or_init(|| Resolve::new(gpu));
            }
        }
    }
}

/// What is needed for some settings. The longest first, so that threads end together.
fn tasks(gpu: &Gpu, settings: &Settings, ground: bool) -> Vec<Task> {
    let relief = settings.relief;
    let shadows = settings.shadows.is_some();
    let ambient = settings.occlusion.filter(|occlusion| occlusion.strength > 0.0);
    let occlusion = ambient.is_some();
    let mut tasks = vec![Task::Surface { relief: false }];
    let mut also = |needed: bool, more: &[Task]| tasks.extend(more.iter().filter(|_| needed));
    also(settings.curves(gpu).is_some(), &[Task::Patches]);
    also(ground, &[Task::Ground { relief }]);
    also(relief, &[Task::Surface { relief: true }]);
    also(true, &[Task::Whole(Whole::Lighting { occlusion, shadows })]);
    let by_cells = settings.reflections.map(|reflections| reflections.method == ReflectionMethod::HiZ);
    also(ground && settings.water, &[Task::Water { by_cells }]);
    if let Some(by_cells) = by_cells {
        also(true, &[Task::Whole(Whole::Reflections { occlusion, by_cells })]);
        also(by_cells, &[Task::Whole(Whole::DepthPyramid)]);
    }
    also(settings.bloom.is_some(), &[Task::Bloom]);
    #[cfg(any(test, feature = "methods"))]
    also(settings.draws_ink(gpu), &[Task::Ink]);
    also(shadows, &[Task::Whole(Whole::Sunlight), Task::Caster]);
    also(shadows && ground, &[Task::GroundCaster]);
    if let Some(ambient) = ambient {
        let normals = ambient.normals;
        let estimate = |method: OcclusionMethod, into| match method {
            #[cfg(any(test, feature = "methods"))]
            OcclusionMethod::HbaoPlus => Task::Layers(normals),
            method => Task::Whole(Whole::Occlusion(Estimate { method, normals, into })),
        };
        let half = ambient.half && !ambient.method.is_layered();
        if half {
            also(true, &[estimate(ambient.method, Estimated::Half), Task::Whole(Whole::Upsample)]);
        } else {
            also(true, &[estimate(ambient.method, Estimated::Frame)]);
        }
        also(!half || ambient.still.is_some(), &[Task::Whole(Whole::Blur)]);
        if let Some(still) = ambient.still {
            also(true, &[estimate(still, Estimated::Mean)]);
        }
    }
    match settings.anti_aliasing {
        AntiAliasing::None => also(true, &[Task::Whole(Whole::ToneMap)]),
        AntiAliasing::Spatial => {
            also(true, &[Task::Whole(Whole::ToneMapDisplay)]);
            if settings.render_scale < 1.0 {
                also(true, &[Task::Whole(Whole::AntiAliasSmall), Task::Whole(Whole::Enlarge)]);
            } else {
                also(true, &[Task::Whole(Whole::AntiAlias)]);
            }
        }
        AntiAliasing::Temporal => {
            also(true, &[Task::Mean, Task::Motion, Task::Whole(Whole::ToneMapTemporal)]);
        }
    }
    also(settings.wireframe, &[Task::Wire, Task::Whole(Whole::Wireframe)]);
    also(settings.wireframe && ground, &[Task::GroundWire]);
    tasks
}
