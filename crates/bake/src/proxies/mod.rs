//! Proxies of a scene: hierarchical levels of detail (Erikson, Manocha and Baxter, "HLODs for faster display of large
//! static and dynamic environments", 2001).
//!
//! A tree groups the instances by place. The mesh of a leaf is the union of its members' base meshes, that of an inner
//! node the union of its children's base meshes; each is prepared as any mesh, with a small base mesh. Roots are made for
//! the start camera. What a scene of many instances needs before its first frame is then a few of these, not the base mesh of every asset.

mod color;
mod components;
mod item_buffer;
mod mesh;
mod pack;
mod start;
#[cfg(test)]
mod tests;
mod thinning;
mod tree;

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use glam::{DVec3, Vec3};
use lodestream_geometry::MeshError;
use lodestream_geometry::pool::Pool as _;
use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::placement::Placement;
use lodestream_scene::proxy::Proxy;
use lodestream_store::{PackFile, StoreError};
use lodestream_threads::Threads;

use crate::compose::placing::{placed, radius, start_camera, visible_first, world_sphere};
use crate::prepare::cache::Key;
use crate::prepare::settings_key::pack_version;
use crate::prepare::{Options, PrepareError};
use crate::scene::Scene;
use mesh::{NodeMesh, Piece, Union};
use start::{Components, StartView};
use thinning::Thinning;
use tree::{Item, Node, Tree};

/// Version of what packs of proxies are made from. Increment it when the same members give another pack, for reasons other
/// than those that change all packs.
const VERSION: u32 = 5;
/// What names of packs begin with.
const NAME: &str = "proxy";
/// Fewest instances, and base meshes in bytes above which a scene gets proxies: below, all of them are sent within the
/// time of a first frame anyway.
const MIN_INSTANCES: usize = 2;
const MIN_BASE_BYTES: u64 = 48 << 10;

/// Proxies of a scene, with their packs.
#[derive(Debug)]
pub struct Forest {
    /// Indices of instances in the order in which they are numbered.
    pub(crate) order: Vec<usize>,
    /// Proxies in the order in which they are sent, parents first; [`Proxy::asset`] is an index into the packs.
    pub(crate) proxies: Vec<Proxy>,
    /// [`root_slope`](lodestream_scene::description::SceneHeader::root_slope).
    pub(crate) root_slope: f32,
    /// The packs of the proxies.
    pub packs: Vec<PackFile>,
    /// What there is of each level, roots first.
    pub levels: Vec<Level>,
    /// How many packs were prepared; the others were in the cache.
    pub prepared: usize,
    /// Time for all of it.
    pub time: Duration,
}

impl Forest {
    /// Entries of the proxies' assets.
    pub(crate) fn entries(&self) -> Result<Vec<AssetEntry>, StoreError> {
        (0_u32..).zip(&self.packs).map(|(number, pack)| pack.entry(&format!("proxy {number}"))).collect()
    }
}

/// Sizes of a level of a [`Forest`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Level {
    /// Number of proxies.
    pub proxies: usize,
    /// Bytes of their base meshes.
    pub base_bytes: u64,
    /// Bytes of their packs.
    pub pack_bytes: u64,
}

impl std::fmt::Display for Forest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (count, prepared, seconds) = (self.proxies.len(), self.prepared, self.time.as_secs_f64());
        write!(f, "{count} proxies, {prepared} prepared in {seconds:.2} s; by level:")?;
        for (number, level) in self.levels.iter().enumerate() {
            let Level { proxies, base_bytes, pack_bytes } = level;
            let separator = if number == 0 { "" } else { ";" };
            write!(f, "{separator} {proxies} with {base_bytes} bytes of base meshes, {pack_bytes} in all")?;
        }
        Ok(())
    }
}

/// Makes the proxies of a scene whose asset `i` is `packs[i]`; `None` for a scene that needs none or is told
/// to have none. Packs are kept in `folder` under keys of what they are made from, so what did not change is not
/// prepared again. They do not depend on the threads; a thread holds one node's mesh at a time.
///
/// # Errors
/// A pack that cannot be read or written.
pub fn make(
    scene: &Scene,
    packs: &[PackFile],
    folder: &Path,
    options: &Options,
) -> Result<Option<Forest>, PrepareError> {
    make_with(scene, packs, folder, options, &mut |_, _| {})
}

