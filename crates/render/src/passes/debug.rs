//! Debug views: intermediate results in place of the picture. Pipelines are compiled on first use.

use crate::frame::composite::{Kind, into_target, kind};
use crate::frame::graph::Resource;
use crate::frame::pipelines::DEBUG;
use crate::frame::settings::DebugView;
use crate::frame::target::{Load, Target};
use crate::passes::gbuffer::shader;
use crate::resources::gpu::Gpu;

/// What is shown: `SHOWN` of `debug.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DebugMode {
    /// White, for occlusion and shadows that are switched off.
    White = 0,
    Normal = 1,
    Albedo = 2,
    Surface = 3,
    Depth = 4,
    Share = 5,
    Count = 6,
    /// Black, for counts of zero.
    Black = 7,
    /// Motion of still and moving objects.
    Motion = 8,
    OwnMotion = 9,
}

/// The view's mode and the resources that it reads, in the order of the shader's slots, or `None` for lit pictures.
/// Arguments tell whether the frame has ambient occlusion, shadows, punctual lights and moving objects. The pass of
/// punctual lights shows their number itself.
pub(crate) fn shown(
    debug_view: DebugView,
    [occlusion, shadows, punctual_lights, moving]: [bool; 4],
) -> Option<(DebugMode, &'static [Resource])> {
    match debug_view {
        DebugView::Material | DebugView::Level | DebugView::Cascade => None,
        DebugView::PunctualLights if punctual_lights => None,
        DebugView::PunctualLights => Some((DebugMode::Black, &[Resource::Depth])),
        DebugView::Normal => Some((DebugMode::Normal, &[Resource::Depth, Resource::Normal])),
        DebugView::Albedo => Some((DebugMode::Albedo, &[Resource::Depth, Resource::Albedo])),
        // Roughness and occlusion are stored with the normal, metalness with the albedo.
        DebugView::Surface => {
            Some((DebugMode::Surface, &[Resource::Depth, Resource::Normal, Resource::Albedo]))
        }
        DebugView::Depth => Some((DebugMode::Depth, &[Resource::Depth])),
        DebugView::Occlusion if occlusion => {
            Some((DebugMode::Share, &[Resource::Depth, Resource::Occlusion]))
        }
        DebugView::Sunlight if shadows => Some((DebugMode::Share, &[Resource::Depth, Resource::Sunlight])),
        DebugView::Motion if moving => Some((DebugMode::OwnMotion, &[Resource::Depth, Resource::Motion])),
        DebugView::Motion => Some((DebugMode::Motion, &[Resource::Depth])),
        DebugView::Occlusion | DebugView::Sunlight => Some((DebugMode::White, &[Resource::Depth])),
        DebugView::Overdraw => Some((DebugMode::Count, &[Resource::Depth, Resource::Overdraw])),
    }
}

/// Pipelines compiled so far.
#[derive(Debug, Default)]
pub(crate) struct DebugPipelines {
    made: Vec<((DebugMode, Kind), wgpu::RenderPipeline)>,
}

impl DebugPipelines {
    /// Compiles the pipeline for a view in `target`, whose colour has `format`.
    pub(crate) fn ensure(
        &mut self,
        gpu: &Gpu,
        format: wgpu::TextureFormat,
        shown: DebugMode,
        target: &Target<'_>,
    ) {
        if self.get(shown, target).is_none() {
            let kind = kind(target);
            self.made.push(((shown, kind), pipeline(gpu, format, shown, kind)));
        }
    }

    /// The pipeline compiled by [`DebugPipelines::ensure`].
    pub(crate) fn get(&self, shown: DebugMode, target: &Target<'_>) -> Option<&wgpu::RenderPipeline> {
        let key = (shown, kind(target));
        self.made.iter().find(|(made, _)| *made == key).map(|(_, pipeline)| pipeline)
    }
}

fn pipeline(gpu: &Gpu, format: wgpu::TextureFormat, shown: DebugMode, kind: Kind) -> wgpu::RenderPipeline {
    let module = shader(gpu, "debug", DEBUG);
    let is = |yes: bool| f64::from(u8::from(yes));
    let constants = [
        ("SHOWN", f64::from(shown as u8)),
        ("DECODE_SRGB", is(format.is_srgb())),
        ("KEEP", is(kind.1 == Load::Keep)),
    ];
    into_target(gpu, &module, (format, kind), ["fs_debug", "fs_debug_depth"], &constants)
}
