//! Head and opening of a published scene.

use super::part::Part;
use super::{MAX_OBJECT_BYTES, PublishedError};
use crate::animation::{AnimationTable, MAX_ANIMATED_MODELS, MAX_ANIMATION_BYTES};
use crate::description::SceneHeader;
use crate::encoding::{self, CodingError, Decode, Encode, Reader, Writer, encode_fields};
use crate::parts::{PartTable, RECORDS_PER_PAGE};
use crate::punctual_lights::{MAX_PUNCTUAL_LIGHTS, PunctualLights};

/// First bytes of every published scene.
const MAGIC: [u8; 8] = *b"LODSCENE";
/// Version of the layout, the encoding of header and pages included.
pub const VERSION: u16 = 6;
/// Pages of records of a [`PartPlaces::tables`] entry.
pub const PART_PAGES_PER_TABLE: u32 = 256;
/// Bytes of the head.
pub const HEAD_BYTES: usize = 40;
/// Bytes of the opening's hash.
const OPENING_HASH_BYTES: usize = 16;
/// Longest opening: 36 bytes a page of 64 instances, so 9 MB for the most instances that a scene can have.
pub const MAX_OPENING_BYTES: u32 = 16 << 20;
/// Memory that a decoded opening may take for each of its bytes.
const MEMORY_PER_BYTE: usize = 16;

/// The head: length of opening and object, and the opening's hash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    /// Length of the opening, which follows the head.
    pub opening_bytes: u32,
    /// Length of the object.
    pub object_bytes: u64,
    hash: [u8; OPENING_HASH_BYTES],
}

impl Head {
    /// Head and opening, for a length of what follows them.
    pub(super) fn encode_opening(opening: &Opening, rest_bytes: u64) -> Result<Vec<u8>, PublishedError> {
        let bytes =
            encoding::encode(opening).map_err(|why| PublishedError::Record { what: "its opening", why })?;
        let head = Self::new(&bytes, rest_bytes)?;
        Ok([head.encode(), bytes].concat())
    }

    fn new(opening: &[u8], rest_bytes: u64) -> Result<Self, PublishedError> {
        let length = u32::try_from(opening.len()).ok().filter(|length| *length <= MAX_OPENING_BYTES);
        let opening_bytes = length.ok_or(PublishedError::TooLong)?;
        let object_bytes = rest_bytes.saturating_add(HEAD_BYTES as u64 + u64::from(opening_bytes));
        if object_bytes > MAX_OBJECT_BYTES {
            return Err(PublishedError::TooLong);
        }
        Ok(Self { opening_bytes, object_bytes, hash: opening_hash(opening) })
    }

    fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEAD_BYTES);
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend([0; 2]);
        bytes.extend(self.opening_bytes.to_le_bytes());
        bytes.extend(self.object_bytes.to_le_bytes());
        bytes.extend(self.hash);
        bytes
    }

    /// Reads the first [`HEAD_BYTES`] of an object.
    ///
    /// # Errors
    /// Another kind of object, another version, or lengths that published scenes cannot have.
    pub fn parse(bytes: &[u8]) -> Result<Self, PublishedError> {
        let (magic, rest) = bytes.split_first_chunk::<8>().ok_or(PublishedError::OtherFile)?;
        if *magic != MAGIC {
            return Err(PublishedError::OtherFile);
        }
        let cut = PublishedError::Truncated("its head");
        let (version, rest) = rest.split_first_chunk().ok_or(cut.clone())?;
        let version = u16::from_le_bytes(*version);
        if version != VERSION {
            return Err(PublishedError::Version(version));
        }
        let (reserved, rest) = rest.split_first_chunk::<2>().ok_or(cut.clone())?;
        if *reserved != [0; 2] {
            return Err(PublishedError::Contradiction("its head has unknown flags"));
        }
        let (opening, rest) = rest.split_first_chunk().ok_or(cut.clone())?;
        let (object, rest) = rest.split_first_chunk().ok_or(cut.clone())?;
        let (hash, _) = rest.split_first_chunk().ok_or(cut)?;
        let (opening_bytes, object_bytes) = (u32::from_le_bytes(*opening), u64::from_le_bytes(*object));
        if opening_bytes > MAX_OPENING_BYTES || object_bytes > MAX_OBJECT_BYTES {
            return Err(PublishedError::TooLong);
        }
        if HEAD_BYTES as u64 + u64::from(opening_bytes) > object_bytes {
            return Err(PublishedError::Contradiction("its opening is longer than the object"));
        }
        Ok(Self { opening_bytes, object_bytes, hash: *hash })
    }

    /// Where the parts begin.
    #[must_use]
    pub const fn parts_start(&self) -> u64 {
        HEAD_BYTES as u64 + self.opening_bytes as u64
    }

    /// Checks and decodes the opening, the bytes after the head.
    ///
    /// # Errors
    /// Bytes that are damaged or contradict themselves.
    pub fn opening(&self, bytes: &[u8]) -> Result<Opening, PublishedError> {
        if bytes.len() != self.opening_bytes as usize || opening_hash(bytes) != self.hash {
            return Err(PublishedError::Hash("its opening"));
        }
        let opening = Opening::decode(bytes)?;
        opening.check(self.object_bytes - self.parts_start())?;
        Ok(opening)
    }
}

