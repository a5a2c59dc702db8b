//! What tests run both here and natively, to compare: packs decoded to the finest level, and the heights of terrain
//! tiles. Not in the page and not in the package: `script/web --checks` builds a module of its own.

use std::sync::Arc;

use lodestream_compress::{decode_base, decode_prefix};
use lodestream_geometry::base::Base;
use lodestream_geometry::index::{CHUNKS_PER_PAGE, ChunkInfo, decode_page, page_count};
use lodestream_geometry::pack::{BlobKind, HEAD_BYTES, Head, find};
use lodestream_geometry::refine::ActiveMesh;
use lodestream_terrain::tiles::{PlacedTerrain, TileId};
use lodestream_terrain::{Parameters, Scratch, Terrain, decode_points, decode_stamps};
use wasm_bindgen::prelude::*;

fn text(why: impl ToString) -> String {
    why.to_string()
}

/// The geometry of a pack, and the mesh that it has been refined to.
#[wasm_bindgen]
#[derive(Debug)]
pub struct PackCheck {
    base: Base,
    infos: Vec<ChunkInfo>,
    /// Payloads as they are stored.
    chunks: Vec<Vec<u8>>,
    mesh: Option<ActiveMesh>,
}

#[wasm_bindgen]
impl PackCheck {
    /// Reads a pack's bytes.
    ///
    /// # Errors
    /// Damage.
    #[wasm_bindgen(constructor)]
    pub fn new(pack: &[u8]) -> Result<PackCheck, String> {
        let head = Head::parse(pack).map_err(text)?;
        let table =
            pack.get(HEAD_BYTES..HEAD_BYTES + head.table_bytes()).ok_or("the pack ends in its table")?;
        let entries = head.parse_table(table, pack.len() as u64).map_err(text)?;
        let blob = |kind| {
            let entry = find(&entries, kind).ok_or_else(|| format!("the pack has no {kind:?}"))?;
            // Within the file, which the table's parser has checked.
            let bytes = &pack[entry.offset as usize..][..entry.length as usize];
            entry.verify(bytes).map_err(text)?;
            Ok::<_, String>(bytes)
        };
        let base = decode_base(blob(BlobKind::Base)?).map_err(text)?;
        let mut infos = Vec::new();
        for (page, first) in (0..).zip((0..base.chunk_count).step_by(CHUNKS_PER_PAGE)) {
            infos.extend(decode_page(blob(BlobKind::IndexPage(page))?, first).map_err(text)?);
        }
        let count = base.chunk_count as usize;
        if infos.len() != count {
            return Err(format!("{} chunks on {} pages, not {count}", infos.len(), page_count(count)));
        }
        let chunks = (0..base.chunk_count).map(|chunk| Ok(blob(BlobKind::Chunk(chunk))?.to_vec()));
        let chunks = chunks.collect::<Result<_, String>>()?;
        Ok(Self { base, infos, chunks, mesh: None })
    }

    /// Number of chunks.
    #[must_use]
    pub fn chunks(&self) -> usize {
        self.chunks.len()
    }

    /// Decodes and applies all chunks, beginning from the base mesh.
    ///
    /// # Errors
    /// Damage.
    pub fn refine(&mut self) -> Result<(), String> {
        let mut mesh = ActiveMesh::new(&self.base);
        for ((chunk, info), stored) in (0..).zip(&self.infos).zip(&self.chunks) {
            let delta = decode_prefix(&mesh, chunk, info, None, stored).map_err(text)?;
            mesh.apply(&delta).map_err(text)?;
        }
        self.mesh = Some(mesh);
        Ok(())
    }

    /// BLAKE3 hash of what a renderer has of the refined mesh: all numbers of its vertices and, by material, its faces.
    ///
    /// # Errors
    /// A mesh that has not been refined.
    pub fn hash(&self) -> Result<String, String> {
        let mesh = self.mesh.as_ref().ok_or("refine the mesh first")?;
        let mut hasher = blake3::Hasher::new();
        for slot in 0..mesh.wedge_slots() {
            let vertex = mesh.render_vertex(slot);
            let numbers = [&vertex.position[..], &vertex.normal, &vertex.uv, &vertex.morph_from].concat();
            let numbers: Vec<u8> = numbers.iter().flat_map(|number| number.to_bits().to_le_bytes()).collect();
            hasher.update(&numbers).update(&vertex.color).update(&[vertex.smooth.into()]);
        }
        for material in 0..mesh.material_count() {
            let faces = mesh.indices(material);
            let slots: Vec<u8> = faces.as_flattened().iter().flat_map(|slot| slot.to_le_bytes()).collect();
            hasher.update(&(faces.len() as u64).to_le_bytes()).update(&slots);
        }
        Ok(hasher.finalize().to_string())
    }
}

/// A terrain, as a scene states it.
#[wasm_bindgen]
#[derive(Debug)]
pub struct TerrainCheck(Terrain);

#[wasm_bindgen]
impl TerrainCheck {
    /// A terrain of encoded parameters and stamps.
    ///
    /// # Errors
    /// Other bytes.
    #[wasm_bindgen(constructor)]
    pub fn new(parameters: &[u8], stamps: &[u8]) -> Result<TerrainCheck, String> {
        let parameters = Parameters::decode(parameters.try_into().map_err(text)?).map_err(text)?;
        let stamps = decode_stamps(stamps).map_err(text)?;
        Ok(Self(Terrain::with_stamps(parameters, stamps).map_err(text)?))
    }

    /// Sets the height overrides of a patch, from the bytes of their blob.
    ///
    /// # Errors
    /// Other bytes, or a patch outside the world.
    pub fn set_points(&mut self, x: i32, y: i32, points: &[u8]) -> Result<(), String> {
        let points = decode_points(self.0.parameters().finest_level, points).map_err(text)?;
        self.0.set_points(x.into(), y.into(), points).map_err(text)
    }

    /// BLAKE3 hash of the heights of the tiles of each spacing up to `spacings` that are at most `reach` tiles from the
    /// origin, each way.
    #[must_use]
    pub fn hash(&self, spacings: u8, reach: i32) -> String {
        let placed = PlacedTerrain::new(Arc::new(self.0.clone()), 1.0, 1.0);
        let (mut scratch, mut heights) = (Scratch::new(), Vec::new());
        let mut hasher = blake3::Hasher::new();
        for spacing in 0..=spacings {
            for (y, x) in (-reach..reach).flat_map(|y| (-reach..reach).map(move |x| (y, x))) {
                placed.heights(TileId { spacing, x, y }, &mut scratch, &mut heights);
                let bytes: Vec<u8> = heights.iter().flat_map(|height| height.to_le_bytes()).collect();
                hasher.update(&bytes);
            }
        }
        hasher.finalize().to_string()
    }
}
