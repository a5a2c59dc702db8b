//! The visible difference that a blob makes: one measure for shapes, textures and lights.
//!
//! A difference is an area of the picture, in square pixels, times the fraction by which it changes. It is an
//! estimate: a surface with an error of `e` pixels over a region of radius `r` changes its outline by an area of the
//! order of `e · r`, and its shading by an angle of the order of `e / r` over the area `r²`. Both are proportional to
//! `e · r`, up to the whole area. A texture level changes its surface by the contrast that it adds, which decreases
//! with the size of its texels. `docs/design/viewing.md` explains the constants.

use super::priority::{Priority, hidden, refine_priority};
use lodestream_scene::view::View;

/// Difference of a shape per `e · r`.
const SHAPE: f32 = 3.0;
/// Weight of an attribute error in the difference of a shape. Less than its weight against the target, since
/// attributes do not move outlines.
const ATTRIBUTE: f32 = 0.35;
/// Fraction by which an area changes if all of its light comes from missing punctual lights: as in a picture that is a
/// quarter too dark. Missing shapes are more visible.
const LIT: f32 = 0.25;
/// Texels of at least this size count as a complete blur.
const BLUR_PX: f32 = 16.0;
/// Bytes from an index page to the first visible effect: of the page and of some chunks.
const PAGE_AND_CHUNKS_BYTES: f32 = 4500.0;

/// Size of the picture, which bounds all differences.
#[derive(Clone, Copy, Debug)]
pub struct Picture {
    /// Half the diagonal, in pixels.
    radius_px: f32,
    /// In square pixels.
    area_px2: f32,
}

impl Picture {
    #[expect(clippy::cast_precision_loss, reason = "sides are small")]
    /// The bounds of a view.
    pub fn new(view: &View) -> Self {
        let [width, height] = view.viewport_px.map(|side| side as f32);
        Self { radius_px: 0.5 * (width * width + height * height).sqrt(), area_px2: width * height }
    }

    /// Difference of a surface with an error of `error_px` within `radius_px`.
    pub fn shape_px2(&self, error_px: f32, radius_px: f32) -> f32 {
        let radius = radius_px.max(error_px).min(self.radius_px);
        (SHAPE * error_px * radius).min(radius * radius)
    }

    /// Difference of an object within `radius_px` for which a surface with an error of `error_px` stands: the share of the
    /// error in the radius, of the area in the picture.
    pub fn object_px2(&self, error_px: f32, radius_px: f32) -> f32 {
        let radius = radius_px.min(self.radius_px);
        self.error_px2(error_px, radius_px).min(radius * radius)
    }

    /// [`Picture::object_px2`], without its bound on what an error may make.
    pub fn error_px2(&self, error_px: f32, radius_px: f32) -> f32 {
        let radius = radius_px.min(self.radius_px);
        radius * radius * (SHAPE * error_px / radius_px.max(f32::MIN_POSITIVE))
    }

    /// Difference of a texture with texels of `texel_px` on a surface of radius `coverage_px`; `weight` is the share
    /// of its area that counts as different while it is a blur.
    pub fn texture_px2(&self, texel_px: f32, coverage_px: f32, weight: f32) -> f32 {
        weight * self.surface_px2(coverage_px) * (texel_px / BLUR_PX).min(1.0)
    }

    /// Area of a surface of radius `coverage_px`, for textures.
    pub fn surface_px2(&self, coverage_px: f32) -> f32 {
        (coverage_px * coverage_px).min(0.25 * self.area_px2)
    }

    /// Priority of an index page whose chunks have an error of at most `error_px`, of an asset of radius `coverage_px`.
    /// `visible` says that the asset is not fully occluded.
    pub fn page_priority(&self, error_px: f32, coverage_px: f32, visible: bool) -> Priority {
        let difference_px2 = self.shape_px2(error_px, coverage_px);
        refine_priority(
            if visible { difference_px2 } else { hidden(difference_px2) },
            PAGE_AND_CHUNKS_BYTES,
            1.0,
        )
    }
}

/// Priority of `bytes` that correct an error of `error_px` of a surface of radius `radius_px`.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
pub fn shape_priority(view: &View, error_px: f32, radius_px: f32, bytes: u32) -> Priority {
    refine_priority(Picture::new(view).shape_px2(error_px, radius_px), bytes as f32, 1.0)
}

