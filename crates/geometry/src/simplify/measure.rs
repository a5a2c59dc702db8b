//! Measures a region's chunk: geometric error, as a whole and at each truncation point, and extent.
//!
//! The collapses are applied part by part, between the truncation points, and each part is measured by its changes.
//! So a truncation point costs what changes twice, not a complete measurement.

use std::borrow::Cow;

use crate::collapse::Placed;
use crate::collapse::Records;
use crate::error::MeshError;
use crate::mesh::vec3::{Vec3, add, length, scale, sub};
use crate::pool::MonitoredPool;
use crate::simplify::commit::CommitProgress;
use crate::simplify::deviation::{
    Attachment, Deviation, FarEdge, MARGIN, MAX_DENSE, MAX_SPARSE, SUSPICIOUS, extend,
};
use crate::simplify::hierarchy::RegionChunk;
use crate::simplify::level::Level;
use crate::simplify::live::Live;
use crate::simplify::placement::{self, Move, Placement, Rounding, place};
use crate::simplify::surroundings::Surroundings;

/// If intermediate errors exceed the samples' distance by this factor, the edges are measured again.
const REMEASURE_FACTOR: f64 = 1.1;

/// Regions whose samples are updated together: enough for any number of threads.
const BATCH: usize = 1024;

/// A region whose collapses are being applied.
struct RegionProgress {
    records: Records,
    committed: CommitProgress,
    /// Whether the current part has collapses.
    performed: bool,
    /// Corners changed by them; `all_corners` if all are.
    corners: Vec<u32>,
    all_corners: bool,
    /// Largest distance so far, without margin.
    error: f64,
    /// The largest distance at each truncation point, finest first.
    truncation_points: Vec<f64>,
    far: Vec<FarEdge>,
    /// Input faces that were far at some point.
    far_faces: Vec<u32>,
    /// Vertices placed on a grid, and their largest distance.
    moves: Vec<Placed>,
    moved: f64,
}

/// Parameters of placing vertices on coarser grids.
#[derive(Clone, Copy)]
pub(crate) struct Coarsening {
    /// Shift (low bits left out) of the grid at this level's start.
    pub(crate) shift: u8,
    /// [`crate::simplify::Settings::coarse_grid`], or 0 to keep that grid.
    pub(crate) share: f64,
    /// Allowed error in cells; placements that exceed it are reduced.
    pub(crate) limit: f64,
}

/// Applies the collapses, places the remaining vertices on their grid, measures the regions, and makes chunks of
/// those with collapses. Returns these, and the shift of the grid at the level's end.
pub(crate) fn measure(
    live: &mut Live<'_>,
    deviation: &mut Deviation,
    level: &Level<'_>,
    records: Vec<Records>,
    coarsening: Coarsening,
    pool: &MonitoredPool<'_>,
    stray_error: &mut f64,
) -> Result<(Vec<RegionChunk>, u8), MeshError> {
    let mut regions_in_progress: Vec<RegionProgress> = records.into_iter().map(RegionProgress::new).collect();
    let mut changes = ChangeLog::new(live, deviation);
    let parts = regions_in_progress.iter().map(|c| c.records.truncation_points.len() + 1).max().unwrap_or(0);
    for part in 1..=parts {
        changes.part = part as u8;
        regions_in_progress.iter_mut().for_each(|c| c.perform(part, live, &mut changes));
        live.settle();
        measure_part(live, deviation, level, &mut regions_in_progress, &mut changes, pool)?;
        regions_in_progress.iter_mut().for_each(|c| c.truncation_points.push(c.error));
    }
    let interior = level.interior_vertices();
    let mut errors: Vec<f64> =
        regions_in_progress.iter().filter(|c| !c.records.collapses.is_empty()).map(|c| c.error).collect();
    let mut rounding = Rounding {
        shift: placement::coarser(live, coarsening.shift, coarsening.share, &mut errors),
        way: Placement::Best,
    };
    while rounding.shift > 0 || usize::from(changes.part) > parts {
        changes.part += 1;
        let (seen, now) = (&*regions_in_progress, &*live);
        let moves = pool.map(seen.len(), &|r| match rounding.shift {
            1.. if !seen[r].records.collapses.is_empty() => place(now, &interior[r], rounding),
            _ => Vec::new(),
        })?;
        for (progress, (faces, moves)) in regions_in_progress.iter_mut().zip(level.faces.iter().zip(moves)) {
            progress.place(live, faces, moves, rounding, &mut changes);
        }
        measure_part(live, deviation, level, &mut regions_in_progress, &mut changes, pool)?;
        let Some(gentler) =
            rounding.weaker(coarsening.shift).filter(|_| worst(&regions_in_progress) > coarsening.limit)
        else {
            break;
        };
        regions_in_progress.iter_mut().for_each(|c| c.undo_placement(live));
        rounding = gentler;
    }
    for m in regions_in_progress.iter().flat_map(|c| &c.moves) {
        let v = m.vertex as usize;
        live.reach[v] += length(sub(live.positions[v], live.position(m.cell)));
    }
    let shift = rounding.shift;
    Ok((finish(live, deviation, level, regions_in_progress, interior, pool, stray_error)?, shift))
}

