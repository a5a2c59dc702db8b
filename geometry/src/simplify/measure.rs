//! What a region's collapses did to the surface: the geometric error and the extent of its chunk.

use crate::error::MeshError;
use crate::pool::Watched;
use crate::simplify::RegionChunk;
use crate::simplify::deviation::{Deviation, extend};
use crate::simplify::level::Level;
use crate::simplify::live::Live;
use crate::simplify::records::Records;
use crate::vec3::{add, length, scale, sub};

/// Measures the regions after their collapses and makes chunks of those that have any.
pub(crate) fn measure(
    live: &Live,
    deviation: &mut Deviation,
    level: &Level,
    records: Vec<Records>,
    touched: &[bool],
    pool: &Watched<'_>,
    stray_error: &mut f64,
) -> Result<Vec<RegionChunk>, MeshError> {
    let samples = deviation.by_region(&level.region_of_face, level.faces.len());
    let measured = {
        let deviation = &*deviation;
        pool.map(records.len(), &|r| {
            if records[r].collapses.is_empty() {
                return None;
            }
            let left: Vec<u32> = level.faces[r].iter().copied().filter(|&f| live.alive[f as usize]).collect();
            let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
            deviation.bounds(&samples[r], &mut bounds);
            let corners = || left.iter().flat_map(|&f| live.triangle(f as usize));
            for p in corners() {
                extend(&mut bounds, p);
            }
            let center = scale(add(bounds[0], bounds[1]), 0.5);
            let mut radius = deviation.farthest(&samples[r], center);
            for p in corners() {
                radius = radius.max(length(sub(p, center)));
            }
            let measured = (!left.is_empty()).then(|| {
                let inside = |f: u32| level.region_of_face[f as usize] == r as u32;
                deviation.measure(live, &left, &|f| touched[f as usize], &inside, &samples[r])
            });
            Some((measured, center, radius))
        })?
    };
    let mut interior = vec![Vec::new(); level.faces.len()];
    for (v, &r) in level.interior.iter().enumerate() {
        if let Some(list) = interior.get_mut(r as usize) {
            list.push(v as u32);
        }
    }
    let mut chunks = Vec::new();
    for (r, (records, measured)) in records.into_iter().zip(measured).enumerate() {
        let Some((measured, center, radius)) = measured else { continue };
        let error = match measured {
            Some(measured) => {
                deviation.attach(&measured.moved);
                measured.error
            }
            None => {
                let error = deviation.attach_anywhere(live, &samples[r]);
                *stray_error = stray_error.max(error);
                error
            }
        };
        let (faces, interior) = (level.faces[r].clone(), std::mem::take(&mut interior[r]));
        chunks.push(RegionChunk { records, faces, interior, error, center, radius });
    }
    Ok(chunks)
}
