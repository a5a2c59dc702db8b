//! A frame's drawables and their instances in the order and form that planning needs: what does not depend on the camera
//! is computed when it changes, not in each frame. It lies in few lists, since thousands of assets lie far apart.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::DVec3;
use lodestream_scene::placement::Placement;

use crate::frame::settings::Drawable;
use crate::scene::asset::{AssetGpu, Look};
use crate::scene::placement::InstanceRaw;

/// Most instances of a cell: few enough to be culled together, enough that cells cost little.
const CELL: usize = 64;
/// Bits per axis of a Morton code.
const MORTON_BITS: u32 = 21;

/// Instances that lie close together. Indices are relative to the drawable's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cell {
    /// Sphere around the spheres of all instances, world space; not a number if one of them is.
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
    first: u32,
    end: u32,
}

impl Cell {
    pub(crate) fn range(&self) -> Range<usize> {
        self.first as usize..self.end as usize
    }
}

/// An instance without its relation to the eye.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacedInstance {
    /// World position of the asset's origin; not a number if any number of the placement is not finite.
    origin: DVec3,
    rotation: [f32; 4],
    scale: f32,
    /// Index within the drawable.
    pub(crate) place: u32,
}

impl PlacedInstance {
    fn new(placement: &Placement, origin: DVec3, place: u32) -> Self {
        let (rotation, scale) = (placement.orientation().to_array(), placement.scale);
        let finite = rotation.iter().chain([&scale]).all(|x| x.is_finite());
        let origin = if finite { placement.to_world(origin) } else { DVec3::NAN };
        Self { origin, rotation, scale, place }
    }

    /// The instance relative to the eye, equal to [`InstanceRaw::new`]; `None` unless all its numbers are finite.
    pub(crate) fn raw(&self, eye: DVec3, states: u32) -> Option<InstanceRaw> {
        let offset = (self.origin - eye).as_vec3();
        let &Self { rotation, scale, .. } = self;
        let raw = InstanceRaw { offset: offset.to_array(), scale, rotation, states, padding: [0; 3] };
        offset.is_finite().then_some(raw)
    }
}

/// A bounding sphere in world space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacedSphere {
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
}

/// The draw of a material of an asset: where its vertices and faces are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PartCall {
    /// Numbers of the material, the page of vertices and the page of faces.
    pub(crate) key: (u64, u32, u32),
    pub(crate) index_count: u32,
    pub(crate) first_index: u32,
    pub(crate) base_vertex: i32,
}

impl PartCall {
    /// The draws of an asset.
    fn of(asset: &AssetGpu) -> impl Iterator<Item = Self> {
        asset.draws().into_iter().flat_map(|(vertices, parts)| {
            parts.map(|part| Self {
                key: (part.material.number, vertices.page(), part.indices.page()),
                index_count: part.faces * 3,
                // Pages are far below 2³¹ elements, and other ranges begin at 0.
                first_index: (part.indices.first() * 3) as u32,
                base_vertex: vertices.first() as i32,
            })
        })
    }
}

/// A drawable, and its instances by cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PlacedDrawable<'a> {
    /// Kinds of materials; `None` if there is nothing to draw.
    pub(crate) look: Option<Look>,
    /// All placements are drawn, as they are.
    pub(crate) has_no_states: bool,
    /// Without bounds: drawn out of view, too.
    pub(crate) unbounded: bool,
    /// Latest birth of a morphing vertex.
    pub(crate) moved_s: f32,
    /// Draws of its materials with faces.
    pub(crate) parts: &'a [PartCall],
    pub(crate) cells: &'a [Cell],
    pub(crate) instances: &'a [PlacedInstance],
    pub(crate) spheres: &'a [PlacedSphere],
    /// A hash of each instance's placement.
    pub(crate) keys: &'a [u64],
}

impl PlacedDrawable<'_> {
    /// Whether vertices may still morph at `time_s`, if a morph takes `morph_s`.
    pub(crate) fn is_moving(&self, time_s: f32, morph_s: f32) -> bool {
        time_s < self.moved_s + morph_s
    }
}

/// What a drawable was when it was last placed.
#[derive(Clone, Debug)]
struct Record {
    asset: u64,
    origin: DVec3,
    sphere: (DVec3, f64),
    /// Number of the states of its parts.
    part_states: u64,
    /// The same if some parts are moved, which changes the instances' spheres; else 0.
    part_moves: u64,
    /// Ranges in the lists.
    instances: Range<usize>,
    cells: Range<usize>,
    parts: Range<usize>,
    /// State of the asset from which follow `look` to `moved_s`, and `parts`.
    stamps: [u64; 3],
    look: Option<Look>,
    has_no_states: bool,
    unbounded: bool,
    moved_s: f32,
}

