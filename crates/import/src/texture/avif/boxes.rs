//! The boxes of an AVIF file: items, where they are, and their properties (ISO/IEC 14496-12 and 23008-12).

use std::collections::BTreeMap;

/// Auxiliary images that are opacity (AV1 Image File Format, 4.1).
const OPACITY: &[u8] = b"urn:mpeg:mpegB:cicp:systems:auxiliary:alpha\0";

/// A property of items.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Property {
    /// Width and height in pixels.
    Size(u32, u32),
    /// Matrix coefficients (ITU-T H.273, table 4) and whether samples have all values.
    Color { matrix: u16, is_full_range: bool },
    /// The item is opacity.
    Opacity,
    /// Quarter turns anticlockwise.
    Rotation(u8),
    /// What is exchanged: left and right, or top and bottom.
    Mirror { left_and_right: bool },
    /// A part of the image is shown: its size, and how far its middle is from the image's, as fractions.
    Crop([(u32, u32); 4]),
    /// A property that describes.
    Description,
    /// Another.
    Unknown([u8; 4]),
}

#[derive(Default)]
struct Item {
    kind: [u8; 4],
    /// Place of its extents: in the file, or in the metadata.
    in_metadata: bool,
    extents: Vec<(u64, u64)>,
    /// Indices of its properties, in the order in which they apply.
    properties: Vec<usize>,
}

/// The items of a file.
pub(super) struct Container<'a> {
    bytes: &'a [u8],
    /// Data in the metadata.
    metadata: &'a [u8],
    /// The item that is the image.
    pub(super) primary: u32,
    items: BTreeMap<u32, Item>,
    properties: Vec<Property>,
    /// Auxiliary items, each with what it belongs to.
    auxiliary: Vec<(u32, u32)>,
}

