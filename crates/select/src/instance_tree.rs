//! Bounding sphere hierarchy of a scene's instances, built once and queried for each view.
//!
//! Leaves hold up to [`LEAF`] neighbouring instances of one asset, found along a Z-order curve (Morton 1966). Each
//! sphere above them bounds [`FAN`] neighbours, level by level up to one. A query returns a superset of the instances
//! that pass the exact tests: those are in f32, so the hierarchy tests in f64 with a tolerance above the rounding of
//! f32.

use std::cmp::Reverse;

use glam::{DVec3, Vec3};

use super::project::Projection;
use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::proxy::Proxies;

/// Most instances of a leaf.
const LEAF: usize = 16;
/// Most children of a sphere.
const FAN: usize = 8;
/// Rounding error of the exact tests relative to the distance: some multiples of 2⁻²⁴.
const SLACK: f64 = 1e-6;
/// Beyond this the exact tests may overflow f32, so nothing is culled.
const FAR: f64 = 1e18;
/// Bits per axis of a position on the curve.
const CURVE_BITS: u32 = 21;

/// A sphere that bounds others; of infinite radius if they are unbounded.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BoundingSphere {
    center: DVec3,
    radius: f64,
    /// Radius of the largest instance in it.
    largest: f64,
}

impl BoundingSphere {
    /// Bounds spheres, centred in the bounding box of their centres.
    fn about(balls: &[Self]) -> Self {
        let [mut low, mut high] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for ball in balls {
            low = low.min(ball.center);
            high = high.max(ball.center);
        }
        let center = low.midpoint(high);
        let reach = |ball: &Self| ball.center.distance(center) + ball.radius;
        let radius = balls.iter().map(reach).fold(0.0, f64::max);
        let largest = balls.iter().map(|ball| ball.largest).fold(0.0, f64::max);
        if radius.is_finite() { Self { center, radius, largest } } else { Self::everywhere() }
    }

    const fn everywhere() -> Self {
        Self { center: DVec3::ZERO, radius: f64::INFINITY, largest: f64::INFINITY }
    }

    /// Upper bound on the screen radius of its instances in pixels, for the distance of its centre from the eye.
    fn widest_px(&self, distance: f64, scale_px: f64) -> f64 {
        let nearest = distance - self.radius;
        if nearest > 0.0 { self.largest * scale_px / nearest * (1.0 + 1e-5) } else { f64::INFINITY }
    }
}

/// A query of the hierarchy: a volume that spheres must reach into, and their least size.
#[derive(Clone, Copy, Debug)]
pub(super) struct TreeQuery {
    eye: DVec3,
    /// Inward normals of the planes through the eye: the near plane and the four sides.
    planes: [DVec3; 5],
    fall: Option<ShadowVolume>,
    /// Least radius on the screen, and pixels per unit of tangent.
    least_px: f64,
    scale_px: f64,
}

/// The sweep of shadows: away from the sun, down to the lowest receiver.
#[derive(Clone, Copy, Debug)]
struct ShadowVolume {
    to_sun: DVec3,
    lowest: f64,
}

impl TreeQuery {
    /// Query for spheres that reach into the frustum.
    pub(super) fn in_view(projection: &Projection) -> Self {
        let frustum = projection.frustum();
        let [a, b, c, d] = frustum.sides;
        let planes = [frustum.forward, a, b, c, d].map(|normal| normal.as_dvec3());
        let scale_px = projection.scale_px();
        Self { eye: projection.eye().into(), planes, fall: None, least_px: 0.0, scale_px }
    }

    /// Query for spheres in the frustum with a screen radius of at least `least_px`.
    pub(super) fn in_view_from(projection: &Projection, least_px: f32) -> Self {
        Self { least_px: f64::from(least_px), ..Self::in_view(projection) }
    }

    /// Query for spheres that reach into the frustum when swept away from the sun, down to `lowest` (along `to_sun`,
    /// from the eye).
    pub(super) fn casting(projection: &Projection, to_sun: Vec3, lowest: f32) -> Self {
        let fall = ShadowVolume { to_sun: to_sun.as_dvec3(), lowest: f64::from(lowest) };
        Self { fall: Some(fall), ..Self::in_view(projection) }
    }

