//! Wedges of new faces with the [axis-aligned codec](crate::entropy::Codec::AxisAligned): whether a face is coplanar
//! with a neighbour or bends sharply predicts which wedges they share, its orientation predicts the normal groups of
//! its corners ([`crate::mesh::orientation_class`]), and textures are projected along the axes
//! ([`crate::codec::uv_map`]).

use crate::codec::attributes::Expected;
use crate::codec::chunk_coder::ChunkCoder;
use crate::codec::local::Local;
use crate::codec::model::{
    AXIS_COPIED, AXIS_COPY, AXIS_GROUP, AXIS_SAME_WEDGE, AXIS_SIDE, CORNERS, FACE_BENDS, PLACES,
};
use crate::codec::uv_map::{Anchor, CornerLookup};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::integer;
use crate::mesh::Attributes;
use crate::mesh::orientation_class::{ORIENTATION_CLASSES, has_one_axis, orientation_class};
use crate::mesh::vec3::{Vec3, dot, triangle_normal};

/// Kinds of corners, below [`CORNERS`]: t, x and u of a new face; u of a moved face.
pub(crate) const AT_TARGET: usize = 0;
pub(crate) const AT_THIRD: usize = 1;
pub(crate) const AT_NEW: usize = 2;
pub(crate) const AT_MOVED: usize = 3;

/// Last of the dihedral classes (flat within 1.5°, within 15°, more): no other face, or one without area.
pub(crate) const NO_BEND: usize = FACE_BENDS - 1;

/// Most wedges of a vertex that are examined: bounds the work for an untrusted peer's vertex.
const MAX_LOOKED_AT: usize = 32;

/// Faces whose wedges are not coded yet: a new one, or the moved ones with one wedge.
pub(crate) struct Sheet {
    normal: Vec3,
    /// The normal group number that corresponds to the faces' orientation.
    group: u32,
    /// Their likely material.
    material: u16,
}

/// One corner of a [`Sheet`].
#[derive(Clone, Copy)]
pub(crate) struct SheetCorner<'a> {
    sheet: &'a Sheet,
    /// [`AT_TARGET`] to [`AT_MOVED`].
    kind: usize,
    /// A wedge of another corner, or of the old vertex in the same faces.
    from: Option<u32>,
    /// Dihedral class against the face that the corner's wedge is predicted from.
    bend: usize,
}

impl Sheet {
    /// Faces with the given normal, of any length.
    pub(crate) fn new(normal: Vec3, material: u16) -> Self {
        Self { normal, group: orientation_class(normal), material }
    }

    pub(crate) fn corner(&self, kind: usize, from: Option<u32>, bend: usize) -> SheetCorner<'_> {
        SheetCorner { sheet: self, kind, from, bend }
    }

    /// Dihedral class between another face and these.
    pub(crate) fn bend(&self, normal: Vec3) -> usize {
        let (along, sizes) = (dot(self.normal, normal), dot(self.normal, self.normal) * dot(normal, normal));
        match along * along {
            _ if sizes == 0.0 => NO_BEND,
            square if along > 0.0 && square >= 0.9993 * sizes => 0,
            square if along > 0.0 && square >= 0.933 * sizes => 1,
            _ => 2,
        }
    }
}

/// Normal of an existing face, of twice its area in length.
pub(crate) fn normal_of_face(local: &Local<'_>, face: u32) -> Vec3 {
    let [a, b, c] = local.faces[face as usize].corners.map(|v| local.position(v));
    triangle_normal(a, b, c)
}