impl Record {
    fn of(drawable: &Drawable<'_>, first: usize, first_cell: usize, parts: Range<usize>) -> Self {
        let (count, asset) = (drawable.instances.len(), drawable.asset);
        Self {
            asset: asset.number(),
            origin: asset.origin(),
            sphere: asset.sphere(),
            part_states: asset.part_states_version(),
            part_moves: asset.part_moves_version(),
            instances: first..first + count,
            cells: first_cell..first_cell + count.div_ceil(CELL),
            parts,
            stamps: asset.stamps(),
            look: asset.look(),
            has_no_states: asset.has_no_states(),
            unbounded: asset.bounds().is_none(),
            moved_s: asset.moved_s(),
        }
    }

    fn is_of(&self, drawable: &Drawable<'_>) -> bool {
        self.asset == drawable.asset.number() && self.instances.len() == drawable.instances.len()
    }

    fn is_placed_as(&self, drawable: &Drawable<'_>) -> bool {
        let asset = drawable.asset;
        self.origin == asset.origin()
            && self.sphere == asset.sphere()
            && self.part_moves == asset.part_moves_version()
    }

    fn looks_as(&self, drawable: &Drawable<'_>) -> bool {
        self.stamps == drawable.asset.stamps() && self.unbounded == drawable.asset.bounds().is_none()
    }
}

/// The instances of the last frame's drawables. All lists but cells have an element per instance, drawable by drawable.
#[derive(Debug, Default)]
pub(crate) struct PlacedInstances {
    drawables: Vec<Record>,
    /// As given.
    placements: Vec<Placement>,
    /// In the order of cells, as are `spheres` and `keys`.
    instances: Vec<PlacedInstance>,
    spheres: Vec<PlacedSphere>,
    keys: Vec<u64>,
    cells: Vec<Cell>,
    parts: Vec<PartCall>,
    /// Number of changes.
    changes: u64,
    /// By number the assets that were there before the last update with other placements, and those.
    before: BTreeMap<u64, Vec<Placement>>,
    /// By number the assets whose parts had other states before the last update, and the number of those states.
    part_states_before: BTreeMap<u64, u64>,
}

