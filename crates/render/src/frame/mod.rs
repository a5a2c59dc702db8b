//! Drawing of one frame: its settings, targets, graph of passes, pipelines, draw lists and timing.

pub(crate) mod accumulation;
pub(crate) mod batch;
pub(crate) mod camera;
pub(crate) mod compiler;
pub(crate) mod composite;
pub(crate) mod counters;
pub(crate) mod draw;
pub(crate) mod draw_calls;
pub(crate) mod draw_groups;
pub(crate) mod draw_passes;
pub(crate) mod fullscreen;
pub(crate) mod graph;
pub(crate) mod headless;
pub(crate) mod pipelines;
pub(crate) mod placed;
pub(crate) mod receivers;
pub(crate) mod settings;
pub(crate) mod target;
pub(crate) mod targets;
pub(crate) mod timing;
pub(crate) mod uniforms;
