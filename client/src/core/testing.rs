//! For tests: a scene of real prepared meshes in memory, and a core and a server session joined by a link
//! in virtual time.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::Cursor;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

use bytes::Bytes;
use geometry::index::Sphere;
use geometry::mesh::{Corner, QuantisedMesh, SourceMesh};
use geometry::pool::{Serial, Silent};
use geometry::prepare::Prepared;
use geometry::quantise::{QuantiseSettings, quantise};
use lodestream_geometry as geometry;
use lodestream_protocol::frame::ServerFrame;
use lodestream_protocol::message::ClientMessage;
use lodestream_protocol::server::{ServerConfig, ServerSession, Transmit};
use lodestream_protocol::source::{SceneSource, SourceError};
use lodestream_protocol::time::Time;
use lodestream_scene::animation::{AnimatedModel, AnimationTable};
use lodestream_scene::asset::{
    AssetDescription, Material, TILE_BORDER, TILE_SIDE, TextureFormat, TextureInfo, TextureKind,
    TextureLevel, TexturePatch, TextureRegion, TextureRegions, tile_grid,
};
use lodestream_scene::blob::{BlobId, BlobPart, Tile};
use lodestream_scene::description::{AssetEntry, Camera, Instance, SceneHeader, SceneLighting, ScenePage};
use lodestream_scene::limits::MAX_ENTRIES_PER_PAGE;
use lodestream_scene::parts::{self, INSTANCES_PER_PAGE, PartInfo, PartTable, RECORDS_PER_PAGE};
use lodestream_scene::proxy::Proxy;
use lodestream_scene::punctual_lights::{
    self, FEW_PAGES, FEW_PUNCTUAL_LIGHTS, LISTED_PER_PAGE, PUNCTUAL_LIGHTS_PER_PAGE, PunctualLight,
    PunctualLightPageEntry, PunctualLights, encode_page,
};
use lodestream_scene::shared::SharedTexture;
use lodestream_scene::terrain::{OverridePatch, TerrainEntry, encode_directory};
use lodestream_terrain::Parameters;

use super::{ClientCore, Config, Progress, StartView};

/// Quads along a side of the test surface.
const SIDE: u32 = 72;

/// The test mesh and its prepared form; made once.
pub(crate) fn prepared() -> &'static (QuantisedMesh, Prepared) {
    static PREPARED: OnceLock<(QuantisedMesh, Prepared)> = OnceLock::new();
    PREPARED.get_or_init(|| {
        let mesh = quantise(&hills(), &QuantiseSettings::default()).unwrap();
        let prepared = coded(&mesh, geometry::Codec::Range);
        (mesh, prepared)
    })
}

pub(crate) fn coded(mesh: &QuantisedMesh, codec: geometry::Codec) -> Prepared {
    let settings = geometry::Settings { region_faces: 300, codec, ..geometry::Settings::default() };
    let mut prepared = lodestream_compress::prepare(mesh, &settings, &Serial, &Silent).unwrap();
    prepared.base.description = description().encode().unwrap();
    prepared
}

/// A bumpy square, two units wide, with texture coordinates.
fn hills() -> SourceMesh {
    let at = |i: u32| f64::from(i) / f64::from(SIDE);
    let mut mesh = SourceMesh::default();
    for y in 0..=SIDE {
        for x in 0..=SIDE {
            let (u, v) = (at(x), at(y));
            let height = 0.2 * (9.0 * u).sin() * (7.0 * v).cos() + 0.03 * (41.0 * u * v).sin();
            mesh.positions.push([2.0 * u - 1.0, height, 2.0 * v - 1.0]);
            mesh.uvs.push([u as f32, v as f32]);
        }
    }
    for y in 0..SIDE {
        for x in 0..SIDE {
            let corner = |dx, dy| {
                let index = (y + dy) * (SIDE + 1) + x + dx;
                Corner { uv: index, ..Corner::at(index) }
            };
            mesh.faces.push([corner(0, 0), corner(0, 1), corner(1, 1)]);
            mesh.faces.push([corner(0, 0), corner(1, 1), corner(1, 0)]);
            mesh.materials.extend([0, 0]);
        }
    }
    mesh
}

