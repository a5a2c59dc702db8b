//! Geometric error: how far a simplified region is from the input, both ways.
//!
//! *Input to coarse:* the vertices of the input are the samples. Over one coarse face the distance is a
//! convex function, so on an input face that lies over one it is largest at a vertex. Where the surface
//! can open, at boundaries and edges of three faces and more, the middles of faces are samples too. Each
//! sample keeps the coarse face that it was last found near; when that face changes, its heirs are looked at, and
//! where they are farther than what is known, the region's nearest face. Searching the region alone
//! can only overestimate. What lies between the samples is looked at where it matters (`input_faces`).
//!
//! *Coarse to input:* where an input face lies over several coarse faces, the distance is largest over the
//! edge between these. So points are laid along each new edge and in the middle of each face that moved,
//! and looked up in a hierarchy over the input: few at first, many where one is far.
//!
//! Overlaying the two surfaces, all extremes lie at vertices or where edges cross (Cohen, Olano and
//! Manocha, "Appearance-preserving simplification", 1998, §4); [`MARGIN`] stands for what lies between
//! the points.

use crate::error::MeshError;
use crate::mesh::UvGrid;
use crate::mesh::corner;
use crate::mesh::distance::TriangleBvh;
use crate::mesh::rows::Rows;
use crate::mesh::vec3::{Vec3, add, length, scale, sub};
use crate::mesh::wide_bvh::{Hints, Seeds, WideBvh};
use crate::pool::MonitoredPool;
use crate::simplify::attributes::InputAttributes;
use crate::simplify::inherited::Inherited;
use crate::simplify::live::Live;
use crate::simplify::star_table::each_edge;
use crate::simplify::surroundings::{ROUNDING, Surroundings, compact};

/// Safety factor for the surface between samples.
pub(crate) const MARGIN: f64 = 1.08;
/// Share of the error known so far beyond which an edge or a face is looked at closely.
pub(crate) const SUSPICIOUS: f64 = 0.7;
/// Parts that a new edge is cut into at first, per mean edge of the input, and at most.
const SPARSE: f64 = 2.0;
pub(crate) const MOST_SPARSE: usize = 4;
/// The same for one that is looked at closely, and the least.
pub(crate) const DENSE: f64 = 4.0;
pub(crate) const LEAST_DENSE: usize = 12;
pub(crate) const MOST_DENSE: usize = 32;
/// The same for the inside of a face, at least.
const LEAST_LATTICE: usize = LEAST_DENSE / 2;
/// Points less than this share of the input's mean edge apart, or of the error, are likely to be near the same face.
const HINT_SHARE: f64 = 0.5;
/// Edges that are remembered as near.
const NEAR_EDGES: usize = 2048;
/// The points of an edge are not quite the same from its other end: what is nearer than a limit by a share of it and a part
/// of a cell is near from there too.
const RELATIVE_ROUNDING: f64 = 1e-9;
const ABSOLUTE_ROUNDING: f64 = 1e-4;
/// A sample that raises the largest distance by more than this factor is looked at closely.
pub(crate) const LEAP: f64 = 1.5;

/// The input surface, its samples, and where the samples are now.
pub(crate) struct Deviation {
    pub(crate) input: WideBvh,
    seeds: Seeds,
    /// The input's faces by their corners.
    pub(crate) input_faces: Rows<u32>,
    attributes: InputAttributes,
    /// Samples beyond the vertices.
    middles: Vec<Vec3>,
    /// By sample, vertices first: live face that it was last found near, and how far, in grid cells.
    pub(crate) attached: Vec<u32>,
    distance: Vec<f32>,
    /// By vertex: no point of the input's faces around it is farther from it.
    around: Vec<f32>,
    /// Mean length of the input's edges.
    pub(crate) mean_edge: f64,
    inherited: Inherited,
}

/// The samples of each region of a level.
pub(crate) struct Samples {
    lists: Rows<u32>,
    /// By sample: its region; others than there are for those without.
    home: Vec<u32>,
}

