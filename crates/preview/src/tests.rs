use std::collections::BTreeMap;
use std::io::Read as _;

use flate2::read::DeflateDecoder;
use glam::Vec3;
use lodestream_geometry::base::Base;
use lodestream_geometry::refine::ActiveMesh;
use lodestream_scene::asset::{Alpha, Material, TextureFormat, TextureInfo, TextureKind, TextureLevel};
use lodestream_scene::description::{AssetEntry, Camera, SceneLighting};
use lodestream_scene::placement::Placement;
use lodestream_scene::terrain::{TerrainEntry, Water};
use lodestream_terrain::{Parameters, Scratch, Terrain};

use super::*;