/// The largest error of all regions.
fn worst(regions_in_progress: &[RegionProgress]) -> f64 {
    regions_in_progress.iter().map(|c| c.error).fold(0.0, f64::max) * MARGIN
}

/// The corners of those of the given faces that remain.
fn corners_left(live: &Live<'_>, faces: &[u32]) -> Vec<u32> {
    let left = faces.iter().filter(|&&f| live.alive[f as usize]);
    left.flat_map(|f| [f * 3, f * 3 + 1, f * 3 + 2]).collect()
}

/// The parts in which elements changed last.
struct ChangeLog {
    /// Parts are few (`Settings::PARTS`), and so are attempts at a grid.
    part: u8,
    /// The part in which each face last changed, and each sample was last placed.
    changed_in: Vec<u8>,
    placed_in: Vec<u8>,
}

impl ChangeLog {
    fn new(live: &Live<'_>, deviation: &Deviation) -> Self {
        Self { part: 0, changed_in: vec![0; live.alive.len()], placed_in: vec![0; deviation.sample_count()] }
    }
}

/// Measures the changes of the current part.
fn measure_part(
    live: &Live<'_>,
    deviation: &mut Deviation,
    level: &Level<'_>,
    regions_in_progress: &mut [RegionProgress],
    changes: &mut ChangeLog,
    pool: &MonitoredPool<'_>,
) -> Result<(), MeshError> {
    // Results do not depend on other regions' samples. Regions are processed in batches, so that not all new
    // attachments are in memory twice.
    for first in (0..regions_in_progress.len()).step_by(BATCH) {
        let (known, now) = (&*deviation, &*changes);
        let seen = &*regions_in_progress;
        let count = (seen.len() - first).min(BATCH);
        let results = pool.map(count, &|r| follow(live, known, level, (&seen[first + r], first + r), now))?;
        for (progress, result) in regions_in_progress[first..].iter_mut().zip(results) {
            if let Some((places, far, moved, error)) = result {
                deviation.attach(&places);
                places.iter().for_each(|&(sample, ..)| changes.placed_in[sample as usize] = changes.part);
                progress.far.extend(far);
                progress.moved = moved;
                progress.error = error;
            }
        }
    }
    let (known, now) = (&*deviation, &*changes);
    let seen = &*regions_in_progress;
    let results = pool.map(seen.len(), &|r| {
        let progress = &seen[r];
        let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
        let region = Surroundings::new(live, &level.faces[r], &inside);
        let placed = |sample: u32| now.placed_in[sample as usize] == now.part;
        // Approximately at first, exactly if the error exceeds the known one.
        let mut far = Vec::new();
        let error = known.faces(&region, &placed, level.samples.of(r), false, &mut far, progress.error);
        let raised = error > progress.error;
        let error = if raised { known.recheck_faces(&region, &far, progress.error) } else { error };
        (far, error)
    })?;
    for (progress, (far, error)) in regions_in_progress.iter_mut().zip(results) {
        progress.far_faces.extend(far);
        progress.error = error;
    }
    Ok(())
}

/// New attachments of a region's samples, its possibly far edges, the distance of placed vertices, and the largest
/// distance; `None` if nothing changed.
fn follow(
    live: &Live<'_>,
    known: &Deviation,
    level: &Level<'_>,
    (progress, r): (&RegionProgress, usize),
    now: &ChangeLog,
) -> Option<(Vec<Attachment>, Vec<FarEdge>, f64, f64)> {
    if !progress.performed {
        return None;
    }
    let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
    let region = Surroundings::new(live, &level.faces[r], &inside);
    let changed = |f: u32| now.changed_in[f as usize] == now.part;
    let (places, error) = known.follow(&region, &changed, level.samples.of(r).list, progress.error);
    let mut far = Vec::new();
    let error = known.edges(live, &progress.corners(live, &level.faces[r]), &mut far, error, MAX_SPARSE);
    let mut moved = 0.0;
    for m in &progress.moves {
        let around = known.input_faces.row(m.vertex).first();
        known.farthest(live.positions[m.vertex as usize], &mut moved, &mut around.copied());
    }
    Some((places, far, moved, error.max(moved)))
}

