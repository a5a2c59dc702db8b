//! What a region's collapses did to the surface: the geometric error of its chunk, at each stop and as
//! a whole, and the chunk's extent.
//!
//! The collapses are performed part by part, between the truncation_points, and each part is measured by what it
//! changed; so truncation_points cost what changes twice, not a whole measurement each.

use std::borrow::Cow;

use crate::collapse::Placed;
use crate::collapse::Records;
use crate::error::MeshError;
use crate::mesh::vec3::{Vec3, add, length, scale, sub};
use crate::pool::MonitoredPool;
use crate::simplify::commit::Committed;
use crate::simplify::deviation::{
    Attachment, Deviation, FarEdge, MARGIN, MOST_DENSE, MOST_SPARSE, SUSPICIOUS, extend,
};
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::level::Level;
use crate::simplify::live::Live;
use crate::simplify::placement::{self, Move, Placement, Rounding, place};
use crate::simplify::surroundings::Surroundings;

/// Where what was far on the way exceeds the samples' distance by this factor, edges are looked at
/// again.
const ABSURD: f64 = 1.1;

/// Regions whose samples are followed together: enough for any number of threads.
const AT_A_TIME: usize = 1024;

/// A region whose collapses are being performed.
struct Course {
    records: Records,
    committed: Committed,
    /// Whether the current part has collapses.
    performed: bool,
    /// Corners that they changed, and whether all did.
    corners: Vec<u32>,
    all_corners: bool,
    /// Largest distance so far, without margin.
    error: f64,
    /// The same when each stop but the last was passed, finest first.
    truncation_points: Vec<f64>,
    far: Vec<FarEdge>,
    /// Input faces that were far on the way.
    far_faces: Vec<u32>,
    /// The vertices that were put on a grid, and the largest distance of one.
    moves: Vec<Placed>,
    moved: f64,
}

/// How vertices may come to lie on coarser grids.
#[derive(Clone, Copy)]
pub(crate) struct Coarsening {
    /// Bits that the grid of this level's start leaves out.
    pub(crate) shift: u8,
    /// [`crate::simplify::Settings::coarse_grid`], or 0 to stay on that grid.
    pub(crate) share: f64,
    /// Error that is allowed, in cells: what exceeds it moves less.
    pub(crate) limit: f64,
}

/// Performs the collapses, puts what is left on its grid, measures the regions, and makes chunks of those that
/// have any collapses; answers them and the bits that the grid at the level's end leaves out.
pub(crate) fn measure(
    live: &mut Live<'_>,
    deviation: &mut Deviation,
    level: &Level<'_>,
    records: Vec<Records>,
    coarsening: Coarsening,
    pool: &MonitoredPool<'_>,
    stray_error: &mut f64,
) -> Result<(Vec<RegionChunk>, u8), MeshError> {
    let mut courses: Vec<Course> = records.into_iter().map(Course::new).collect();
    let mut latest = Latest::new(live, deviation);
    let parts = courses.iter().map(|c| c.records.truncation_points.len() + 1).max().unwrap_or(0);
    for part in 1..=parts {
        latest.part = part as u8;
        courses.iter_mut().for_each(|c| c.perform(part, live, &mut latest));
        live.settle();
        look(live, deviation, level, &mut courses, &mut latest, pool)?;
        courses.iter_mut().for_each(|c| c.truncation_points.push(c.error));
    }
    let interior = level.interior_vertices();
    let mut errors: Vec<f64> =
        courses.iter().filter(|c| !c.records.collapses.is_empty()).map(|c| c.error).collect();
    let mut rounding = Rounding {
        shift: placement::coarser(live, coarsening.shift, coarsening.share, &mut errors),
        way: Placement::Best,
    };
    while rounding.shift > 0 || usize::from(latest.part) > parts {
        latest.part += 1;
        let (seen, now) = (&*courses, &*live);
        let moves = pool.map(seen.len(), &|r| match rounding.shift {
            1.. if !seen[r].records.collapses.is_empty() => place(now, &interior[r], rounding),
            _ => Vec::new(),
        })?;
        for (course, (faces, moves)) in courses.iter_mut().zip(level.faces.iter().zip(moves)) {
            course.place(live, faces, moves, rounding, &mut latest);
        }
        look(live, deviation, level, &mut courses, &mut latest, pool)?;
        let Some(gentler) = rounding.gentler(coarsening.shift).filter(|_| worst(&courses) > coarsening.limit)
        else {
            break;
        };
        courses.iter_mut().for_each(|c| c.lift(live));
        rounding = gentler;
    }
    for m in courses.iter().flat_map(|c| &c.moves) {
        let v = m.vertex as usize;
        live.reach[v] += length(sub(live.positions[v], live.position(m.cell)));
    }
    let shift = rounding.shift;
    Ok((finish(live, deviation, level, courses, interior, pool, stray_error)?, shift))
}

