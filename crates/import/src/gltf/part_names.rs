//! What the placed meshes of a file are called: names of nodes and meshes, paths, and extras.
//!
//! A node keeps its name and its nearest ancestor with a name. Paths are built when they are asked for, from the node
//! upwards until they are long enough: a chain of thousands of nodes costs no more than its names.

use lodestream_scene::parts::{MAX_EXTRAS_BYTES, MAX_NAME_BYTES, MAX_PATH_BYTES, PartInfo};
use serde::Deserialize;
use serde::de::{MapAccess, Visitor};
use serde_json::value::RawValue;

use super::byte_values::{Rest, put_list, put_option, put_text};
use super::container::Document;
use super::root;

/// Stands for what is left out of a name or path.
const ELLIPSIS: &str = "…";

#[derive(Clone, Debug, Default, PartialEq)]
struct Node {
    /// Its name; empty if it has none.
    name: Box<str>,
    /// The nearest ancestor that has a name.
    above: Option<u32>,
    extras: Option<Box<str>>,
}

/// The nodes of a scene, as they are visited.
#[derive(Debug, Default)]
pub(super) struct Nodes {
    list: Vec<Node>,
    /// Nodes with extras that were cut or left out.
    shortened: usize,
}

impl Nodes {
    pub(super) fn new(count: usize) -> Self {
        Self { list: vec![Node::default(); count], shortened: 0 }
    }

    /// Adds a node, given its nearest ancestor that has a name; returns that of its children.
    pub(super) fn add(&mut self, index: usize, node: &root::Node, above: Option<u32>) -> Option<u32> {
        let name = node.name.as_deref().unwrap_or_default();
        // Only nodes with meshes are asked for their extras.
        let extras = node.mesh.and_then(|_| compact(node.extras.as_deref(), &mut self.shortened));
        if let Some(slot) = self.list.get_mut(index) {
            *slot = Node { name: shortened(name).into(), above, extras };
        }
        if name.is_empty() { above } else { u32::try_from(index).ok() }
    }
}

/// What the placed meshes of a file are called.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartNames {
    nodes: Vec<Node>,
    /// Name and extras of each mesh.
    meshes: Vec<(Box<str>, Option<Box<str>>)>,
}

impl PartNames {
    /// Collects the names of a file, and a warning if extras were too long and have been cut by key.
    pub(super) fn new(document: &Document, nodes: Nodes, names: &[String]) -> (Self, Option<String>) {
        let mut count = nodes.shortened;
        let meshes = document.root.meshes.iter().zip(names).map(|(mesh, name)| {
            let extras = compact(mesh.extras.as_deref(), &mut count);
            (shortened(name).into(), extras)
        });
        let this = Self { nodes: nodes.list, meshes: meshes.collect() };
        let warning = (count > 0).then(|| {
            let path = document.path.display();
            format!("{path}: extras of {count} parts are longer than {MAX_EXTRAS_BYTES} bytes; entries that do not fit are left out")
        });
        (this, warning)
    }

    /// What a placed mesh is called: its node's name, else its mesh's; the names above its node; and its node's extras,
    /// else its mesh's; no placement. Takes time and memory in proportion to the path, at most [`MAX_PATH_BYTES`].
    #[must_use]
    pub fn of(&self, node: Option<u32>, mesh: usize) -> PartInfo {
        let node = node.and_then(|node| self.nodes.get(node as usize));
        let mesh = self.meshes.get(mesh);
        let own = node.map(|node| &*node.name).filter(|name| !name.is_empty());
        let extras = node.and_then(|node| node.extras.as_deref());
        PartInfo {
            name: own.or(mesh.map(|(name, _)| &**name)).unwrap_or_default().to_owned(),
            path: self.path(node.and_then(|node| node.above)),
            extras: extras.or(mesh.and_then(|(_, extras)| extras.as_deref())).map(str::to_owned),
            ..PartInfo::default()
        }
    }

    /// Appends them as bytes.
    pub(super) fn put(&self, out: &mut Vec<u8>) {
        let Self { nodes, meshes } = self;
        put_list(out, nodes, |out, Node { name, above, extras }| {
            put_text(out, name);
            put_option(out, above.as_ref(), |out, above| out.extend(above.to_le_bytes()));
            put_option(out, extras.as_deref(), put_text);
        });
        put_list(out, meshes, |out, (name, extras)| {
            put_text(out, name);
            put_option(out, extras.as_deref(), put_text);
        });
    }

    /// What [`Self::put`] appended; `None` for other bytes.
    pub(super) fn take(rest: &mut Rest<'_>) -> Option<Self> {
        let text = |rest: &mut Rest<'_>| rest.text().map(Box::from);
        let node = |rest: &mut Rest<'_>| {
            Some(Node { name: text(rest)?, above: rest.option(Rest::u32)?, extras: rest.option(text)? })
        };
        let mesh = |rest: &mut Rest<'_>| Some((text(rest)?, rest.option(text)?));
        Some(Self { nodes: rest.list(node)?, meshes: rest.list(mesh)? })
    }

    /// The names from the root to a node. The beginning of a path that is too long is left out.
    fn path(&self, mut from: Option<u32>) -> String {
        let (mut names, mut bytes) = (Vec::new(), 0);
        while let Some(node) = from.and_then(|node| self.nodes.get(node as usize)) {
            bytes += node.name.len() + 1;
            if bytes + ELLIPSIS.len() > MAX_PATH_BYTES {
                names.push(ELLIPSIS);
                break;
            }
            names.push(&node.name);
            from = node.above;
        }
        names.reverse();
        names.join("/")
    }
}

