//! View-dependent peers given as data: length, error and bounds of their nodes.
//!
//! A file is a JSON array of peers:
//!
//! ```json
//! [{ "peer": "name and settings", "kind": "cluster-dag", "index_bytes": 96, "total_bytes": 1500,
//!    "nodes": [{ "bytes": 400, "vertices": 60, "faces": 100, "error": 0.1, "center": [0, 0, 0], "radius": 1,
//!                "children": [1] },
//!              { "bytes": 900, "vertices": 210, "faces": 400, "error": 0.02, "center": [0, 0, 0], "radius": 1,
//!                "children": [] }] }]
//! ```
//!
//! Lengths are in bytes on the wire; `error`, `center` and `radius` are in the model's units. A node's error is that of
//! what is drawn while its children are missing. Children come after their parents and may have several; nodes without
//! parents are the roots.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use serde::Deserialize;

/// Longest file.
const MAX_FILE_BYTES: u64 = 64 << 20;
/// Most peers in all files: each multiplies the runs of every case.
const MAX_PEERS: usize = 64;
/// Length limit of a node or index.
const MAX_PEER_PART_BYTES: u64 = 1 << 32;
/// The only known kind of peer.
const CLUSTER_DAG: &str = "cluster-dag";

/// Why two peers must not share a name.
const ROWS_DIFFER: &str = "rows of a report need different ones";

/// An invalid file of peers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {place}: {message}")]
pub struct PeersError {
    /// The file.
    pub file: String,
    /// The peer and field (`[0].nodes[3].radius`), the line, or "file".
    pub place: String,
    /// The fault and its remedy.
    pub message: String,
}

/// A view-dependent technique with its encoding of one model.
#[derive(Clone, Debug, PartialEq)]
pub struct Peer {
    /// Name and settings, for the report.
    pub name: String,
    /// Length of the index, which precedes all nodes.
    pub index_bytes: u64,
    /// Nodes, parents first.
    pub nodes: Vec<Node>,
}

impl Peer {
    /// The same peer with errors multiplied by `factor`, to model what would be fetched if it stated larger errors.
    #[must_use]
    pub fn with_errors(mut self, factor: f32) -> Self {
        for node in &mut self.nodes {
            node.error = (node.error * factor).min(f32::MAX);
        }
        self.name = format!("{}, errors times {factor}", self.name);
        self
    }
}

/// A part of a model at some precision.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Length of its body.
    pub bytes: u64,
    /// Error while its children are missing, in the model's units.
    pub error: f32,
    /// Bounds, in the model's units.
    pub center: [f64; 3],
    /// Bounds, in the model's units.
    pub radius: f32,
    /// Nodes that refine it.
    pub children: Vec<u32>,
}

#[derive(Deserialize)]
struct PeerFile {
    peer: String,
    kind: String,
    index_bytes: u64,
    total_bytes: u64,
    nodes: Vec<NodeFile>,
}

#[derive(Deserialize)]
struct NodeFile {
    bytes: u64,
    #[serde(rename = "vertices")]
    _vertices: u64,
    #[serde(rename = "faces")]
    _faces: u64,
    error: f64,
    center: [f64; 3],
    radius: f64,
    children: Vec<u64>,
}

/// A fault, without the file's name.
struct Fault {
    place: String,
    message: String,
}

fn fault<T>(place: impl Into<String>, message: impl Into<String>) -> Result<T, Fault> {
    Err(Fault { place: place.into(), message: message.into() })
}

/// Reads all files of a list in the format of `$PATH`: each entry is a file of peers, or a folder whose `*.json` files
/// are read in the order of their names.
///
/// # Errors
/// As [`read`]; also folders without such files, and two peers with one name.
pub fn read_all(list: &OsStr) -> Result<Vec<Peer>, PeersError> {
    let mut all: Vec<Peer> = Vec::new();
    for entry in std::env::split_paths(list) {
        for path in files(&entry)? {
            let refused = |place: String, message: String| PeersError {
                file: path.display().to_string(),
                place,
                message,
            };
            for (p, peer) in read(&path)?.into_iter().enumerate() {
                if all.iter().any(|other| other.name == peer.name) {
                    let message =
                        format!("{:?} is the name of another file's peer; {ROWS_DIFFER}", peer.name);
                    return Err(refused(format!("[{p}].peer"), message));
                }
                all.push(peer);
            }
            if all.len() > MAX_PEERS {
                let message =
                    format!("with it there are {} peers; {MAX_PEERS} may be named at once", all.len());
                return Err(refused("file".to_owned(), message));
            }
        }
    }
    Ok(all)
}

