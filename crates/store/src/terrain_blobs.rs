//! Encodes the blobs of a terrain: height overrides of its patches, and their directory.

use bytes::Bytes;
use lodestream_scene::TerrainBlob;
use lodestream_scene::terrain::{OverridePatch, PATCHES_PER_PAGE, encode_directory};
use lodestream_terrain::{Scratch, Terrain, TerrainError, encode_points};

/// Encoded height overrides, made once when a scene is opened; features are small.
#[derive(Clone, Debug, Default)]
pub struct TerrainBlobs {
    pages: Vec<Bytes>,
    /// Height overrides by index in the directory.
    points: Vec<Bytes>,
}

/// Features that cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum TerrainBlobsError {
    /// A patch's points cannot be coded.
    #[error("the points of patch {x}, {y} cannot be coded: {why}")]
    Points {
        /// Its column.
        x: i64,
        /// Its row.
        y: i64,
        /// Why.
        why: TerrainError,
    },
    /// The directory cannot be coded.
    #[error("the terrain's directory cannot be coded: {0}")]
    Directory(String),
}

impl TerrainBlobs {
    /// Encodes a terrain's height overrides. Generates each of their patches with and without them, which gives the error
    /// of leaving them out.
    ///
    /// # Errors
    /// See [`TerrainBlobsError`].
    pub fn new(terrain: &Terrain) -> Result<Self, TerrainBlobsError> {
        let parameters = terrain.parameters();
        let mut listed = Vec::new();
        let mut points = Vec::new();
        let mut scratch = Scratch::new();
        let (mut with, mut without) = (Vec::new(), Vec::new());
        for (x, y) in terrain.patches_with_points() {
            let bad = |why| TerrainBlobsError::Points { x, y, why };
            let Some(list) = terrain.points(x, y) else { continue };
            let bytes = encode_points(parameters.finest_level, list).map_err(bad)?;
            let mut bare = terrain.clone();
            bare.remove_points(x, y);
            let level = parameters.finest_level;
            terrain.patch_into(x, y, level, &mut scratch, &mut with).map_err(bad)?;
            bare.patch_into(x, y, level, &mut scratch, &mut without).map_err(bad)?;
            let error = with.iter().zip(&without).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
            let place = |at: i64| i32::try_from(at).unwrap_or(i32::MAX);
            let length = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
            listed.push(OverridePatch { x: place(x), y: place(y), bytes: length, error });
            points.push(Bytes::from(bytes));
        }
        let pages = listed.chunks(PATCHES_PER_PAGE as usize).map(encode_directory);
        let pages = pages
            .map(|page| page.map(Bytes::from).map_err(|why| TerrainBlobsError::Directory(why.to_string())))
            .collect::<Result<_, _>>()?;
        Ok(Self { pages, points })
    }

    /// The directory's pages and the overrides, encoded before.
    pub(crate) const fn of_parts(pages: Vec<Bytes>, points: Vec<Bytes>) -> Self {
        Self { pages, points }
    }

    /// The pages of the directory, and the overrides.
    pub fn parts(&self) -> (&[Bytes], &[Bytes]) {
        (&self.pages, &self.points)
    }

    /// A blob; `None` if there is none of this number.
    #[must_use]
    pub fn get(&self, blob: TerrainBlob) -> Option<&Bytes> {
        match blob {
            TerrainBlob::DirectoryPage(page) => self.pages.get(page as usize),
            TerrainBlob::HeightOverrides(patch) => self.points.get(patch as usize),
        }
    }

    /// All bytes, for fingerprints.
    pub fn all(&self) -> impl Iterator<Item = &Bytes> {
        self.pages.iter().chain(&self.points)
    }
}