/// The samples of one region.
#[derive(Clone, Copy)]
pub(crate) struct Own<'a> {
    /// Ascending.
    pub(crate) list: &'a [u32],
    home: &'a [u32],
    region: u32,
}

impl Samples {
    /// The samples of the regions `0..regions`, by the region of each.
    pub(crate) fn new(home: Vec<u32>, regions: usize) -> Self {
        let of_a_region = || (0..).zip(&home).map(|(sample, &region)| (region, sample));
        let lists = Rows::new(regions, || of_a_region().filter(|&(region, _)| (region as usize) < regions));
        Self { lists, home }
    }

    pub(crate) fn of(&self, region: usize) -> Own<'_> {
        let region = region as u32;
        Own { list: self.lists.row(region), home: &self.home, region }
    }
}

impl Own<'_> {
    pub(crate) fn contains(&self, sample: u32) -> bool {
        self.home[sample as usize] == self.region
    }
}

/// Where a sample is found anew: (sample, face, distance).
pub(crate) type Attachment = (u32, u32, f32);

/// An edge, and the distance of its farthest point from the input.
pub(crate) type FarEdge = ([u32; 2], f64);

/// What is sampled, before anything is collapsed: see the fields of [`Deviation`].
struct FirstSamples {
    attached: Vec<u32>,
    middles: Vec<Vec3>,
    around: Vec<f32>,
    mean_edge: f64,
}

impl FirstSamples {
    fn new(live: &Live<'_>) -> Self {
        let count = live.face_vertices.len();
        let mut attached = vec![0_u32; live.positions.len()];
        let mut around = vec![0.0_f32; live.positions.len()];
        let mut edges = 0.0;
        for face in 0..count {
            let [a, b, c] = live.triangle(face);
            let sides = [length(sub(b, a)), length(sub(c, b)), length(sub(a, c))];
            edges += sides[0] + sides[1] + sides[2];
            for (k, v) in live.face_vertices[face].into_iter().enumerate() {
                attached[v as usize] = face as u32;
                let longest = sides[k].max(sides[corner::previous(k)]) * ROUNDING;
                around[v as usize] = around[v as usize].max(longest as f32);
            }
        }
        let mut open = Vec::new();
        each_edge(&live.stars, &live.face_vertices, &mut |_, _, corners| {
            if corners.len() != 2 {
                open.extend(corners.iter().map(|&c| corner::face_of(c)));
            }
        });
        open.sort_unstable();
        open.dedup();
        attached.extend(&open);
        Self {
            middles: open.iter().map(|&f| live.centroid(f as usize)).collect(),
            attached,
            around,
            mean_edge: edges / (3 * count).max(1) as f64,
        }
    }
}

impl Deviation {
    /// Of an input of which nothing is collapsed.
    pub(crate) fn new(live: &Live<'_>, uv_grid: UvGrid, pool: &MonitoredPool<'_>) -> Result<Self, MeshError> {
        let (hierarchy, rest) = pool.both(
            &|| {
                let input = WideBvh::new(&live.positions, &live.face_vertices);
                let by_corner = || {
                    (0..).zip(input.triangles()).flat_map(|(id, corners)| corners.map(|vertex| (vertex, id)))
                };
                (Rows::new(live.positions.len(), by_corner), input)
            },
            &|| (FirstSamples::new(live), InputAttributes::new(live, uv_grid)),
        )?;
        let ((input_faces, input), (first, attributes)) = (hierarchy, rest);
        let FirstSamples { attached, middles, around, mean_edge } = first;
        Ok(Self {
            seeds: Seeds::new(&input, mean_edge),
            input_faces,
            input,
            attributes,
            middles,
            distance: vec![0.0; attached.len()],
            attached,
            around,
            mean_edge,
            inherited: Inherited::default(),
        })
    }

