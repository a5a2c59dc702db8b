//! The visible difference that a blob makes: the one currency in which shapes and textures are compared.
//!
//! A difference is an area of the picture, in square pixels, times how much of it changes. The form is an estimate: a
//! surface that lies up to `e` pixels off over a region of radius `r` is seen by its outline, which is of the order of
//! `e · r`, and by its shading, whose angle is off by the order of `e / r` over the area `r²`; both grow as `e · r` does,
//! up to the whole area. A texture's level changes its surface by the contrast that it adds, which matters less once its
//! texels are small. The constants keep pictures on the way near the settled one without making the last errors wait
//! long (docs/design/viewing.md, "What comes first"; docs/decisions.md has what was tried).

use super::priority::{Priority, hidden, refine_priority};
use lodestream_scene::view::View;

/// Difference of a shape over `e · r`.
const SHAPE: f32 = 3.0;
/// How much of an attribute's error is seen as an error of the shape: less than it counts against the target, since what
/// slides within a surface moves no outline.
const ATTRIBUTE: f32 = 0.35;
/// How much of what is seen changes where all light there comes from punctual lights that are missing: as much as in a picture
/// that is a quarter too dark. What is missing of a shape is missed sooner.
const LIT: f32 = 0.25;
/// Texels of so many pixels and more are a blur all alike.
const BLUR_PX: f32 = 16.0;
/// Bytes that come before anything behind an index page is seen: its own and those of some chunks.
const BEHIND_PAGE_BYTES: f32 = 4500.0;

/// What there is to be seen of a view, which bounds all differences.
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

    /// Of a surface that lies up to `error_px` off within `radius_px`.
    pub fn shape_px2(&self, error_px: f32, radius_px: f32) -> f32 {
        let radius = radius_px.max(error_px).min(self.radius_px);
        (SHAPE * error_px * radius).min(radius * radius)
    }

    /// Of a texture whose texels are `texel_px` large on a surface of radius `coverage_px`; `weight` is the share of its
    /// area that counts as different while it is a blur.
    pub fn texture_px2(&self, texel_px: f32, coverage_px: f32, weight: f32) -> f32 {
        weight * self.surface_px2(coverage_px) * (texel_px / BLUR_PX).min(1.0)
    }

    /// Area of a surface of radius `coverage_px`, as textures count it.
    pub fn surface_px2(&self, coverage_px: f32) -> f32 {
        (coverage_px * coverage_px).min(0.25 * self.area_px2)
    }

    /// Priority of an index page whose chunks have an error of at most `error_px`, of an asset of radius `coverage_px`.
    /// `seen`: of which something is.
    pub fn page_priority(&self, error_px: f32, coverage_px: f32, seen: bool) -> Priority {
        let difference_px2 = self.shape_px2(error_px, coverage_px);
        refine_priority(if seen { difference_px2 } else { hidden(difference_px2) }, BEHIND_PAGE_BYTES, 1.0)
    }
}

/// Priority of something that brings a surface of radius `radius_px` nearer by up to `error_px`, for `bytes`.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
pub fn shape_priority(view: &View, error_px: f32, radius_px: f32, bytes: u32) -> Priority {
    refine_priority(Picture::new(view).shape_px2(error_px, radius_px), bytes as f32, 1.0)
}

/// Priority of punctual lights that light a sphere of radius `radius_px`, for `bytes`; `share` of all light there is theirs, 0 to 1.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "a priority needs no more of a length than 24 bits")]
pub fn punctual_light_priority(view: &View, share: f32, radius_px: f32, bytes: u32) -> Priority {
    let picture = Picture::new(view);
    let area = (radius_px * radius_px).min(picture.area_px2);
    refine_priority(LIT * share * area, bytes as f32, 1.0)
}

/// The part of a chunk's visible error that makes a difference, given both its errors.
pub fn seen_error(error: f32, attribute_error: f32, attribute_share: f32) -> f32 {
    error.max(ATTRIBUTE * attribute_share * attribute_error)
}

/// A difference and the bytes that it takes: a chunk, with what hangs on it where that is worth more.
#[derive(Clone, Copy, Debug, Default)]
pub struct SubtreeBenefit {
    /// The visible difference, in square pixels.
    pub difference_px2: f32,
    /// Bytes that it takes.
    pub bytes: f32,
}

impl SubtreeBenefit {
    /// This and what `behind` has: together, or this alone where that makes more of a difference per byte.
    pub fn with(self, behind: Self) -> Self {
        let both = Self {
            difference_px2: self.difference_px2 + behind.difference_px2,
            bytes: self.bytes + behind.bytes,
        };
        if self.difference_px2 * both.bytes > both.difference_px2 * self.bytes { self } else { both }
    }

    /// Adds a child's package, of which this is one of so many `parents`.
    #[expect(clippy::cast_precision_loss, reason = "a chunk has few parents")]
    pub fn add(&mut self, child: Self, parents: usize) {
        let share = 1.0 / parents.max(1) as f32;
        self.difference_px2 += share * child.difference_px2;
        self.bytes += share * child.bytes;
    }

    /// The priority of a request for it.
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
    fn differences_grow_with_error_and_size_and_are_bounded_by_what_is_there() {
        let picture = picture();
        assert_eq!(picture.shape_px2(2.0, 100.0), SHAPE * 200.0);
        assert!(picture.shape_px2(4.0, 100.0) > picture.shape_px2(2.0, 100.0));
        assert!(picture.shape_px2(2.0, 200.0) > picture.shape_px2(2.0, 100.0));
        assert_eq!(picture.shape_px2(90.0, 100.0), 10_000.0, "all of the region");
        assert_eq!(picture.shape_px2(f32::MAX, f32::MAX), 734.0 * 734.0, "all of the picture");
        assert_eq!(picture.shape_px2(0.0, 0.0), 0.0);
        let texture = |texel, coverage| picture.texture_px2(texel, coverage, 0.02);
        assert_eq!(texture(400.0, 100.0), 200.0);
        assert_eq!(texture(400.0, 100.0), texture(16.0, 100.0));
        assert_eq!(texture(4.0, 100.0), 50.0);
        assert_eq!(texture(f32::MAX, f32::MAX), 0.02 * (0.25 * 1280.0 * 720.0));
    }

    #[test]
    fn what_hangs_on_a_chunk_counts_where_it_is_worth_more() {
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
