//! What a scene is: names of blobs, descriptions of assets, materials, lights, instances, terrain and views.
//!
//! The crate is the shared vocabulary of importer, server, client and renderer. It is pure: it opens no file and no
//! socket, reads no clock and spawns no thread.
//!
//! | module | contents |
//! |---|---|
//! | [`blob`] | names of what is sent: base meshes, index pages, chunks, texture levels |
//! | [`description`] | the scene's header and pages |
//! | [`asset`] | the description of one asset: materials and textures |
//! | [`shared`] | textures that several assets have in common |
//! | [`terrain`] | a scene's terrain, and the directory of its height overrides |
//! | [`punctual_lights`] | point and spot lights, and their pages |
//! | [`view`], [`pose`] | the camera by which errors are judged |
//! | [`limits`] | bounds on every length and count that a peer may send |
//! | [`coding`] | the bytes of descriptions and messages |

#![cfg_attr(
    not(test),
    warn(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )
)]

pub mod asset;
pub mod blob;
pub mod coding;
pub mod description;
pub mod limits;
pub mod pose;
pub mod punctual_lights;
pub mod shared;
pub mod terrain;
pub mod view;

pub use blob::{BlobId, BlobPart, PunctualLightBlob, TerrainBlob};
pub use view::View;
