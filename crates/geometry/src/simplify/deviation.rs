//! Geometric error: two-sided distance between a simplified region and the input.
//!
//! *Input to coarse:* the samples are the vertices of the input. Over one coarse face the distance is convex, so for
//! an input face over one coarse face it is largest at a vertex. Where the surface can open, at boundaries and at
//! edges of three or more faces, face centres are samples too. Each sample remembers its nearest coarse face; when
//! that face changes, its successors are searched, and if they are farther than the known error, the region's nearest
//! face. Searching the region only can overestimate but not underestimate. Points between samples are examined where
//! needed (`input_faces`).
//!
//! *Coarse to input:* if an input face lies over several coarse faces, the distance is largest over the edge between
//! these. So points along each new edge and at the centre of each moved face are looked up in a hierarchy over the
//! input: few at first, many where one is far.
//!
//! In the overlay of the two surfaces, all extremes are at vertices or edge crossings (Cohen, Olano and Manocha,
//! "Appearance-preserving simplification", 1998, §4); [`MARGIN`] covers the surface between the sampled points.

use crate::error::MeshError;
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

/// Safety factor for the surface between sampled points.
pub(crate) const MARGIN: f64 = 1.08;
/// Share of the current error above which an edge or face is sampled densely.
pub(crate) const SUSPICIOUS: f64 = 0.7;
/// Initial segments of a new edge per mean input edge, and their maximum.
const SPARSE: f64 = 2.0;
pub(crate) const MAX_SPARSE: usize = 4;
/// Segments of a densely sampled edge per mean input edge, their minimum and maximum.
pub(crate) const DENSE: f64 = 4.0;
pub(crate) const MIN_DENSE: usize = 12;
pub(crate) const MAX_DENSE: usize = 32;
/// Minimum subdivisions of a densely sampled face.
const MIN_LATTICE: usize = MIN_DENSE / 2;
/// Points closer than this share of the input's mean edge, or of the error, are likely near the same face.
const HINT_SHARE: f64 = 0.5;
/// Size of the cache of edges near the input.
const NEAR_EDGES: usize = 2048;
/// Points of an edge differ slightly when computed from its other end. A distance below a limit by these relative and
/// absolute margins is below it from both ends.
const RELATIVE_ROUNDING: f64 = 1e-9;
const ABSOLUTE_ROUNDING: f64 = 1e-4;
/// A sample that raises the largest distance by more than this factor is searched exactly.
pub(crate) const LEAP: f64 = 1.5;

/// The input surface, its samples, and their current nearest faces.
pub(crate) struct Deviation {
    pub(crate) input: WideBvh,
    seeds: Seeds,
    /// The input's faces by their corners.
    pub(crate) input_faces: Rows<u32>,
    attributes: InputAttributes,
    /// Samples besides the vertices: centres of open faces.
    middles: Vec<Vec3>,
    /// Per sample, vertices first: the live face found nearest, and its distance in grid cells.
    pub(crate) attached: Vec<u32>,
    distance: Vec<f32>,
    /// Per vertex: upper bound on the distance to points of the input faces around it.
    around: Vec<f32>,
    /// Mean length of the input's edges.
    pub(crate) mean_edge: f64,
    inherited: Inherited,
}

/// The samples of a level, by region.
pub(crate) struct Samples {
    lists: Rows<u32>,
    /// Region of each sample; out-of-range values mean none.
    home: Vec<u32>,
}

/// The samples of one region.
#[derive(Clone, Copy)]
pub(crate) struct RegionSamples<'a> {
    /// Ascending.
    pub(crate) list: &'a [u32],
    home: &'a [u32],
    region: u32,
}

impl Samples {
    /// Groups samples by region; `home` holds the region of each.
    pub(crate) fn new(home: Vec<u32>, regions: usize) -> Self {
        let of_a_region = || (0..).zip(&home).map(|(sample, &region)| (region, sample));
        let lists = Rows::new(regions, || of_a_region().filter(|&(region, _)| (region as usize) < regions));
        Self { lists, home }
    }

    pub(crate) fn of(&self, region: usize) -> RegionSamples<'_> {
        let region = region as u32;
        RegionSamples { list: self.lists.row(region), home: &self.home, region }
    }
}

impl RegionSamples<'_> {
    pub(crate) fn contains(&self, sample: u32) -> bool {
        self.home[sample as usize] == self.region
    }
}

/// A sample's new nearest face: (sample, face, distance).
pub(crate) type Attachment = (u32, u32, f32);

/// An edge with the distance of its farthest point from the input.
pub(crate) type FarEdge = ([u32; 2], f64);