impl PlacedInstances {
    /// Takes a frame's drawables. Cost: a comparison per instance; a sort of the instances of changed drawables.
    pub(crate) fn update(&mut self, drawables: &[Drawable<'_>]) {
        self.before.clear();
        self.part_states_before.clear();
        if self.drawables.len() != drawables.len() {
            return self.rearrange(drawables);
        }
        let mut changed = Vec::new();
        for (number, (record, drawable)) in self.drawables.iter().zip(drawables).enumerate() {
            if !record.is_of(drawable) {
                return self.rearrange(drawables);
            }
            let moved = self.placements[record.instances.clone()] != *drawable.instances;
            let placed = !moved && record.is_placed_as(drawable);
            if !placed || !record.looks_as(drawable) {
                changed.push((number, moved, placed));
            }
        }
        for (number, ..) in changed.iter().filter(|(_, moved, _)| *moved) {
            self.keep(self.drawables[*number].asset);
        }
        let mut resized = false;
        for (number, _, placed) in &changed {
            let (Record { instances, cells, parts, .. }, drawable) =
                (&self.drawables[*number], &drawables[*number]);
            let record = Record::of(drawable, instances.start, cells.start, parts.clone());
            if !placed {
                self.place(&record, drawable);
            }
            let calls: Vec<_> = PartCall::of(drawable.asset).collect();
            match self.parts.get_mut(record.parts.clone()).filter(|parts| parts.len() == calls.len()) {
                Some(parts) => parts.copy_from_slice(&calls),
                None => resized = true,
            }
            let was = std::mem::replace(&mut self.drawables[*number], record);
            if was.part_states != self.drawables[*number].part_states {
                self.part_states_before.insert(was.asset, was.part_states);
            }
        }
        if resized {
            self.parts.clear();
            for (record, drawable) in self.drawables.iter_mut().zip(drawables) {
                let first = self.parts.len();
                self.parts.extend(PartCall::of(drawable.asset));
                record.parts = first..self.parts.len();
            }
        }
        self.changes += u64::from(!changed.is_empty());
    }

    /// Keeps an asset's placements, in the order of its drawables, as those of the frame before.
    fn keep(&mut self, asset: u64) {
        self.before.entry(asset).or_insert_with(|| {
            let own = self.drawables.iter().filter(|record| record.asset == asset);
            own.flat_map(|record| &self.placements[record.instances.clone()]).copied().collect()
        });
    }

    /// Takes other drawables than before, and computes those that have changed.
    fn rearrange(&mut self, drawables: &[Drawable<'_>]) {
        let old = std::mem::take(self);
        let mut by_asset: BTreeMap<u64, Vec<&Record>> = BTreeMap::new();
        for record in &old.drawables {
            by_asset.entry(record.asset).or_default().push(record);
        }
        let mut taken: BTreeMap<u64, usize> = BTreeMap::new();
        self.changes = old.changes + 1;
        let count = drawables.iter().map(|drawable| drawable.instances.len()).sum();
        self.placements.reserve(count);
        self.instances.reserve(count);
        self.spheres.reserve(count);
        self.keys.reserve(count);
        for drawable in drawables {
            let first = self.parts.len();
            self.parts.extend(PartCall::of(drawable.asset));
            let parts = first..self.parts.len();
            let record = Record::of(drawable, self.instances.len(), self.cells.len(), parts);
            let known = by_asset.get(&record.asset).and_then(|records| records.first());
            if let Some(was) = known.filter(|was| was.part_states != record.part_states) {
                self.part_states_before.insert(was.asset, was.part_states);
            }
            let number = taken.entry(record.asset).or_default();
            let was = by_asset.get(&record.asset).and_then(|records| records.get(*number));
            *number += 1;
            let was = was.filter(|was| old.placements[was.instances.clone()] == *drawable.instances);
            if was.is_none()
                && let Some(records) = by_asset.get(&record.asset)
            {
                let all = records.iter().flat_map(|record| &old.placements[record.instances.clone()]);
                self.before.entry(record.asset).or_insert_with(|| all.copied().collect());
            }
            match was.filter(|was| was.is_placed_as(drawable)) {
                Some(was) => {
                    self.placements.extend_from_slice(&old.placements[was.instances.clone()]);
                    self.instances.extend_from_slice(&old.instances[was.instances.clone()]);
                    self.spheres.extend_from_slice(&old.spheres[was.instances.clone()]);
                    self.keys.extend_from_slice(&old.keys[was.instances.clone()]);
                    self.cells.extend_from_slice(&old.cells[was.cells.clone()]);
                }
                None => {
                    self.placements.extend_from_slice(drawable.instances);
                    let none = PlacedInstance::new(&Placement::default(), DVec3::NAN, 0);
                    self.instances.resize(record.instances.end, none);
                    let none = PlacedSphere { centre: DVec3::NAN, radius: 0.0 };
                    self.spheres.resize(record.instances.end, none);
                    self.keys.resize(record.instances.end, 0);
                    let none = Cell { centre: DVec3::NAN, radius: 0.0, first: 0, end: 0 };
                    self.cells.resize(record.cells.end, none);
                    self.place(&record, drawable);
                }
            }
            self.drawables.push(record);
        }
    }

    /// Computes a drawable's part of the lists.
    fn place(&mut self, record: &Record, drawable: &Drawable<'_>) {
        let Record { origin, sphere: (centre, radius), instances, cells, .. } = record.clone();
        self.placements[instances.clone()].copy_from_slice(drawable.instances);
        let has_moves = record.part_moves != 0;
        let sphere = |index: usize, placement: &Placement| {
            let own = if has_moves { drawable.asset.sphere_of(index) } else { (centre, radius) };
            PlacedSphere {
                centre: placement.to_world(origin)
                    + placement.orientation().as_dquat() * (own.0 * f64::from(placement.scale)),
                radius: own.1 * f64::from(placement.scale),
            }
        };
        let centres = drawable.instances.iter().enumerate();
        let order = order(centres.map(|(index, placement)| sphere(index, placement).centre));
        for (&place, at) in order.iter().zip(instances.clone()) {
            let placement = &drawable.instances[place as usize];
            self.instances[at] = PlacedInstance::new(placement, origin, place);
            self.spheres[at] = sphere(place as usize, placement);
            self.keys[at] = key(placement);
        }
        let count = instances.len();
        for (cell, first) in self.cells[cells].iter_mut().zip((0..).step_by(CELL)) {
            let end = count.min(first + CELL);
            let (centre, radius) = around(&self.spheres[instances.start + first..instances.start + end]);
            *cell = Cell { centre, radius, first: first as u32, end: end as u32 };
        }
    }

    /// The drawables of the frame.
    pub(crate) fn drawables(&self) -> impl Iterator<Item = PlacedDrawable<'_>> {
        self.drawables.iter().map(|record| self.of(record))
    }

    /// A drawable of the frame.
    pub(crate) fn drawable(&self, number: usize) -> Option<PlacedDrawable<'_>> {
        self.drawables.get(number).map(|record| self.of(record))
    }