    /// Conservative test: false only if no instance in the sphere passes the exact test.
    fn reaches(&self, ball: &BoundingSphere) -> bool {
        let center = ball.center - self.eye;
        let size = center.abs().element_sum() + ball.radius;
        // NaN is not culled either.
        if size.is_nan() || size > FAR {
            return true;
        }
        if ball.widest_px(center.length(), self.scale_px) < self.least_px {
            return false;
        }
        let radius = ball.radius + SLACK * size;
        let Some(ShadowVolume { to_sun, lowest }) = self.fall else {
            return self.planes.iter().all(|normal| normal.dot(center) >= -radius);
        };
        let fall = to_sun.dot(center) + radius - lowest;
        if fall <= 0.0 {
            return false;
        }
        let way = to_sun * -fall;
        let slack = SLACK * fall;
        let [mut from, mut to] = [0.0_f64, 1.0];
        for normal in &self.planes {
            let (inside, slope) = (normal.dot(center) + radius + slack, normal.dot(way));
            if slope > slack {
                from = from.max(-inside / slope);
            } else if slope < -slack {
                to = to.min(-inside / slope);
            } else if inside + slack < 0.0 {
                return false;
            }
        }
        // Both ends are quotients of rounded numbers.
        from <= to + 1e-5
    }
}

/// Bounding sphere hierarchy of instances.
#[derive(Clone, Debug, Default)]
pub struct InstanceTree {
    /// Instance numbers, leaf by leaf.
    numbers: Vec<u32>,
    /// Start of each leaf in `numbers`, and the end.
    begins: Vec<u32>,
    balls: Vec<BoundingSphere>,
    /// The first leaf of each asset, and the end.
    leaves_of: Vec<u32>,
    /// Leaves in order of the curve, as the first level above bounds them.
    along: Vec<u32>,
    /// From fine to coarse.
    levels: Vec<Vec<BoundingSphere>>,
}