/// As [`make`]. `fetch` is called on this thread with path and key of each pack that `folder` lacks, members before their
/// parents. What it does not put there is prepared.
///
/// # Errors
/// As [`make`].
pub fn make_with(
    scene: &Scene,
    packs: &[PackFile],
    folder: &Path,
    options: &Options,
    fetch: &mut dyn FnMut(&Path, &Key),
) -> Result<Option<Forest>, PrepareError> {
    let wanted = options.preparation_settings.proxies.unwrap_or(scene.proxies);
    if !wanted {
        return Ok(None);
    }
    let begin = Instant::now();
    let entries: Vec<AssetEntry> = packs.iter().map(|pack| pack.entry("")).collect::<Result<_, _>>()?;
    let (instances, _) = placed(scene, &entries);
    let used: BTreeSet<u32> = instances.iter().map(|instance| instance.asset).collect();
    let bytes: u64 = used.iter().map(|&asset| u64::from(entries[asset as usize].base_bytes)).sum();
    if instances.len() < MIN_INSTANCES || bytes <= MIN_BASE_BYTES {
        return Ok(None);
    }
    let mut faces: BTreeMap<u32, u64> = BTreeMap::new();
    for &asset in &used {
        faces.insert(asset, u64::from(packs[asset as usize].base_faces()?));
    }
    let spheres: Vec<_> = instances.iter().map(|i| world_sphere(i, &entries)).collect();
    let mut rank = vec![0; instances.len()];
    let camera = start_camera(scene, &spheres);
    for (at, instance) in visible_first(&camera, &spheres).into_iter().enumerate() {
        rank[instance] = at;
    }
    let item = |(at, instance): (usize, &Instance)| Item {
        center: spheres[at].0,
        radius: spheres[at].1,
        asset: instance.asset,
        base_bytes: u64::from(entries[instance.asset as usize].base_bytes),
        faces: faces.get(&instance.asset).copied().unwrap_or(0),
        rank: rank[at],
    };
    let items: Vec<Item> = instances.iter().enumerate().map(item).collect();
    let tree = tree::build(&items);
    drop(items);
    std::fs::create_dir_all(folder)
        .map_err(|source| PrepareError::Write { path: folder.to_owned(), source })?;
    let start = StartView::new(&camera, radius(&spheres));
    let maker = Maker { tree: &tree, instances: &instances, entries: &entries, packs, folder, start };
    let made = maker.all(options.threads.map_or_else(Threads::all_cores, Threads::new), fetch)?;
    let mut forest = Forest {
        root_slope: made.iter().map(|made| made.stated.slope).fold(0.0, f32::max),
        proxies: Vec::with_capacity(made.len()),
        packs: Vec::with_capacity(made.len()),
        levels: Vec::new(),
        prepared: made.iter().filter(|made| made.prepared).count(),
        time: Duration::ZERO,
        order: Vec::new(),
    };
    for (number, (node, made)) in (0_u32..).zip(tree.nodes.iter().zip(made)) {
        forest.levels.resize(forest.levels.len().max(node.depth + 1), Level::default());
        let level = &mut forest.levels[node.depth];
        level.proxies += 1;
        level.base_bytes += u64::from(made.entry.base_bytes);
        level.pack_bytes += made.pack.total_bytes();
        forest.packs.push(made.pack);
        forest.proxies.push(Proxy {
            asset: number,
            parent: node.parent.map_or(0, |parent| parent as u32 + 1),
            first_instance: node.instances.start as u32,
            instance_count: node.instances.len() as u32,
            child_count: node.children.len() as u32,
            error: made.stated.error,
        });
    }
    forest.order = tree.order;
    forest.time = begin.elapsed();
    Ok(Some(forest))
}

/// A node whose pack is there.
struct Made {
    pack: PackFile,
    entry: AssetEntry,
    stated: pack::Stated,
    prepared: bool,
}