    fn of(&self, record: &Record) -> PlacedDrawable<'_> {
        let Record { instances, cells, parts, .. } = record;
        PlacedDrawable {
            look: record.look,
            has_no_states: record.has_no_states,
            unbounded: record.unbounded,
            moved_s: record.moved_s,
            parts: &self.parts[parts.clone()],
            cells: &self.cells[cells.clone()],
            instances: &self.instances[instances.clone()],
            spheres: &self.spheres[instances.clone()],
            keys: &self.keys[instances.clone()],
        }
    }

    /// Number of changes: equal for frames with the same drawables, in the same state and the same places.
    pub(crate) fn changes(&self) -> u64 {
        self.changes
    }

    /// Whether vertices of any drawable may still morph at `time_s`, if a morph takes `morph_s`.
    pub(crate) fn are_moving(&self, time_s: f32, morph_s: f32) -> bool {
        self.drawables.iter().any(|record| time_s < record.moved_s + morph_s)
    }

    /// Placements before the last update of the assets that have moved by it, by asset number; those of an asset's
    /// drawables together.
    pub(crate) fn before(&self) -> &BTreeMap<u64, Vec<Placement>> {
        &self.before
    }

    /// Numbers of the states before the last update of the parts whose states it changed, by asset number.
    pub(crate) fn part_states_before(&self) -> &BTreeMap<u64, u64> {
        &self.part_states_before
    }
}

/// An order in which consecutive points lie close together: by Morton code (Morton 1966), or as they are if they fit
/// a cell.
fn order(points: impl ExactSizeIterator<Item = DVec3> + Clone) -> Vec<u32> {
    let count = points.len() as u32;
    if points.len() <= CELL {
        return (0..count).collect();
    }
    let finite = points.clone().filter(|point| point.is_finite());
    let (low, high) = finite
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(point), high.max(point)));
    // `as` maps what is not a number to 0.
    let scale = (f64::from(1_u32 << MORTON_BITS) - 1.0) / (high - low).max_element().max(f64::MIN_POSITIVE);
    let code = |point: DVec3| {
        let cell = (point - low) * scale;
        spread(cell.x as u64) | spread(cell.y as u64) << 1 | spread(cell.z as u64) << 2
    };
    let mut all: Vec<(u64, u32)> = points.map(code).zip(0..count).collect();
    all.sort_unstable();
    all.into_iter().map(|(_, index)| index).collect()
}