fn picture(side: u32) -> Bytes {
    let image = image::RgbaImage::from_fn(side, side, |x, y| image::Rgba([x as u8, y as u8, 9, 255]));
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, image::ImageFormat::Png).unwrap();
    out.into_inner().into()
}

const TEXTURE_SIDES: [u32; 3] = [8, 16, 32];

fn description() -> AssetDescription {
    let levels = TEXTURE_SIDES.map(|side| TextureLevel {
        width: side,
        height: side,
        bytes: picture(side).len() as u32,
        format: TextureFormat::Png,
    });
    AssetDescription {
        name: "hills".into(),
        materials: vec![Material { base_color_texture: Some(0), ..Material::default() }],
        textures: vec![TextureInfo {
            kind: TextureKind::Color,
            width: 32,
            height: 32,
            planes: 0,
            mean: Some([59, 59, 9]),
            uv_per_unit: 0.5,
            levels: levels.into(),
        }],
    }
}

/// Levels of a texture with so many texels along its sides.
fn tiled_levels(side: u32) -> Vec<TextureLevel> {
    let sides = std::iter::successors(Some(128), |side| Some(2 * side)).take_while(|level| *level <= side);
    let level = |side: u32| TextureLevel {
        width: side,
        height: side,
        bytes: picture(side.min(256)).len() as u32,
        format: TextureFormat::Png,
    };
    sides.map(level).collect()
}

/// Texture regions of the hills, 8 × 8, with a texture of so many texels along its sides. Of the texture, u runs along x,
/// v along z; rows of texels run down.
fn regions(origin: [f64; 3], side: u32) -> TextureRegions {
    let cells_along = (side / TILE_SIDE) as u16;
    let cells_of = |at: u16| at * cells_along / 8..((at + 1) * cells_along).div_ceil(8);
    let region = |at: u16| {
        let (column, row) = (at % 8, at / 8);
        let [x, z] = [column, row].map(|at| 0.25 * (f32::from(at) + 0.5) - 1.0);
        let center = [f64::from(x) - origin[0], -origin[1], f64::from(z) - origin[2]].map(|part| part as f32);
        let (columns, rows) = (cells_of(column), cells_of(row));
        let run = |row| cells_along * row + columns.start..cells_along * row + columns.end;
        let cells = (cells_along - rows.end..cells_along - rows.start).map(run).collect();
        let patch = TexturePatch { material: 0, area: 0.07, uv_per_unit: 0.5, cells };
        TextureRegion { sphere: Sphere { center, radius: 0.35 }, patches: vec![patch] }
    };
    let regions: Vec<TextureRegion> = (0..64).map(region).collect();
    TextureRegions { low: regions[0].sphere.center, size: 1.75, regions }
}

/// The server's scene: several assets in a row, all with the test mesh.
#[derive(Debug)]
pub(crate) struct TestScene {
    pub(crate) header: SceneHeader,
    page: Arc<ScenePage>,
    blobs: BTreeMap<BlobPart, Bytes>,
    /// Bytes to serve instead of the valid ones.
    pub(crate) damaged: BTreeMap<BlobId, Bytes>,
    /// The page of the terrain's directory, if there is terrain.
    directory: Bytes,
    /// The message about punctual lights, if there are some.
    punctual_lights: Option<PunctualLights>,
    /// Blobs of punctual lights and parts.
    scene_blobs: BTreeMap<BlobId, Bytes>,
    parts: Option<PartTable>,
    animations: Option<AnimationTable>,
    /// Listed, but served as not found.
    pub(crate) missing: BTreeSet<BlobId>,
    /// Blobs that the server cannot read from its disk.
    pub(crate) unreadable: Mutex<BTreeSet<BlobId>>,
}

impl TestScene {
    pub(crate) fn new(assets: u32) -> Self {
        Self::of(&prepared().1, assets)
    }

    /// The same mesh with a texture of 1024 texels, of whose levels the finer two are cut into tiles.
    pub(crate) fn tiled(assets: u32) -> Self {
        Self::tiled_of(assets, 1024)
    }

