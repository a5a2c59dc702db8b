//! Which instances the proxies of a scene stand for: a tree by recursive median split (Kay and Kajiya 1986).

use std::collections::{BTreeMap, VecDeque};
use std::ops::Range;

use glam::DVec3;
use lodestream_geometry::base::MAX_PARTS;

/// Base meshes of a leaf's members, in bytes, above which it is split.
const MAX_LEAF_BYTES: u64 = 16 << 10;
/// Faces of a leaf's members above which it is split: a leaf is prepared in well under a second.
const MAX_LEAF_FACES: u64 = 20_000;
/// What an instance weighs besides its base mesh, in bytes: some 14 in a page, and its part of a proxy.
const INSTANCE_BYTES: u64 = 20;
/// An instance is small if its radius is so many times below the mean, weighted by area.
const SMALL: f64 = 8.0;
/// Each kept level of the binary tree is this many below the one before, so a node has at most eight children.
const KEPT_LEVELS: usize = 3;

/// An instance, as the tree needs it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    /// Centre in the world.
    pub(super) center: DVec3,
    /// Radius of its bounding sphere in the world.
    pub(super) radius: f64,
    /// Its asset.
    pub(super) asset: u32,
    /// Length of the asset's base mesh.
    pub(super) base_bytes: u64,
    /// Faces of the asset's base mesh.
    pub(super) faces: u64,
    /// Place among the instances by visibility from the start camera; unique.
    pub(super) rank: usize,
}

/// A node, with the instances that it stands for by their numbers in [`Tree::order`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Node {
    pub(super) parent: Option<usize>,
    pub(super) instances: Range<usize>,
    pub(super) children: Vec<usize>,
    pub(super) depth: usize,
}

/// A forest: a tree whose upper nodes have more instances than a mesh can have parts is cut below these.
#[derive(Clone, Debug, Default)]
pub(super) struct Tree {
    /// Indices of instances in the order in which they are numbered: depth first.
    pub(super) order: Vec<usize>,
    /// Nodes breadth first.
    pub(super) nodes: Vec<Node>,
}

/// A node before it has a number.
struct Branch {
    /// Instances of a leaf.
    members: Vec<usize>,
    children: Vec<Branch>,
    /// Least rank of its instances.
    rank: usize,
}

/// Builds the tree in O(n log² n). It does not depend on the order of equal centres other than by index.
pub(super) fn build(items: &[Item]) -> Tree {
    let mut all: Vec<usize> = (0..items.len()).collect();
    let mut roots = grow(items, &mut all, 0);
    roots.sort_by_key(|branch| branch.rank);
    let mut tree = Tree::default();
    // Numbers depth first, then nodes breadth first.
    let mut queue: VecDeque<(Numbered, Option<usize>, usize)> =
        roots.into_iter().map(|root| (number(root, &mut tree.order), None, 0)).collect();
    while let Some((Numbered { instances, children }, parent, depth)) = queue.pop_front() {
        let own = tree.nodes.len();
        if let Some(parent) = parent {
            tree.nodes[parent].children.push(own);
        }
        tree.nodes.push(Node { parent, instances, children: Vec::new(), depth });
        queue.extend(children.into_iter().map(|child| (child, Some(own), depth + 1)));
    }
    tree
}

/// A branch whose instances have numbers.
struct Numbered {
    instances: Range<usize>,
    children: Vec<Numbered>,
}

fn number(branch: Branch, order: &mut Vec<usize>) -> Numbered {
    let first = order.len();
    order.extend(branch.members);
    let children = branch.children.into_iter().map(|child| number(child, order)).collect();
    Numbered { instances: first..order.len(), children }
}

/// The kept nodes of the binary tree of some instances that have no kept node above them, at `level` of the binary tree.
fn grow(items: &[Item], members: &mut [usize], level: usize) -> Vec<Branch> {
    let rank = members.iter().map(|&member| items[member].rank).min().unwrap_or(0);
    if is_leaf(items, members) {
        // Copies of an asset are coded in few bytes after each other.
        members.sort_unstable_by_key(|&member| (items[member].asset, member));
        return vec![Branch { members: members.to_vec(), children: Vec::new(), rank }];
    }
    let few_enough = members.len() <= MAX_PARTS as usize;
    let by_size = if level == 0 { split_by_size(items, members) } else { None };
    let at = by_size.unwrap_or_else(|| split(items, members));
    let (left, right) = members.split_at_mut(at);
    let mut below = grow(items, left, level + 1);
    below.extend(grow(items, right, level + 1));
    if by_size.is_none() {
        below.sort_by_key(|branch| branch.rank);
    }
    if level.is_multiple_of(KEPT_LEVELS) && few_enough {
        return vec![Branch { members: Vec::new(), children: below, rank }];
    }
    below
}

fn is_leaf(items: &[Item], members: &[usize]) -> bool {
    // Each asset is sent once, but each instance has its faces in the proxy.
    let assets: BTreeMap<u32, u64> =
        members.iter().map(|&member| (items[member].asset, items[member].base_bytes)).collect();
    let bytes = assets.values().sum::<u64>() + INSTANCE_BYTES * members.len() as u64;
    let faces: u64 = members.iter().map(|&member| items[member].faces).sum();
    members.len() <= 1 || bytes <= MAX_LEAF_BYTES && faces <= MAX_LEAF_FACES
}