impl InstanceTree {
    /// Builds the hierarchy of instances, numbered in order, up to the first whose asset is not known. `asset`
    /// returns an asset's entry. O(n log n); some 10 bytes per instance.
    #[must_use]
    pub fn new<'a>(
        instances: impl Iterator<Item = &'a Instance>,
        asset: impl Fn(u32) -> Option<&'a AssetEntry>,
    ) -> Self {
        let placed = (0_u32..).zip(instances).map_while(|(number, instance)| {
            let entry = asset(instance.asset)?;
            Some((instance.asset, number, ball(entry, instance)))
        });
        let placed: Vec<(u32, u32, BoundingSphere)> = placed.collect();
        let curve = Curve::through(placed.iter().map(|(_, _, ball)| ball.center));
        let mut order: Vec<(u32, u64, u32)> =
            placed.iter().map(|(asset, number, ball)| (*asset, curve.place(ball.center), *number)).collect();
        order.sort_unstable();
        let mut tree = Self::default();
        tree.begins.push(0);
        let mut of_leaf = Vec::with_capacity(LEAF);
        for same in order.chunk_by(|a, b| a.0 == b.0) {
            let leaves = length(tree.balls.len());
            tree.leaves_of.resize(same[0].0 as usize + 1, leaves);
            for leaf in same.chunks(LEAF) {
                of_leaf.clear();
                of_leaf.extend(leaf.iter().map(|(_, _, number)| placed[*number as usize].2));
                tree.numbers.extend(leaf.iter().map(|(_, _, number)| number));
                tree.begins.push(length(tree.numbers.len()));
                tree.balls.push(BoundingSphere::about(&of_leaf));
            }
        }
        tree.leaves_of.push(length(tree.balls.len()));
        tree.raise(&curve);
        tree
    }

    /// Builds the levels above the leaves.
    fn raise(&mut self, curve: &Curve) {
        self.along = (0..length(self.balls.len())).collect();
        self.along.sort_by_cached_key(|leaf| curve.place(self.balls[*leaf as usize].center));
        let mut below: Vec<BoundingSphere> =
            self.along.iter().map(|leaf| self.balls[*leaf as usize]).collect();
        while below.len() > 1 {
            below = below.chunks(FAN).map(BoundingSphere::about).collect();
            self.levels.push(below.clone());
        }
    }

    /// Number of instances in it: the first ones of the scene.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether it has no instances.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// Whether it has an instance of an asset.
    pub fn places(&self, asset: u32) -> bool {
        !self.leaves(asset).is_empty()
    }

    fn leaves(&self, asset: u32) -> std::ops::Range<usize> {
        let at = |asset: usize| self.leaves_of.get(asset).map_or(self.balls.len(), |leaf| *leaf as usize);
        at(asset as usize)..at((asset as usize).saturating_add(1))
    }

    fn of_leaf(&self, leaf: usize) -> &[u32] {
        &self.numbers[self.begins[leaf] as usize..self.begins[leaf + 1] as usize]
    }

    /// Numbers of the instances that may be in view, ascending. Conservative.
    pub fn in_view(&self, projection: &Projection) -> Vec<u32> {
        let mut found = IndexSet::default();
        self.find(&TreeQuery::in_view(projection), &mut found);
        found.numbers
    }

    /// Finds the instances that may match a query, ascending. Conservative.
    pub(super) fn find(&self, sought: &TreeQuery, found: &mut IndexSet) {
        found.bits.clear();
        found.bits.resize(self.numbers.len().div_ceil(64), 0);
        // Levels count from the leaves, which are level 0.
        let mut open: Vec<(usize, usize)> = Vec::new();
        let roots = self.levels.last().map_or(self.along.len(), Vec::len);
        open.extend((0..roots).map(|at| (self.levels.len(), at)));
        while let Some((level, at)) = open.pop() {
            if let Some(above) = level.checked_sub(1) {
                if sought.reaches(&self.levels[above][at]) {
                    let below =
                        above.checked_sub(1).map_or(self.along.len(), |level| self.levels[level].len());
                    open.extend((at * FAN..below.min((at + 1) * FAN)).map(|at| (above, at)));
                }
                continue;
            }
            let leaf = self.along[at] as usize;
            if sought.reaches(&self.balls[leaf]) {
                for &number in self.of_leaf(leaf) {
                    found.bits[number as usize / 64] |= 1 << (number % 64);
                }
            }
        }
        found.list();
    }

    /// The instance of an asset with the largest screen radius, in view or not, and that radius in pixels; the first of
    /// several.
    pub fn largest(
        &self,
        asset: u32,
        projection: &Projection,
        radius_px: impl Fn(u32) -> f32,
    ) -> Option<(u32, f32)> {
        let mut best: Option<(f32, Reverse<u32>)> = None;
        for leaf in self.leaves(asset) {
            let ball = &self.balls[leaf];
            let widest_px =
                ball.widest_px(ball.center.distance(projection.eye().into()), projection.scale_px());
            if best.is_some_and(|(px, _)| widest_px < f64::from(px)) {
                continue;
            }
            for &number in self.of_leaf(leaf) {
                let px = radius_px(number);
                if best.is_none_or(|best| (px, Reverse(number)) > best) {
                    best = Some((px, Reverse(number)));
                }
            }
        }
        best.map(|(px, Reverse(number))| (number, px))
    }
}

fn ball(asset: &AssetEntry, instance: &Instance) -> BoundingSphere {
    let center = instance.to_world(asset.origin, asset.sphere.center);
    let radius = f64::from(asset.sphere.radius * instance.placement.scale);
    let known = center.is_finite() && radius.is_finite();
    if known { BoundingSphere { center, radius, largest: radius } } else { BoundingSphere::everywhere() }
}

/// Converts a count; scenes have fewer than 2³² of anything.
fn length(length: usize) -> u32 {
    u32::try_from(length).unwrap_or(u32::MAX)
}

/// A scene's instances, optionally with a hierarchy of the first ones.
#[derive(Clone, Copy, Debug)]
pub struct Instances<'a> {
    all: &'a [Instance],
    tree: Option<&'a InstanceTree>,
    proxies: Option<&'a Proxies>,
}

impl<'a> From<&'a [Instance]> for Instances<'a> {
    fn from(all: &'a [Instance]) -> Self {
        Self { all, tree: None, proxies: None }
    }
}

impl<'a> Instances<'a> {
    /// All instances of a scene, and a hierarchy of the first ones.
    ///
    /// # Panics
    /// If the hierarchy has more instances than there are.
    #[must_use]
    pub fn new(all: &'a [Instance], tree: &'a InstanceTree) -> Self {
        assert!(tree.len() <= all.len(), "the hierarchy is of other instances");
        Self { all, tree: Some(tree), proxies: None }
    }

