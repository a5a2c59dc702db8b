//! Render targets of a frame: a picture, or a host's colour and depth.

use crate::resources::gpu::RenderError;

/// What happens to a target's content.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Load {
    /// Overwritten: sky where no surface is, with depth 0.
    #[default]
    Clear,
    /// Kept where no surface is drawn, or where the content is nearer. No sky is drawn.
    Keep,
}

/// The views that a frame is drawn into: textures of a host or of a window.
///
/// Depth is reversed and has no far plane: `near / view depth` with the near plane of [`crate::Settings::near`], so
/// 0 is infinitely far and nearer is greater. A host that draws into the same depth texture projects as
/// [`clip_from_view`](crate::clip_from_view) does, clears depth to 0 and compares with
/// `CompareFunction::Greater`. It may draw before a frame with [`Load::Keep`], and after any frame.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Colour, in the renderer's format, one sample per pixel, usable as a render attachment.
    pub colour: &'a wgpu::TextureView,
    /// Depth in any depth format, preferably `Depth32Float`, of the colour's size. Written, and with [`Load::Keep`]
    /// tested against.
    pub depth: Option<&'a wgpu::TextureView>,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// What happens to the content of both.
    pub load: Load,
}

impl<'a> Target<'a> {
    /// A colour target that is overwritten.
    #[must_use]
    pub const fn colour(colour: &'a wgpu::TextureView, size: (u32, u32)) -> Self {
        Self { colour, depth: None, size, load: Load::Clear }
    }

    /// Checks that the passes can be attached to the views; wgpu would abort the program.
    pub(crate) fn check(&self, format: wgpu::TextureFormat) -> Result<(), RenderError> {
        let refuse = |why: String| Err(RenderError::Target(why));
        for (name, view) in [("colour", Some(self.colour)), ("depth", self.depth)] {
            let Some(texture) = view.map(wgpu::TextureView::texture) else { continue };
            let size = (texture.width(), texture.height());
            if texture.sample_count() != 1 {
                return refuse(format!("the {name} target has {} samples, not 1", texture.sample_count()));
            }
            if self.size.0 > size.0 || self.size.1 > size.1 {
                return refuse(format!("the {name} target has {size:?} pixels, the frame {:?}", self.size));
            }
            let found = texture.format();
            if name == "depth" && !found.has_depth_aspect() {
                return refuse(format!("{found:?} is not a depth format"));
            }
            if name == "colour" && found.add_srgb_suffix() != format.add_srgb_suffix() {
                return refuse(format!(
                    "the colour target is of {found:?}, the renderer made for {format:?}"
                ));
            }
            if !texture.usage().contains(wgpu::TextureUsages::RENDER_ATTACHMENT) {
                return refuse(format!("the {name} target lacks the usage RENDER_ATTACHMENT"));
            }
        }
        Ok(())
    }
}