impl RegionProgress {
    fn new(records: Records) -> Self {
        let (committed, corners) = (CommitProgress::default(), Vec::new());
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

    /// Applies the collapses of one part, counted from 1.
    fn perform(&mut self, part: usize, live: &mut Live<'_>, changes: &mut ChangeLog) {
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
            changes.changed_in[(corner / 3) as usize] = changes.part;
            corners.push(corner);
        });
        corners.sort_unstable();
        corners.dedup();
    }

    /// Places the remaining vertices of a region with collapses on a grid, which invalidates its measurements.
    fn place(
        &mut self,
        live: &mut Live<'_>,
        faces: &[u32],
        moves: Vec<Move>,
        rounding: Rounding,
        changes: &mut ChangeLog,
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
            changes.changed_in[face as usize] = changes.part;
        }
        self.error = 0.0;
        self.far.clear();
        self.far_faces.clear();
    }

    /// The corners that changed last.
    fn corners<'a>(&'a self, live: &Live<'_>, faces: &[u32]) -> Cow<'a, [u32]> {
        if self.all_corners { corners_left(live, faces).into() } else { (&self.corners).into() }
    }

    /// Reverts the placement.
    fn undo_placement(&mut self, live: &mut Live<'_>) {
        for m in self.moves.drain(..) {
            live.positions[m.vertex as usize] = live.position(m.cell);
            live.shifts[m.vertex as usize] = m.shift;
        }
    }

    /// Largest distance from the input of the remaining edges and their ends. Edges not sampled densely were within a
    /// share of the largest distance at that time.
    fn edges(&self, live: &Live<'_>) -> f64 {
        let joined = |[a, b]: [u32; 2]| {
            live.stars.corners(a).any(|c| live.face_vertices[(c / 3) as usize].contains(&b))
        };
        let far = self.far.iter().filter(|f| joined(f.0)).map(|f| f.1);
        far.fold(self.moved.max(SUSPICIOUS * self.error), f64::max)
    }
}

/// Computes the final errors after all collapses.
fn finish(
    live: &Live<'_>,
    deviation: &mut Deviation,
    level: &Level<'_>,
    regions_in_progress: Vec<RegionProgress>,
    mut interior: Vec<Vec<u32>>,
    pool: &MonitoredPool<'_>,
    stray_error: &mut f64,
) -> Result<Vec<RegionChunk>, MeshError> {
    let known = &*deviation;
    let settled = pool.map(regions_in_progress.len(), &|r| {
        if regions_in_progress[r].records.collapses.is_empty() {
            return None;
        }
        let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
        let region = Surroundings::new(live, &level.faces[r], &inside);
        let left = || level.faces[r].iter().copied().filter(|&f| live.alive[f as usize]);
        let result = left().next().map(|_| {
            let (places, error) = known.settle(&region, level.samples.of(r).list);
            let error = known.recheck_faces(&region, &regions_in_progress[r].far_faces, error);
            let mut edges = regions_in_progress[r].edges(live);
            if edges > REMEASURE_FACTOR * error && edges <= SUSPICIOUS * regions_in_progress[r].error {
                // Something was far at some point; the final state may be closer.
                let corners = corners_left(live, &level.faces[r]);
                edges = known.edges(
                    live,
                    &corners,
                    &mut Vec::new(),
                    error.max(regions_in_progress[r].moved),
                    MAX_DENSE,
                );
                edges = known.faces(&region, &|_| true, level.samples.of(r), true, &mut Vec::new(), edges);
            }
            (places, error.max(edges) * MARGIN)
        });
        let points = || {
            let corners = left().flat_map(|f| live.triangle(f as usize));
            // The chunk's vertices lie on finer grids than the remaining ones, not exactly on the input.
            let brings =
                regions_in_progress[r].records.collapses.iter().map(|c| live.positions[c.removed as usize]);
            let moves = regions_in_progress[r].moves.iter().map(|m| live.position(m.cell));
            level.samples.of(r).list.iter().map(|&s| known.point(s)).chain(corners).chain(brings).chain(moves)
        };
        Some((result, sphere(&points)))
    })?;
    // All attachments must be final first, because attributes are compared there.
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
    let attributes = pool.map(regions_in_progress.len(), &|r| {
        let samples = level.samples.of(r).list;
        found[r].map_or(0.0, |_| known.attribute_error(live, samples))
    })?;
    let mut chunks = Vec::new();
    let found = found.into_iter().zip(attributes);
    for (r, (progress, (found, attribute_error))) in regions_in_progress.into_iter().zip(found).enumerate() {
        let Some((error, stray, (center, radius))) = found else { continue };
        let [inherited, of_attributes] = deviation.inherited(level.samples.of(r).list);
        let error = error + inherited;
        if stray {
            *stray_error = stray_error.max(error);
        }
        let truncation_points = progress.records.truncation_points.len();
        let truncation_errors = progress.truncation_points[..truncation_points]
            .iter()
            .rev()
            .map(|e| e * MARGIN + inherited)
            .collect();
        let (faces, interior) = (level.faces[r].clone(), std::mem::take(&mut interior[r]));
        chunks.push(RegionChunk {
            records: progress.records,
            faces,
            interior,
            error,
            attribute_error: attribute_error + of_attributes,
            truncation_errors,
            moves: progress.moves,
            center,
            radius,
        });
    }
    Ok(chunks)
}

/// Bounding sphere around the centre of the bounding box.
fn sphere<P: Iterator<Item = Vec3>>(points: &dyn Fn() -> P) -> (Vec3, f64) {
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    points().for_each(|p| extend(&mut bounds, p));
    let center = scale(add(bounds[0], bounds[1]), 0.5);
    (center, points().map(|p| length(sub(p, center))).fold(0.0, f64::max))
}