    /// With proxies, which are drawn instead of instances that are small on the screen.
    #[must_use]
    pub const fn with_proxies(self, proxies: &'a Proxies) -> Self {
        Self { proxies: Some(proxies), ..self }
    }

    /// The proxies, if there are any.
    pub(super) fn proxies(&self) -> Option<&'a Proxies> {
        self.proxies.filter(|proxies| !proxies.is_empty())
    }

    /// All instances, by number.
    #[must_use]
    pub const fn all(&self) -> &'a [Instance] {
        self.all
    }

    /// Finds the instances that may match a query, ascending; with all that are not in the hierarchy. Conservative.
    pub(super) fn find(&self, sought: &TreeQuery, found: &mut IndexSet) {
        found.numbers.clear();
        let known = self.tree.map_or(0, |tree| {
            tree.find(sought, found);
            tree.len()
        });
        found.numbers.extend(length(known)..length(self.all.len()));
    }

    /// Whether the hierarchy has an instance of an asset.
    pub(super) fn places(&self, asset: u32) -> bool {
        self.tree.is_some_and(|tree| tree.places(asset))
    }

    /// Radius on the screen of the largest instance of an asset that the hierarchy knows, in pixels, in view or not; 0
    /// where there is none.
    pub(super) fn coverage_px(&self, number: u32, asset: &AssetEntry, projection: &Projection) -> f32 {
        let radius_px = |instance: u32| projection.coverage_px(asset, &self.all[instance as usize]);
        let largest = self.tree.and_then(|tree| tree.largest(number, projection, radius_px));
        largest.map_or(0.0, |(_, px)| px)
    }
}

/// Numbers of instances that were found.
#[derive(Clone, Debug, Default)]
pub(super) struct IndexSet {
    bits: Vec<u64>,
    numbers: Vec<u32>,
}

impl IndexSet {
    fn list(&mut self) {
        self.numbers.clear();
        for (word, &bits) in (0_u32..).zip(&self.bits) {
            let mut bits = bits;
            while bits != 0 {
                self.numbers.push(word * 64 + bits.trailing_zeros());
                bits &= bits - 1;
            }
        }
    }

    /// Ascending.
    pub(super) fn numbers(&self) -> &[u32] {
        &self.numbers
    }
}

/// The Z-order curve through a box.
#[derive(Clone, Copy, Debug)]
struct Curve {
    low: DVec3,
    per_unit: DVec3,
}

impl Curve {
    fn through(points: impl Iterator<Item = DVec3>) -> Self {
        let [mut low, mut high] = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for point in points {
            low = low.min(point);
            high = high.max(point);
        }
        let steps = f64::from((1_u32 << CURVE_BITS) - 1);
        Self { low, per_unit: DVec3::splat(steps) / (high - low).max(DVec3::splat(f64::MIN_POSITIVE)) }
    }

    fn place(&self, point: DVec3) -> u64 {
        let at = (point - self.low) * self.per_unit;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
        let [x, y, z] = at.to_array().map(|along| spread((along as u64).min((1 << CURVE_BITS) - 1)));
        x | y << 1 | z << 2
    }
}