    /// The same where what is measured against is itself off: what is `inherited` comes on top of all that is found.
    pub(crate) fn behind(self, inherited: Inherited) -> Self {
        Self { inherited, ..self }
    }

    /// What comes on top of what is found around the given samples: of the surface, and of attributes.
    pub(crate) fn inherited(&self, samples: &[u32]) -> [f64; 2] {
        self.inherited.around(samples)
    }

    pub(crate) fn sample_count(&self) -> usize {
        self.attached.len()
    }

    /// Where a sample is.
    pub(crate) fn point(&self, sample: u32) -> Vec3 {
        let vertices = self.attached.len() - self.middles.len();
        match (sample as usize).checked_sub(vertices) {
            Some(middle) => self.middles[middle],
            None => self.input.position(sample),
        }
    }

    /// The samples of each region, by the region of the face that they are attached to.
    pub(crate) fn by_region(&self, region_of_face: &[u32], regions: usize) -> Samples {
        Samples::new(self.attached.iter().map(|&face| region_of_face[face as usize]).collect(), regions)
    }

    /// Upper bound on the distance of a vertex from the face that it was last found near.
    pub(crate) fn last_distance(&self, vertex: u32) -> f64 {
        f64::from(self.distance[vertex as usize])
    }

    /// Whether all points of the input's faces around a vertex are within `limit` of the face that the vertex was
    /// last found near.
    pub(crate) fn all_around_within(&self, vertex: u32, limit: f64) -> bool {
        (self.last_distance(vertex) + f64::from(self.around[vertex as usize])) * ROUNDING <= limit
    }

    /// Looks again at the samples whose face changed: their new places, and the largest distance of all,
    /// at least `error`.
    pub(crate) fn follow(
        &self,
        region: &Surroundings<'_>,
        changed: &impl Fn(u32) -> bool,
        samples: &[u32],
        mut error: f64,
    ) -> (Vec<Attachment>, f64) {
        let live = region.live;
        let mut places = Vec::new();
        for &sample in samples {
            let face = self.attached[sample as usize];
            if live.alive[face as usize] && !changed(face) {
                error = error.max(f64::from(self.distance[sample as usize]));
                continue;
            }
            if live.moved_to.get(sample as usize) == Some(&sample)
                && live.positions[sample as usize] == self.point(sample)
                && let Some(own) =
                    live.stars.corners(sample).map(corner::face_of).find(|&f| (region.inside)(f))
            {
                places.push((sample, own, 0.0));
                continue;
            }
            let point = self.point(sample);
            let mut place = region.heir(face, point, error);
            if place.0 > error && place.0.is_finite() {
                place = region.walk(point, place, error);
            } else if place.0.is_infinite()
                && let Some(nearest) = region.nearest(point, f64::INFINITY)
            {
                place = nearest;
            }
            // Where a component has removed_wedges, its heirs may be far and another component near; the largest
            // distance is what closeness is judged by, so it must not leap for nothing.
            if place.0.is_finite()
                && place.0 > LEAP * error.max(self.mean_edge)
                && let Some(nearest) = region.nearest(point, place.0)
            {
                place = nearest;
            }
            if place.0.is_finite() {
                error = error.max(place.0);
                places.push((sample, place.1, (place.0 * ROUNDING) as f32));
            }
        }
        (places, error)
    }

    /// The largest distance of the samples, exactly; and the new places of those that were nearer than
    /// was thought.
    pub(crate) fn settle(&self, region: &Surroundings<'_>, samples: &[u32]) -> (Vec<Attachment>, f64) {
        let farthest = samples
            .iter()
            .copied()
            .max_by(|&a, &b| self.distance[a as usize].total_cmp(&self.distance[b as usize]).then(b.cmp(&a)));
        let mut error = 0.0_f64;
        let mut places = Vec::new();
        for &sample in farthest.iter().chain(samples) {
            let known = f64::from(self.distance[sample as usize]);
            if known <= error {
                continue;
            }
            let point = self.point(sample);
            if let Some((distance, face)) = region.nearest(point, known) {
                error = error.max(distance);
                places.push((sample, face, (distance * ROUNDING) as f32));
            }
        }
        (places, error)
    }