    /// The same mesh with a texture of so many texels along its sides, of which the coarsest level has 128.
    pub(crate) fn tiled_of(assets: u32, side: u32) -> Self {
        let (level, mut prepared) = (tiled_levels(side), prepared().1.clone());
        let texture = TextureInfo {
            width: side,
            height: side,
            levels: level.clone(),
            ..description().textures.remove(0)
        };
        let description = AssetDescription { textures: vec![texture], ..description() };
        prepared.base.description = description.encode().unwrap();
        let mut scene = Self::of(&prepared, assets);
        scene.blobs.retain(|part, _| part.texture().is_none());
        let tile_picture = picture(TILE_SIDE + 2 * TILE_BORDER);
        for (number, level) in (0..).zip(level) {
            if number < 2 {
                scene.blobs.insert(BlobPart::Texture { texture: 0, level: number }, picture(level.width));
                continue;
            }
            let [columns, rows] = tile_grid(level.size());
            for tile in 0..(columns * rows) as u16 {
                let part = BlobPart::Tile(Tile { texture: 0, level: number, tile });
                scene.blobs.insert(part, tile_picture.clone());
            }
        }
        let regions = regions(prepared.base.grid.origin, side).encode().unwrap();
        scene.blobs.insert(BlobPart::TextureRegions, regions.into());
        scene
    }

    /// The same mesh, coded by zstd.
    pub(crate) fn compressed() -> Self {
        Self::of(&coded(&prepared().0, geometry::Codec::Zstd), 1)
    }

    /// Assets of one mesh each.
    pub(crate) fn of(prepared: &Prepared, assets: u32) -> Self {
        let base = lodestream_compress::encode_base(&prepared.base).unwrap();
        let mut blobs = BTreeMap::from([(BlobPart::Base, Bytes::from(base))]);
        for (n, page) in (0..).zip(&prepared.pages) {
            blobs.insert(BlobPart::IndexPage(n), page.clone().into());
        }
        for (n, chunk) in (0..).zip(&prepared.chunks) {
            blobs.insert(BlobPart::Chunk(n), chunk.clone().into());
        }
        for (level, side) in (0..).zip(TEXTURE_SIDES) {
            blobs.insert(BlobPart::Texture { texture: 0, level }, picture(side));
        }
        let base = &prepared.base;
        let entry = AssetEntry {
            name: "hills".into(),
            fingerprint: [1; 16],
            origin: base.grid.origin,
            sphere: base.sphere,
            root_error: prepared
                .infos
                .iter()
                .map(|i| geometry::screen::visible_error(i, 1.0))
                .fold(base.geometric_error, f32::max),
            base_bytes: blobs[&BlobPart::Base].len() as u32,
            chunk_count: base.chunk_count,
            shared: Vec::new(),
        };
        let place = |n: u32| Instance::at(n, [3.0 * f64::from(n), 0.0, 0.0]);
        Self {
            header: SceneHeader {
                name: "hills".into(),
                fingerprint: [7; 16],
                asset_count: assets,
                instance_count: assets,
                page_count: assets.div_ceil(MAX_ENTRIES_PER_PAGE as u32).max(1),
                light: SceneLighting { direction: [0.0, 1.0, 0.0], color: [1.0; 3], ambient: [0.2; 3] },
                background: [0.1; 3],
                terrain: None,
                camera: Camera { eye: [0.0, 2.0, 3.0], target: [0.0; 3], up: [0.0, 1.0, 0.0], fov_y: 0.9 },
                root_slope: 0.0,
            },
            page: Arc::new(ScenePage {
                assets: vec![entry; assets as usize],
                instances: (0..assets).map(place).collect(),
                ..ScenePage::default()
            }),
            blobs,
            damaged: BTreeMap::new(),
            directory: Bytes::new(),
            punctual_lights: None,
            scene_blobs: BTreeMap::new(),
            parts: None,
            animations: None,
            missing: BTreeSet::new(),
            unreadable: Mutex::default(),
        }
    }

    /// The same in light from another direction.
    pub(crate) fn lit_from(mut self, direction: [f32; 3]) -> Self {
        self.header.light.direction = direction;
        self
    }