fn opening_hash(bytes: &[u8]) -> [u8; OPENING_HASH_BYTES] {
    let mut hash = [0; OPENING_HASH_BYTES];
    hash.copy_from_slice(&blake3::hash(bytes).as_bytes()[..OPENING_HASH_BYTES]);
    hash
}

/// Places of a scene page and of its packs' record, and what the page's instances fill.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PagePlace {
    /// The [`PageRecord`](super::PageRecord).
    pub page: Part,
    /// The [`SourceRecord`](super::SourceRecord).
    pub source: Part,
    /// Centre of a sphere around the page's instances, relative to the start camera's eye, in world units.
    pub center: [f32; 3],
    /// Its radius.
    pub radius: f32,
}

encode_fields!(PagePlace { page, source, center, radius });

/// The opening: the scene's header, and where everything else lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Opening {
    /// Header of the scene.
    pub header: SceneHeader,
    /// End of the parts for the first frame and first refinements from the start camera, counted from the end of the
    /// opening.
    pub flight_bytes: u64,
    /// Scene pages, in order.
    pub pages: Vec<PagePlace>,
    /// Pages of the directory of height overrides.
    pub terrain_directory: Vec<Part>,
    /// Tables of the height overrides ([`BlobTable`](super::BlobTable)), one for each page of the directory.
    pub terrain_tables: Vec<Part>,
    /// Number of punctual lights.
    pub light_count: u32,
    /// Pages of the directory of punctual lights.
    pub light_directory: Vec<Part>,
    /// Tables of the pages of punctual lights, one for each page of the directory.
    pub light_tables: Vec<Part>,
    /// The blob that the message about punctual lights carries, if any.
    pub first_lights: Vec<u8>,
    /// What the scene's parts are called.
    pub parts: PartPlaces,
    /// Animated models. Nothing is written of them if there are none.
    pub animations: Vec<Part>,
}

/// Places of the table of a scene's parts; nothing in it if there is none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartPlaces {
    /// Number of records.
    pub records: u32,
    /// Pages of the directory.
    pub directory: Vec<Part>,
    /// Tables of the pages of records ([`BlobTable`](super::BlobTable)), [`PART_PAGES_PER_TABLE`] each.
    pub tables: Vec<Part>,
}

encode_fields!(PartPlaces { records, directory, tables });

impl PartPlaces {
    /// The message about the table; `None` without one.
    #[must_use]
    pub fn table(&self) -> Option<PartTable> {
        (self.records > 0).then_some(PartTable { records: self.records })
    }

    /// Number of pages that a table lists; 0 beyond the last.
    #[must_use]
    pub fn in_table(&self, table: u32) -> u32 {
        let pages = self.records.div_ceil(RECORDS_PER_PAGE);
        pages.saturating_sub(table.saturating_mul(PART_PAGES_PER_TABLE)).min(PART_PAGES_PER_TABLE)
    }

    fn check(&self, instances: u32) -> Result<(), PublishedError> {
        let [directory, tables] = match self.table() {
            Some(table) if table.check().is_err() => [u32::MAX; 2],
            Some(table) => {
                [PartTable::directory_pages(instances), table.pages().div_ceil(PART_PAGES_PER_TABLE)]
            }
            None => [0; 2],
        };
        if [&self.directory, &self.tables].map(Vec::len) != [directory, tables].map(|count| count as usize) {
            return Err(PublishedError::Contradiction(
                "its tables of parts are not as many as their number needs",
            ));
        }
        Ok(())
    }
}

