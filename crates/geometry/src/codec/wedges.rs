//! Coding of wedges and materials of a split: the wedges of moved corners and new faces, and the attributes of new
//! wedges.

use crate::codec::attributes::{
    Expected, SHARED_ALIKE, SHARED_AT_CORNER, SHARED_UNLIKE, SharedUv, code_attributes,
};
use crate::codec::chunk_coder::ChunkCoder;
use crate::codec::local::Local;
use crate::codec::model::{
    AXIS_LIKELY_WEDGE, AXIS_NEW_WEDGE, MATERIAL, NEW_MOVED_WEDGE, NEW_WEDGE, SAME_MATERIAL, SAME_MOVED_WEDGE,
    SAME_WEDGE,
};
use crate::codec::plan::TargetWedge;
use crate::codec::residual::quarter_octaves;
use crate::codec::scratch::{AddedFace, Split, UvFit};
use crate::codec::sheet::{
    AT_MOVED, AT_NEW, AT_TARGET, AT_THIRD, NO_BEND, Sheet, SheetCorner, normal_of_face,
};
use crate::entropy::range_coder::Coder;
use crate::entropy::symbols::{index, integer};
use crate::error::DecodeError;
use crate::mesh::vec3::{Vec3, add, cross, dot, scale, sub};
use crate::numbers::floored;

/// A corner of a new face.
struct Corner<'a> {
    /// [`AT_TARGET`], [`AT_THIRD`] or [`AT_NEW`].
    kind: usize,
    vertex: u32,
    /// The wedge that a neighbouring face has there.
    guess: Option<u32>,
    /// A nearby wedge.
    near: Option<u32>,
    /// Builder's face, when encoding.
    face: Option<u32>,
    /// With the axis-aligned codec.
    facing: Option<SheetCorner<'a>>,
}

impl<C: Coder> ChunkCoder<'_, '_, C> {
    /// Codes the wedges of the moved corners and of the new faces, and the new faces' materials.
    pub(crate) fn wedges(&mut self, split: &Split) -> Result<(), DecodeError> {
        self.moved(split)?;
        self.record_projections(split.moving.iter().map(|&i| split.fan.star_faces[i].face));
        for face in &split.added {
            self.face(split, face)?;
            self.record_projections([face.local]);
        }
        Ok(())
    }

    /// Codes wedges of the new vertex for the moved faces.
    fn moved(&mut self, split: &Split) -> Result<(), DecodeError> {
        let mut pairs = std::mem::take(&mut self.scratch.fitting.pairs);
        pairs.clear();
        for &i in &split.moving {
            let star_face = split.fan.star_faces[i];
            let from = split.targets[i];
            let same = pairs.iter().find(|p| p.0 == from).map(|p| p.1);
            let first = self.local.first_wedge(split.u);
            let guide = self.guide.as_ref();
            let want = guide.map(|g| g.wedge(g.names.faces[star_face.face as usize], split.u, same, first));
            let wedge = match same {
                Some(same) if self.coder.bit(SAME_MOVED_WEDGE, want == Some(TargetWedge::Known(same))) => {
                    same
                }
                _ => {
                    let new = matches!(want, Some(TargetWedge::New(_)));
                    if first.is_none() || self.coder.bit(NEW_MOVED_WEDGE, new) {
                        let expected = self.expected(split, from, &pairs);
                        let sheet = self.axis_aligned().then(|| {
                            let normal = normal_of_moved(&self.local, split, Some(from));
                            Sheet::new(normal, self.local.material(star_face.face))
                        });
                        let facing = sheet.as_ref().map(|sheet| sheet.corner(AT_MOVED, Some(from), NO_BEND));
                        self.new_wedge(split.u, expected, facing, want)?
                    } else {
                        self.chosen(split.u, want)?
                    }
                }
            };
            if same.is_none() {
                pairs.push((from, wedge));
            }
            self.local.set_wedge(star_face.face, star_face.k, wedge);
        }
        self.scratch.fitting.pairs = pairs;
        Ok(())
    }

    /// Codes one of a vertex's wedges.
    fn chosen(&mut self, vertex: u32, want: Option<TargetWedge>) -> Result<u32, DecodeError> {
        let wedges = || self.local.wedges_of(vertex);
        let place = wedges().position(|w| want == Some(TargetWedge::Known(w))).unwrap_or(0);
        let place = index(self.coder, wedges().count(), place, "chunk: wedge")?;
        wedges().nth(place).ok_or_else(|| DecodeError::new("chunk", "a vertex without wedges"))
    }