/// Initial samples of an uncollapsed mesh: see the fields of [`Deviation`].
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
    /// For an uncollapsed input.
    pub(crate) fn new(live: &Live<'_>, pool: &MonitoredPool<'_>) -> Result<Self, MeshError> {
        let (hierarchy, rest) = pool.both(
            &|| {
                let input = WideBvh::new(&live.positions, &live.face_vertices);
                let by_corner = || {
                    (0..).zip(input.triangles()).flat_map(|(id, corners)| corners.map(|vertex| (vertex, id)))
                };
                (Rows::new(live.positions.len(), by_corner), input)
            },
            &|| (FirstSamples::new(live), InputAttributes::new(live)),
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

    /// For a reference mesh that deviates from the input itself: the `inherited` error is added to all results.
    pub(crate) fn with_inherited(self, inherited: Inherited) -> Self {
        Self { inherited, ..self }
    }

    /// Error to add around the given samples: geometric, and of attributes.
    pub(crate) fn inherited(&self, samples: &[u32]) -> [f64; 2] {
        self.inherited.around(samples)
    }

    pub(crate) fn sample_count(&self) -> usize {
        self.attached.len()
    }

    /// Position of a sample.
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

    /// Upper bound on the distance between a vertex and its last nearest face.
    pub(crate) fn last_distance(&self, vertex: u32) -> f64 {
        f64::from(self.distance[vertex as usize])
    }

    /// Whether all points of the input faces around a vertex are within `limit` of the vertex's last nearest face.
    pub(crate) fn all_around_within(&self, vertex: u32, limit: f64) -> bool {
        (self.last_distance(vertex) + f64::from(self.around[vertex as usize])) * ROUNDING <= limit
    }

    /// Updates the samples whose face changed. Returns their new attachments, and the largest distance of all, at
    /// least `error`.
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
            let mut place = region.successor(face, point, error);
            if place.0 > error && place.0.is_finite() {
                place = region.walk(point, place, error);
            } else if place.0.is_infinite()
                && let Some(nearest) = region.nearest(point, f64::INFINITY)
            {
                place = nearest;
            }
            // After a component is removed, the successors may be far while another component is near. Later searches
            // are bounded by the largest distance, so it must not jump needlessly.
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

    /// Computes the largest distance of the samples exactly. Returns it with the attachments that became closer.
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

    /// Samples the edges that begin at changed corners, and the centres of their faces. Appends possibly far ones to
    /// `far`; returns the largest distance, at least `error`. Each edge has at most `most` segments at first.
    pub(crate) fn edges(
        &self,
        live: &Live<'_>,
        corners: &[u32],
        far: &mut Vec<FarEdge>,
        mut error: f64,
        most: usize,
    ) -> f64 {
        let mut near = NearInputCache::new(HINT_SHARE * self.mean_edge.max(error), &self.seeds);
        for &corner in corners {
            let (face, k) = (corner::face_of(corner) as usize, corner::side_of(corner));
            if !live.alive[face] {
                continue;
            }
            let vertices = live.face_vertices[face];
            let (apex, next, before) =
                (vertices[k], vertices[corner::next(k)], vertices[corner::previous(k)]);
            self.edge(live, [apex, next], (far, &mut near), &mut error, most);
            // Most edges are the "next" edge of another face; the rest are ends of fans.
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
            let mut is_near = |point| self.input.any_within_hinted(point, limit, &mut near.hints);
            if is_near(live.centroid(face))
                && (lattice == MIN_LATTICE || all_over(triangle, lattice, &mut is_near))
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

    /// Subdivisions for sampling a face densely. If the reference is the result of blocks, it has few points and
    /// possibly holes, so wide faces are subdivided by its mean edge.
    fn lattice(&self, [a, b, c]: [Vec3; 3]) -> usize {
        if self.inherited.is_empty() {
            return MIN_LATTICE;
        }
        let longest = [sub(b, a), sub(c, b), sub(a, c)].map(length).into_iter().fold(0.0, f64::max);
        let parts = (longest / self.mean_edge.max(f64::MIN_POSITIVE)).ceil();
        (parts as usize).clamp(MIN_LATTICE, MAX_DENSE)
    }

    fn edge(
        &self,
        live: &Live<'_>,
        edge: [u32; 2],
        (far, near): (&mut Vec<FarEdge>, &mut NearInputCache<'_>),
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
            (1..n).all(|i| self.input.any_within_hinted(between(a, b, i, n), limit, &mut near.hints))
        };
        let surely = limit * (1.0 - RELATIVE_ROUNDING) - ABSOLUTE_ROUNDING;
        if surely > 0.0 && all_within(surely) {
            near.add(edge);
            return;
        }
        if all_within(limit) {
            return;
        }
        let n = ((DENSE * edges).ceil() as usize).clamp(MIN_DENSE, MAX_DENSE);
        let mut own = 0.0;
        let mut last = None;
        (1..n).for_each(|i| self.farthest(between(a, b, i, n), &mut own, &mut last));
        far.push((edge, own));
        *error = error.max(own);
    }

    /// Raises `error` to the distance of a point from the input; see [`WideBvh::distance_beyond`] for `last`.
    pub(crate) fn farthest(&self, point: Vec3, error: &mut f64, last: &mut Option<u32>) {
        if let Some(distance) = self.input.distance_beyond(point, *error, last) {
            *error = error.max(distance);
        }
    }

    /// Whether the given triangles are within `limit` of the input samples and the reverse, judged by about `budget`
    /// samples and triangle centres.
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

    /// Whether a point is within `limit` of the input, including [`MARGIN`].
    pub(crate) fn input_within(&self, point: Vec3, limit: f64) -> bool {
        self.input.any_within(point, limit / MARGIN)
    }

    /// The last nearest face of a sample.
    pub(crate) fn face_near(&self, sample: u32) -> u32 {
        self.attached[sample as usize]
    }

    /// The attribute error of a region after all its collapses.
    pub(crate) fn attribute_error(&self, live: &Live<'_>, samples: &[u32]) -> f64 {
        self.attributes.error(live, &self.input, samples, &|s| self.attached[s as usize])
    }

    /// Nearest faces and distances of all samples.
    pub(crate) fn places(&self) -> (&[u32], &[f32]) {
        (&self.attached, &self.distance)
    }

    /// Sets nearest faces and distances of all samples.
    pub(crate) fn set_places(&mut self, attached: Vec<u32>, distance: Vec<f32>) {
        (self.attached, self.distance) = (attached, distance);
    }

    /// Searches the nearest remaining face of all samples anew.
    pub(crate) fn search_all(&mut self, live: &Live<'_>, pool: &MonitoredPool<'_>) -> Result<(), MeshError> {
        let triangles: Vec<[u32; 3]> = live.faces.iter().map(|&f| live.face_vertices[f as usize]).collect();
        let (positions, triangles) = compact(&live.positions, &triangles);
        let left = TriangleBvh::new(&positions, &triangles);
        let count = self.sample_count();
        let found = pool.map(count.div_ceil(SAMPLES_PER_TASK), &|part| {
            let samples = part * SAMPLES_PER_TASK..((part + 1) * SAMPLES_PER_TASK).min(count);
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

    /// Updates attachments.
    pub(crate) fn attach(&mut self, places: &[Attachment]) {
        for &(sample, face, distance) in places {
            self.attached[sample as usize] = face;
            self.distance[sample as usize] = distance;
        }
    }

    /// Attaches samples whose region lost all faces to the nearest face of the mesh.
    pub(crate) fn attach_anywhere(&mut self, live: &Live<'_>, samples: RegionSamples<'_>) -> f64 {
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

/// Samples per task of a full search.
const SAMPLES_PER_TASK: usize = 4096;

/// Cache of edges and faces that are near the input, valid while the largest distance only grows.
struct NearInputCache<'a> {
    hints: Hints<'a>,
    /// Edges, by a hash of theirs: each inner edge comes from both its faces. One takes another's place.
    edges: Vec<[u32; 2]>,
    /// The last face whose centre was near.
    face: Option<usize>,
}

impl<'a> NearInputCache<'a> {
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

/// The `i`-th of the points that divide an edge into `n` segments.
pub(crate) fn between(a: Vec3, b: Vec3, i: usize, n: usize) -> Vec3 {
    add(a, scale(sub(b, a), i as f64 / n as f64))
}

pub(crate) fn middle([a, b, c]: [Vec3; 3]) -> Vec3 {
    scale(add(add(a, b), c), 1.0 / 3.0)
}

/// A lattice point of a triangle whose edges are divided into `n` segments.
pub(crate) fn on_face([a, b, c]: [Vec3; 3], n: usize, i: usize, j: usize) -> Vec3 {
    let inverse = 1.0 / n as f64;
    let (u, v) = (i as f64 * inverse, j as f64 * inverse);
    add(add(scale(a, u), scale(b, v)), scale(c, 1.0 - u - v))
}

/// Whether all of [`over_face`]'s points satisfy a predicate.
fn all_over(triangle: [Vec3; 3], n: usize, is: &mut dyn FnMut(Vec3) -> bool) -> bool {
    (1..n).all(|i| (1..n - i).all(|j| is(on_face(triangle, n, i, j))))
}

/// Calls `visit` for lattice points inside a triangle, without its edges.
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
