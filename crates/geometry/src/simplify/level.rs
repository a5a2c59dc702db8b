//! One level: its regions, and the number of collapses in each.

use crate::collapse::Records;
use crate::error::MeshError;
use crate::mesh::corner;
use crate::pool::MonitoredPool;
use crate::simplify::deviation::{Deviation, Samples};
use crate::simplify::live::Live;
use crate::simplify::partition::{NO_FACE, partition};
use crate::simplify::queue::simplify_region;
use crate::simplify::region::Region;
use crate::simplify::settings::Settings;
use crate::simplify::star_table::each_edge;
use crate::simplify::whole_components::{Visible, WholeComponents};

/// Marks a vertex whose star is in several regions, or in none.
const OUTLINE: u32 = u32::MAX;
/// Share of a region's interior vertices tried, so that flat regions can lose more than others.
const MAX_REGION_SHARE: f64 = 0.85;

/// Vertices that no level removes.
#[derive(Clone, Copy)]
pub(crate) struct Fixed<'a> {
    /// Ascending; other vertices may collapse onto them.
    pub(crate) held: &'a [u32],
    /// Per vertex: whether some of its faces are outside this part, so that it is always on an outline. Empty if all
    /// faces are here.
    pub(crate) locked: &'a [bool],
}

/// The regions of one level.
pub(crate) struct Level<'a> {
    pub(crate) region_of_face: Vec<u32>,
    pub(crate) faces: Vec<Vec<u32>>,
    /// Region of each interior vertex, else [`OUTLINE`].
    pub(crate) interior: Vec<u32>,
    /// Number of interior vertices of each region.
    capacity: Vec<usize>,
    /// Number of live vertices.
    pub(crate) vertices: usize,
    fixed: Fixed<'a>,
    /// The samples of each region.
    pub(crate) samples: Samples,
    /// If the mesh is divided into parts.
    pub(crate) components: Option<WholeComponents>,
}

impl<'a> Level<'a> {
    /// Partitions the live faces into `count` regions.
    pub(crate) fn new(
        live: &Live<'_>,
        deviation: &Deviation,
        number: usize,
        count: usize,
        fixed: Fixed<'a>,
        visible: Visible,
        pool: &MonitoredPool<'_>,
    ) -> Result<Self, MeshError> {
        let list = &live.faces;
        let components = live.has_parts().then(|| WholeComponents::new(live, visible));
        let place = |f: u32| {
            let components = components.as_ref();
            let whole = components.and_then(|components| components.place(live.face_vertices[f as usize]));
            whole.unwrap_or_else(|| live.centroid(f as usize))
        };
        let centroids = || list.iter().map(|&f| place(f));
        let regions = partition(&centroids, &|| adjacency(live), count, number, pool)?;
        let mut region_of_face = vec![OUTLINE; live.alive.len()];
        let mut sizes = vec![0; count.max(1)];
        regions.iter().for_each(|&region| sizes[region as usize] += 1);
        let mut faces: Vec<Vec<u32>> = sizes.into_iter().map(Vec::with_capacity).collect();
        for (&f, &region) in list.iter().zip(&regions) {
            region_of_face[f as usize] = region;
            faces[region as usize].push(f);
        }
        let mut interior = vec![OUTLINE; live.positions.len()];
        let mut capacity = vec![0; faces.len()];
        let mut vertices = 0;
        for v in 0..live.positions.len() as u32 {
            let mut corners = live.stars.corners(v).map(|c| region_of_face[corner::face_of(c) as usize]);
            let Some(first) = corners.next() else { continue };
            vertices += 1;
            if corners.all(|r| r == first) && !fixed.locked.get(v as usize).is_some_and(|&locked| locked) {
                interior[v as usize] = first;
                capacity[first as usize] += 1;
            }
        }
        let samples = deviation.by_region(&region_of_face, faces.len());
        Ok(Self { region_of_face, faces, interior, capacity, vertices, fixed, samples, components })
    }