    /// Predicts the new vertex's wedge from the moved faces that had wedge `from`: texture coordinates by an affine
    /// fit over the ring, weighted by proximity, at the new position. `pairs` are the wedges of the old and the new
    /// vertex in the moved faces so far.
    fn expected(&mut self, split: &Split, from: u32, pairs: &[(u32, u32)]) -> Expected {
        let (kinds, local) = (self.mesh.kinds, &self.local);
        let near = Some(local.wedges[from as usize].attributes);
        let mut expected = Expected { near, ..Expected::default() };
        if kinds.uv_bits > 0 || kinds.second_uv_bits > 0 || kinds.normals {
            expected.normal = normal_of_moved(local, split, None);
        }
        if kinds.uv_bits > 0 {
            let UvFit { points, visited, .. } = &mut self.scratch.fitting;
            gather_points(local, split, from, 0, points, visited);
            let (uv, size) = fitted(points, expected.normal);
            (expected.uv, expected.uv_size) = (uv, Some(size));
        }
        if kinds.second_uv_bits > 0 {
            let UvFit { points, visited, .. } = &mut self.scratch.fitting;
            gather_points(local, split, from, 1, points, visited);
            let (uv, size) = fitted(points, expected.normal);
            (expected.second_uv, expected.second_uv_size) = (uv, Some(size));
            let uv_of = |wedge: u32, set| local.wedges[wedge as usize].attributes.uv_of_set(set);
            expected.shared = [0, 1].map(|set| {
                let alike =
                    pairs.iter().find(|pair| uv_of(pair.0, set) == uv_of(from, set)).map(|pair| pair.1);
                let place = if alike.is_some() { SHARED_ALIKE } else { SHARED_UNLIKE };
                let wedge = alike.or(local.first_wedge(split.u))?;
                Some(SharedUv { uv: uv_of(wedge, set), place })
            });
        }
        expected
    }

    fn new_wedge(
        &mut self,
        vertex: u32,
        mut expected: Expected,
        facing: Option<SheetCorner<'_>>,
        want: Option<TargetWedge>,
    ) -> Result<u32, DecodeError> {
        let builder = match want {
            Some(TargetWedge::New(builder)) => Some(builder),
            _ => None,
        };
        let want = builder.and_then(|b| Some(self.guide.as_ref()?.source.wedges.get(b).attributes));
        expected.first = self.local.first_wedge(vertex).is_none();
        let lookup = facing.map(|facing| self.predict_new_wedge(vertex, &facing, &mut expected, want));
        let attributes = code_attributes(self.coder, self.mesh.kinds, &mut self.recent_uv, &expected, want)?;
        if let Some(lookup) = lookup {
            self.uv_maps.update(&lookup, attributes.uv);
        }
        let wedge = self.local.add_wedge(vertex, attributes);
        if let (Some(guide), Some(builder)) = (self.guide.as_mut(), builder) {
            guide.names.wedge(builder);
        }
        Ok(wedge)
    }