/// Priority of `bytes` with punctual lights that light a sphere of radius `radius_px`; `share` is their share of all
/// light there, 0 to 1.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
pub fn punctual_light_priority(view: &View, share: f32, radius_px: f32, bytes: u32) -> Priority {
    let picture = Picture::new(view);
    let area = (radius_px * radius_px).min(picture.area_px2);
    refine_priority(LIT * share * area, bytes as f32, 1.0)
}

/// Error of a chunk for its visible difference, from its geometric and attribute errors.
pub fn difference_error(error: f32, attribute_error: f32, attribute_share: f32) -> f32 {
    error.max(ATTRIBUTE * attribute_share * attribute_error)
}

/// Benefit and cost of a chunk, with its descendants if they raise the benefit per byte.
#[derive(Clone, Copy, Debug, Default)]
pub struct SubtreeBenefit {
    /// The visible difference, in square pixels.
    pub difference_px2: f32,
    /// Bytes that it costs.
    pub bytes: f32,
}

impl SubtreeBenefit {
    /// This with `descendants`, or this alone if that has more difference per byte.
    pub fn with(self, descendants: Self) -> Self {
        let both = Self {
            difference_px2: self.difference_px2 + descendants.difference_px2,
            bytes: self.bytes + descendants.bytes,
        };
        if self.difference_px2 * both.bytes > both.difference_px2 * self.bytes { self } else { both }
    }

    /// Adds a child's benefit, divided among its `parents`.
    #[expect(clippy::cast_precision_loss, reason = "a chunk has few parents")]
    pub fn add(&mut self, child: Self, parents: usize) {
        let share = 1.0 / parents.max(1) as f32;
        self.difference_px2 += share * child.difference_px2;
        self.bytes += share * child.bytes;
    }

    /// Priority of a request for it.
    pub fn priority(&self, foveation: f32) -> Priority {
        refine_priority(self.difference_px2, self.bytes, foveation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        Picture { radius_px: 734.0, area_px2: 1280.0 * 720.0 }
    }

    #[test]
    fn differences_grow_with_error_and_size_up_to_the_picture() {
        let picture = picture();
        assert_eq!(picture.shape_px2(2.0, 100.0), SHAPE * 200.0);
        assert!(picture.shape_px2(4.0, 100.0) > picture.shape_px2(2.0, 100.0));
        assert!(picture.shape_px2(2.0, 200.0) > picture.shape_px2(2.0, 100.0));
        assert_eq!(picture.shape_px2(90.0, 100.0), 10_000.0, "all of the region");
        assert_eq!(picture.shape_px2(f32::MAX, f32::MAX), 734.0 * 734.0, "all of the picture");
        assert_eq!(picture.shape_px2(0.0, 0.0), 0.0);
        assert_eq!((picture.shape_px2(50.0, 10.0), picture.object_px2(50.0, 10.0)), (2500.0, 100.0));
        assert_eq!(picture.object_px2(2.0, 100.0), SHAPE * 200.0);
        let texture = |texel, coverage| picture.texture_px2(texel, coverage, 0.02);
        assert_eq!(texture(400.0, 100.0), 200.0);
        assert_eq!(texture(400.0, 100.0), texture(16.0, 100.0));
        assert_eq!(texture(4.0, 100.0), 50.0);
        assert_eq!(texture(f32::MAX, f32::MAX), 0.02 * (0.25 * 1280.0 * 720.0));
    }

    #[test]
    fn descendants_count_if_they_raise_the_benefit_per_byte() {
        let (poor, rich) = (
            SubtreeBenefit { difference_px2: 10.0, bytes: 1000.0 },
            SubtreeBenefit { difference_px2: 900.0, bytes: 500.0 },
        );
        assert_eq!(poor.with(rich).difference_px2, 910.0);
        assert_eq!(rich.with(poor).bytes, 500.0);
        let mut behind = SubtreeBenefit::default();
        behind.add(rich, 2);
        behind.add(rich, 2);
        assert_eq!((behind.difference_px2, behind.bytes), (900.0, 500.0));
        assert!(poor.with(behind).priority(1.0) > poor.priority(1.0));
    }
}