/// The low bits of a number, two zeros between each.
fn spread(x: u64) -> u64 {
    let x = x & ((1 << MORTON_BITS) - 1);
    let x = (x | x << 32) & 0x001f_0000_0000_ffff;
    let x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    let x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    let x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// A sphere around spheres.
fn around(spheres: &[PlacedSphere]) -> (DVec3, f64) {
    if let [one] = spheres {
        return (one.centre, one.radius);
    }
    if spheres.iter().any(|sphere| !sphere.centre.is_finite() || !sphere.radius.is_finite()) {
        return (DVec3::NAN, f64::NAN);
    }
    let ends = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = spheres.iter().fold(ends, |(low, high), sphere| {
        (low.min(sphere.centre - sphere.radius), high.max(sphere.centre + sphere.radius))
    });
    let centre = 0.5 * (low + high);
    let reach = spheres.iter().map(|sphere| sphere.centre.distance(centre) + sphere.radius);
    // Rounding must not leave an instance outside.
    (centre, reach.fold(0.0, f64::max) * (1.0 + 1e-9) + 1e-12 * centre.abs().max_element())
}

/// A hash of a placement: SplitMix64's mixing function (Steele et al. 2014) over its words.
fn key(placement: &Placement) -> u64 {
    let Placement { translation, rotation, scale } = placement;
    let pair = |a: f32, b: f32| u64::from(a.to_bits()) << 32 | u64::from(b.to_bits());
    let [x, y, z, w] = *rotation;
    let words = translation.map(f64::to_bits).into_iter().chain([pair(x, y), pair(z, w), pair(*scale, 0.0)]);
    words.fold(0, |key: u64, word| {
        let mixed = (key ^ word).wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ mixed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    })
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::frame::camera::{Frustum, Side};
    use crate::tests::headless;
    use crate::{Material, Pose};

    /// Placements at pseudorandom places.
    fn places(count: u32, mut state: u32) -> Vec<Placement> {
        let mut random = || {
            // Numerical Recipes' generator.
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24) - 0.5
        };
        (0..count)
            .map(|_| {
                let at = DVec3::new(random(), random(), random()) * 60.0;
                Placement::new(at, DQuat::from_rotation_y(9.0 * random()), (random() + 1.0) as f32)
            })
            .collect()
    }

    #[test]
    fn cells_hold_their_instances_and_agree_with_them_about_what_is_in_view() {
        let Some(h) = headless(1, 1) else { return };
        let mut asset = h.renderer().create_asset(h.gpu(), DVec3::X, &[Material::default()], &[]);
        asset.set_bounds(DVec3::new(0.2, 0.1, -0.3), 0.7);
        let mut all = places(20_000, 1);
        all[7].translation[1] = f64::NAN;
        all[8].rotation[2] = f32::INFINITY;
        all[9].scale = f32::NAN;
        let mut placed = PlacedInstances::default();
        placed.update(&[Drawable { asset: &asset, instances: &all }]);
        let PlacedDrawable { cells, instances, spheres, .. } = placed.drawable(0).unwrap();
        let mut found: Vec<u32> = instances.iter().map(|instance| instance.place).collect();
        found.sort_unstable();
        assert!(found.into_iter().eq(0..20_000));
        let camera = Pose::look_at(DVec3::new(3.0, 9.0, 40.0), DVec3::ZERO, DVec3::Y, 0.9);
        let frustum = Frustum::new(&camera, (160, 90));
        let mut sides = [0; 3];
        for cell in cells {
            let side = frustum.side(cell.centre - camera.eye, cell.radius);
            sides[side as usize] += 1;
            for at in cell.range() {
                let PlacedSphere { centre, radius } = spheres[at];
                let seen = frustum.side(centre - camera.eye, radius) != Side::Out;
                assert!(side == Side::Across || seen == (side == Side::In), "{cell:?} {at}");
                let placement = &all[instances[at].place as usize];
                let raw = InstanceRaw::new(placement, DVec3::X, camera.eye);
                let finite = !(7..10).contains(&instances[at].place);
                assert_eq!(instances[at].raw(camera.eye, 0), finite.then_some(raw));
                let (near, r) = raw.sphere((DVec3::new(0.2, 0.1, -0.3), 0.7));
                assert!(!finite || (near + camera.eye).distance(centre) < 1e-4 && r == radius);
            }
        }
        assert!(sides.iter().all(|count| *count > 0), "{sides:?}");
    }

    #[test]
    fn updates_equal_a_fresh_start_and_tell_what_moved() {
        let Some(h) = headless(1, 1) else { return };
        let make = |radius| {
            let mut asset = h.renderer().create_asset(h.gpu(), DVec3::ZERO, &[Material::default()], &[]);
            asset.set_bounds(DVec3::ZERO, radius);
            asset
        };
        let (mut assets, mut all) = ([make(0.5), make(1.0), make(2.0)], [300, 1, 70].map(|n| places(n, n)));
        let mut placed = PlacedInstances::default();
        let mut check = |assets: &[crate::AssetGpu; 3], all: &[Vec<Placement>; 3], order: &[usize]| {
            let of = |i: &usize| Drawable { asset: &assets[*i], instances: &all[*i] };
            let drawables: Vec<_> = order.iter().map(of).collect();
            let changes = placed.changes();
            placed.update(&drawables);
            let mut fresh = PlacedInstances::default();
            fresh.update(&drawables);
            let text = |placed: &PlacedInstances| {
                placed.drawables().map(|drawable| format!("{drawable:?}")).collect::<Vec<_>>()
            };
            assert_eq!(text(&placed), text(&fresh));
            let moved = placed
                .before()
                .keys()
                .map(|number| assets.iter().position(|asset| asset.number() == *number).unwrap());
            (placed.changes() > changes, moved.collect::<Vec<_>>())
        };
        assert_eq!(check(&assets, &all, &[0, 1, 2]), (true, vec![]));
        assert_eq!(check(&assets, &all, &[0, 1, 2]), (false, vec![]));
        all[0][17].scale = 3.0;
        assert_eq!(check(&assets, &all, &[0, 1, 2]), (true, vec![0]));
        assets[2].set_bounds(DVec3::X, 2.0);
        assert_eq!(check(&assets, &all, &[0, 1, 2]), (true, vec![]));
        assert_eq!(check(&assets, &all, &[2, 0]), (true, vec![]), "another order, and one is gone");
        all[2].pop();
        assert_eq!(check(&assets, &all, &[1, 2, 0]), (true, vec![2]), "another number");
        assert_eq!(check(&assets, &all, &[1, 2, 0]), (false, vec![]));
    }
}