impl<'a> Container<'a> {
    /// Reads the metadata.
    ///
    /// # Errors
    /// What is missing, wrong or not supported.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, String> {
        let mut this = Self {
            bytes,
            metadata: &[],
            primary: 0,
            items: BTreeMap::new(),
            properties: Vec::new(),
            auxiliary: Vec::new(),
        };
        let meta = find(bytes, *b"meta")?.ok_or("it has no metadata")?;
        let mut has_primary = false;
        for part in Boxes(after_version(meta)?) {
            let (kind, body) = part?;
            match &kind {
                b"pitm" => {
                    let mut fields = Fields(body);
                    let wide = fields.version()? > 0;
                    (this.primary, has_primary) = (fields.id(wide)?, true);
                }
                b"iloc" => this.read_places(body)?,
                b"iinf" => this.read_kinds(body)?,
                b"iref" => this.read_references(body)?,
                b"iprp" => this.read_properties(body)?,
                b"idat" => this.metadata = body,
                _ => {}
            }
        }
        if has_primary { Ok(this) } else { Err("it names no image".to_owned()) }
    }

    /// Type of an item.
    pub(super) fn kind(&self, item: u32) -> Option<[u8; 4]> {
        self.items.get(&item).map(|item| item.kind)
    }

    /// Properties of an item, in the order in which they apply.
    pub(super) fn properties(&self, item: u32) -> impl Iterator<Item = &Property> + Clone {
        let indices = self.items.get(&item).map_or(&[][..], |item| &item.properties);
        indices.iter().filter_map(|&index| self.properties.get(index))
    }

    /// The item that is the opacity of another.
    pub(super) fn opacity_of(&self, item: u32) -> Option<u32> {
        let mut of = self.auxiliary.iter().filter(|(_, of)| *of == item).map(|(auxiliary, _)| *auxiliary);
        of.find(|&auxiliary| self.properties(auxiliary).any(|property| *property == Property::Opacity))
    }

    /// Data of an item, at most as many bytes as the file.
    pub(super) fn data(&self, item: u32) -> Result<Vec<u8>, String> {
        let item = self.items.get(&item).ok_or("an item is missing")?;
        let from = if item.in_metadata { self.metadata } else { self.bytes };
        let mut data = Vec::new();
        for &(offset, length) in &item.extents {
            let rest = usize::try_from(offset).ok().and_then(|offset| from.get(offset..));
            let extent = match (rest, usize::try_from(length)) {
                // All there is.
                (Some(rest), Ok(0)) => Some(rest),
                (Some(rest), Ok(length)) => rest.get(..length),
                _ => None,
            };
            let extent = extent.ok_or("data beyond its end")?;
            if data.len() + extent.len() > self.bytes.len() {
                return Err("data that overlaps".to_owned());
            }
            data.extend_from_slice(extent);
        }
        // The decoder asserts that there is some.
        if data.is_empty() { Err("an item without data".to_owned()) } else { Ok(data) }
    }

    fn read_places(&mut self, body: &[u8]) -> Result<(), String> {
        let mut fields = Fields(body);
        let version = fields.version()?;
        let sizes = fields.number(2)?;
        let [offset_size, length_size, base_size, index_size] =
            [12, 8, 4, 0].map(|shift| (sizes >> shift) as usize & 15);
        let count = fields.number(if version < 2 { 2 } else { 4 })?;
        for _ in 0..count {
            let id = fields.id(version >= 2)?;
            let construction = if version > 0 { fields.number(2)? & 15 } else { 0 };
            if construction > 1 || fields.number(2)? != 0 {
                return Err("data that is elsewhere".to_owned());
            }
            let base = fields.number(base_size)?;
            let item = self.items.entry(id).or_default();
            item.in_metadata = construction == 1;
            for _ in 0..fields.number(2)? {
                if version > 0 {
                    fields.number(index_size)?;
                }
                let (offset, length) = (fields.number(offset_size)?, fields.number(length_size)?);
                item.extents.push((base.saturating_add(offset), length));
                if offset_size + length_size == 0 && item.extents.len() > 1 {
                    return Err("data that overlaps".to_owned());
                }
            }
        }
        Ok(())
    }

    fn read_kinds(&mut self, body: &[u8]) -> Result<(), String> {
        let mut fields = Fields(body);
        let version = fields.version()?;
        fields.number(if version == 0 { 2 } else { 4 })?;
        for entry in Boxes(fields.0) {
            let (_, body) = entry?;
            let mut fields = Fields(body);
            let version = fields.version()?;
            if version >= 2 {
                let id = fields.id(version > 2)?;
                fields.number(2)?;
                self.items.entry(id).or_default().kind = fields.kind()?;
            }
        }
        Ok(())
    }

    fn read_references(&mut self, body: &[u8]) -> Result<(), String> {
        let mut fields = Fields(body);
        let wide = fields.version()? > 0;
        for reference in Boxes(fields.0) {
            let (kind, body) = reference?;
            let mut fields = Fields(body);
            let from = fields.id(wide)?;
            for _ in 0..fields.number(2)? {
                let to = fields.id(wide)?;
                match &kind {
                    b"auxl" => self.auxiliary.push((from, to)),
                    b"prem" => return Err("its colours are multiplied by opacity; convert it".to_owned()),
                    _ => {}
                }
            }
        }
        Ok(())
    }

    fn read_properties(&mut self, body: &[u8]) -> Result<(), String> {
        for property in Boxes(find(body, *b"ipco")?.ok_or("it has no properties")?) {
            let (kind, body) = property?;
            self.properties.push(property_of(kind, body)?);
        }
        for part in Boxes(body) {
            let (kind, body) = part?;
            if kind != *b"ipma" {
                continue;
            }
            let mut fields = Fields(body);
            let head = fields.number(4)?;
            let (wide, long) = (head >> 24 > 0, head & 1 == 1);
            for _ in 0..fields.number(4)? {
                let id = fields.id(wide)?;
                for _ in 0..fields.number(1)? {
                    let association = fields.number(if long { 2 } else { 1 })?;
                    let (bit, mask) = if long { (15, 0x7FFF) } else { (7, 0x7F) };
                    let Some(index) = (association & mask).checked_sub(1) else { continue };
                    let index = index as usize;
                    if association >> bit == 1
                        && let Some(Property::Unknown(kind)) = self.properties.get(index)
                    {
                        return Err(format!("it needs {}, which is not supported", kind.escape_ascii()));
                    }
                    self.items.entry(id).or_default().properties.push(index);
                }
            }
        }
        Ok(())
    }
}