    /// Looks at the edges that begin at corners whose vertex changed, and at the middles of their faces:
    /// adds those that may be far and answers the largest distance, at least `error`.
    /// Each edge is cut into at most `most` parts at first.
    pub(crate) fn edges(
        &self,
        live: &Live<'_>,
        corners: &[u32],
        far: &mut Vec<FarEdge>,
        mut error: f64,
        most: usize,
    ) -> f64 {
        let mut near = NearInput::new(HINT_SHARE * self.mean_edge.max(error), &self.seeds);
        for &corner in corners {
            let (face, k) = (corner::face_of(corner) as usize, corner::side_of(corner));
            if !live.alive[face] {
                continue;
            }
            let vertices = live.face_vertices[face];
            let (apex, next, before) =
                (vertices[k], vertices[corner::next(k)], vertices[corner::previous(k)]);
            self.edge(live, [apex, next], (far, &mut near), &mut error, most);
            // Most edges are some other face's "next"; what is left are ends of fans.
            let next_of =
                |c: u32| live.face_vertices[corner::face_of(c) as usize][corner::next(corner::side_of(c))];
            if !live.stars.corners(apex).any(|c| next_of(c) == before) {
                self.edge(live, [apex, before], (far, &mut near), &mut error, most);
            }
            if near.face == Some(face) {
                continue;
            }
            let (triangle, limit) = (live.triangle(face), SUSPICIOUS * error);
            let lattice = self.lattice(triangle);
            let mut is_near = |point| self.input.any_within_again(point, limit, &mut near.hints);
            if is_near(live.centroid(face))
                && (lattice == LEAST_LATTICE || all_over(triangle, lattice, &mut is_near))
            {
                near.face = Some(face);
            } else {
                let mut own = 0.0;
                let mut last = None;
                let visit = &mut |p| self.farthest(p, &mut own, &mut last);
                over_face(triangle, lattice, visit);
                far.push(([apex, next], own));
                error = error.max(own);
            }
        }
        error
    }

    /// Parts that a face's edges are cut into to look at its inside closely. Behind blocks what is measured against has
    /// few points itself, and a face may lie across a hole of it: wide faces are looked at by its mean edge.
    fn lattice(&self, [a, b, c]: [Vec3; 3]) -> usize {
        if self.inherited.is_empty() {
            return LEAST_LATTICE;
        }
        let longest = [sub(b, a), sub(c, b), sub(a, c)].map(length).into_iter().fold(0.0, f64::max);
        let parts = (longest / self.mean_edge.max(f64::MIN_POSITIVE)).ceil();
        (parts as usize).clamp(LEAST_LATTICE, MOST_DENSE)
    }