struct Maker<'a> {
    tree: &'a Tree,
    instances: &'a [Instance],
    entries: &'a [AssetEntry],
    packs: &'a [PackFile],
    folder: &'a Path,
    start: StartView,
}

/// A member of a node: a placed base mesh.
struct Member<'a> {
    pack: &'a PackFile,
    /// Which members share the pack.
    number: u32,
    placement: Placement,
    /// First part in the node.
    part: u32,
    /// Whether it is an instance, thus one part of the node whatever parts its asset has.
    is_instance: bool,
    /// Bound on the distance of its base mesh from what it stands for, in world units.
    error: f64,
}

/// What the base mesh of a root is made from: meshes that are fine enough to be simplified to an error.
struct Sources<'a> {
    root: usize,
    /// The nodes that are there.
    made: &'a [Option<Made>],
    error_px: f64,
    /// Whether transparent faces count.
    transparent_too: bool,
}

impl Maker<'_> {
    /// All nodes: the deepest level first, its nodes side by side.
    fn all(&self, threads: Threads, fetch: &mut dyn FnMut(&Path, &Key)) -> Result<Vec<Made>, PrepareError> {
        let nodes = &self.tree.nodes;
        let mut made: Vec<Option<Made>> = nodes.iter().map(|_| None).collect();
        let mut end = nodes.len();
        while end > 0 {
            // Nodes are breadth first.
            let first = nodes.partition_point(|node| node.depth < nodes[end - 1].depth);
            let level = &nodes[first..end];
            let own =
                if level.len() < threads.count().get() { threads } else { Threads::new(NonZeroUsize::MIN) };
            for node in level {
                let key = self.key(node, &made);
                let path = key.path(self.folder, NAME);
                if !path.exists() {
                    fetch(&path, &key);
                }
            }
            let slots: Vec<_> = level.iter().map(|_| Mutex::new(None)).collect();
            let one = |i: usize| {
                *slots[i].lock().unwrap_or_else(PoisonError::into_inner) =
                    Some(self.make(first + i, &made, own));
            };
            threads.run(level.len(), &one);
            let results: Vec<_> = slots
                .into_iter()
                .map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner))
                .collect();
            for (i, result) in results.into_iter().enumerate() {
                // A pool that runs no task leaves it to us.
                let result = result.unwrap_or_else(|| self.make(first + i, &made, own));
                made[first + i] = Some(result?);
            }
            end = first;
        }
        Ok(made.into_iter().flatten().collect())
    }

    /// The members of a node: instances of a leaf, children of an inner node.
    fn members<'a>(&'a self, node: &Node, made: &'a [Option<Made>]) -> Vec<Member<'a>> {
        let instances = node.instances.clone().filter(|_| node.children.is_empty()).map(|number| {
            let instance = &self.instances[self.tree.order[number]];
            Member {
                pack: &self.packs[instance.asset as usize],
                number: instance.asset,
                placement: instance.placement,
                part: (number - node.instances.start) as u32,
                is_instance: true,
                error: f64::from(self.entries[instance.asset as usize].root_error)
                    * f64::from(instance.placement.scale),
            }
        });
        let children = node.children.iter().filter_map(|&child| {
            let (of, made) = (&self.tree.nodes[child], made[child].as_ref()?);
            Some(Member {
                pack: &made.pack,
                number: child as u32,
                placement: Placement::default(),
                part: (of.instances.start - node.instances.start) as u32,
                is_instance: false,
                error: f64::from(made.entry.root_error) + f64::from(made.stated.error),
            })
        });
        instances.chain(children).collect()
    }

    fn make(&self, number: usize, made: &[Option<Made>], threads: Threads) -> Result<Made, PrepareError> {
        let node = &self.tree.nodes[number];
        if node.parent.is_some() { self.node(node, made, threads) } else { self.root(number, made, threads) }
    }

    /// The key of a node's pack: what its members' packs hold, where they are, and for a root the start camera.
    fn key(&self, node: &Node, made: &[Option<Made>]) -> Key {
        let start = if node.parent.is_none() { self.start.key() } else { Vec::new() };
        key(&self.members(node, made), &start)
    }

    /// The pack of a root, whose base mesh is made for the start camera.
    fn root(&self, number: usize, made: &[Option<Made>], threads: Threads) -> Result<Made, PrepareError> {
        let key = self.key(&self.tree.nodes[number], made);
        let path = key.path(self.folder, NAME);
        let (pack, stated, prepared) = match pack::open(&path, &key) {
            Some((pack, stated)) => (pack, stated, false),
            None => {
                let (base, stated) = self.root_base(number, made, threads, &path)?;
                let (pack, stated) = pack::write_base(&base, stated, &path, &key)?;
                (pack, stated, true)
            }
        };
        let entry = pack.entry("")?;
        Ok(Made { pack, entry, stated, prepared })
    }

    /// The base blob of a root: with the smallest error that gives few enough bytes.
    fn root_base(
        &self,
        number: usize,
        made: &[Option<Made>],
        threads: Threads,
        path: &Path,
    ) -> Result<(Vec<u8>, pack::Stated), PrepareError> {
        let mesh_error = |source| PrepareError::Mesh { path: path.to_owned(), source };
        let mut tries = start::ERRORS_PX.into_iter().peekable();
        let (fine, source_error) = loop {
            let Some(&error_px) = tries.peek() else {
                return Err(mesh_error(MeshError::NoFaces { dropped: 0 }));
            };
            let mut sources = Sources { root: number, made, error_px, transparent_too: false };
            let (mut fine, mut error) = self.gather(&sources)?;
            if fine.face_count() == 0 {
                sources.transparent_too = true;
                (fine, error) = self.gather(&sources)?;
            }
            if !start::is_too_much(fine.face_count(), error_px) {
                break (fine.finish(), error);
            }
            tries.next();
        };
        let components = Components::new(&fine.mesh, &self.start);
        let most_bytes = start::MAX_BYTES / self.tree.nodes.iter().filter(|n| n.parent.is_none()).count();
        while let Some(error_px) = tries.next() {
            let (mesh, error) =
                self.start.simplified(&fine.mesh, &components, error_px, threads).map_err(mesh_error)?;
            let mesh = NodeMesh { mesh, material: fine.material.clone(), ..fine };
            let base = pack::whole_base(&mesh, self.start.rounding(error_px)).map_err(mesh_error)?;
            if base.len() <= most_bytes || tries.peek().is_none() {
                let error = source_error.max(mesh.appearance_error) + error + self.start.rounding(error_px);
                let slope = (self.start.slope(error_px) as f32).min(1.0);
                return Ok((base, pack::Stated { error: (error as f32).next_up(), slope }));
            }
            // Errors that would give too many bytes are not tried.
            let mut bytes = start::LEAST_SHARE * base.len() as f64;
            while bytes > most_bytes as f64 && tries.len() > 1 {
                tries.next();
                bytes *= start::LEAST_SHARE;
            }
        }
        Err(mesh_error(MeshError::NoFaces { dropped: 0 }))
    }

    /// The union of the sources without what [`Thinning`] leaves out, until there are too many, and its error.
    fn gather(&self, sources: &Sources<'_>) -> Result<(Union, f64), PrepareError> {
        let mut thinning = Thinning::new(&self.start, sources.error_px);
        let error = self.each_source(sources, &mut |piece, placement, _| {
            thinning.add(&piece, placement);
            true
        })?;
        let mut kept = thinning.kept();
        let mut union = Union::default();
        self.each_source(sources, &mut |piece, placement, first_part| {
            union.add(&kept.of(piece), placement, first_part);
            !start::is_too_much(union.face_count(), sources.error_px)
        })?;
        Ok((union, error + kept.error))
    }

    /// Calls `add` with each source, its place and its first part, while it returns true. Gives their largest error.
    fn each_source(
        &self,
        sources: &Sources<'_>,
        add: &mut dyn FnMut(Piece, &Placement, u32) -> bool,
    ) -> Result<f64, PrepareError> {
        let &Sources { root, made, error_px, transparent_too } = sources;
        let first = self.tree.nodes[root].instances.start;
        let (mut nodes, mut instances) = (vec![root], Vec::new());
        let mut most = 0.0_f64;
        while let Some(number) = nodes.pop() {
            let node = &self.tree.nodes[number];
            for &child in &node.children {
                let Some(of) = &made[child] else { continue };
                let error = f64::from(of.entry.root_error) + f64::from(of.stated.error);
                let sphere = of.entry.sphere;
                let center = DVec3::from(of.entry.origin) + Vec3::from(sphere.center).as_dvec3();
                if self.start.is_fine(error_px, error, center, f64::from(sphere.radius)) {
                    let part = self.tree.nodes[child].instances.start - first;
                    most = most.max(error);
                    let piece = Piece::read(&of.pack, transparent_too)?;
                    if !add(piece, &Placement::default(), part as u32) {
                        return Ok(most);
                    }
                } else {
                    nodes.push(child);
                }
            }
            instances.extend(node.instances.clone().filter(|_| node.children.is_empty()));
        }
        // One asset in memory at a time.
        let asset_of = |number: usize| self.instances[self.tree.order[number]].asset;
        instances.sort_unstable_by_key(|&number| (asset_of(number), number));
        for of_asset in instances.chunk_by(|a, b| asset_of(*a) == asset_of(*b)) {
            let pack = &self.packs[asset_of(of_asset[0]) as usize];
            let asset = pack.load()?;
            for &number in of_asset {
                let placement = &self.instances[self.tree.order[number]].placement;
                let (piece, error) =
                    self.start.refined(error_px, pack, &asset, placement, transparent_too)?;
                most = most.max(error);
                if !add(piece.into_one_part(), placement, (number - first) as u32) {
                    return Ok(most);
                }
            }
        }
        Ok(most)
    }

    fn node(&self, node: &Node, made: &[Option<Made>], threads: Threads) -> Result<Made, PrepareError> {
        let members = self.members(node, made);
        let key = self.key(node, made);
        let path = key.path(self.folder, NAME);
        let (pack, stated, prepared) = match pack::open(&path, &key) {
            Some((pack, stated)) => (pack, stated, false),
            None => {
                let mut mesh = union(&members, false)?;
                if mesh.mesh.faces.is_empty() {
                    mesh = union(&members, true)?;
                }
                let error = members.iter().map(|member| member.error).fold(mesh.appearance_error, f64::max);
                let (pack, stated) = pack::write(mesh, error, threads, &path, &key)?;
                (pack, stated, true)
            }
        };
        let entry = pack.entry("")?;
        Ok(Made { pack, entry, stated, prepared })
    }
}