    /// The same with one texture shared by all assets.
    pub(crate) fn sharing_textures(mut self) -> Self {
        let page = Arc::make_mut(&mut self.page);
        for entry in page.assets.iter_mut().skip(1) {
            entry.shared = vec![SharedTexture { texture: 0, asset: 0, of: 0 }];
        }
        self
    }

    /// The same with other instances.
    pub(crate) fn with_instances(mut self, instances: Vec<Instance>) -> Self {
        self.header.instance_count = instances.len() as u32;
        Arc::make_mut(&mut self.page).instances = instances;
        self
    }

    /// The same with proxies, each of an asset more with the same mesh.
    pub(crate) fn with_proxies(mut self, proxies: &[Proxy]) -> Self {
        let page = Arc::make_mut(&mut self.page);
        for proxy in proxies {
            page.proxies.push(Proxy { asset: page.assets.len() as u32, ..*proxy });
            page.assets.push(page.assets[0].clone());
        }
        self.header.asset_count = page.assets.len() as u32;
        self
    }

    /// The same with another fingerprint, so another scene.
    pub(crate) fn with_fingerprint(mut self, byte: u8) -> Self {
        self.header.fingerprint = [byte; 16];
        self
    }

    /// The same on a terrain of 2^`extent_log2` patches to each side, of which `listed` have height overrides.
    pub(crate) fn on_terrain(mut self, extent_log2: u8, listed: &[OverridePatch]) -> Self {
        self.header.terrain = Some(Box::new(TerrainEntry {
            parameters: Parameters { extent_log2, ..Parameters::default() },
            unit: 1.0,
            height_unit: 0.01,
            zones: [0.0, 120.0, 300.0],
            stamps: Vec::new(),
            patches: listed.len() as u32,
            water: None,
        }));
        self.directory = encode_directory(listed).unwrap().into();
        self
    }

    /// The same under punctual lights, which fill pages in the order of the list.
    pub(crate) fn lit_by(mut self, punctual_lights: &[PunctualLight]) -> Self {
        let mut listed = Vec::new();
        for (number, group) in (0..).zip(punctual_lights.chunks(PUNCTUAL_LIGHTS_PER_PAGE as usize)) {
            let page = encode_page(group).unwrap();
            listed.push(PunctualLightPageEntry::of(group, page.len() as u32));
            self.scene_blobs.insert(BlobId::punctual_light_page(number), page.into());
        }
        for (number, group) in (0..).zip(listed.chunks(LISTED_PER_PAGE as usize)) {
            let page = punctual_lights::encode_directory(group).unwrap();
            self.scene_blobs.insert(BlobId::punctual_light_directory(number), page.into());
        }
        let first = match listed.len() as u32 {
            1 if punctual_lights.len() <= FEW_PUNCTUAL_LIGHTS as usize => {
                self.scene_blobs[&BlobId::punctual_light_page(0)].to_vec()
            }
            ..=FEW_PAGES => self.scene_blobs[&BlobId::punctual_light_directory(0)].to_vec(),
            _ => Vec::new(),
        };
        self.punctual_lights = Some(PunctualLights { count: punctual_lights.len() as u32, first });
        self
    }

    /// The same with parts: of each instance so many, called one after the other.
    pub(crate) fn of_parts(mut self, parts: &[u32], called: &[PartInfo]) -> Self {
        let mut next = 0;
        let mut range = |count: &u32| {
            next += count;
            next - count..next
        };
        let ranges: Vec<_> = parts.iter().map(&mut range).collect();
        let pages = called.chunks(RECORDS_PER_PAGE as usize).map(parts::encode_page);
        let directory = ranges.chunks(INSTANCES_PER_PAGE as usize).map(parts::encode_directory);
        for (number, page) in (0..).zip(pages) {
            self.scene_blobs.insert(BlobId::part_page(number), page.unwrap().into());
        }
        for (number, page) in (0..).zip(directory) {
            self.scene_blobs.insert(BlobId::part_directory(number), page.unwrap().into());
        }
        self.parts = Some(PartTable { records: called.len() as u32 });
        self
    }

    /// The same with animated models.
    pub(crate) fn animated(mut self, models: &[AnimatedModel]) -> Self {
        for (number, model) in (0..).zip(models) {
            self.scene_blobs.insert(BlobId::Animation(number), model.to_bytes().unwrap().into());
        }
        self.animations = Some(AnimationTable { models: models.len() as u32 });
        self
    }

