//! What a region's collapses did to the surface: the geometric error of its chunk, at each stop and as
//! a whole, and the chunk's extent.
//!
//! The collapses are performed part by part, between the stops, and each part is measured by what it
//! changed; so stops cost what changes twice, not a whole measurement each.

use crate::error::MeshError;
use crate::pool::Watched;
use crate::simplify::RegionChunk;
use crate::simplify::attributes::vertex_normals;
use crate::simplify::deviation::{Deviation, FarEdge, MARGIN, MOST_DENSE, MOST_SPARSE, SUSPICIOUS, extend};
use crate::simplify::level::Level;
use crate::simplify::live::Live;
use crate::simplify::records::{Committed, Records};
use crate::simplify::surroundings::Surroundings;
use crate::vec3::{Vec3, add, length, scale, sub};

/// Where what was far on the way exceeds the samples' distance by this factor, edges are looked at
/// again.
const ABSURD: f64 = 1.1;

/// A region whose collapses are being performed.
struct Course {
    records: Records,
    committed: Committed,
    /// Whether the current part has collapses.
    performed: bool,
    /// Corners that they changed.
    corners: Vec<u32>,
    /// Largest distance so far, without margin.
    error: f64,
    /// The same when each stop but the last was passed, finest first.
    stops: Vec<f64>,
    far: Vec<FarEdge>,
    /// Input faces that were far on the way.
    far_faces: Vec<u32>,
}

/// Performs the collapses, measures the regions, and makes chunks of those that have any.
pub(crate) fn measure(
    live: &mut Live,
    deviation: &mut Deviation,
    level: &Level,
    records: Vec<Records>,
    pool: &Watched<'_>,
    stray_error: &mut f64,
) -> Result<Vec<RegionChunk>, MeshError> {
    let samples = deviation.by_region(&level.region_of_face, level.faces.len());
    let mut courses: Vec<Course> = records.into_iter().map(Course::new).collect();
    let mut changed_in = vec![0_u32; live.alive.len()];
    let mut placed_in = vec![0_u32; deviation.sample_count()];
    let parts = courses.iter().map(|c| c.records.stops.len() + 1).max().unwrap_or(0);
    for part in 1..=parts as u32 {
        courses.iter_mut().for_each(|c| c.perform(part as usize, live, &mut changed_in));
        live.settle();
        let (live, known) = (&*live, &*deviation);
        let results = pool.map(courses.len(), &|r| {
            let course = &courses[r];
            if !course.performed {
                return None;
            }
            let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
            let region = Surroundings::new(live, &level.faces[r], &inside);
            let changed = |f: u32| changed_in[f as usize] == part;
            let (places, error) = known.follow(&region, &changed, &samples[r], course.error);
            let mut far = Vec::new();
            let error = known.edges(live, &course.corners, &mut far, error, MOST_SPARSE);
            Some((places, far, error))
        })?;
        for (course, result) in courses.iter_mut().zip(results) {
            if let Some((places, far, error)) = result {
                deviation.attach(&places);
                places.iter().for_each(|&(sample, ..)| placed_in[sample as usize] = part);
                course.far.extend(far);
                course.error = error;
            }
        }
        let known = &*deviation;
        let results = pool.map(courses.len(), &|r| {
            let course = &courses[r];
            let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
            let region = Surroundings::new(live, &level.faces[r], &inside);
            let placed = |sample: u32| placed_in[sample as usize] == part;
            // Quickly at first, and exactly where that found more than there was.
            let mut far = Vec::new();
            let error = known.faces(&region, &placed, &samples[r], false, &mut far, course.error);
            let raised = error > course.error;
            let error = if raised { known.faces_again(&region, &far, course.error) } else { error };
            (far, error)
        })?;
        for (course, (far, error)) in courses.iter_mut().zip(results) {
            course.far_faces.extend(far);
            course.error = error;
            course.stops.push(error);
        }
    }
    finish(live, deviation, level, courses, &samples, pool, stray_error)
}

