//! Keeps every level within the error that the base mesh is allowed.

use crate::error::MeshError;
use crate::pool::Watched;
use crate::simplify::deviation::Deviation;
use crate::simplify::level::Level;
use crate::simplify::live::Live;
use crate::simplify::records::Records;

/// Input samples by which a region is judged while a level that keeps within the base's error is
/// searched for.
const SEARCH_SAMPLES: usize = 20_000;
/// The least of them for one region.
const LEAST_SEARCH_SAMPLES: usize = 1500;

/// Shortens each region's collapses until its error is within `limit`: no level may leave the base
/// mesh worse than it is allowed to be.
pub(crate) fn limit_error(
    live: &Live,
    deviation: &Deviation,
    level: &Level,
    records: &mut [Records],
    limit: f64,
    pool: &Watched<'_>,
) -> Result<(), MeshError> {
    let samples = deviation.by_region(&level.region_of_face, level.faces.len());
    let budget = (SEARCH_SAMPLES / records.len().max(1)).max(LEAST_SEARCH_SAMPLES);
    let keep = pool.map(records.len(), &|r| {
        let whole = records[r].collapses.len();
        if records[r].reach <= limit {
            return whole;
        }
        let good = |count: usize| {
            let triangles = faces_after(live, &level.faces[r], &records[r], count);
            !triangles.is_empty() && deviation.within(&live.positions, &triangles, &samples[r], limit, budget)
        };
        if whole == 0 || good(whole) {
            return whole;
        }
        let (mut low, mut high) = (0, whole);
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if good(middle) { low = middle } else { high = middle }
        }
        low
    })?;
    for (region, keep) in records.iter_mut().zip(keep) {
        region.truncate(keep);
    }
    Ok(())
}

/// A region's triangles after its first `count` collapses.
fn faces_after(live: &Live, faces: &[u32], records: &Records, count: usize) -> Vec<[u32; 3]> {
    let place = |face: u32| faces.binary_search(&face).unwrap_or(0);
    let mut triangles: Vec<Option<[u32; 3]>> =
        faces.iter().map(|&f| Some(live.face_vertices[f as usize])).collect();
    for i in 0..count {
        let (collapse, moved, removed) = records.parts(i);
        for m in moved {
            if let Some(triangle) = &mut triangles[place(m.face)]
                && let Some(corner) = triangle.iter_mut().find(|v| **v == collapse.removed)
            {
                *corner = collapse.target;
            }
        }
        for r in removed {
            triangles[place(r.face)] = None;
        }
    }
    triangles.into_iter().flatten().collect()
}