/// The largest error of the regions.
fn worst(courses: &[Course]) -> f64 {
    courses.iter().map(|c| c.error).fold(0.0, f64::max) * MARGIN
}

/// The corners of those of the given faces that are left.
fn corners_left(live: &Live<'_>, faces: &[u32]) -> Vec<u32> {
    let left = faces.iter().filter(|&&f| live.alive[f as usize]);
    left.flat_map(|f| [f * 3, f * 3 + 1, f * 3 + 2]).collect()
}

/// What changed last.
struct Latest {
    /// Stops are few (`Settings::PARTS`), and so are attempts at a grid.
    part: u8,
    /// The part in which each face changed last, and each sample was placed.
    changed_in: Vec<u8>,
    placed_in: Vec<u8>,
}

impl Latest {
    fn new(live: &Live<'_>, deviation: &Deviation) -> Self {
        Self { part: 0, changed_in: vec![0; live.alive.len()], placed_in: vec![0; deviation.sample_count()] }
    }
}

/// Measures what changed.
fn look(
    live: &Live<'_>,
    deviation: &mut Deviation,
    level: &Level<'_>,
    courses: &mut [Course],
    latest: &mut Latest,
    pool: &MonitoredPool<'_>,
) -> Result<(), MeshError> {
    // Nothing that is found here depends on where another region's samples are: some regions at a time, so that not all
    // new places are there twice.
    for first in (0..courses.len()).step_by(AT_A_TIME) {
        let (known, now) = (&*deviation, &*latest);
        let seen = &*courses;
        let count = (seen.len() - first).min(AT_A_TIME);
        let results = pool.map(count, &|r| follow(live, known, level, (&seen[first + r], first + r), now))?;
        for (course, result) in courses[first..].iter_mut().zip(results) {
            if let Some((places, far, moved, error)) = result {
                deviation.attach(&places);
                places.iter().for_each(|&(sample, ..)| latest.placed_in[sample as usize] = latest.part);
                course.far.extend(far);
                course.moved = moved;
                course.error = error;
            }
        }
    }
    let (known, now) = (&*deviation, &*latest);
    let seen = &*courses;
    let results = pool.map(seen.len(), &|r| {
        let course = &seen[r];
        let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
        let region = Surroundings::new(live, &level.faces[r], &inside);
        let placed = |sample: u32| now.placed_in[sample as usize] == now.part;
        // Quickly at first, and exactly where that found more than there was.
        let mut far = Vec::new();
        let error = known.faces(&region, &placed, level.samples.of(r), false, &mut far, course.error);
        let raised = error > course.error;
        let error = if raised { known.faces_again(&region, &far, course.error) } else { error };
        (far, error)
    })?;
    for (course, (far, error)) in courses.iter_mut().zip(results) {
        course.far_faces.extend(far);
        course.error = error;
    }
    Ok(())
}