fn anchor(local: &Local<'_>, wedge: u32) -> Anchor {
    let wedge = &local.wedges[wedge as usize];
    let Attributes { uv, group, .. } = wedge.attributes;
    Anchor { at: local.position(wedge.vertex), uv, group }
}

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Records the texture projections of faces, if the codec uses them.
    pub(crate) fn record_projections(&mut self, faces: impl IntoIterator<Item = u32>) {
        if self.axis_aligned() && self.mesh.kinds.uv_bits > 0 {
            for number in faces {
                let wedges = self.local.faces[number as usize].wedges;
                let corners = wedges.map(|wedge| anchor(&self.local, wedge));
                self.uv_maps.add_face(self.local.material(number), corners);
            }
        }
    }

    /// Context of whether the wedge at a corner equals the prediction.
    pub(crate) fn same_wedge(&self, of: &SheetCorner<'_>, guess: u32) -> usize {
        let agrees = self.group_of(guess) % ORIENTATION_CLASSES == self.likely_group(of);
        AXIS_SAME_WEDGE + (usize::from(agrees) * FACE_BENDS + of.bend) * (CORNERS - 1) + of.kind
    }

    /// A wedge of the vertex other than the prediction whose normal group is the likely one.
    pub(crate) fn likely_wedge(&self, vertex: u32, of: &SheetCorner<'_>, guess: Option<u32>) -> Option<u32> {
        let group = self.likely_group(of);
        let mut others = self.local.wedges_of(vertex).take(MAX_LOOKED_AT).filter(|&w| Some(w) != guess);
        others.find(|&w| self.group_of(w) == group)
    }

    fn group_of(&self, wedge: u32) -> u32 {
        self.local.wedges[wedge as usize].attributes.group
    }

    /// The likely normal group of a corner: another corner's (without copies), else by the faces' orientation.
    fn likely_group(&self, of: &SheetCorner<'_>) -> u32 {
        of.from.map_or(of.sheet.group, |wedge| self.group_of(wedge) % ORIENTATION_CLASSES)
    }

    /// Codes the normal group of a new wedge, and predicts its texture coordinates.
    pub(crate) fn predict_new_wedge(
        &mut self,
        vertex: u32,
        of: &SheetCorner<'_>,
        expected: &mut Expected,
        want: Option<Attributes>,
    ) -> CornerLookup {
        let group = self.group(vertex, of, expected, want.map(|want| want.group));
        expected.known_group = Some(group);
        let place = match (of.kind, of.from) {
            (AT_MOVED, _) => 0,
            (_, Some(_)) => 1,
            (_, None) => 2,
        };
        let from = of.from.map(|wedge| anchor(&self.local, wedge));
        let lookup = self.uv_maps.predict(
            place,
            (group, of.sheet.material),
            from,
            self.local.position(vertex),
            expected.uv,
        );
        if self.mesh.kinds.uv_bits > 0 {
            let copy = group >= ORIENTATION_CLASSES;
            expected.like_near = copy.then_some(place);
            if let Some(uv) = self.uv_maps.choose(&lookup) {
                let top = (1 << self.mesh.kinds.uv_bits) - 1;
                expected.uv = uv.map(|x| x.clamp(0, top));
                expected.projected = Some(usize::from(copy) * PLACES + place);
            }
        }
        lookup
    }

    /// Codes a normal group: its orientation class, one of which is likely, and which copy of it.
    fn group(&mut self, vertex: u32, of: &SheetCorner<'_>, expected: &Expected, want: Option<u32>) -> u32 {
        let likely = self.likely_group(of);
        let want = want.unwrap_or(likely);
        let as_near = expected.near.is_some_and(|near| near.group == likely);
        let context = AXIS_GROUP + usize::from(expected.first) * 2 + usize::from(as_near);
        let leans = match self.coder.bit(context, want % ORIENTATION_CLASSES == likely) {
            true => likely,
            false => integer(self.coder, AXIS_SIDE, want % ORIENTATION_CLASSES),
        };
        // At a chamfer, each corner has a side along its own axis.
        let own = |w| self.group_of(w) < ORIENTATION_CLASSES && has_one_axis(self.group_of(w));
        let has_own = self.local.wedges_of(vertex).take(MAX_LOOKED_AT).any(own);
        let of_copy = of.from.is_some_and(|w| self.group_of(w) >= ORIENTATION_CLASSES);
        let context = [of_copy, has_own, has_one_axis(leans)]
            .into_iter()
            .fold(of.kind, |c, bit| c * 2 + usize::from(bit));
        if !self.coder.bit(AXIS_COPIED + context, want >= ORIENTATION_CLASSES) {
            return leans;
        }
        let copy = integer(self.coder, AXIS_COPY, (want / ORIENTATION_CLASSES).saturating_sub(1));
        leans.wrapping_add(ORIENTATION_CLASSES.wrapping_mul(copy.wrapping_add(1)))
    }
}
