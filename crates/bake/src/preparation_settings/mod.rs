//! Preparation settings: one type with one range for each, shared by command lines, scene files, plans of the simulator
//! and the text in packs.
//!
//! | setting | type | range | effect |
//! |---|---|---|---|
//! | position bits, or tolerance | [`PositionBits`], [`Tolerance`] | 4 to 24, or a positive length | grid of positions |
//! | uv bits | [`UvBits`] | 1 to 16 | grid of texture coordinates |
//! | normal tolerance | [`NormalTolerance`] | 0 to 180 degrees | which normals are sent |
//! | crease angle | [`CreaseAngle`] | 0 to 180 degrees | where surfaces are smooth |
//! | relief depth | [`ReliefDepth`] | 0 to 1 of texture coordinates | materials |
//! | texture quality | [`TextureQuality`] | 1 to 100: lossless | textures |
//! | effort | [`Effort`] | `full`, `least` | bytes of packs, time |
//! | metric | [`Metric`](lodestream_geometry::Metric) | `qem`, `melax`, `clustering`, `clustering-seams` | order of collapses |
//! | round size | [`Round`] | `heap`, or a share of 0.01 to 0.5 | order of collapses |
//! | codec | [`CodecChoice`] | `auto`, `range`, `axis-aligned`, `zstd` | base mesh and chunks |
//! | region faces | [`RegionFaces`] | 50 to 20,000 | size of chunks |
//! | level share | [`LevelShare`] | 0.1 to 0.9 | number of levels |
//! | top regions | [`TopRegions`] | 0.25 to 16 | the first step |
//! | coarse grid | [`CoarseGrid`] | 0 to 4 | grids of coarse levels |
//! | block faces | [`BlockFaces`] | 100 to 100,000,000 | meshes that are simplified block after block |
//! | batch | [`Batching`] | `auto`, `off`, or 1,000 to 10,000,000 faces | which assets a file becomes |
//!
//! `FromStr` reads each from text and `TryFrom` from a number, with the same error.

mod batching;
mod choices;
mod codec_choice;
mod effort;
mod setting;

pub use batching::Batching;
pub use choices::{Precision, PreparationSettings, ReadError};
pub use codec_choice::CodecChoice;
pub use effort::Effort;
pub use lodestream_import::CreaseAngle;
pub use lodestream_import::texture::TextureQuality;
pub use setting::{
    BatchFaces, BlockFaces, CoarseGrid, LevelShare, NormalTolerance, PositionBits, RegionFaces, ReliefDepth,
    Round, RoundShare, Tolerance, TopRegions, UvBits,
};
