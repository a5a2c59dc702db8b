//! Accessors: the elements of vertex attributes and indices.
//!
//! Of a buffer only what an accessor holds is read, when it is opened; compressed views are decoded whole, and kept. An
//! accessor is checked once, when it is opened; reads of its elements rely on that.

use std::collections::BTreeMap;
use std::ops::Range;

use bytes::Bytes;
use gltf::json::accessor::{ComponentType, Type};
use gltf::json::validation::Checked;

use super::compressed::{CompressedView, of_view};
use super::container::{Buffer, Document};
use crate::error::ImportError;
use crate::file::MAX_FILE_BYTES;

/// Most elements of an accessor without a buffer view, which are zeros and sparse values.
const MAX_ZEROS: usize = 1 << 16;

/// Buffers, decoded views and images of a file. Each view is decoded and each image read once.
pub(super) struct Buffers<'a> {
    document: &'a Document,
    opened: Vec<Option<Buffer>>,
    /// Bytes of images, by view; `None` if images are not read.
    images: Option<BTreeMap<usize, Bytes>>,
    /// Decoded views, by index.
    unpacked: BTreeMap<usize, Bytes>,
    /// Total length of the decoded views.
    unpacked_bytes: u64,
    /// Compressed bytes that were decoded, by buffer.
    decoded_bytes: Vec<u64>,
}

/// The bytes of a view.
enum Stored {
    /// Decoded.
    Unpacked(Bytes),
    /// A range within a buffer.
    In { buffer: usize, range: Range<u64> },
}

impl Stored {
    fn length(&self) -> u64 {
        match self {
            Self::Unpacked(bytes) => bytes.len() as u64,
            Self::In { range, .. } => range.end - range.start,
        }
    }
}

/// The elements of one accessor.
pub(super) struct Elements {
    count: usize,
    components: usize,
    kind: ComponentType,
    normalised: bool,
    /// First byte of element 0 and the distance between elements; `None`: all zero.
    dense: Option<(Bytes, usize)>,
    /// Elements that differ, by index, with their values one after the other.
    sparse: Vec<u32>,
    values: Bytes,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(document: &'a Document) -> Self {
        let buffers = document.root.buffers.len();
        Self {
            document,
            opened: vec![None; buffers],
            images: Some(BTreeMap::new()),
            unpacked: BTreeMap::new(),
            unpacked_bytes: 0,
            decoded_bytes: vec![0; buffers],
        }
    }

    /// Buffers whose images are empty: for those who need shapes only.
    pub(super) fn without_images(document: &'a Document) -> Self {
        Self { images: None, ..Self::new(document) }
    }

    fn buffer(&mut self, index: usize) -> Result<&Buffer, ImportError> {
        if !matches!(self.opened.get(index), Some(Some(_))) {
            let buffer = self.document.buffer(index)?;
            self.opened[index] = Some(buffer);
        }
        // It was opened above.
        self.opened[index]
            .as_ref()
            .ok_or_else(|| self.document.error(format!("buffers[{index}] is not open")))
    }

    /// The bytes of an image in a view.
    pub(super) fn image(&mut self, view: usize) -> Result<Bytes, ImportError> {
        if let Some(bytes) = self.images.as_ref().and_then(|images| images.get(&view)) {
            return Ok(bytes.clone());
        }
        let stored = self.view(view)?.0;
        if self.images.is_none() {
            return Ok(Bytes::new());
        }
        let bytes = Bytes::copy_from_slice(&self.part(&stored, 0..stored.length())?);
        self.images.as_mut().map(|images| images.insert(view, bytes.clone()));
        Ok(bytes)
    }

    /// A buffer view and its stride, if it has one.
    fn view(&mut self, index: usize) -> Result<(Stored, Option<usize>), ImportError> {
        let error = |what: &str| self.document.error(format!("bufferViews[{index}] {what}"));
        let view = self.document.root.buffer_views.get(index).ok_or_else(|| error("does not exist"))?;
        let stride = view.byte_stride;
        if let Some(compressed) = of_view(view).map_err(|why| error(&why.to_string()))? {
            return Ok((Stored::Unpacked(self.unpacked(index, &compressed)?), stride));
        }
        Ok((self.range(index, view.buffer.value(), view.byte_offset, view.byte_length)?, stride))
    }

    /// The bytes of a buffer view that the caller will decode; counts them against the limit.
    pub(super) fn compressed_view(&mut self, index: usize) -> Result<Bytes, ImportError> {
        let views = &self.document.root.buffer_views;
        let buffer = views.get(index).map_or(0, |view| view.buffer.value());
        let (stored, _) = self.view(index)?;
        self.count(index, buffer, stored.length())?;
        self.part(&stored, 0..stored.length())
    }

    /// A range of a buffer; errors name the view `index`.
    fn range(
        &mut self,
        index: usize,
        buffer: usize,
        offset: u64,
        length: u64,
    ) -> Result<Stored, ImportError> {
        let document = self.document;
        let bytes = self.buffer(buffer)?.length();
        let end = offset.checked_add(length).filter(|&end| end <= bytes);
        let end = end.ok_or_else(|| {
            document.error(format!("bufferViews[{index}] reaches beyond its buffer; the file is damaged"))
        })?;
        Ok(Stored::In { buffer, range: offset..end })
    }