impl Encode for Opening {
    fn encode<W: Writer>(&self, writer: &mut W) -> Result<(), CodingError> {
        (&self.header, self.flight_bytes, &self.pages).encode(writer)?;
        (&self.terrain_directory, &self.terrain_tables).encode(writer)?;
        (self.light_count, &self.light_directory, &self.light_tables, &self.first_lights).encode(writer)?;
        self.parts.encode(writer)?;
        if self.animations.is_empty() { Ok(()) } else { self.animations.encode(writer) }
    }
}

impl Decode for Opening {
    fn decode<R: Reader>(reader: &mut R) -> Result<Self, CodingError> {
        let mut opening = Self {
            header: Decode::decode(reader)?,
            flight_bytes: Decode::decode(reader)?,
            pages: Decode::decode(reader)?,
            terrain_directory: Decode::decode(reader)?,
            terrain_tables: Decode::decode(reader)?,
            light_count: Decode::decode(reader)?,
            light_directory: Decode::decode(reader)?,
            light_tables: Decode::decode(reader)?,
            first_lights: Decode::decode(reader)?,
            parts: Decode::decode(reader)?,
            animations: Vec::new(),
        };
        if reader.has(1) {
            opening.animations = Decode::decode(reader)?;
            if opening.animations.is_empty() {
                return Err(CodingError::value("a list of no animations"));
            }
        }
        Ok(opening)
    }
}

impl Opening {
    /// Decodes an opening of the newest version; its parts are not checked yet.
    ///
    /// # Errors
    /// Bytes that are no opening.
    pub fn decode(bytes: &[u8]) -> Result<Self, PublishedError> {
        encoding::decode(bytes, (bytes.len() + 64).saturating_mul(MEMORY_PER_BYTE))
            .map_err(|why| PublishedError::Record { what: "its opening", why })
    }

    /// The message about punctual lights; `None` without lights.
    #[must_use]
    pub fn punctual_lights(&self) -> Option<PunctualLights> {
        (self.light_count > 0)
            .then(|| PunctualLights { count: self.light_count, first: self.first_lights.clone() })
    }

    /// The message about animated models; `None` without any.
    #[must_use]
    pub fn animation_table(&self) -> Option<AnimationTable> {
        let models = u32::try_from(self.animations.len()).ok().filter(|models| *models > 0)?;
        Some(AnimationTable { models })
    }

    /// Checks its values and that all parts lie within `rest_bytes`.
    ///
    /// # Errors
    /// A contradiction.
    pub fn check(&self, rest_bytes: u64) -> Result<(), PublishedError> {
        let contradiction = |why| Err(PublishedError::Contradiction(why));
        if let Err(why) = self.header.check() {
            return Err(PublishedError::Record {
                what: "its header",
                why: encoding::CodingError::value(why),
            });
        }
        if self.pages.len() != self.header.page_count as usize {
            return contradiction("it lists other pages than its header states");
        }
        if self.light_count > MAX_PUNCTUAL_LIGHTS
            || self.light_directory.len() != PunctualLights::directory_pages_of(self.light_count) as usize
            || self.light_tables.len() != self.light_directory.len()
        {
            return contradiction("its directory of punctual lights is not as long as their number needs");
        }
        if self.terrain_tables.len() != self.terrain_directory.len() {
            return contradiction("it lists other tables of height overrides than directory pages");
        }
        self.parts.check(self.header.instance_count)?;
        if self.animations.len() > MAX_ANIMATED_MODELS as usize
            || self.animations.iter().any(|part| part.bytes > MAX_ANIMATION_BYTES)
        {
            return contradiction("it has more animated models, or longer ones, than scenes can have");
        }
        let pages = self.pages.iter().flat_map(|place| [&place.page, &place.source]);
        let lists = [
            &self.terrain_directory,
            &self.terrain_tables,
            &self.light_directory,
            &self.light_tables,
            &self.parts.directory,
            &self.parts.tables,
            &self.animations,
        ];
        let mut parts = pages.chain(lists.into_iter().flatten());
        if self.flight_bytes > rest_bytes || parts.any(|part| part.end() > rest_bytes) {
            return contradiction("it lists a part beyond its end");
        }
        let finite = |place: &PagePlace| {
            place.center.iter().all(|x| x.is_finite()) && place.radius.is_finite() && place.radius >= 0.0
        };
        if !self.pages.iter().all(finite) {
            return contradiction("the bounds of a page are not finite");
        }
        Ok(())
    }
}