/// Where the samples of a region went, its edges that may be far, how far the vertices are that were put on a grid, and
/// the largest distance; `None` where nothing changed.
fn follow(
    live: &Live<'_>,
    known: &Deviation,
    level: &Level<'_>,
    (course, r): (&Course, usize),
    now: &Latest,
) -> Option<(Vec<Attachment>, Vec<FarEdge>, f64, f64)> {
    if !course.performed {
        return None;
    }
    let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
    let region = Surroundings::new(live, &level.faces[r], &inside);
    let changed = |f: u32| now.changed_in[f as usize] == now.part;
    let (places, error) = known.follow(&region, &changed, level.samples.of(r).list, course.error);
    let mut far = Vec::new();
    let error = known.edges(live, &course.corners(live, &level.faces[r]), &mut far, error, MOST_SPARSE);
    let mut moved = 0.0;
    for m in &course.moves {
        let around = known.input_faces.row(m.vertex).first();
        known.farthest(live.positions[m.vertex as usize], &mut moved, &mut around.copied());
    }
    Some((places, far, moved, error.max(moved)))
}

impl Course {
    fn new(records: Records) -> Self {
        let (committed, corners) = (Committed::default(), Vec::new());
        Self {
            records,
            committed,
            performed: false,
            corners,
            all_corners: false,
            error: 0.0,
            truncation_points: Vec::new(),
            far: Vec::new(),
            far_faces: Vec::new(),
            moves: Vec::new(),
            moved: 0.0,
        }
    }

    /// Performs the collapses of one part, counted from 1.
    fn perform(&mut self, part: usize, live: &mut Live<'_>, latest: &mut Latest) {
        self.corners.clear();
        self.performed = false;
        let truncation_points = self.records.truncation_points.len();
        let end = match part {
            _ if part <= truncation_points => {
                self.records.truncation_points[truncation_points - part] as usize
            }
            _ if part == truncation_points + 1 => self.records.collapses.len(),
            _ => return,
        };
        self.performed = !self.records.collapses.is_empty();
        let corners = &mut self.corners;
        self.records.commit(live, &mut self.committed, end, &mut |corner| {
            latest.changed_in[(corner / 3) as usize] = latest.part;
            corners.push(corner);
        });
        corners.sort_unstable();
        corners.dedup();
    }

    /// Puts what is left of a region with collapses on a grid. Nothing that was known of it holds then.
    fn place(
        &mut self,
        live: &mut Live<'_>,
        faces: &[u32],
        moves: Vec<Move>,
        rounding: Rounding,
        latest: &mut Latest,
    ) {
        self.corners = Vec::new();
        self.all_corners = true;
        self.performed = !self.records.collapses.is_empty();
        if !self.performed {
            return;
        }
        if rounding.way != Placement::Stay {
            for Move { from, to } in &moves {
                live.positions[from.vertex as usize] = *to;
                live.shifts[from.vertex as usize] = rounding.shift;
            }
        }
        self.moves = moves.into_iter().map(|m| m.from).collect();
        for &face in faces.iter().filter(|&&f| live.alive[f as usize]) {
            latest.changed_in[face as usize] = latest.part;
        }
        self.error = 0.0;
        self.far.clear();
        self.far_faces.clear();
    }

    /// The corners that changed last.
    fn corners<'a>(&'a self, live: &Live<'_>, faces: &[u32]) -> Cow<'a, [u32]> {
        if self.all_corners { corners_left(live, faces).into() } else { (&self.corners).into() }
    }

    /// Takes the vertices off the grid again.
    fn lift(&mut self, live: &mut Live<'_>) {
        for m in self.moves.drain(..) {
            live.positions[m.vertex as usize] = live.position(m.cell);
            live.shifts[m.vertex as usize] = m.shift;
        }
    }

    /// Largest distance from the input of the edges that are still there, and of their ends. What was not looked at closely
    /// was within a share of the largest distance at that time.
    fn edges(&self, live: &Live<'_>) -> f64 {
        let joined = |[a, b]: [u32; 2]| {
            live.stars.corners(a).any(|c| live.face_vertices[(c / 3) as usize].contains(&b))
        };
        let far = self.far.iter().filter(|f| joined(f.0)).map(|f| f.1);
        far.fold(self.moved.max(SUSPICIOUS * self.error), f64::max)
    }
}

