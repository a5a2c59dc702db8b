//! Where a frame goes: a picture of our own, or a host's colour and depth.

use crate::resources::gpu::RenderError;

/// What becomes of what a target holds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Load {
    /// It is overwritten: sky where no surface is, at depth 0.
    #[default]
    Clear,
    /// It stays where none of our surfaces is, or where it is nearer. Nothing is drawn of the sky.
    Keep,
}

/// The views that a frame is drawn into: of textures of a host, or of a window's.
///
/// Depth is reversed and has no far plane: `near / view depth` with the near plane of [`super::Settings::near`], so
/// 0 is infinitely far and nearer is greater. A host that draws into the same depth texture projects as
/// [`clip_from_view`](super::clip_from_view) does, clears depth to 0 and compares with
/// `CompareFunction::Greater`. It may draw before a frame with [`Load::Keep`], and after any frame.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Of the format that the renderer was made for, one sample per pixel, usable as a render attachment.
    pub colour: &'a wgpu::TextureView,
    /// Of a depth format, preferably `Depth32Float` as the frame's own, as large as the colour; drawn into, and with
    /// [`Load::Keep`] tested against.
    pub depth: Option<&'a wgpu::TextureView>,
    /// Width and height in pixels.
    pub size: (u32, u32),
    /// What becomes of what both hold.
    pub load: Load,
}

impl<'a> Target<'a> {
    /// A picture that is overwritten.
    #[must_use]
    pub const fn colour(colour: &'a wgpu::TextureView, size: (u32, u32)) -> Self {
        Self { colour, depth: None, size, load: Load::Clear }
    }

    /// Refuses views that the renderer's passes cannot be attached to; wgpu would stop the program.
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
                return refuse(format!("{found:?} is no depth format"));
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
