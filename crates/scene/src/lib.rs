//! Data types of a scene: blob names, assets, materials, lights, placements, terrain and cameras.
//!
//! Importer, server, client and renderer share them. The crate does no I/O: it opens no file and no socket, reads no
//! clock and spawns no thread.
//!
//! | module | contents |
//! |---|---|
//! | [`blob`] | names of blobs: base meshes, index pages, chunks, texture levels, terrain, lights, parts |
//! | [`description`] | the scene's header and pages |
//! | [`asset`] | the description of one asset: materials and textures |
//! | [`shared`] | textures that several assets share |
//! | [`terrain`] | a scene's terrain, and the directory of its height overrides |
//! | [`punctual_lights`] | point and spot lights, and their pages |
//! | [`parts`] | what the parts of the scene are called |
//! | [`animation`] | clips of keyframes that move instances |
//! | [`published`] | the scene as an object that clients read in ranges |
//! | [`placement`] | where an object stands: position, rotation and scale |
//! | [`view`], [`pose`] | a camera for screen errors, with its picture, and for drawing, in f64 |
//! | [`section`] | planes beyond which the scene is cut away |
//! | [`limits`] | bounds on every length and count that a peer may send |
//! | [`encoding`] | encoding of all of these |

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

pub mod animation;
pub mod asset;
pub mod blob;
pub mod description;
pub mod encoding;
pub mod instances;
pub mod limits;
pub mod parts;
pub mod placement;
pub mod pose;
pub mod proxy;
pub mod published;
pub mod punctual_lights;
pub mod section;
pub mod shared;
pub mod surroundings;
pub mod terrain;
pub mod view;

pub use blob::{BlobId, BlobPart, PartBlob, PunctualLightBlob, TerrainBlob, Tile};
pub use view::View;
