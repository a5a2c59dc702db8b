//! Which part of the scene a ray meets, and where parts are: from the meshes that are drawn, without a request.

use glam::DVec3;
use lodestream_geometry::mesh::skin::Skin;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_scene::animation::SkinPose;
use lodestream_scene::description::Instance;
use lodestream_scene::parts::ScenePart;
use lodestream_scene::placement::Placement;
use lodestream_scene::proxy::Proxy;
use lodestream_scene::section::SectionPlanes;

use super::ClientCore;

/// A ray in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Its origin, world units.
    pub origin: DVec3,
    /// Its direction, of any length but 0.
    pub direction: DVec3,
}

/// The nearest surface on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Number of the instance that was hit.
    pub instance: u32,
    /// Number of the part within it. `None` if a proxy stands for the instance, which does not know its parts: give it to
    /// [`ClientCore::pin_instances`], and pick again when it is drawn itself.
    pub part: Option<u32>,
    /// Where, world units.
    pub place: DVec3,
    /// Distance from the ray's origin, world units.
    pub distance: f64,
}

impl Hit {
    /// The part that was hit, if it is known.
    #[must_use]
    pub fn scene_part(&self) -> Option<ScenePart> {
        self.part.map(|part| ScenePart { instance: self.instance, part })
    }
}

/// Bounds of a part as it is drawn, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartBounds {
    /// Corners of the box along the world's axes: lowest and highest coordinates.
    pub extent: [DVec3; 2],
    /// Centre of the box and of the sphere.
    pub centre: DVec3,
    /// Radius of a sphere about the centre that contains the part.
    pub radius: f64,
}

/// Instances whose faces are searched between two passes over the scene.
const CANDIDATES: usize = 16;
/// Spheres are of f32: rounding of their centre and radius, as a share of both.
const SPHERE_ROUNDING: f64 = 1e-6;

/// An instance whose sphere the ray meets; ordered by distance, then number.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    /// Distance at which the ray enters the sphere, world units.
    enters: f64,
    instance: u32,
}

impl Candidate {
    fn is_before(&self, other: &Self) -> bool {
        self.enters.total_cmp(&other.enters).then(self.instance.cmp(&other.instance)).is_lt()
    }
}

impl ClientCore {
    /// The nearest face that a ray meets, from either side, at the current refinement; parts for which `is_hidden`
    /// holds are skipped, and moved ones count where they are. Of equally near parts the lowest counts. Opacity, morphs,
    /// terrain and its exaggeration are ignored. `None` too for a ray that is not finite or has no direction.
    ///
    /// Cost: a pass over the scene's instances, and one over the faces of each mesh whose bounding sphere the ray meets
    /// before the hit. Memory does not depend on the scene.
    #[must_use]
    pub fn pick(&self, ray: Ray, is_hidden: impl Fn(ScenePart) -> bool) -> Option<Hit> {
        let length = ray.direction.length();
        let direction = ray.direction / length;
        if !ray.origin.is_finite() || !direction.is_finite() {
            return None;
        }
        let nearest = self.pick_instance(ray.origin, direction, &is_hidden);
        self.pick_proxy(ray.origin, direction, &is_hidden, nearest)
    }

    /// The same where section planes cut the scene: the nearest face on the part of the ray that they leave. On a cap that is
    /// the face behind it, of the part that the cap belongs to.
    #[must_use]
    pub fn pick_cut(
        &self,
        ray: Ray,
        planes: &SectionPlanes,
        is_hidden: impl Fn(ScenePart) -> bool,
    ) -> Option<Hit> {
        let [from, to] = planes.kept_stretch(ray.origin, ray.direction)?;
        let length = ray.direction.length();
        let hit = self.pick(Ray { origin: ray.origin + ray.direction * from, ..ray }, is_hidden)?;
        let distance = from * length + hit.distance;
        (distance <= to * length).then_some(Hit { distance, ..hit })
    }

    /// The nearest face of the proxies that are drawn, if it is before `nearest`. A part of a proxy is an instance.
    fn pick_proxy(
        &self,
        origin: DVec3,
        direction: DVec3,
        is_hidden: &impl Fn(ScenePart) -> bool,
        mut nearest: Option<Hit>,
    ) -> Option<Hit> {
        for (number, proxy) in self.scene.drawn_proxies() {
            let Some(mesh) = self.mesh(proxy.asset) else { continue };
            let instance = |part: u32| proxy.first_instance.saturating_add(part);
            // An instance with a part that has a state is drawn itself.
            let skip = |part: u32| {
                self.scene.cut().hides(number, part)
                    || is_hidden(ScenePart { instance: instance(part), part: 0 })
            };
            let from = origin - DVec3::from(mesh.grid().origin);
            let most = nearest.map_or(f64::INFINITY, |hit| hit.distance);
            let hit = mesh.cast_ray(from.to_array(), direction.to_array(), most, skip);
            if let Some(hit) = hit.filter(|hit| hit.distance < most) {
                let (instance, place) = (instance(hit.part), origin + direction * hit.distance);
                let is_whole = self.placed_mesh(instance).is_some_and(|(_, mesh)| mesh.part_count() <= 1);
                nearest = Some(Hit { instance, part: is_whole.then_some(0), place, distance: hit.distance });
            }
        }
        nearest
    }