    pub(crate) fn camera(&self) -> Camera {
        self.header.camera
    }

    /// The blob with its middle byte changed.
    pub(crate) fn damage(&mut self, id: BlobId) {
        let real = id.part().map_or_else(|| &self.scene_blobs[&id], |part| &self.blobs[&part]);
        let mut bytes = real.to_vec();
        for byte in &mut bytes {
            *byte ^= 0x5A;
        }
        self.damaged.insert(id, bytes.into());
    }
}

impl SceneSource for TestScene {
    fn header(&self) -> &SceneHeader {
        &self.header
    }

    fn page(&self, page: u32) -> Option<Arc<ScenePage>> {
        if self.header.page_count == 1 {
            return (page == 0).then(|| self.page.clone());
        }
        let of = |count: usize| {
            let first = count.min(page as usize * MAX_ENTRIES_PER_PAGE);
            first..count.min(first + MAX_ENTRIES_PER_PAGE)
        };
        let (assets, instances) = (&self.page.assets, &self.page.instances);
        (page < self.header.page_count).then(|| {
            Arc::new(ScenePage {
                page,
                first_asset: of(assets.len()).start as u32,
                first_instance: of(instances.len()).start as u32,
                assets: assets[of(assets.len())].to_vec(),
                instances: instances[of(instances.len())].to_vec(),
                ..ScenePage::default()
            })
        })
    }

    fn punctual_lights(&self) -> Option<&PunctualLights> {
        self.punctual_lights.as_ref()
    }

    fn parts(&self) -> Option<PartTable> {
        self.parts
    }

    fn animations(&self) -> Option<AnimationTable> {
        self.animations
    }

    fn blob_len(&self, id: &BlobId) -> Option<u32> {
        if let Some(bytes) = self.scene_blobs.get(id) {
            return Some(bytes.len() as u32);
        }
        if *id == BlobId::terrain_page(0) {
            return Some(self.directory.len() as u32);
        }
        if let Some(bytes) = self.damaged.get(id) {
            return Some(bytes.len() as u32);
        }
        let BlobId::Asset { asset, part } = *id else { return None };
        self.blobs.get(&part).filter(|_| asset < self.header.asset_count).map(|b| b.len() as u32)
    }

    fn read(&self, id: &BlobId) -> Result<Bytes, SourceError> {
        if self.unreadable.lock().unwrap().contains(id) {
            return Err(SourceError::Unreadable { id: *id, why: "the disk rots".into() });
        }
        if *id == BlobId::terrain_page(0) {
            return Ok(self.directory.clone());
        }
        let real = id.part().map_or_else(|| self.scene_blobs.get(id), |part| self.blobs.get(&part));
        let real = real.filter(|_| !self.missing.contains(id));
        let real = real.ok_or(SourceError::NotFound(*id))?;
        Ok(self.damaged.get(id).unwrap_or(real).clone())
    }
}

/// One direction of the link: messages under way, with their arrival times.
type Pipe<T> = VecDeque<(Time, T)>;

/// A core and a server session, 20 ms apart.
pub(crate) struct Loopback {
    pub(crate) now: Time,
    pub(crate) core: ClientCore,
    pub(crate) source: Arc<TestScene>,
    server: Option<ServerSession>,
    up: Pipe<ClientMessage>,
    down: Pipe<Transmit>,
    /// Blobs whose first piece was sent, in order, with repetitions.
    pub(crate) sent: Vec<BlobId>,
    /// Bytes sent of each blob.
    pub(crate) sent_bytes: BTreeMap<BlobId, u64>,
    /// Bytes that the server may send unasked once it knows the view.
    pub(crate) push_bytes: u64,
    /// Budget of each update.
    pub(crate) budget: u64,
    /// Towards the client.
    pub(crate) rate_bits_per_s: u64,
}

const LATENCY: Duration = Duration::from_millis(20);