/// A name of at most [`MAX_NAME_BYTES`].
fn shortened(name: &str) -> String {
    if name.len() <= MAX_NAME_BYTES {
        return name.to_owned();
    }
    let end = name.floor_char_boundary(MAX_NAME_BYTES - ELLIPSIS.len());
    format!("{}{ELLIPSIS}", &name[..end])
}

/// Extras without white space between tokens. Of an object that is too long, the first entries that fit; anything else
/// that is too long is left out.
fn compact(extras: Option<&RawValue>, shortened: &mut usize) -> Option<Box<str>> {
    let text = without_space(extras?.get());
    if text == "null" {
        return None;
    }
    if text.len() <= MAX_EXTRAS_BYTES {
        return Some(text.into());
    }
    *shortened += 1;
    let Entries(entries) = serde_json::from_str(&text).unwrap_or_default();
    let mut kept = String::from("{");
    for (key, value) in entries {
        let comma = if kept.len() > 1 { "," } else { "" };
        let key = serde_json::Value::from(key).to_string();
        let entry = [comma, &key, ":", value.get()];
        // The closing brace follows.
        if kept.len() + entry.iter().map(|text| text.len()).sum::<usize>() < MAX_EXTRAS_BYTES {
            kept.extend(entry);
        }
    }
    kept.push('}');
    (kept.len() > 2).then(|| kept.into())
}

/// Valid JSON without white space outside texts.
fn without_space(json: &str) -> String {
    let (mut inside, mut escaped) = (false, false);
    json.chars()
        .filter(|&c| {
            let keep = inside || !c.is_ascii_whitespace();
            inside ^= c == '"' && !escaped;
            escaped = inside && c == '\\' && !escaped;
            keep
        })
        .collect()
}

/// Entries of a JSON object, in its order.
#[derive(Default)]
struct Entries(Vec<(String, Box<RawValue>)>);

impl<'de> Deserialize<'de> for Entries {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Collect;
        impl<'de> Visitor<'de> for Collect {
            type Value = Entries;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Entries, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Entries(entries))
            }
        }
        deserializer.deserialize_map(Collect)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node(name: &str, mesh: bool, extras: Option<&str>) -> root::Node {
        let json = serde_json::json!({"name": name, "mesh": mesh.then_some(0)});
        let mut node: root::Node = serde_json::from_value(json).unwrap();
        node.extras = extras.map(|text| RawValue::from_string(text.into()).unwrap());
        node
    }

    fn names(nodes: Nodes) -> PartNames {
        PartNames { nodes: nodes.list, meshes: vec![("pane".into(), Some("{\"of\":\"mesh\"}".into()))] }
    }

    #[test]
    fn a_part_has_its_nodes_name_the_names_above_it_and_extras() {
        let mut nodes = Nodes::new(5);
        let site = nodes.add(0, &node("site", false, None), None);
        let building = nodes.add(1, &node("building 2", false, None), site);
        // A node without a name leaves no gap.
        let nameless = nodes.add(2, &node("", true, None), building);
        nodes.add(3, &node("door", true, Some(" { \"a b\" : [1.50, \"x \\\" y\"] }\n")), nameless);
        let names = names(nodes);
        let door = names.of(Some(3), 0);
        assert_eq!((&*door.name, &*door.path), ("door", "site/building 2"));
        assert_eq!(door.extras.as_deref(), Some("{\"a b\":[1.50,\"x \\\" y\"]}"));
        let pane = names.of(Some(2), 0);
        assert_eq!((&*pane.name, &*pane.path), ("pane", "site/building 2"));
        assert_eq!(pane.extras.as_deref(), Some("{\"of\":\"mesh\"}"));
        assert_eq!(names.of(None, 0), PartInfo { path: String::new(), ..pane });
        assert_eq!(names.of(Some(9), 9), PartInfo::default());
    }

    #[test]
    fn a_deep_chain_costs_no_more_than_its_names() {
        const DEPTH: usize = 100_000;
        let mut nodes = Nodes::new(DEPTH);
        let mut above = None;
        for index in 0..DEPTH {
            above = nodes.add(index, &node(if index % 2 == 0 { "storey" } else { "" }, true, None), above);
        }
        let names = names(nodes);
        let mut bytes = 0;
        for index in 0..DEPTH {
            let info = names.of(u32::try_from(index).ok(), 0);
            assert!(info.path.len() <= MAX_PATH_BYTES, "{} bytes", info.path.len());
            bytes += info.path.len();
        }
        assert!(names.of(Some(99_999), 0).path.starts_with("…/storey/storey"));
        assert!(bytes > DEPTH * 1000, "paths are cut where they must be: {bytes}");
        assert_eq!(names.of(Some(2), 0).path, "storey");
    }

    #[test]
    fn texts_that_are_too_long_are_cut_where_they_may_be() {
        let name = "ä".repeat(300);
        let long = format!("{{\"a\":1,\"b\":\"{}\",\"c\":[2]}}", "x".repeat(MAX_EXTRAS_BYTES));
        let mut nodes = Nodes::new(2);
        nodes.add(0, &node(&name, true, Some(&long)), None);
        nodes.add(1, &node("list", true, Some(&format!("[{}0]", "0,".repeat(3000)))), None);
        assert_eq!(nodes.shortened, 2);
        let names = PartNames { nodes: nodes.list, meshes: Vec::new() };
        let info = names.of(Some(0), 0);
        assert!(info.name.len() <= MAX_NAME_BYTES && info.name.ends_with("ä…"), "{}", info.name);
        assert_eq!(info.extras.as_deref(), Some("{\"a\":1,\"c\":[2]}"));
        assert_eq!(names.of(Some(1), 0).extras, None);
    }
}
