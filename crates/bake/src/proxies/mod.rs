//! Proxies of a scene: hierarchical levels of detail (Erikson, Manocha and Baxter, "HLODs for faster display of large
//! static and dynamic environments", 2001).
//!
//! A tree groups the instances by place. The mesh of a leaf is the union of its members' base meshes, that of an inner
//! node the union of its children's base meshes; each is prepared as any mesh, with a small base mesh. What a scene of
//! many instances needs before its first frame is then a few of these, not the base mesh of every asset.

mod color;
mod mesh;
mod pack;
#[cfg(test)]
mod tests;
mod tree;

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use lodestream_geometry::pool::Pool as _;
use lodestream_scene::description::{AssetEntry, Instance};
use lodestream_scene::placement::Placement;
use lodestream_scene::proxy::Proxy;
use lodestream_store::{PackFile, StoreError};
use lodestream_threads::Threads;

use crate::compose::placing::{placed, start_camera, visible_first, world_sphere};
use crate::prepare::cache::Key;
use crate::prepare::settings_key::pack_version;
use crate::prepare::{Options, PrepareError};
use crate::scene::Scene;
use mesh::{NodeMesh, Piece, Union};
use tree::{Item, Node, Tree};

/// Version of what packs of proxies are made from. Increment it when the same members give another pack, for reasons other
/// than those that change all packs.
const VERSION: u32 = 2;
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
    let start = Instant::now();
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
    for (at, instance) in visible_first(&start_camera(scene, &spheres), &spheres).into_iter().enumerate() {
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
    let maker = Maker { tree: &tree, instances: &instances, entries: &entries, packs, folder };
    let made = maker.all(options.threads.map_or_else(Threads::all_cores, Threads::new), fetch)?;
    let mut forest = Forest {
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
            error: made.error,
        });
    }
    forest.order = tree.order;
    forest.time = start.elapsed();
    Ok(Some(forest))
}

/// A node whose pack is there.
struct Made {
    pack: PackFile,
    entry: AssetEntry,
    error: f32,
    prepared: bool,
}

struct Maker<'a> {
    tree: &'a Tree,
    instances: &'a [Instance],
    entries: &'a [AssetEntry],
    packs: &'a [PackFile],
    folder: &'a Path,
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
                let key = key(&self.members(node, &made));
                let path = key.path(self.folder, NAME);
                if !path.exists() {
                    fetch(&path, &key);
                }
            }
            let slots: Vec<_> = level.iter().map(|_| Mutex::new(None)).collect();
            let one = |i: usize| {
                let node: Result<Made, PrepareError> = self.node(&level[i], &made, own);
                *slots[i].lock().unwrap_or_else(PoisonError::into_inner) = Some(node);
            };
            threads.run(level.len(), &one);
            let results: Vec<_> = slots
                .into_iter()
                .map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner))
                .collect();
            for (i, result) in results.into_iter().enumerate() {
                // A pool that runs no task leaves it to us.
                let result = result.unwrap_or_else(|| self.node(&level[i], &made, own));
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
                error: f64::from(made.entry.root_error) + f64::from(made.error),
            })
        });
        instances.chain(children).collect()
    }

    fn node(&self, node: &Node, made: &[Option<Made>], threads: Threads) -> Result<Made, PrepareError> {
        let members = self.members(node, made);
        let key = key(&members);
        let path = key.path(self.folder, NAME);
        let (pack, error, prepared) = match pack::open(&path, &key) {
            Some((pack, error)) => (pack, error, false),
            None => {
                let mut mesh = union(&members, false)?;
                if mesh.mesh.faces.is_empty() {
                    mesh = union(&members, true)?;
                }
                let error = members.iter().map(|member| member.error).fold(mesh.appearance_error, f64::max);
                let (pack, error) = pack::write(mesh, error, threads, &path, &key)?;
                (pack, error, true)
            }
        };
        let entry = pack.entry("")?;
        Ok(Made { pack, entry, error, prepared })
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

/// The key of a node's pack: what its members' packs hold, and where they are.
fn key(members: &[Member<'_>]) -> Key {
    let mut bytes = VERSION.to_le_bytes().to_vec();
    bytes.extend([pack::BASE_ERROR, pack::VISIBLE_SIDE].iter().flat_map(|x| x.to_le_bytes()));
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
