//! The pack of a node.

use std::path::Path;

use lodestream_compress::whole_file::write_atomically;
use lodestream_compress::{encode_base, prepare};
use lodestream_geometry::base::Base;
use lodestream_geometry::mesh::{QuantisedMesh, SourceMesh};
use lodestream_geometry::pack::{self, BlobKind};
use lodestream_geometry::pool::Silent;
use lodestream_geometry::prepare::{suit, whole};
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::{Codec, MeshError, Settings};
use lodestream_scene::asset::AssetDescription;
use lodestream_store::PackFile;
use lodestream_threads::Threads;

use super::mesh::NodeMesh;
use crate::preparation_settings::CodecChoice;
use crate::prepare::PrepareError;
use crate::prepare::cache::Key;

/// Largest error of a node's base mesh, as a share of the diagonal: it then has two to eight kilobytes. Half of it doubles
/// the bytes (docs/design/proxies.md).
pub(super) const BASE_ERROR: f64 = 0.06;
/// [`Settings::visible_side`]: walls that share edges are one component of a proxy.
pub(super) const VISIBLE_SIDE: f64 = 0.35;
/// Largest rounding of positions, as a share of the bounding box's diagonal and of the error of the members.
const ROUNDING_OF_DIAGONAL: f64 = 1.0 / 32_768.0;
const ROUNDING_OF_ERROR: f64 = 1.0 / 16.0;

/// What the settings of a pack begin with, before the error that the proxy states.
const SETTINGS: &str = "proxy, error ";
const SLOPE: &str = ", per distance ";

/// What a pack states of its proxy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stated {
    /// Error of the finest mesh.
    pub(super) error: f32,
    /// [`root_slope`](lodestream_scene::description::SceneHeader::root_slope) of a root, else 0.
    pub(super) slope: f32,
}

/// Opens a pack of the cache, unless it is missing, damaged or made from something else, with what was stated for it.
pub(super) fn open(path: &Path, key: &Key) -> Option<(PackFile, Stated)> {
    let pack = PackFile::open(path).ok().filter(|pack| pack.made_from() == key.bytes())?;
    pack.verify().and_then(|()| pack.base_faces()).ok()?;
    let text = pack.settings().ok()?;
    let (error, slope) = text.strip_prefix(SETTINGS)?.split_once(SLOPE)?;
    Some((pack, Stated { error: error.parse().ok()?, slope: slope.parse().ok()? }))
}

/// Largest distance between a position and its grid point, for members with the given error.
fn rounding(mesh: &NodeMesh, members_error: f64) -> Precision {
    let points = || mesh.mesh.positions.iter().map(|&point| glam::DVec3::from(point));
    let low = points().fold(glam::DVec3::INFINITY, glam::DVec3::min);
    let high = points().fold(glam::DVec3::NEG_INFINITY, glam::DVec3::max);
    let length = (ROUNDING_OF_ERROR * members_error).max(ROUNDING_OF_DIAGONAL * low.distance(high));
    if length > 0.0 && length.is_finite() { Precision::Tolerance(length) } else { Precision::Bits(8) }
}

/// Prepares a node's mesh, whose members have the given error, and writes its pack.
///
/// # Errors
/// A mesh without a usable face, a file that cannot be written.
pub(super) fn write(
    mesh: NodeMesh,
    members_error: f64,
    threads: Threads,
    path: &Path,
    key: &Key,
) -> Result<(PackFile, Stated), PrepareError> {
    let mesh_error = |source| PrepareError::Mesh { path: path.to_owned(), source };
    let description = describe(&mesh).map_err(mesh_error)?;
    let (quantised, codec) = quantised(&mesh.mesh, rounding(&mesh, members_error)).map_err(mesh_error)?;
    drop(mesh);
    let settings =
        Settings { base_error: BASE_ERROR, visible_side: VISIBLE_SIDE, codec, ..Settings::default() };
    let mut prepared = prepare(&quantised, &settings, &threads, &Silent).map_err(mesh_error)?;
    prepared.base.description = description;
    let base = encoded(&prepared.base).map_err(mesh_error)?;
    let mut blobs: Vec<(BlobKind, &[u8])> = vec![(BlobKind::Base, &base)];
    blobs.extend((0..).zip(&prepared.pages).map(|(i, page)| (BlobKind::IndexPage(i), &page[..])));
    blobs.extend((0..).zip(&prepared.chunks).map(|(i, chunk)| (BlobKind::Chunk(i), &chunk[..])));
    // A grid point is at most half a cell away along each axis; the sum is rounded up.
    let rounding = prepared.base.grid.step * 3.0_f64.sqrt() / 2.0;
    let error = ((members_error + rounding) as f32).next_up();
    store(blobs, Stated { error, slope: 0.0 }, path, key)
}

/// The base blob of a mesh that is its own base mesh, with positions rounded by at most a length.
///
/// # Errors
/// A mesh without a usable face.
pub(super) fn whole_base(mesh: &NodeMesh, rounding: f64) -> Result<Vec<u8>, MeshError> {
    let (quantised, codec) = quantised(&mesh.mesh, Precision::Tolerance(rounding))?;
    let mut base = whole(&quantised, codec)?;
    base.description = describe(mesh)?;
    encoded(&base)
}

/// Writes a pack that has a base blob alone.
///
/// # Errors
/// A file that cannot be written.
pub(super) fn write_base(
    base: &[u8],
    stated: Stated,
    path: &Path,
    key: &Key,
) -> Result<(PackFile, Stated), PrepareError> {
    store(vec![(BlobKind::Base, base)], stated, path, key)
}

fn describe(mesh: &NodeMesh) -> Result<Vec<u8>, MeshError> {
    let description =
        AssetDescription { materials: vec![mesh.material.clone()], ..AssetDescription::default() };
    description.encode().map_err(|why| MeshError::Internal { why: why.to_string() })
}

fn quantised(mesh: &SourceMesh, precision: Precision) -> Result<(QuantisedMesh, Codec), MeshError> {
    let mut quantised = quantise(mesh, &QuantiseSettings { precision, ..QuantiseSettings::default() })?;
    let codec = CodecChoice::Auto.of(&quantised);
    suit(&mut quantised, codec);
    Ok((quantised, codec))
}

fn encoded(base: &Base) -> Result<Vec<u8>, MeshError> {
    encode_base(base).map_err(|why| MeshError::Internal { why: why.to_string() })
}

fn store(
    blobs: Vec<(BlobKind, &[u8])>,
    stated: Stated,
    path: &Path,
    key: &Key,
) -> Result<(PackFile, Stated), PrepareError> {
    let settings = format!("{SETTINGS}{}{SLOPE}{}", stated.error, stated.slope);
    let mut blobs = blobs;
    blobs.push((BlobKind::Settings, settings.as_bytes()));
    let write_error = |source| PrepareError::Write { path: path.to_owned(), source };
    let bytes = pack::write(key.bytes(), &blobs).map_err(|why| write_error(std::io::Error::other(why)))?;
    write_atomically(path, |out| out.write_all(&bytes)).map_err(write_error)?;
    Ok((PackFile::open(path)?, stated))
}
