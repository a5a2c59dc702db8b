//! Model files.

use std::cell::RefCell;

use lodestream_geometry::mesh::{NONE, SourceMesh};
use lodestream_geometry::quantise::{QuantiseSettings, quantise};
use lodestream_import::gltf::CopyTolerance;
use lodestream_import::{ImageSource, Part, texture};
use lodestream_scene::placement::Placement;
use tempfile::TempDir;

use crate::compressed::file;
use crate::meter::{Ceiling, within};

thread_local! {
    static FOLDER: RefCell<Option<TempDir>> = const { RefCell::new(None) };
}

/// Runs `work` in a folder that the thread reuses.
fn in_folder<T>(work: impl FnOnce(&std::path::Path) -> T) -> T {
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| TempDir::new().expect("a temporary folder"));
        work(folder.path())
    })
}

/// An OBJ file and, after the first zero byte, its `m.mtl`.
pub fn obj_import(data: &[u8]) -> bool {
    let (obj, mtl) =
        data.iter().position(|&b| b == 0).map_or((data, &[][..]), |at| (&data[..at], &data[at + 1..]));
    in_folder(|folder| {
        let path = folder.join("a.obj");
        std::fs::write(&path, obj).expect("a file in the temporary folder");
        std::fs::write(folder.join("m.mtl"), mtl).expect("a file in the temporary folder");
        let Ok(imported) = within(OBJ, data.len(), || lodestream_import::import(&path)) else { return false };
        let materials = imported.materials.len();
        consistent(&imported.mesh, materials);
        true
    })
}

/// A line of eight bytes becomes two lines of text, a position in the parser, one in a table of distinct values and one
/// in the mesh, each in a vector with up to twice its length as capacity.
const OBJ: Ceiling = Ceiling { base_bytes: 1 << 18, bytes_per_byte: 512, base_steps: 0, steps_per_byte: 0 };

/// A PLY file, or an STL file if it does not begin as PLY does: the formats that are streamed.
pub fn ply_import(data: &[u8]) -> bool {
    in_folder(|folder| {
        let path = folder.join(if data.starts_with(b"ply") { "a.ply" } else { "a.stl" });
        std::fs::write(&path, data).expect("a file in the temporary folder");
        let Ok(imported) = within(PLY, data.len(), || lodestream_import::import(&path)) else { return false };
        consistent(&imported.mesh, imported.materials.len());
        true
    })
}

/// A buffer of 64 KiB; a facet of STL of 50 bytes has three corners with values of their own; a face of one byte reserves 50 bytes, a vertex of three 60; a vertex of nine bytes with new
/// values is also stored in the tables.
const PLY: Ceiling = Ceiling { base_bytes: 1 << 18, bytes_per_byte: 256, base_steps: 0, steps_per_byte: 0 };

/// A glTF or GLB file: its contents, and its first mesh alone.
pub fn gltf_import(data: &[u8]) -> bool {
    let has = |name: &[u8]| data.windows(name.len()).any(|text| text == name);
    let dense = has(b"_compression") || has(b"_instancing");
    import_gltf(data, if dense { COMPRESSED } else { GLTF })
}

/// A stream of Draco or of one of meshoptimizer's codecs, in a generated GLB file.
pub fn gltf_compressed(data: &[u8]) -> bool {
    file(data).is_some_and(|file| import_gltf(&file, COMPRESSED))
}