    fn edge(
        &self,
        live: &Live<'_>,
        edge: [u32; 2],
        (far, near): (&mut Vec<FarEdge>, &mut NearInput<'_>),
        error: &mut f64,
        most: usize,
    ) {
        if near.holds(edge) {
            return;
        }
        let [a, b] = edge.map(|v| live.positions[v as usize]);
        let edges = length(sub(b, a)) / self.mean_edge.max(f64::MIN_POSITIVE);
        let n = ((SPARSE * edges).ceil() as usize).clamp(2, most);
        let limit = SUSPICIOUS * *error;
        let mut all_within = |limit: f64| {
            (1..n).all(|i| self.input.any_within_again(between(a, b, i, n), limit, &mut near.hints))
        };
        let surely = limit * (1.0 - RELATIVE_ROUNDING) - ABSOLUTE_ROUNDING;
        if surely > 0.0 && all_within(surely) {
            near.add(edge);
            return;
        }
        if all_within(limit) {
            return;
        }
        let n = ((DENSE * edges).ceil() as usize).clamp(LEAST_DENSE, MOST_DENSE);
        let mut own = 0.0;
        let mut last = None;
        (1..n).for_each(|i| self.farthest(between(a, b, i, n), &mut own, &mut last));
        far.push((edge, own));
        *error = error.max(own);
    }

    /// Raises `error` to the distance of a point from the input; for `last` see [`WideBvh::distance_beyond`].
    pub(crate) fn farthest(&self, point: Vec3, error: &mut f64, last: &mut Option<u32>) {
        if let Some(distance) = self.input.distance_beyond(point, *error, last) {
            *error = error.max(distance);
        }
    }

    /// Whether the given triangles are within `limit` of the input's samples, and the input of them,
    /// judged by about `budget` of the samples and the middles of the triangles.
    pub(crate) fn within(
        &self,
        live: &Live<'_>,
        triangles: &[[u32; 3]],
        samples: &[u32],
        limit: f64,
        budget: usize,
    ) -> bool {
        let limit = limit / MARGIN;
        let (compacted, triangles) = compact(&live.positions, triangles);
        let coarse = WideBvh::new(&compacted, &triangles);
        let step = (samples.len() / budget.max(1)).max(1);
        samples.iter().step_by(step).all(|&s| coarse.any_within(self.point(s), limit))
            && triangles.iter().all(|t| {
                let [a, b, c] = t.map(|v| compacted[v as usize]);
                self.input.any_within(scale(add(add(a, b), c), 1.0 / 3.0), limit)
            })
    }

    /// Whether a point is within `limit` of the input, margin included.
    pub(crate) fn input_within(&self, point: Vec3, limit: f64) -> bool {
        self.input.any_within(point, limit / MARGIN)
    }

    /// The face that a sample was last found near.
    pub(crate) fn face_near(&self, sample: u32) -> u32 {
        self.attached[sample as usize]
    }

    /// The attribute error of a settled region.
    pub(crate) fn attribute_error(&self, live: &Live<'_>, samples: &[u32]) -> f64 {
        self.attributes.error(live, &self.input, samples, &|s| self.attached[s as usize])
    }

    /// Where all samples are: faces, and how far.
    pub(crate) fn places(&self) -> (&[u32], &[f32]) {
        (&self.attached, &self.distance)
    }

    /// Takes over the places of all samples.
    pub(crate) fn take_places(&mut self, attached: Vec<u32>, distance: Vec<f32>) {
        (self.attached, self.distance) = (attached, distance);
    }

    /// Finds all samples anew, wherever they were: the nearest face that is left.
    pub(crate) fn find_again(&mut self, live: &Live<'_>, pool: &MonitoredPool<'_>) -> Result<(), MeshError> {
        let triangles: Vec<[u32; 3]> = live.faces.iter().map(|&f| live.face_vertices[f as usize]).collect();
        let (positions, triangles) = compact(&live.positions, &triangles);
        let left = TriangleBvh::new(&positions, &triangles);
        let count = self.sample_count();
        let found = pool.map(count.div_ceil(FOUND_TOGETHER), &|part| {
            let samples = part * FOUND_TOGETHER..((part + 1) * FOUND_TOGETHER).min(count);
            let place = |sample: usize| {
                let point = self.point(sample as u32);
                left.nearest(point, f64::INFINITY)
                    .map(|(distance, face)| (live.faces[face as usize], (distance * ROUNDING) as f32))
            };
            samples.map(place).collect::<Vec<_>>()
        })?;
        for (sample, place) in found.into_iter().flatten().enumerate() {
            if let Some((face, distance)) = place {
                self.attached[sample] = face;
                self.distance[sample] = distance;
            }
        }
        Ok(())
    }

    /// Takes over the new places of samples.
    pub(crate) fn attach(&mut self, places: &[Attachment]) {
        for &(sample, face, distance) in places {
            self.attached[sample as usize] = face;
            self.distance[sample as usize] = distance;
        }
    }

    /// Attaches samples whose region has lost all its faces to the nearest face anywhere.
    pub(crate) fn attach_anywhere(&mut self, live: &Live<'_>, samples: Own<'_>) -> f64 {
        let faces: Vec<u32> = (0..live.alive.len() as u32).filter(|&f| live.alive[f as usize]).collect();
        let everywhere = Surroundings::new(live, &faces, &|_| true);
        let mut error = 0.0_f64;
        for &sample in samples.list {
            if let Some((distance, face)) = everywhere.nearest(self.point(sample), f64::INFINITY) {
                error = error.max(distance);
                self.attach(&[(sample, face, (distance * ROUNDING) as f32)]);
            }
        }
        error = self.faces(&everywhere, &|_| true, samples, true, &mut Vec::new(), error);
        error * MARGIN
    }
}

/// Samples that are found anew as one task.
const FOUND_TOGETHER: usize = 4096;

/// What was found near the input in a pass over edges and faces in which the largest distance only grows: it need not be
/// looked at again.
struct NearInput<'a> {
    hints: Hints<'a>,
    /// Edges, by a hash of theirs: each inner edge comes from both its faces. One takes another's place.
    edges: Vec<[u32; 2]>,
    /// The last face whose middle was near.
    face: Option<usize>,
}