    /// Codes wedges and material of one new face.
    fn face(&mut self, split: &Split, added: &AddedFace) -> Result<(), DecodeError> {
        let cut = added.cut.map(|c| &split.cuts[c]);
        // The neighbouring faces' wedges at t, x and u.
        let (mut at_t, mut at_x, mut at_u, mut beside) = (None, None, None, None);
        let mut staying = None;
        if let Some(cut) = cut {
            staying = cut.stays.map(|i| split.fan.star_faces[i].face);
            let moving = &split.fan.star_faces[cut.moves];
            let [centre, a, b] = self.local.spoke_wedges(moving);
            at_u = Some(centre);
            at_x = Some(if cut.left { a } else { b });
            at_t = Some(split.targets[cut.stays.unwrap_or(cut.moves)]);
            beside = Some(moving.face);
        } else if let Some(star_face) = split.fan.star_faces.first() {
            at_t = Some(split.targets[0]);
            beside = Some(star_face.face);
        }
        let near = beside.map_or(0, |f| self.local.material(f));
        let sheet = self.axis_aligned().then(|| Sheet::new(normal_of_face(&self.local, added.local), near));
        let sheet = sheet.as_ref();
        let bend = |face: Option<u32>| match (sheet, face) {
            (Some(sheet), Some(face)) => sheet.bend(normal_of_face(&self.local, face)),
            _ => NO_BEND,
        };
        // The wedge at t is predicted from the face that stays, if there is one; the others from the face that moves.
        let (at_stay, at_move) = (bend(staying.or(beside)), bend(beside));
        let corner = |kind, vertex, guess, from, bend| {
            let facing = sheet.map(|sheet| sheet.corner(kind, from, bend));
            Corner { kind, vertex, guess, near: at_t, face: added.face, facing }
        };
        let t_wedge = self.corner(&corner(AT_TARGET, split.t, at_t, None, at_stay))?;
        let x_wedge = self.corner(&corner(AT_THIRD, added.x, at_x, Some(t_wedge), at_move))?;
        let u_guess = at_u.or(self.local.first_wedge(split.u));
        let u_wedge = self.corner(&corner(AT_NEW, split.u, u_guess, Some(t_wedge), at_move))?;

        let want = match (added.face, self.guide.as_ref()) {
            (Some(face), Some(g)) => g.source.faces[face as usize].material,
            _ => near,
        };
        let mut material = near;
        let materials = self.materials();
        if materials > 1 && !self.coder.bit(SAME_MATERIAL, want == near) {
            let got = integer(self.coder, MATERIAL, u32::from(want));
            material = u16::try_from(got).unwrap_or(u16::MAX);
            if material >= materials {
                return Err(DecodeError::new("chunk", format!("material {material} of {materials}")));
            }
        }
        let wedges = if added.left { [t_wedge, x_wedge, u_wedge] } else { [u_wedge, x_wedge, t_wedge] };
        self.local.set_face(added.local, wedges, material);
        Ok(())
    }

    /// Codes the wedge at a corner of a new face: usually that of a neighbouring face.
    #[inline(always)]
    fn corner(&mut self, corner: &Corner<'_>) -> Result<u32, DecodeError> {
        let Corner { kind, vertex, guess, face, ref facing, .. } = *corner;
        let first = || self.local.first_wedge(vertex);
        let want = self.guide.as_ref().and_then(|g| Some(g.wedge(face?, vertex, guess, first())));
        if let Some(guess) = guess {
            let same = facing.as_ref().map_or(SAME_WEDGE + kind, |facing| self.same_wedge(facing, guess));
            if self.coder.bit(same, want == Some(TargetWedge::Known(guess))) {
                return Ok(guess);
            }
        }
        self.other_at_corner(corner, want)
    }

    #[inline(never)]
    fn other_at_corner(
        &mut self,
        corner: &Corner<'_>,
        want: Option<TargetWedge>,
    ) -> Result<u32, DecodeError> {
        let Corner { kind, vertex, guess, near, facing, .. } = *corner;
        let first = self.local.first_wedge(vertex);
        let mut new = NEW_WEDGE + kind;
        if let Some(facing) = &facing {
            let likely = self.likely_wedge(vertex, facing, guess);
            if let Some(likely) = likely
                && self.coder.bit(AXIS_LIKELY_WEDGE + kind, want == Some(TargetWedge::Known(likely)))
            {
                return Ok(likely);
            }
            new = AXIS_NEW_WEDGE + kind * 2 + usize::from(likely.is_some());
        }
        if first.is_none() || self.coder.bit(new, matches!(want, Some(TargetWedge::New(_)))) {
            let attributes = |w: u32| self.local.wedges[w as usize].attributes;
            let own = guess.or(first);
            let near = own.or(near).map(attributes);
            let mut expected = Expected { uv: near.map_or([0; 2], |w| w.uv), near, ..Expected::default() };
            if self.mesh.kinds.second_uv_bits > 0 {
                expected.second_uv = near.map_or([0; 2], |w| w.uv_of_set(1));
                expected.shared = [0, 1].map(|set| {
                    let uv = attributes(own?).uv_of_set(set);
                    Some(SharedUv { uv, place: SHARED_AT_CORNER })
                });
            }
            return self.new_wedge(vertex, expected, facing, want);
        }
        self.chosen(vertex, want)
    }
}

/// Area-weighted sum of the moved faces' normals: of all, or of those with one wedge of t.
fn normal_of_moved(local: &Local<'_>, split: &Split, of: Option<u32>) -> Vec3 {
    let center = local.position(split.u);
    let mut normal = [0.0; 3];
    for &i in split.moving.iter().filter(|&&i| of.is_none_or(|of| split.targets[i] == of)) {
        let star_face = &split.fan.star_faces[i];
        let [a, b] = [star_face.a, star_face.b].map(|v| sub(local.position(v), center));
        normal = add(normal, cross(a, b));
    }
    normal
}