/// Settles the errors when all collapses are done.
fn finish(
    live: &Live<'_>,
    deviation: &mut Deviation,
    level: &Level<'_>,
    courses: Vec<Course>,
    mut interior: Vec<Vec<u32>>,
    pool: &MonitoredPool<'_>,
    stray_error: &mut f64,
) -> Result<Vec<RegionChunk>, MeshError> {
    let known = &*deviation;
    let settled = pool.map(courses.len(), &|r| {
        if courses[r].records.collapses.is_empty() {
            return None;
        }
        let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
        let region = Surroundings::new(live, &level.faces[r], &inside);
        let left = || level.faces[r].iter().copied().filter(|&f| live.alive[f as usize]);
        let result = left().next().map(|_| {
            let (places, error) = known.settle(&region, level.samples.of(r).list);
            let error = known.faces_again(&region, &courses[r].far_faces, error);
            let mut edges = courses[r].edges(live);
            if edges > ABSURD * error && edges <= SUSPICIOUS * courses[r].error {
                // Something on the way was far; what is there now need not be.
                let corners = corners_left(live, &level.faces[r]);
                edges = known.edges(live, &corners, &mut Vec::new(), error.max(courses[r].moved), MOST_DENSE);
                edges = known.faces(&region, &|_| true, level.samples.of(r), true, &mut Vec::new(), edges);
            }
            (places, error.max(edges) * MARGIN)
        });
        let points = || {
            let corners = left().flat_map(|f| live.triangle(f as usize));
            // What the chunk brings lies on finer grids than what is left, and not quite on the input.
            let brings = courses[r].records.collapses.iter().map(|c| live.positions[c.removed as usize]);
            let moves = courses[r].moves.iter().map(|m| live.position(m.cell));
            level.samples.of(r).list.iter().map(|&s| known.point(s)).chain(corners).chain(brings).chain(moves)
        };
        Some((result, sphere(&points)))
    })?;
    // Where all samples are comes first: attributes are compared there.
    let mut found = Vec::with_capacity(settled.len());
    for (r, settled) in settled.into_iter().enumerate() {
        found.push(settled.map(|(result, sphere)| {
            let stray = result.is_none();
            let error = match result {
                Some((places, error)) => {
                    deviation.attach(&places);
                    error
                }
                None => deviation.attach_anywhere(live, level.samples.of(r)),
            };
            (error, stray, sphere)
        }));
    }
    let known = &*deviation;
    let attributes = pool.map(courses.len(), &|r| {
        let samples = level.samples.of(r).list;
        found[r].map_or(0.0, |_| known.attribute_error(live, samples))
    })?;
    let mut chunks = Vec::new();
    let found = found.into_iter().zip(attributes);
    for (r, (course, (found, attribute_error))) in courses.into_iter().zip(found).enumerate() {
        let Some((error, stray, (center, radius))) = found else { continue };
        let [inherited, of_attributes] = deviation.inherited(level.samples.of(r).list);
        let error = error + inherited;
        if stray {
            *stray_error = stray_error.max(error);
        }
        let truncation_points = course.records.truncation_points.len();
        let truncation_errors = course.truncation_points[..truncation_points]
            .iter()
            .rev()
            .map(|e| e * MARGIN + inherited)
            .collect();
        let (faces, interior) = (level.faces[r].clone(), std::mem::take(&mut interior[r]));
        chunks.push(RegionChunk {
            records: course.records,
            faces,
            interior,
            error,
            attribute_error: attribute_error + of_attributes,
            truncation_errors,
            moves: course.moves,
            center,
            radius,
        });
    }
    Ok(chunks)
}

/// A bounding sphere about the middle of the bounding box.
fn sphere<P: Iterator<Item = Vec3>>(points: &dyn Fn() -> P) -> (Vec3, f64) {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    points().for_each(|p| extend(&mut bounds, p));
    let center = scale(add(bounds[0], bounds[1]), 0.5);
    (center, points().map(|p| length(sub(p, center))).fold(0.0, f64::max))
}