/// The files of an entry of a list.
fn files(entry: &Path) -> Result<Vec<PathBuf>, PeersError> {
    if !entry.is_dir() {
        return Ok(vec![entry.to_owned()]);
    }
    let refused = |message: String| PeersError {
        file: entry.display().to_string(),
        place: "folder".to_owned(),
        message,
    };
    let mut files = Vec::new();
    for file in std::fs::read_dir(entry).map_err(|why| refused(format!("cannot be read: {why}")))? {
        let path = file.map_err(|why| refused(format!("cannot be read: {why}")))?.path();
        if path.extension().is_some_and(|extension| extension == "json") {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(refused("has no *.json; name a file of peers, or a folder with some".to_owned()));
    }
    files.sort();
    Ok(files)
}

/// Reads a file of peers.
///
/// # Errors
/// Names the file, the peer and the invalid field.
pub fn read(path: &Path) -> Result<Vec<Peer>, PeersError> {
    let file = || path.display().to_string();
    let unreadable = |why: &dyn std::fmt::Display| PeersError {
        file: file(),
        place: "file".to_owned(),
        message: format!("cannot be read: {why}"),
    };
    let metadata = std::fs::metadata(path).map_err(|e| unreadable(&e))?;
    if !metadata.is_file() {
        return Err(unreadable(&"it is not a regular file"));
    }
    if metadata.len() > MAX_FILE_BYTES {
        let message = format!("has {} bytes; a file of peers has at most {MAX_FILE_BYTES}", metadata.len());
        return Err(PeersError { file: file(), place: "file".to_owned(), message });
    }
    let text = std::fs::read_to_string(path).map_err(|e| unreadable(&e))?;
    parse(&text, &file())
}

/// Parses the text of a file of peers; `file` is named in errors.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, file: &str) -> Result<Vec<Peer>, PeersError> {
    let error = |Fault { place, message }| PeersError { file: file.to_owned(), place, message };
    let peers: Vec<PeerFile> = serde_json::from_str(text)
        .map_err(|e| Fault {
            place: format!("line {}, column {}", e.line(), e.column()),
            message: e.to_string().replace('\n', " "),
        })
        .map_err(error)?;
    check(peers).map_err(error)
}

fn check(peers: Vec<PeerFile>) -> Result<Vec<Peer>, Fault> {
    if peers.is_empty() || peers.len() > MAX_PEERS {
        return fault("file", format!("has {} peers; 1 to {MAX_PEERS} are wanted", peers.len()));
    }
    let mut checked: Vec<Peer> = Vec::with_capacity(peers.len());
    for (p, file) in peers.into_iter().enumerate() {
        let peer = check_peer(file).map_err(|f| Fault { place: format!("[{p}].{}", f.place), ..f })?;
        if checked.iter().any(|other| other.name == peer.name) {
            let message = format!("{:?} is another peer's name; {ROWS_DIFFER}", peer.name);
            return fault(format!("[{p}].peer"), message);
        }
        checked.push(peer);
    }
    Ok(checked)
}

fn check_peer(file: PeerFile) -> Result<Peer, Fault> {
    let PeerFile { peer: name, kind, index_bytes, total_bytes, nodes } = file;
    if name.trim().is_empty() || name.len() > 200 || name.chars().any(char::is_control) {
        return fault("peer", "is not a name of 1 to 200 bytes in one line");
    }
    if kind != CLUSTER_DAG {
        return fault("kind", format!("{kind:?} is not known; only {CLUSTER_DAG:?} is"));
    }
    if index_bytes > MAX_PEER_PART_BYTES {
        return fault("index_bytes", format!("{index_bytes} is more than {MAX_PEER_PART_BYTES}"));
    }
    if nodes.is_empty() {
        return fault("nodes", "is empty; a model has at least one node");
    }
    let count = nodes.len();
    let checked = nodes
        .into_iter()
        .enumerate()
        .map(|(n, node)| {
            check_node(n, node, count).map_err(|f| Fault { place: format!("nodes[{n}].{}", f.place), ..f })
        })
        .collect::<Result<Vec<_>, _>>()?;
    // Lengths are at most 2^32 each, and the length of the file is bounded.
    let sum = index_bytes + checked.iter().map(|node| node.bytes).sum::<u64>();
    if sum > total_bytes {
        return fault("total_bytes", format!("is {total_bytes}, but index and nodes have {sum}"));
    }
    Ok(Peer { name, index_bytes, nodes: checked })
}