impl Course {
    fn new(records: Records) -> Self {
        let (committed, corners) = (Committed::default(), Vec::new());
        Self {
            records,
            committed,
            performed: false,
            corners,
            error: 0.0,
            stops: Vec::new(),
            far: Vec::new(),
            far_faces: Vec::new(),
        }
    }

    /// Performs the collapses of one part, counted from 1.
    fn perform(&mut self, part: usize, live: &mut Live, changed_in: &mut [u32]) {
        self.corners.clear();
        self.performed = false;
        let stops = self.records.stops.len();
        let end = match part {
            _ if part <= stops => self.records.stops[stops - part] as usize,
            _ if part == stops + 1 => self.records.collapses.len(),
            _ => return,
        };
        self.performed = !self.records.collapses.is_empty();
        let corners = &mut self.corners;
        self.records.commit(live, &mut self.committed, end, &mut |corner| {
            changed_in[(corner / 3) as usize] = part as u32;
            corners.push(corner);
        });
        corners.sort_unstable();
        corners.dedup();
    }

    /// Largest distance from the input of the edges that are still there. What was not looked at closely
    /// was within a share of the largest distance at that time.
    fn edges(&self, live: &Live) -> f64 {
        let joined = |[a, b]: [u32; 2]| {
            live.stars.corners(a).any(|c| live.face_vertices[(c / 3) as usize].contains(&b))
        };
        let far = self.far.iter().filter(|f| joined(f.0)).map(|f| f.1);
        far.fold(SUSPICIOUS * self.error, f64::max)
    }
}

/// Settles the errors when all collapses are done.
fn finish(
    live: &Live,
    deviation: &mut Deviation,
    level: &Level,
    courses: Vec<Course>,
    samples: &[Vec<u32>],
    pool: &Watched<'_>,
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
            let (places, error) = known.settle(&region, &samples[r]);
            let error = known.faces_again(&region, &courses[r].far_faces, error);
            let mut edges = courses[r].edges(live);
            if edges > ABSURD * error && edges <= SUSPICIOUS * courses[r].error {
                // Something on the way was far; what is there now need not be.
                let corners: Vec<u32> = left().flat_map(|f| [f * 3, f * 3 + 1, f * 3 + 2]).collect();
                edges = known.edges(live, &corners, &mut Vec::new(), error, MOST_DENSE);
                edges = known.faces(&region, &|_| true, &samples[r], true, &mut Vec::new(), edges);
            }
            (places, error.max(edges) * MARGIN)
        });
        let points = || {
            let corners = left().flat_map(|f| live.triangle(f as usize));
            samples[r].iter().map(|&s| known.point(live, s)).chain(corners)
        };
        Some((result, sphere(&points)))
    })?;
    let normals = vertex_normals(live);
    let mut interior = vec![Vec::new(); level.faces.len()];
    for (v, &r) in level.interior.iter().enumerate() {
        if let Some(list) = interior.get_mut(r as usize) {
            list.push(v as u32);
        }
    }
    let mut chunks = Vec::new();
    for (r, (course, settled)) in courses.into_iter().zip(settled).enumerate() {
        let Some((result, (center, radius))) = settled else { continue };
        let error = match result {
            Some((places, error)) => {
                deviation.attach(&places);
                error
            }
            None => {
                let error = deviation.attach_anywhere(live, &samples[r]);
                *stray_error = stray_error.max(error);
                error
            }
        };
        let attribute_error = deviation.attribute_error(live, &samples[r], &normals);
        let stops = course.records.stops.len();
        let stop_errors = course.stops[..stops].iter().rev().map(|e| e * MARGIN).collect();
        let (faces, interior) = (level.faces[r].clone(), std::mem::take(&mut interior[r]));
        let records = course.records;
        chunks.push(RegionChunk {
            records,
            faces,
            interior,
            error,
            attribute_error,
            stop_errors,
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