    /// A part of what is stored, which is not longer than that.
    fn part(&mut self, stored: &Stored, part: Range<u64>) -> Result<Bytes, ImportError> {
        match stored {
            Stored::Unpacked(bytes) => Ok(bytes.slice(part.start as usize..part.end as usize)),
            Stored::In { buffer, range } => {
                self.buffer(*buffer)?.read(range.start + part.start..range.start + part.end)
            }
        }
    }

    /// The bytes of `count` elements of `size` bytes, `stride` apart; `None` if they exceed what is stored.
    fn elements(
        &mut self,
        stored: &Stored,
        offset: u64,
        [count, stride, size]: [usize; 3],
    ) -> Result<Option<Bytes>, ImportError> {
        match elements(stored.length(), offset, count, stride, size) {
            Some(range) => self.part(stored, range).map(Some),
            None => Ok(None),
        }
    }

    /// Counts compressed bytes against the length of their buffer: without this limit, overlapping views would decode the
    /// same bytes many times, each listed in a few bytes of JSON.
    fn count(&mut self, index: usize, buffer: usize, bytes: u64) -> Result<(), ImportError> {
        let length = self.buffer(buffer)?.length();
        let decoded = &mut self.decoded_bytes[buffer];
        *decoded += bytes;
        if *decoded > length {
            return Err(self.document.error(format!(
                "bufferViews[{index}]: the compressed views of buffers[{buffer}] overlap: together they are longer than its length, \
                 {length}; export the file again"
            )));
        }
        Ok(())
    }

    /// The decoded bytes of a compressed view.
    fn unpacked(&mut self, index: usize, view: &CompressedView) -> Result<Bytes, ImportError> {
        if let Some(bytes) = self.unpacked.get(&index) {
            return Ok(bytes.clone());
        }
        let stored = self.range(index, view.buffer, view.offset, view.length)?;
        self.count(index, view.buffer, stored.length())?;
        let data = self.part(&stored, 0..stored.length())?;
        let document = self.document;
        let error = |what: String| document.error(format!("bufferViews[{index}] {what}"));
        let bytes = view.unpacked_bytes().and_then(|bytes| bytes.checked_add(self.unpacked_bytes));
        self.unpacked_bytes = bytes.filter(|&bytes| bytes <= MAX_FILE_BYTES).ok_or_else(|| {
            error(format!(
                "decodes to too many bytes; at most {MAX_FILE_BYTES} are supported, so split the file"
            ))
        })?;
        let bytes = view
            .unpack(&data)
            .map_err(|what| error(format!("does not decode: {what}; export the file again")))?;
        let bytes = Bytes::from(bytes);
        self.unpacked.insert(index, bytes.clone());
        Ok(bytes)
    }

    /// Stored length of an accessor's view, compressed or not; 0 without a view.
    pub(super) fn stored_bytes(&self, accessor: usize) -> u64 {
        let root = &self.document.root;
        let view = root.accessors.get(accessor).and_then(|accessor| accessor.buffer_view);
        let view = view.and_then(|view| root.buffer_views.get(view.value()));
        view.map_or(0, |view| match of_view(view) {
            Ok(Some(compressed)) => compressed.length,
            _ => view.byte_length,
        })
    }

    /// Opens an accessor. `place` names its use in messages.
    ///
    /// # Errors
    /// Accessors that do not exist, have a shape that is not `allowed`, or reach beyond their bytes.
    pub(super) fn open(
        &mut self,
        index: usize,
        place: &str,
        allowed: &[Type],
    ) -> Result<Elements, ImportError> {
        self.open_with(index, place, allowed, MAX_ZEROS)
    }