impl<'a> NearInput<'a> {
    fn new(hint_size: f64, seeds: &'a Seeds) -> Self {
        Self { hints: Hints::new(hint_size, Some(seeds)), edges: vec![[u32::MAX; 2]; NEAR_EDGES], face: None }
    }

    fn holds(&self, [a, b]: [u32; 2]) -> bool {
        let edge = [a.min(b), a.max(b)];
        self.edges[Self::place(edge)] == edge
    }

    fn add(&mut self, [a, b]: [u32; 2]) {
        let edge = [a.min(b), a.max(b)];
        self.edges[Self::place(edge)] = edge;
    }

    fn place([a, b]: [u32; 2]) -> usize {
        // Multiplicative hashing (Knuth, "The Art of Computer Programming" vol. 3, section 6.4).
        let hash = a.wrapping_mul(0x9E37_79B1) ^ b.wrapping_mul(0x85EB_CA6B);
        (hash >> 16) as usize % NEAR_EDGES
    }
}

/// The `i`-th of the points that cut an edge into `n` parts.
pub(crate) fn between(a: Vec3, b: Vec3, i: usize, n: usize) -> Vec3 {
    add(a, scale(sub(b, a), i as f64 / n as f64))
}

pub(crate) fn middle([a, b, c]: [Vec3; 3]) -> Vec3 {
    scale(add(add(a, b), c), 1.0 / 3.0)
}

/// A point of the lattice that cuts the edges of a triangle into `n` parts.
pub(crate) fn on_face([a, b, c]: [Vec3; 3], n: usize, i: usize, j: usize) -> Vec3 {
    let inverse = 1.0 / n as f64;
    let (u, v) = (i as f64 * inverse, j as f64 * inverse);
    add(add(scale(a, u), scale(b, v)), scale(c, 1.0 - u - v))
}

/// Whether all of [`over_face`]'s points are as asked.
fn all_over(triangle: [Vec3; 3], n: usize, is: &mut dyn FnMut(Vec3) -> bool) -> bool {
    (1..n).all(|i| (1..n - i).all(|j| is(on_face(triangle, n, i, j))))
}

/// Calls `visit` for a lattice of points inside a triangle, edges left out.
fn over_face(triangle: [Vec3; 3], n: usize, visit: &mut dyn FnMut(Vec3)) {
    for i in 1..n {
        (1..n - i).for_each(|j| visit(on_face(triangle, n, i, j)));
    }
}

/// Extends a box by a point.
pub(crate) fn extend(bounds: &mut [Vec3; 2], p: Vec3) {
    for axis in 0..3 {
        bounds[0][axis] = bounds[0][axis].min(p[axis]);
        bounds[1][axis] = bounds[1][axis].max(p[axis]);
    }
}