    fn pick_instance(
        &self,
        origin: DVec3,
        direction: DVec3,
        is_hidden: &impl Fn(ScenePart) -> bool,
    ) -> Option<Hit> {
        let mut nearest: Option<Hit> = None;
        let mut searched = None;
        loop {
            let farthest = nearest.map_or(f64::INFINITY, |hit| hit.distance);
            let candidates = self.candidates(origin, direction, searched, farthest);
            for candidate in &candidates {
                let most = nearest.map_or(f64::INFINITY, |hit| hit.distance);
                if candidate.enters > most {
                    return nearest;
                }
                let found = self.cast(candidate.instance, origin, direction, most, is_hidden);
                let is_nearer = |found: &Hit| {
                    nearest.is_none_or(|hit| {
                        let (one, other) = ((found.instance, found.part), (hit.instance, hit.part));
                        found.distance.total_cmp(&hit.distance).then(one.cmp(&other)).is_lt()
                    })
                };
                nearest = found.filter(is_nearer).or(nearest);
            }
            if candidates.len() < CANDIDATES {
                return nearest;
            }
            searched = candidates.last().copied();
        }
    }

    /// The first instances along a ray after `searched`, at most [`CANDIDATES`], in order.
    fn candidates(
        &self,
        origin: DVec3,
        direction: DVec3,
        searched: Option<Candidate>,
        farthest: f64,
    ) -> Vec<Candidate> {
        let mut found: Vec<Candidate> = Vec::with_capacity(CANDIDATES + 1);
        let drawn =
            (0..).zip(self.scene.instances().all()).filter(|(number, _)| self.scene.is_drawn(*number));
        for (number, instance) in drawn {
            let Some(state) = self.scene.states.get(instance.asset as usize) else { continue };
            let (entry, placement) = (state.entry(), &instance.placement);
            let centre = DVec3::from(entry.sphere.center.map(f64::from));
            // Coarse surfaces may lie outside the input's sphere, by their error.
            let radius = f64::from(entry.sphere.radius) + f64::from(entry.root_error);
            let rounding = SPHERE_ROUNDING * (centre.length() + radius);
            let sphere = (DVec3::from(entry.origin) + centre, radius + rounding);
            let (centre, radius) = self.moved.sphere(number, placement, sphere);
            let Some(enters) = entry_into(origin, direction, centre, radius) else { continue };
            let candidate = Candidate { enters, instance: number };
            let is_new = searched.is_none_or(|searched| searched.is_before(&candidate));
            if enters <= farthest && is_new {
                let at = found.partition_point(|other| other.is_before(&candidate));
                found.insert(at, candidate);
                found.truncate(CANDIDATES);
            }
        }
        found
    }

    /// The nearest face of an instance.
    fn cast(
        &self,
        number: u32,
        origin: DVec3,
        direction: DVec3,
        farthest: f64,
        is_hidden: &impl Fn(ScenePart) -> bool,
    ) -> Option<Hit> {
        let (instance, mesh) = self.placed_mesh(number)?;
        let placement = &instance.placement;
        let back = placement.orientation().as_dquat().inverse();
        let scale = f64::from(placement.scale);
        let own = DVec3::from(mesh.grid().origin);
        let from = back * (origin - DVec3::from(placement.translation)) / scale;
        // In the asset's units, so that distances are in world units.
        let along = back * direction / scale;
        let part = |part| ScenePart { instance: number, part };
        let skip = |number| is_hidden(part(number));
        let ray = |from: DVec3, along: DVec3| [(from - own).to_array(), along.to_array()];
        let still = ray(from, along);
        let hit = if let Some(pose) = self.moved.pose(number) {
            mesh.cast_ray_posed(still, farthest, skip, |skin, place| posed(pose, own, skin, place))
        } else if self.moved.moves(number) {
            let ray = |number: u32| {
                let moved = self.moved.transform(part(number));
                moved.map_or(still, |to| ray(to.undo(from), to.undo_direction(along)))
            };
            mesh.cast_ray_of_each(ray, farthest, skip)
        } else {
            mesh.cast_ray(still[0], still[1], farthest, skip)
        }?;
        let place = origin + direction * hit.distance;
        Some(Hit { instance: number, part: Some(hit.part), place, distance: hit.distance })
    }

