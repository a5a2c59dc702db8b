//! Stand-in for `relief_acceleration.rs` without the feature `methods`: the default search of relief mapping needs no
//! acceleration texture, so there is no kind of one.

use crate::resources::descriptors::group_layout;
use crate::resources::gpu::{Gpu, RenderError};

/// Has no value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReliefAcceleration {}

impl ReliefAcceleration {
    /// Number of kinds.
    pub(crate) const COUNT: usize = 0;

    /// Index of the kind.
    pub(crate) const fn number(self) -> usize {
        match self {}
    }

    /// Layout of group 3, which is empty.
    pub(crate) fn layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
        group_layout(gpu, "no relief acceleration", &[])
    }

    /// Builds the texture.
    pub(crate) fn make(
        self,
        _gpu: &Gpu,
        _heights: &wgpu::Texture,
        _level: u32,
    ) -> Result<Option<wgpu::Texture>, RenderError> {
        match self {}
    }
}