/// A set of texture coordinates of the wedges of the moved faces with one wedge of t, relative to the position of u.
/// With two sets, of the faces whose wedges of t have equal coordinates in this one: at a seam of the other set, too.
fn gather_points(
    local: &Local<'_>,
    split: &Split,
    from: u32,
    set: usize,
    points: &mut Vec<(Vec3, Vec3, f64)>,
    visited: &mut Vec<u32>,
) {
    let center = local.position(split.u);
    let two_sets = local.mesh.kinds.second_uv_bits > 0;
    let uv_of = |wedge: u32| local.wedges[wedge as usize].attributes.uv_of_set(set);
    visited.clear();
    points.clear();
    let see = |wedge: u32, points: &mut Vec<(Vec3, Vec3, f64)>, visited: &mut Vec<u32>| {
        if visited.contains(&wedge) {
            return;
        }
        visited.push(wedge);
        let w = &local.wedges[wedge as usize];
        let at = sub(local.position(w.vertex), center);
        let [u, v] = w.attributes.uv_of_set(set).map(f64::from);
        points.push((at, [u, v, 0.0], 1.0 / (dot(at, at) + 1.0)));
    };
    see(from, points, visited);
    for &i in &split.moving {
        let target = split.targets[i];
        let joined = two_sets && visited.len() < MAX_JOINED && uv_of(target) == uv_of(from);
        if target == from || joined {
            let [_, a, b] = local.spoke_wedges(&split.fan.star_faces[i]);
            see(a, points, visited);
            see(b, points, visited);
        }
    }
}

/// Most points to which faces across a seam of the other set add: bounds the work for an untrusted peer's vertex, each
/// of whose wedges may have the same coordinates in one set.
const MAX_JOINED: usize = 32;

/// Expected error of a fitted texture coordinate, relative to the spread of the points.
const UV_SIZE: f64 = 0.1;

/// Texture coordinates by [`fit`], and their expected error sizes in quarter octaves.
fn fitted(points: &[(Vec3, Vec3, f64)], normal: Vec3) -> ([i32; 2], [i32; 2]) {
    let (uv, spread) = fit(points, normal);
    let uv = [0, 1].map(|k| floored((uv[k] + 0.5).clamp(-1.0e9, 1.0e9)));
    (uv, [quarter_octaves(spread * UV_SIZE); 2])
}

/// Value at the origin of an affine function fitted to (position, value, weight) in the plane with the given normal,
/// and the root mean square of the values about their mean. With too few points: the mean.
fn fit(points: &[(Vec3, Vec3, f64)], normal: Vec3) -> (Vec3, f64) {
    let total: f64 = points.iter().map(|p| p.2).sum();
    let (mut place, mut value) = ([0.0; 3], [0.0; 3]);
    for p in points {
        place = add(place, scale(p.0, p.2 / total));
        value = add(value, scale(p.1, p.2 / total));
    }
    let size = dot(normal, normal).sqrt();
    // Any orthogonal frame of the plane.
    let n = if size > 0.0 { scale(normal, 1.0 / size) } else { [0.0, 0.0, 1.0] };
    let least = (0..3).min_by(|&a, &b| n[a].abs().total_cmp(&n[b].abs())).unwrap_or(0);
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let e1 = cross(n, axis);
    let e2 = cross(n, e1);
    let (mut xx, mut xy, mut yy, mut square) = (0.0, 0.0, 0.0, 0.0);
    let (mut xv, mut yv) = ([0.0; 3], [0.0; 3]);
    for p in points {
        let (d, v) = (sub(p.0, place), sub(p.1, value));
        let (x, y) = (dot(d, e1), dot(d, e2));
        xx += p.2 * x * x;
        xy += p.2 * x * y;
        yy += p.2 * y * y;
        square += p.2 * dot(v, v);
        xv = add(xv, scale(v, p.2 * x));
        yv = add(yv, scale(v, p.2 * y));
    }
    let spread = (square / total).sqrt();
    let determinant = xx * yy - xy * xy;
    if points.len() < 3 || determinant <= 1e-3 * xx * yy {
        return (value, spread);
    }
    let (x, y) = (-dot(place, e1), -dot(place, e2));
    let gx = scale(sub(scale(xv, yy), scale(yv, xy)), 1.0 / determinant);
    let gy = scale(sub(scale(yv, xx), scale(xv, xy)), 1.0 / determinant);
    (add(value, add(scale(gx, x), scale(gy, y))), spread)
}