    /// Bounds of a part at the current refinement; `None` for a part without faces, or that has not arrived. Cost: two
    /// passes over the faces of its asset.
    #[must_use]
    pub fn part_bounds(&self, part: ScenePart) -> Option<PartBounds> {
        let (placement, mesh, of_mesh) = match self.placed_mesh(part.instance) {
            Some((instance, mesh)) => (instance.placement, mesh, part.part),
            None => self.in_proxy(part.instance)?,
        };
        let own = DVec3::from(mesh.grid().origin);
        let moved = self.moved.transform(part);
        let corners = || {
            let pose = self.moved.pose(part.instance);
            let at = move |skin, place| pose.map_or(place, |pose| posed(pose, own, skin, place));
            let of_asset = mesh.part_corners(of_mesh, at).map(|at| own + DVec3::from(at));
            of_asset.map(|at| placement.to_world(moved.map_or(at, |to| to.apply(at))))
        };
        let extent = corners().fold(None, |extent: Option<[DVec3; 2]>, at| {
            Some(extent.map_or([at; 2], |[low, high]| [low.min(at), high.max(at)]))
        })?;
        let centre = 0.5 * (extent[0] + extent[1]);
        let radius = corners().map(|at| centre.distance(at)).fold(0.0, f64::max);
        Some(PartBounds { extent, centre, radius })
    }

    /// The drawn proxy that stands for an instance: where it is placed, its mesh and the instance's part of it.
    fn in_proxy(&self, instance: u32) -> Option<(Placement, &ActiveMesh, u32)> {
        let draws = |(number, proxy): &(u32, &Proxy)| {
            let part = instance.checked_sub(proxy.first_instance);
            part.is_some_and(|part| part < proxy.instance_count && !self.scene.cut().hides(*number, part))
        };
        let (_, proxy) = self.scene.drawn_proxies().find(draws)?;
        Some((Placement::at([0.0; 3]), self.mesh(proxy.asset)?, instance - proxy.first_instance))
    }

    /// An instance whose base mesh has arrived, and its mesh.
    /// The scene's parts by instance, at most `most`. Of instances without a base mesh yet the first part alone is known.
    #[must_use]
    pub fn scene_parts(&self, most: usize) -> Vec<ScenePart> {
        let numbers = (0..).zip(self.scene.instances().all());
        let parts = |instance| self.placed_mesh(instance).map_or(1, |(_, mesh)| mesh.part_count().max(1));
        numbers
            .flat_map(|(instance, _)| (0..parts(instance)).map(move |part| ScenePart { instance, part }))
            .take(most)
            .collect()
    }

    /// A place of the world in the units and axes of an instance's asset, unmoved; `None` without such an instance.
    #[must_use]
    pub fn in_asset(&self, instance: u32, place: DVec3) -> Option<DVec3> {
        let placement = &self.scene.instances().all().get(instance as usize)?.placement;
        let turned =
            placement.orientation().as_dquat().inverse() * (place - DVec3::from(placement.translation));
        Some(turned / f64::from(placement.scale))
    }

    /// Longest distance of a vertex at full detail from its place in the input, in world units: positions are rounded to a
    /// grid. `None` before the instance's base mesh is here.
    #[must_use]
    pub fn rounding(&self, instance: u32) -> Option<f64> {
        let (instance, mesh) = self.placed_mesh(instance)?;
        Some(0.5 * 3.0_f64.sqrt() * mesh.grid().step * f64::from(instance.placement.scale))
    }

    /// Bounds of all instances that are known, by their spheres; `None` before there are any.
    #[must_use]
    pub fn scene_bounds(&self) -> Option<PartBounds> {
        let spheres = self.scene.instances().all().iter().filter_map(|instance| {
            let entry = self.scene.states.get(instance.asset as usize)?.entry();
            let centre = DVec3::from(entry.origin) + DVec3::from(entry.sphere.center.map(f64::from));
            let radius = f64::from(entry.sphere.radius) * f64::from(instance.placement.scale);
            Some((instance.placement.to_world(centre), radius))
        });
        let extent = spheres.fold(None, |extent: Option<[DVec3; 2]>, (centre, radius)| {
            let [low, high] = extent.unwrap_or([centre; 2]);
            Some([low.min(centre - radius), high.max(centre + radius)])
        });
        extent.map(|[low, high]| PartBounds {
            extent: [low, high],
            centre: (low + high) / 2.0,
            radius: (high - low).length() / 2.0,
        })
    }

    fn placed_mesh(&self, instance: u32) -> Option<(&Instance, &ActiveMesh)> {
        let instance = self.scene.instances().all().get(instance as usize)?;
        Some((instance, self.mesh(instance.asset)?))
    }
}

/// Where a pose takes a vertex of a mesh whose places are relative to `origin`.
fn posed(pose: &SkinPose, origin: DVec3, skin: Skin, place: [f64; 3]) -> [f64; 3] {
    (pose.apply(skin.influences(), origin + DVec3::from(place)) - origin).to_array()
}

/// Distance at which a ray of unit direction enters a sphere, 0 inside it; `None` if it misses.
fn entry_into(origin: DVec3, direction: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
    let to = centre - origin;
    let along = to.dot(direction);
    // From the nearest point of the line, which is exact where the sphere is far and small.
    let aside = (to - direction * along).length_squared();
    let half = (radius * radius - aside).max(0.0).sqrt();
    (aside <= radius * radius && along + half >= 0.0).then(|| (along - half).max(0.0))
}