fn property_of(kind: [u8; 4], body: &[u8]) -> Result<Property, String> {
    let mut fields = Fields(body);
    Ok(match &kind {
        b"ispe" => {
            fields.version()?;
            Property::Size(fields.number(4)? as u32, fields.number(4)? as u32)
        }
        b"colr" if body.starts_with(b"nclx") => {
            fields.number(8)?;
            Property::Color { matrix: fields.number(2)? as u16, is_full_range: fields.number(1)? >> 7 == 1 }
        }
        b"auxC" => {
            fields.version()?;
            if fields.0.starts_with(OPACITY) { Property::Opacity } else { Property::Description }
        }
        b"irot" => Property::Rotation(fields.number(1)? as u8 & 3),
        b"imir" => Property::Mirror { left_and_right: fields.number(1)? & 1 == 1 },
        b"clap" => {
            let mut fraction =
                || -> Result<_, String> { Ok((fields.number(4)? as u32, fields.number(4)? as u32)) };
            Property::Crop([fraction()?, fraction()?, fraction()?, fraction()?])
        }
        b"av1C" | b"colr" | b"pixi" | b"pasp" | b"clli" | b"mdcv" => Property::Description,
        _ => Property::Unknown(kind),
    })
}

/// The first box of a kind.
fn find(bytes: &[u8], kind: [u8; 4]) -> Result<Option<&[u8]>, String> {
    for part in Boxes(bytes) {
        let (found, body) = part?;
        if found == kind {
            return Ok(Some(body));
        }
    }
    Ok(None)
}

fn after_version(body: &[u8]) -> Result<&[u8], String> {
    body.get(4..).ok_or_else(cut)
}

fn cut() -> String {
    "it is cut short".to_owned()
}

/// Boxes one after the other, each with its kind.
struct Boxes<'a>(&'a [u8]);

impl<'a> Iterator for Boxes<'a> {
    type Item = Result<([u8; 4], &'a [u8]), String>;

    fn next(&mut self) -> Option<Self::Item> {
        (!self.0.is_empty()).then(|| {
            let all = std::mem::take(&mut self.0);
            let mut fields = Fields(all);
            let (length, kind) = (fields.number(4)?, fields.kind()?);
            let length = match length {
                0 => all.len() as u64,
                1 => fields.number(8)?,
                length => length,
            };
            let head = all.len() - fields.0.len();
            let length = usize::try_from(length).ok().filter(|length| (head..=all.len()).contains(length));
            let (this, rest) = all.split_at(length.ok_or_else(cut)?);
            self.0 = rest;
            Ok((kind, &this[head..]))
        })
    }
}

/// Big-endian fields one after the other.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn number(&mut self, bytes: usize) -> Result<u64, String> {
        if bytes > 8 {
            return Err("a field of more than 8 bytes".to_owned());
        }
        let (field, rest) = self.0.split_at_checked(bytes).ok_or_else(cut)?;
        self.0 = rest;
        Ok(field.iter().fold(0, |number, &byte| number << 8 | u64::from(byte)))
    }

    /// Version and flags; the flags are dropped.
    fn version(&mut self) -> Result<u64, String> {
        Ok(self.number(4)? >> 24)
    }

    fn id(&mut self, wide: bool) -> Result<u32, String> {
        Ok(self.number(if wide { 4 } else { 2 })? as u32)
    }

    fn kind(&mut self) -> Result<[u8; 4], String> {
        Ok((self.number(4)? as u32).to_be_bytes())
    }
}