/// The mesh of members. Each pack is read once; transparent faces are left out unless `transparent_too`.
fn union(members: &[Member<'_>], transparent_too: bool) -> Result<NodeMesh, PrepareError> {
    let mut pieces: BTreeMap<u32, Piece> = BTreeMap::new();
    let mut union = Union::default();
    for member in members {
        let piece = match pieces.entry(member.number) {
            Entry::Occupied(piece) => piece.into_mut(),
            Entry::Vacant(place) => {
                let piece = Piece::read(member.pack, transparent_too)?;
                place.insert(if member.is_instance { piece.into_one_part() } else { piece })
            }
        };
        union.add(piece, &member.placement, member.part);
    }
    Ok(union.finish())
}

/// The key of a pack of members, and of what else it is made from.
fn key(members: &[Member<'_>], more: &[u8]) -> Key {
    let mut bytes = VERSION.to_le_bytes().to_vec();
    bytes.extend([pack::BASE_ERROR, pack::VISIBLE_SIDE].iter().flat_map(|x| x.to_le_bytes()));
    bytes.extend(more);
    for Member { pack, number: _, placement, part, is_instance: _, error } in members {
        bytes.extend(pack.fingerprint());
        let Placement { translation, rotation, scale } = placement;
        bytes.extend(translation.iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(rotation.iter().chain([scale]).flat_map(|x| x.to_le_bytes()));
        bytes.extend(part.to_le_bytes());
        bytes.extend(error.to_le_bytes());
    }
    Key::of_settings(&bytes, pack_version())
}