fn import_gltf(data: &[u8], ceiling: Ceiling) -> bool {
    in_folder(|folder| {
        let path = folder.join(if data.starts_with(b"glTF") { "a.glb" } else { "a.gltf" });
        std::fs::write(&path, data).expect("a file in the temporary folder");
        let mut accepted = false;
        let found = within(ceiling, data.len(), || lodestream_import::gltf::contents(&path, None));
        for animation in found.into_iter().filter_map(|contents| contents.animation) {
            assert!(animation.model.to_bytes().is_ok(), "what is found can be sent");
        }
        let parts = [
            Part::Whole,
            Part::Mesh { mesh: 0, linear: [[1.0, 0.5, 0.0], [0.0, -2.0, 0.0], [0.0, 0.0, 1.0]] },
        ];
        for part in parts {
            if let Ok(imported) = within(ceiling, data.len(), || {
                lodestream_import::import_part(&path, &part, lodestream_import::CreaseAngle::default())
            }) {
                consistent(&imported.mesh, imported.materials.len());
                accepted = true;
            }
        }
        let copies = Some(CopyTolerance::Share(1e-4));
        if let Ok(contents) = within(ceiling, data.len(), || lodestream_import::gltf::contents(&path, copies))
        {
            for placed in &contents.placed {
                let Placement { translation, rotation, scale } = placed.placement;
                assert!(scale > 0.0 && scale.is_finite());
                assert!(translation.iter().all(|x| x.is_finite()) && rotation.iter().all(|x| x.is_finite()));
            }
            for punctual_light in &contents.punctual_lights {
                punctual_light.check().expect("an imported light can be");
            }
        }
        accepted
    })
}

/// JSON values of a few bytes become structures of some hundred bytes. Every instance of a mesh is a node in the file,
/// so the imported size may be quadratic in the file's length; this limit is for small files.
const GLTF: Ceiling = Ceiling { base_bytes: 1 << 22, bytes_per_byte: 4096, base_steps: 0, steps_per_byte: 0 };

/// A byte of a compressed stream decodes to at most 256 elements, or 128 triangles and points, each of some hundred
/// bytes in the decoder, its result and the mesh. A byte may also be one more instance of a mesh.
const COMPRESSED: Ceiling =
    Ceiling { base_bytes: 1 << 23, bytes_per_byte: 1 << 16, base_steps: 0, steps_per_byte: 0 };

/// An image file of any format: its header and, if they are few, its texels.
pub fn image_import(data: &[u8]) -> bool {
    let source = ImageSource { path: "a".into(), bytes: Some(data.to_vec().into()) };
    let Ok((width, height)) = within(IMAGE, data.len(), || texture::size(&source)) else { return false };
    let texels = width as usize * height as usize;
    if texels > MOST_TEXELS {
        return false;
    }
    let ceiling = Ceiling { base_bytes: IMAGE.base_bytes + BYTES_PER_TEXEL * texels, ..IMAGE };
    let Ok(image) = within(ceiling, data.len(), || texture::decode(&source)) else { return false };
    assert_eq!((image.width(), image.height()), (width, height));
    true
}

/// Texels that are decoded: larger images only take longer.
const MOST_TEXELS: usize = 1 << 16;

/// Codebooks of Basis Universal have up to 65,535 entries of 20 bytes, whatever their length; tables of the other formats
/// are smaller. A texel has up to eight bytes, which decoders hold a few times.
const IMAGE: Ceiling = Ceiling { base_bytes: 1 << 22, bytes_per_byte: 64, base_steps: 0, steps_per_byte: 0 };
const BYTES_PER_TEXEL: usize = 32;

/// Whether all vertices that faces refer to exist; and whether the mesh can be quantised.
fn consistent(mesh: &SourceMesh, materials: usize) {
    assert_eq!(mesh.faces.len(), mesh.materials.len());
    assert!(mesh.materials.iter().all(|&m| usize::from(m) < materials));
    for corner in mesh.faces.iter().flatten() {
        assert!((corner.position as usize) < mesh.positions.len());
        assert!(corner.uv == NONE || (corner.uv as usize) < mesh.uvs.len());
        assert!(corner.normal == NONE || (corner.normal as usize) < mesh.normals.len());
    }
    assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
    assert!(mesh.uvs.iter().flatten().all(|x| x.is_finite()));
    assert!(mesh.normals.iter().flatten().all(|x| x.is_finite()));
    if let Ok(quantised) = quantise(mesh, &QuantiseSettings::default()) {
        assert!(quantised.faces.len() <= mesh.faces.len());
    }
}