fn check_node(number: usize, node: NodeFile, count: usize) -> Result<Node, Fault> {
    let NodeFile { bytes, error, center, radius, children, .. } = node;
    if !(1..=MAX_PEER_PART_BYTES).contains(&bytes) {
        return fault("bytes", format!("{bytes} is not a length from 1 to {MAX_PEER_PART_BYTES}"));
    }
    // Within f32, in which screen errors are computed.
    let length = |value: f64| Some(value as f32).filter(|x| value >= 0.0 && x.is_finite());
    let Some(error) = length(error) else {
        return fault("error", format!("{error} is not a length"));
    };
    let Some(radius) = length(radius) else {
        return fault("radius", format!("{radius} is not a length"));
    };
    if let Some(axis) = center.iter().position(|x| x.abs() > f64::from(f32::MAX)) {
        return fault(format!("center[{axis}]"), format!("{} is too large", center[axis]));
    }
    let mut checked = Vec::with_capacity(children.len());
    for (c, child) in children.into_iter().enumerate() {
        let place = || format!("children[{c}]");
        if child >= count as u64 {
            return fault(place(), format!("{child} is not a node; there are {count}, numbered from 0"));
        }
        if child <= number as u64 {
            return fault(place(), format!("{child} does not come after its parent, node {number}"));
        }
        let Ok(child) = u32::try_from(child) else { return fault(place(), "is too large") };
        if checked.contains(&child) {
            return fault(place(), format!("{child} is named twice"));
        }
        checked.push(child);
    }
    Ok(Node { bytes, error, center, radius, children: checked })
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXAMPLE: &str = include_str!("../../peers/example.json");

    #[test]
    fn the_example_is_read() {
        let peers = parse(EXAMPLE, "example.json").unwrap();
        let nodes: Vec<usize> = peers.iter().map(|peer| peer.nodes.len()).collect();
        assert_eq!((peers[0].name.as_str(), nodes), ("example, one node a level", vec![3, 5]));
        assert_eq!(peers[1].nodes[0].children, [2, 3]);
    }

    #[test]
    fn invalid_peers_are_refused_with_their_place() {
        let good = r#"[{"peer":"p","kind":"cluster-dag","index_bytes":10,"total_bytes":500,"nodes":[
            {"bytes":100,"vertices":3,"faces":1,"error":0.5,"center":[0,0,0],"radius":1,"children":[1]},
            {"bytes":200,"vertices":3,"faces":1,"error":0.1,"center":[0,0,0],"radius":1,"children":[]}]}]"#;
        assert_eq!(parse(good, "f").unwrap()[0].nodes.len(), 2);
        let cases = [
            ("\"error\":0.5", "\"error\":-1", "[0].nodes[0].error", "not a length"),
            ("\"error\":0.5", "\"error\":1e39", "[0].nodes[0].error", "not a length"),
            ("\"error\":0.5", "\"error\":1e999", "line 2", "number out of range"),
            ("\"error\":0.5", "\"error\":null", "line 2", "invalid type"),
            (
                "\"radius\":1,\"children\":[1]",
                "\"radius\":-2,\"children\":[1]",
                "[0].nodes[0].radius",
                "not a",
            ),
            (
                "\"center\":[0,0,0],\"radius\":1,\"children\":[1]",
                "\"center\":[0,1e300,0],\"radius\":1,\"children\":[1]",
                "[0].nodes[0].center[1]",
                "too large",
            ),
            ("\"children\":[1]", "\"children\":[2]", "[0].nodes[0].children[0]", "there are 2"),
            ("\"children\":[1]", "\"children\":[0]", "[0].nodes[0].children[0]", "after its parent"),
            ("\"children\":[1]", "\"children\":[1,1]", "[0].nodes[0].children[1]", "twice"),
            ("\"children\":[1]", "\"children\":[-1]", "line 2", "invalid value"),
            ("\"children\":[]", "\"children\":[0]", "[0].nodes[1].children[0]", "after its parent"),
            ("\"bytes\":100", "\"bytes\":0", "[0].nodes[0].bytes", "not a length"),
            ("\"bytes\":100", "\"bytes\":9999999999", "[0].nodes[0].bytes", "not a length"),
            ("\"bytes\":100,", "", "line 2", "missing field"),
            ("cluster-dag", "octree", "[0].kind", "octree"),
            ("\"peer\":\"p\"", "\"peer\":\" \"", "[0].peer", "not a name"),
            ("\"total_bytes\":500", "\"total_bytes\":300", "[0].total_bytes", "have 310"),
            ("\"index_bytes\":10", "\"index_bytes\":5000000000", "[0].index_bytes", "more than"),
        ];
        for (from, to, place, message) in cases {
            let bad = good.replacen(from, to, 1);
            assert_ne!(bad, good, "{from}");
            let error = parse(&bad, "f").unwrap_err();
            assert!(error.place.starts_with(place), "{to}: {error}");
            assert!(error.message.contains(message), "{to}: {error}");
            assert!(!error.to_string().contains('\n'));
        }
        let one = good.trim_start_matches('[').strip_suffix(']').unwrap();
        let twice = format!("[{one},{one}]");
        assert_eq!(parse(&twice, "f").unwrap_err().place, "[1].peer");
        assert_eq!(parse("[]", "f").unwrap_err().place, "file");
        assert!(parse("[{]", "f").unwrap_err().place.starts_with("line 1"));
        let empty = good.split("\"nodes\"").next().unwrap().to_owned() + "\"nodes\":[]}]";
        assert_eq!(parse(&empty, "f").unwrap_err().place, "[0].nodes");
        assert!(read(Path::new("no/peers.json")).unwrap_err().message.contains("cannot be read"));
        assert!(read(Path::new(env!("CARGO_MANIFEST_DIR"))).unwrap_err().message.contains("regular"));
    }

    #[test]
    fn errors_may_be_larger_than_stated() {
        let peer = parse(EXAMPLE, "example.json").unwrap().remove(0);
        let twice = peer.clone().with_errors(2.0);
        assert_eq!(twice.name, format!("{}, errors times 2", peer.name));
        for (node, larger) in peer.nodes.iter().zip(&twice.nodes) {
            assert_eq!(Node { error: 2.0 * node.error, ..node.clone() }, *larger);
        }
        assert!(twice.with_errors(f32::MAX).nodes.iter().all(|node| node.error.is_finite()));
    }

    /// A list of files and folders as `$PATH` has them.
    fn list(entries: &[&Path]) -> std::ffi::OsString {
        std::env::join_paths(entries).unwrap()
    }

    #[test]
    fn several_files_and_folders_of_them_are_read_in_their_order() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, peer: &str| {
            let text = format!(
                r#"[{{"peer":"{peer}","kind":"cluster-dag","index_bytes":1,"total_bytes":9,"nodes":[
                {{"bytes":8,"vertices":3,"faces":1,"error":0,"center":[0,0,0],"radius":1,"children":[]}}]}}]"#
            );
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        let (second, first) = (file("b.json", "second"), file("a.json", "first"));
        std::fs::write(folder.path().join("notes.txt"), "not of peers").unwrap();
        let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../peers/example.json");
        let names = |entries: &[&Path]| {
            let peers = read_all(&list(entries)).unwrap();
            peers.into_iter().map(|peer| peer.name).collect::<Vec<_>>()
        };
        assert_eq!(names(&[folder.path()]), ["first", "second"]);
        assert_eq!(names(&[&second, &first]), ["second", "first"]);
        assert_eq!(names(&[&example]), names(&[example.parent().unwrap()]), "one file is a list too");
        assert_eq!(names(&[folder.path(), &example]).len(), 4);

        let refused = |entries: &[&Path]| read_all(&list(entries)).unwrap_err();
        let twice = refused(&[&first, folder.path()]);
        assert_eq!((twice.file.as_str(), twice.place.as_str()), (first.to_str().unwrap(), "[0].peer"));
        assert!(twice.message.contains("another file's peer"), "{twice}");
        let none = refused(&[&first, Path::new("no/peers.json")]);
        assert!(none.file.contains("no/peers.json") && none.message.contains("cannot be read"), "{none}");
        let empty = tempfile::tempdir().unwrap();
        assert!(refused(&[empty.path()]).message.contains("has no *.json"));
        file("c.json", " ");
        let bad = refused(&[folder.path()]);
        assert!(bad.file.ends_with("c.json") && bad.message.contains("not a name"), "{bad}");
        std::fs::remove_file(folder.path().join("c.json")).unwrap();
        for number in 0..MAX_PEERS {
            file(&format!("d{number}.json"), &format!("peer {number}"));
        }
        assert!(refused(&[folder.path()]).message.contains("there are 65 peers"));
    }
}