/// Two zeros between any two of the lowest 21 bits.
const fn spread(bits: u64) -> u64 {
    let bits = (bits | bits << 32) & 0x001f_0000_0000_ffff;
    let bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
    let bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
    let bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
    (bits | bits << 2) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use lodestream_scene::placement::Placement;
    use lodestream_scene::view::View;

    fn asset(radius: f32) -> AssetEntry {
        let mut asset = AssetEntry { origin: [3.0, -1.0, 0.5], ..AssetEntry::default() };
        (asset.sphere.center, asset.sphere.radius) = ([0.1, 0.2, -0.1], radius);
        asset
    }

    fn placed() -> impl Strategy<Value = Instance> {
        let at = prop_oneof![
            8 => prop::array::uniform3(-100.0..100.0_f64),
            1 => prop::array::uniform3(-1e9..1e9_f64),
            1 => Just([1e300, 0.0, -1e300]),
            1 => Just([5.0; 3]),
        ];
        (0_u32..5, at, prop_oneof![8 => 0.01..3.0_f32, 1 => Just(1e30_f32), 1 => Just(1e-30_f32)]).prop_map(
            |(asset, at, scale)| Instance { asset, placement: Placement { scale, ..Placement::at(at) } },
        )
    }

    fn eyes() -> impl Strategy<Value = View> {
        let points = prop::array::uniform3(-120.0..120.0_f64);
        (points.clone(), points, 0.01..3.0_f32, prop_oneof![3 => Just(0.0), 1 => Just(1e9)]).prop_map(
            |(eye, target, fov, far)| {
                let shifted = |at: [f64; 3]| at.map(|x| x + far);
                View::look_at(shifted(eye), shifted(target), [0.0, 1.0, 0.0], fov, [640, 360])
            },
        )
    }

    proptest! {
        #[test]
        fn hierarchy_misses_no_instance_that_passes_the_exact_test(
            instances in prop::collection::vec(placed(), 0..400),
            view in eyes(),
            sun in prop::array::uniform3(-1.0..1.0_f32),
            lowest in -50.0..50.0_f32,
            least_px in 0.1..100.0_f32,
        ) {
            let assets: Vec<AssetEntry> = [0.5, 2.0, 0.0, 40.0, 1.0].map(asset).into();
            let tree = InstanceTree::new(instances.iter(), |number| assets.get(number as usize));
            prop_assert_eq!(tree.len(), instances.len());
            let projection = Projection::new(&view);
            let mut found = IndexSet::default();
            tree.find(&TreeQuery::in_view(&projection), &mut found);
            prop_assert!(found.numbers().is_sorted());
            let sphere = |at: usize| {
                let instance = &instances[at];
                projection.sphere(&assets[instance.asset as usize], instance)
            };
            for at in 0..instances.len() {
                let (center, radius) = sphere(at);
                let known = found.numbers().binary_search(&length(at)).is_ok();
                prop_assert!(known || !projection.sees(center, radius), "{}", at);
            }
            tree.find(&TreeQuery::in_view_from(&projection, least_px), &mut found);
            for (at, instance) in instances.iter().enumerate() {
                let bounds = projection.bounds(&assets[instance.asset as usize], instance);
                let known = found.numbers().binary_search(&length(at)).is_ok();
                prop_assert!(known || !bounds.visible || bounds.coverage_px < least_px, "{}", at);
            }
            let to_sun = Vec3::from(sun).normalize_or(Vec3::Y);
            tree.find(&TreeQuery::casting(&projection, to_sun, lowest), &mut found);
            for at in 0..instances.len() {
                let (center, radius) = sphere(at);
                let fall = to_sun.dot(center) + radius - lowest;
                let casts = fall > 0.0 && projection.shadow_depth(center, radius, to_sun * -fall).is_some();
                let known = found.numbers().binary_search(&length(at)).is_ok();
                prop_assert!(known || !casts, "{}", at);
            }
            let all = Instances::new(&instances, &tree);
            for (number, entry) in (0_u32..).zip(&assets) {
                let of = instances.iter().filter(|instance| instance.asset == number);
                let largest = of.clone().map(|instance| projection.coverage_px(entry, instance));
                prop_assert_eq!(all.coverage_px(number, entry, &projection), largest.fold(0.0, f32::max));
                prop_assert_eq!(all.places(number), of.count() > 0);
            }
        }
    }

    #[test]
    fn branches_out_of_view_are_not_visited() {
        let side = 100_u32;
        let at = |number: u32| [f64::from(number % side), 0.0, f64::from(number / side)];
        let instances: Vec<Instance> = (0..side * side).map(|n| Instance::at(0, at(n))).collect();
        let mut entry = asset(0.4);
        entry.origin = [0.0; 3];
        let tree = InstanceTree::new(instances.iter(), |_| Some(&entry));
        let eye = [50.0, 1.0, 50.0];
        let view = View::look_at(eye, [60.0, 0.0, 50.0], [0.0, 1.0, 0.0], 0.5, [640, 360]);
        let projection = Projection::new(&view);
        let seen = instances.iter().filter(|it| projection.bounds(&entry, it).visible).count();
        let found = tree.in_view(&projection).len();
        assert!(seen > 500 && found < 2 * seen && 2 * seen < instances.len(), "{found} for {seen}");
        // Instances after the first one of an unknown asset are not known either.
        let tree = InstanceTree::new(instances.iter(), |_| None);
        assert!(tree.is_empty() && tree.in_view(&projection).is_empty() && !tree.places(0));
    }
}