    /// As [`Self::open`], with as many elements without a buffer view as something else in the file has.
    pub(super) fn open_with(
        &mut self,
        index: usize,
        place: &str,
        allowed: &[Type],
        zeros: usize,
    ) -> Result<Elements, ImportError> {
        let zeros = zeros.max(MAX_ZEROS);
        let document = self.document;
        let error = |what: String| document.error(format!("{place}: accessors[{index}] {what}"));
        let accessor = document.root.accessors.get(index).ok_or_else(|| error("does not exist".into()))?;
        let (Some(kind), Some(shape)) = (accessor.component_type, accessor.shape) else {
            return Err(error("has an unknown component type or shape".into()));
        };
        if !allowed.contains(&shape) {
            return Err(error(format!("has the shape {shape:?}; expected {allowed:?}")));
        }
        let components = shape.multiplicity();
        let size = components * kind.size();
        let count = usize::try_from(accessor.count).ok().filter(|&n| n <= u32::MAX as usize);
        let count = count.ok_or_else(|| error(format!("has {} elements; too many", accessor.count)))?;
        let dense = match &accessor.buffer_view {
            None if count > zeros => {
                return Err(error(format!(
                    "has {count} elements but no bufferView; at most {zeros} can be zero"
                )));
            }
            None => None,
            Some(view) => {
                let (stored, stride) = self.view(view.value())?;
                let stride = stride.unwrap_or(size);
                let bytes = self.elements(&stored, accessor.byte_offset, [count, stride, size])?;
                Some((bytes.ok_or_else(|| error(beyond(count, stride)))?, stride))
            }
        };
        let (sparse, values) = match &accessor.sparse {
            None => (Vec::new(), Bytes::new()),
            Some(sparse) => {
                let Checked::Valid(index_kind) = sparse.indices.component_type else {
                    return Err(error("has sparse indices of an unknown type".into()));
                };
                let many = usize::try_from(sparse.count.0).ok().filter(|&many| many <= count);
                let many = many.ok_or_else(|| error("has more sparse elements than elements".into()))?;
                let index_kind = index_kind.0;
                let stored = self.view(sparse.indices.buffer_view.value())?.0;
                let width = index_kind.size();
                let offset = sparse.indices.byte_offset.0;
                let bytes = self.elements(&stored, offset, [many, width, width])?;
                let bytes = bytes.ok_or_else(|| error(beyond(many, width)))?;
                let indices: Vec<u32> =
                    (0..many).map(|i| component(&bytes[i * width..], index_kind) as u32).collect();
                let last = indices.last().map_or(0, |&last| last as usize + 1);
                if !indices.is_sorted_by(|a, b| a < b) || last > count {
                    return Err(error(
                        "has sparse indices that do not increase, or are beyond its length".into(),
                    ));
                }
                let stored = self.view(sparse.values.buffer_view.value())?.0;
                let bytes = self.elements(&stored, sparse.values.byte_offset.0, [many, size, size])?;
                (indices, bytes.ok_or_else(|| error(beyond(many, size)))?)
            }
        };
        Ok(Elements { count, components, kind, normalised: accessor.normalized, dense, sparse, values })
    }
}

fn beyond(count: usize, stride: usize) -> String {
    format!("reaches beyond its bufferView with {count} elements {stride} bytes apart; the file is damaged")
}

/// Where `count` elements of `size` bytes are, `stride` apart; `None` if they exceed `length`.
fn elements(length: u64, offset: u64, count: usize, stride: usize, size: usize) -> Option<Range<u64>> {
    if count == 0 {
        return Some(0..0);
    }
    let bytes = (count - 1).checked_mul(stride)?.checked_add(size)?;
    let end = offset.checked_add(bytes as u64).filter(|&end| end <= length && stride >= size)?;
    Some(offset..end)
}

/// The component at the start of `bytes`.
fn component(bytes: &[u8], kind: ComponentType) -> f64 {
    match kind {
        ComponentType::I8 => f64::from(bytes[0] as i8),
        ComponentType::U8 => f64::from(bytes[0]),
        ComponentType::I16 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
        ComponentType::U16 => f64::from(u16::from_le_bytes([bytes[0], bytes[1]])),
        ComponentType::U32 => f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
        ComponentType::F32 => f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])),
    }
}

impl Elements {
    /// Elements without gaps between them.
    ///
    /// # Panics
    /// If there are less bytes than that many elements have.
    pub(super) fn packed(
        bytes: Bytes,
        count: usize,
        components: usize,
        kind: ComponentType,
        normalised: bool,
    ) -> Self {
        let size = components * kind.size();
        assert!(bytes.len() / size >= count, "{} bytes for {count} elements of {size}", bytes.len());
        Self {
            count,
            components,
            kind,
            normalised,
            dense: Some((bytes, size)),
            sparse: Vec::new(),
            values: Bytes::new(),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.count
    }

    /// Whether components are unsigned integers, as indices must be.
    pub(super) fn is_unsigned(&self) -> bool {
        matches!(self.kind, ComponentType::U8 | ComponentType::U16 | ComponentType::U32)
    }

    /// Components per element.
    pub(super) fn components(&self) -> usize {
        self.components
    }

    /// An element's components, the first `N` of them; 0 where it has fewer. Normalised integers are
    /// divided by their largest value (glTF 2.0 specification, §3.11).
    ///
    /// # Panics
    /// If `index` is not below [`Self::len`].
    pub(super) fn get<const N: usize>(&self, index: usize) -> [f64; N] {
        assert!(index < self.count, "element {index} of {}", self.count);
        let width = self.kind.size();
        let bytes: &[u8] = match (self.sparse.binary_search(&(index as u32)), &self.dense) {
            (Ok(found), _) => &self.values[found * self.components * width..],
            (Err(_), Some((bytes, stride))) => &bytes[index * stride..],
            (Err(_), None) => return [0.0; N],
        };
        let mut values = [0.0; N];
        for (i, value) in values.iter_mut().enumerate().take(self.components) {
            let raw = component(&bytes[i * width..], self.kind);
            *value = match self.kind {
                ComponentType::I8 if self.normalised => (raw / 127.0).max(-1.0),
                ComponentType::U8 if self.normalised => raw / 255.0,
                ComponentType::I16 if self.normalised => (raw / 32_767.0).max(-1.0),
                ComponentType::U16 if self.normalised => raw / 65_535.0,
                _ => raw,
            };
        }
        values
    }
}