    /// The interior vertices of each region, ascending.
    pub(crate) fn interior_vertices(&self) -> Vec<Vec<u32>> {
        let mut lists: Vec<Vec<u32>> = self.capacity.iter().map(|&count| Vec::with_capacity(count)).collect();
        for (v, &r) in self.interior.iter().enumerate() {
            if let Some(list) = lists.get_mut(r as usize) {
                list.push(v as u32);
            }
        }
        lists
    }

    /// Simplifies all regions; with `last`, each as far as possible.
    pub(crate) fn simplify(
        &self,
        live: &Live<'_>,
        last: bool,
        tear: bool,
        settings: &Settings,
        pool: &MonitoredPool<'_>,
    ) -> Result<Vec<Records>, MeshError> {
        let share = MAX_REGION_SHARE.max(settings.level_share);
        pool.map(self.faces.len(), &|r| {
            let limit = if last { usize::MAX } else { (self.capacity[r] as f64 * share) as usize };
            let mut region = self.region(live, r, settings);
            region.hold(|v| self.fixed.held.binary_search(&v).is_ok());
            region.group(self.components.as_ref());
            if tear {
                region.tear_outline();
            }
            simplify_region(region, limit, settings.round_share)
        })
    }

    /// Simplifies one region again with additional locked vertices `held` (ascending), limited in collapses and cost.
    pub(crate) fn simplify_with_locked(
        &self,
        live: &Live<'_>,
        r: usize,
        held: &[u32],
        (most, highest_cost): (usize, f64),
        settings: &Settings,
    ) -> Records {
        let mut region = self.region(live, r, settings);
        region.hold(|v| [self.fixed.held, held].iter().any(|held| held.binary_search(&v).is_ok()));
        region.group(self.components.as_ref());
        let mut records = simplify_region(region, most, settings.round_share);
        let keep = records.costs.partition_point(|&cost| cost <= highest_cost);
        records.truncate(keep);
        records
    }

    fn region(&self, live: &Live<'_>, r: usize, settings: &Settings) -> Region {
        let inside = |v: u32| self.interior[v as usize] == r as u32;
        Region::new(live, self.faces[r].clone(), &inside, settings.metric)
    }
}

/// Truncates the collapses of all regions at one cost, so that a level removes its share where it costs least;
/// regions with too few splits keep none.
pub(crate) fn truncate_globally(records: &mut [Records], level: &Level<'_>, settings: &Settings) {
    let mut costs: Vec<f64> = records.iter().flat_map(|r| r.costs.iter().copied()).collect();
    let total: usize = level.capacity.iter().sum();
    let target = (total as f64 * settings.level_share) as usize;
    let limit = if target < costs.len() && target > 0 {
        *costs.select_nth_unstable_by(target - 1, f64::total_cmp).1
    } else {
        f64::INFINITY
    };
    for region in records {
        let mut keep = region.costs.partition_point(|&cost| cost <= limit);
        if keep < settings.min_splits {
            keep = 0;
        }
        region.truncate(keep);
    }
}

/// Per live face (by index in the list): the index of a face across each edge.
fn adjacency(live: &Live<'_>) -> Vec<[u32; 3]> {
    let mut place = vec![NO_FACE; live.alive.len()];
    for (i, &f) in live.faces.iter().enumerate() {
        place[f as usize] = i as u32;
    }
    let mut adjacent = vec![[NO_FACE; 3]; live.faces.len()];
    each_edge(&live.stars, &live.face_vertices, &mut |_, _, corners| {
        // At edges of more than two faces, each face gets the next one.
        for (i, &corner) in corners.iter().enumerate().filter(|_| corners.len() > 1) {
            let next = corners[(i + 1) % corners.len()];
            adjacent[place[corner::face_of(corner) as usize] as usize][corner::side_of(corner)] =
                place[corner::face_of(next) as usize];
        }
    });
    adjacent
}
