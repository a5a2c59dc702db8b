//! The nodes of a file that move, as far as meshes hang on them. What stands still between them is multiplied out.

use std::collections::{BTreeMap, BTreeSet};

use glam::DAffine3;
use lodestream_scene::animation::{AnimatedNode, MAX_ENTRIES, Rest};

use super::container::Document;
use super::nodes::{SceneContents, local};

/// Where a node hangs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Above {
    /// Number of the nearest node at or above it that moves.
    pub(super) number: Option<u32>,
    /// From the node to that one, or to the scene.
    pub(super) below: DAffine3,
}

impl Above {
    const SCENE: Self = Self { number: None, below: DAffine3::IDENTITY };
}

/// The nodes that move. Each node of the file is looked at once, however deep it is.
pub(super) struct AnimatedNodes<'a> {
    pub(super) document: &'a Document,
    contents: &'a SceneContents,
    targets: &'a BTreeSet<usize>,
    pub(super) nodes: Vec<AnimatedNode>,
    /// Numbers of the nodes, by node of the file.
    pub(super) numbers: BTreeMap<usize, u32>,
    known: BTreeMap<usize, Above>,
}

impl<'a> AnimatedNodes<'a> {
    pub(super) fn new(
        document: &'a Document,
        contents: &'a SceneContents,
        targets: &'a BTreeSet<usize>,
    ) -> Self {
        Self {
            document,
            contents,
            targets,
            nodes: Vec::new(),
            numbers: BTreeMap::new(),
            known: BTreeMap::new(),
        }
    }

    /// Where a node of the scene hangs; adds those above it that move.
    pub(super) fn above(&mut self, node: usize) -> Above {
        let mut path = Vec::new();
        let mut at = Some(node);
        while let Some(node) = at.filter(|node| !self.known.contains_key(node)) {
            path.push(node);
            at = parent(self.contents, node);
        }
        let mut above = at.and_then(|node| self.known.get(&node)).copied().unwrap_or(Above::SCENE);
        for node in path.into_iter().rev() {
            above = self.add(node, above);
            self.known.insert(node, above);
        }
        above
    }

    /// Where what hangs on a node does, of which the parent hangs on `above`.
    fn add(&mut self, node: usize, above: Above) -> Above {
        let number = u32::try_from(self.nodes.len()).unwrap_or(u32::MAX);
        if self.targets.contains(&node) && self.nodes.len() < MAX_ENTRIES {
            let rest = self.rest(node);
            self.nodes.push(AnimatedNode { parent: above.number, to_parent: above.below, rest });
            self.numbers.insert(node, number);
            return Above { number: Some(number), below: DAffine3::IDENTITY };
        }
        Above { below: above.below * self.local(node), ..above }
    }

    fn local(&self, node: usize) -> DAffine3 {
        self.document.root.nodes.get(node).map_or(DAffine3::IDENTITY, |node| DAffine3::from_mat4(local(node)))
    }

    fn rest(&self, node: usize) -> Rest {
        let Some(node) = self.document.root.nodes.get(node).filter(|node| node.matrix.is_none()) else {
            let (scale, rotation, translation) = self.local(node).to_scale_rotation_translation();
            let [scale, translation] = [scale, translation].map(|v| v.to_array());
            return Rest { translation, rotation: rotation.to_array(), scale };
        };
        // As written, so that the numbers of the file are short.
        let usual = Rest::default();
        Rest {
            translation: node.translation.unwrap_or(usual.translation),
            rotation: node.rotation.filter(|q| q.iter().any(|x| *x != 0.0)).unwrap_or(usual.rotation),
            scale: node.scale.unwrap_or(usual.scale),
        }
    }
}

fn parent(contents: &SceneContents, node: usize) -> Option<usize> {
    contents.parents.get(node).copied().flatten().map(|parent| parent as usize)
}

/// Which nodes move, with those above them. Each node is looked at once.
pub(super) struct Moving<'a> {
    contents: &'a SceneContents,
    targets: &'a BTreeSet<usize>,
    known: BTreeMap<usize, bool>,
}

impl<'a> Moving<'a> {
    pub(super) fn new(contents: &'a SceneContents, targets: &'a BTreeSet<usize>) -> Self {
        Self { contents, targets, known: BTreeMap::new() }
    }

    /// Whether a node or one above it is a target.
    pub(super) fn moves(&mut self, node: usize) -> bool {
        let mut path = Vec::new();
        let mut at = Some(node);
        let mut moves = false;
        while let Some(node) = at {
            if let Some(&known) = self.known.get(&node) {
                moves = known;
                break;
            }
            path.push(node);
            if self.targets.contains(&node) {
                moves = true;
                break;
            }
            at = parent(self.contents, node);
        }
        self.known.extend(path.into_iter().map(|node| (node, moves)));
        moves
    }
}