impl Loopback {
    /// A client that looks at the scene's start view, not connected yet.
    pub(crate) fn new(source: TestScene, adapt: impl FnOnce(&mut Config)) -> Self {
        let mut config = Config::new(StartView::OfScene { viewport_px: [640, 360], target_px: 1.0 });
        adapt(&mut config);
        Self {
            now: Time::ZERO,
            core: ClientCore::new(config),
            source: Arc::new(source),
            server: None,
            up: Pipe::new(),
            down: Pipe::new(),
            sent: Vec::new(),
            sent_bytes: BTreeMap::new(),
            push_bytes: ServerConfig::websocket(None).push_after_hello_bytes,
            budget: u64::MAX,
            rate_bits_per_s: 8_000_000,
        }
    }

    /// Opens a connection.
    pub(crate) fn connect(&mut self) {
        // Nothing is pushed before `Hello` lists what the client has, so counts are exact.
        self.connect_pushing(0);
    }

    /// Opens a connection over which base meshes overtake `Welcome`, as QUIC streams may.
    pub(crate) fn connect_overtaken(&mut self) {
        self.connect_pushing(u64::MAX);
        let now = self.now;
        let Some(server) = &mut self.server else { return };
        let mut flight: Vec<_> = std::iter::from_fn(|| server.poll_transmit(now)).collect();
        flight.sort_by_key(|transmit| !matches!(transmit, Transmit::Piece { .. }));
        self.down.extend(flight.into_iter().map(|transmit| (now + LATENCY, transmit)));
    }

    fn connect_pushing(&mut self, push_before_hello_bytes: u64) {
        let config = ServerConfig {
            push_before_hello_bytes,
            refine_before_hello_bytes: 0,
            push_after_hello_bytes: self.push_bytes,
            ..ServerConfig::websocket(Some(self.rate_bits_per_s))
        };
        self.server = Some(ServerSession::new(Arc::new(config), self.source.clone(), 1, self.now));
        self.core.connect(self.now);
    }

    /// Cuts the connection; data under way is lost.
    pub(crate) fn cut(&mut self) {
        self.server = None;
        self.up.clear();
        self.down.clear();
        self.core.handle_lost(self.now, "cut");
    }

    /// Runs for so many milliseconds, in steps of one.
    pub(crate) fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.now = self.now + Duration::from_millis(1);
            self.step();
        }
    }

    /// Runs until settled; panics after a minute of virtual time.
    pub(crate) fn settle(&mut self) {
        for _ in 0..60_000 {
            self.run(1);
            if self.core.is_settled() && self.server.is_some() {
                return;
            }
        }
        panic!("not settled: {:?}", self.core.stats());
    }

    fn step(&mut self) {
        let now = self.now;
        let arrivals = self.down.len();
        while let Some((_, transmit)) = self.down.pop_front_if(|(at, _)| *at <= now) {
            match transmit {
                Transmit::Message { message, .. } => {
                    self.core.handle_frame(now, ServerFrame::Message(message))
                }
                Transmit::Piece { piece, .. } => self.core.handle_piece(now, piece),
                Transmit::Abandon(id) => self.core.handle_abandoned(now, id),
            }
        }
        self.core.handle_timeout(now);
        while self.core.update(now, self.budget) == Progress::More {}
        if self.down.len() < arrivals {
            self.core.check_states();
        }
        while let Some(message) = self.core.poll_transmit(now) {
            self.up.push_back((now + LATENCY, message));
        }
        let Some(server) = &mut self.server else { return };
        while let Some((_, message)) = self.up.pop_front_if(|(at, _)| *at <= now) {
            server.handle_message(now, message);
        }
        server.handle_timeout(now);
        while let Some(transmit) = server.poll_transmit(now) {
            if let Transmit::Piece { piece, .. } = &transmit {
                *self.sent_bytes.entry(piece.id).or_default() += piece.bytes.len() as u64;
                if piece.offset == 0 {
                    self.sent.push(piece.id);
                }
            }
            self.down.push_back((now + LATENCY, transmit));
        }
    }

    /// How often each blob was sent.
    pub(crate) fn times_sent(&self) -> BTreeMap<BlobId, usize> {
        let mut times = BTreeMap::new();
        for id in &self.sent {
            *times.entry(*id).or_default() += 1;
        }
        times
    }
}
