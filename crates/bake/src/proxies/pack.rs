//! The pack of a node.

use std::path::Path;

use lodestream_compress::whole_file::write_atomically;
use lodestream_compress::{encode_base, prepare};
use lodestream_geometry::pack::{self, BlobKind};
use lodestream_geometry::pool::Silent;
use lodestream_geometry::prepare::suit;
use lodestream_geometry::quantise::{Precision, QuantiseSettings, quantise};
use lodestream_geometry::{MeshError, Settings};
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

/// Opens a pack of the cache, unless it is missing, damaged or made from something else, with the error that was stated
/// for it.
pub(super) fn open(path: &Path, key: &Key) -> Option<(PackFile, f32)> {
    let pack = PackFile::open(path).ok().filter(|pack| pack.made_from() == key.bytes())?;
    pack.verify().and_then(|()| pack.base_faces()).ok()?;
    let text = pack.settings().ok()?;
    let error = text.strip_prefix(SETTINGS)?.parse().ok()?;
    Some((pack, error))
}

/// Largest distance between a position and its grid point, for members with the given error.
fn rounding(mesh: &NodeMesh, members_error: f64) -> Precision {
    let points = || mesh.mesh.positions.iter().map(|&point| glam::DVec3::from(point));
    let low = points().fold(glam::DVec3::INFINITY, glam::DVec3::min);
    let high = points().fold(glam::DVec3::NEG_INFINITY, glam::DVec3::max);
    let length = (ROUNDING_OF_ERROR * members_error).max(ROUNDING_OF_DIAGONAL * low.distance(high));
    if length > 0.0 && length.is_finite() { Precision::Tolerance(length) } else { Precision::Bits(8) }
}

/// Prepares a node's mesh, whose members have the given error, and writes its pack. Gives the error of the finest mesh.
///
/// # Errors
/// A mesh without a usable face, a file that cannot be written.
pub(super) fn write(
    mesh: NodeMesh,
    members_error: f64,
    threads: Threads,
    path: &Path,
    key: &Key,
) -> Result<(PackFile, f32), PrepareError> {
    let mesh_error = |source| PrepareError::Mesh { path: path.to_owned(), source };
    let description =
        AssetDescription { materials: vec![mesh.material.clone()], ..AssetDescription::default() };
    let internal = |why: String| mesh_error(MeshError::Internal { why });
    let description = description.encode().map_err(|why| internal(why.to_string()))?;
    let settings =
        QuantiseSettings { precision: rounding(&mesh, members_error), ..QuantiseSettings::default() };
    let mut quantised = quantise(&mesh.mesh, &settings).map_err(mesh_error)?;
    drop(mesh);
    let codec = CodecChoice::Auto.of(&quantised);
    suit(&mut quantised, codec);
    let settings =
        Settings { base_error: BASE_ERROR, visible_side: VISIBLE_SIDE, codec, ..Settings::default() };
    let mut prepared = prepare(&quantised, &settings, &threads, &Silent).map_err(mesh_error)?;
    prepared.base.description = description;
    let base = encode_base(&prepared.base).map_err(|why| internal(why.to_string()))?;
    let mut blobs: Vec<(BlobKind, &[u8])> = vec![(BlobKind::Base, &base)];
    blobs.extend((0..).zip(&prepared.pages).map(|(i, page)| (BlobKind::IndexPage(i), &page[..])));
    blobs.extend((0..).zip(&prepared.chunks).map(|(i, chunk)| (BlobKind::Chunk(i), &chunk[..])));
    // A grid point is at most half a cell away along each axis; the sum is rounded up.
    let rounding = prepared.base.grid.step * 3.0_f64.sqrt() / 2.0;
    let error = ((members_error + rounding) as f32).next_up();
    let settings = format!("{SETTINGS}{error}");
    blobs.push((BlobKind::Settings, settings.as_bytes()));
    let write_error = |source| PrepareError::Write { path: path.to_owned(), source };
    let bytes = pack::write(key.bytes(), &blobs).map_err(|why| write_error(std::io::Error::other(why)))?;
    write_atomically(path, |out| out.write_all(&bytes)).map_err(write_error)?;
    Ok((PackFile::open(path)?, error))
}