/// Sorts members by size, if some are much smaller than those that cover most of the area, and returns where the small ones
/// begin. Large ones come first in the pages, since a picture is wrong without them: buildings before their windows.
fn split_by_size(items: &[Item], members: &mut [usize]) -> Option<usize> {
    let sum = |power| members.iter().map(|&member| items[member].radius.powi(power)).sum::<f64>();
    let least = sum(3) / sum(2) / SMALL;
    let is_small = |&member: &usize| items[member].radius < least;
    members.sort_unstable_by_key(|member| (is_small(member), *member));
    let large = members.partition_point(|member| !is_small(member));
    (large < members.len()).then_some(large)
}

/// Sorts at least two members along the longest axis of their centres and returns where to split them: where half of the
/// bytes are on each side, but not outside the middle quarter of the members, which bounds the depth: 2^24 instances give
/// at most 36 levels of the binary tree, 13 kept ones.
fn split(items: &[Item], members: &mut [usize]) -> usize {
    let centers = || members.iter().map(|&member| items[member].center);
    let size = centers().fold(DVec3::NEG_INFINITY, DVec3::max) - centers().fold(DVec3::INFINITY, DVec3::min);
    let axis = if size.x >= size.y && size.x >= size.z { 0 } else { if size.z >= size.y { 2 } else { 1 } };
    members
        .sort_unstable_by(|&a, &b| items[a].center[axis].total_cmp(&items[b].center[axis]).then(a.cmp(&b)));
    let weight = |&member: &usize| items[member].base_bytes + INSTANCE_BYTES;
    let half = members.iter().map(weight).sum::<u64>() / 2;
    let mut sum = 0;
    let at = members.iter().take_while(|&member| {
        sum += weight(member);
        sum <= half
    });
    let (at, count) = (at.count(), members.len());
    at.clamp((count * 3 / 8).max(1), (count * 5).div_ceil(8).min(count - 1))
}

#[cfg(test)]
mod tests {
    use lodestream_scene::proxy::MAX_PROXY_DEPTH;

    use super::*;

    fn item(x: f64, z: f64, base_bytes: u64, rank: usize) -> Item {
        Item { center: DVec3::new(x, 0.0, z), radius: 1.0, asset: rank as u32, base_bytes, faces: 10, rank }
    }

    #[test]
    fn nodes_have_runs_of_instances_that_their_children_divide() {
        // The visible ones are the last.
        let items: Vec<Item> =
            (0..2000).map(|i| item(f64::from(i % 50), f64::from(i / 50), 400, 1999 - i as usize)).collect();
        let tree = build(&items);
        assert_eq!((tree.nodes[0].instances.clone(), tree.nodes[0].parent), (0..2000, None));
        let mut sorted = tree.order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..2000));
        for node in &tree.nodes {
            let children = || node.children.iter().map(|&child| tree.nodes[child].clone());
            assert!(node.children.len() <= 8 && node.children.len() != 1);
            if !node.children.is_empty() {
                assert!(children().flat_map(|child| child.instances).eq(node.instances.clone()));
                let ranks =
                    children().map(|c| tree.order[c.instances].iter().map(|&i| items[i].rank).min().unwrap());
                assert!(ranks.collect::<Vec<_>>().is_sorted(), "nearest first");
            } else {
                let bytes: u64 =
                    tree.order[node.instances.clone()].iter().map(|&i| items[i].base_bytes).sum();
                assert!((2000..=MAX_LEAF_BYTES).contains(&bytes), "{bytes}");
            }
            assert!(node.parent.is_none_or(|parent| tree.nodes[parent].depth + 1 == node.depth));
        }
        assert_eq!(tree.nodes.iter().map(|node| node.depth).max(), Some(2));
    }

    #[test]
    fn large_instances_come_before_small_ones() {
        let size = |i: usize| Item {
            radius: if i.is_multiple_of(10) { 20.0 } else { 1.0 },
            ..item(i as f64, 0.0, 4000, i)
        };
        let tree = build(&(0..100).map(size).collect::<Vec<_>>());
        let (large, small) = tree.order.split_at(10);
        assert!(large.iter().all(|i| i.is_multiple_of(10)) && small.contains(&1), "{:?}", tree.order);
        assert!(
            tree.nodes
                .iter()
                .filter(|node| node.depth > 0)
                .all(|node| node.instances.end <= 10 || node.instances.start >= 10)
        );
        let of_one_size = |i: usize| Item { radius: 1.0 + i as f64 / 25.0, ..item(i as f64, 0.0, 4000, i) };
        assert_eq!(
            split_by_size(&(0..100).map(of_one_size).collect::<Vec<_>>(), &mut (0..100).collect::<Vec<_>>()),
            None
        );
    }

    #[test]
    fn trees_are_shallow_whatever_the_weights_and_centers() {
        // Weights that fall by half, all in one place: a median of weights alone would give 4,000 levels.
        let items: Vec<Item> =
            (0..4000).map(|i| item(0.0, 0.0, (1 << 40) >> i.min(30), i as usize)).collect();
        let tree = build(&items);
        assert!(tree.nodes.iter().all(|node| node.depth < MAX_PROXY_DEPTH.min(7)));
    }

    #[test]
    fn copies_of_an_asset_count_once_until_they_have_too_many_faces() {
        let copies = |faces| {
            let copy = |i: u32| Item { asset: 0, faces, ..item(f64::from(i), 0.0, 8000, i as usize) };
            build(&(0..200).map(copy).collect::<Vec<_>>()).nodes.len()
        };
        assert_eq!(copies(100), 1);
        assert!(copies(200) > 2);
    }
}
