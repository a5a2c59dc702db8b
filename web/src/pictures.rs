//! Files of texture levels that the worker's script decodes with the browser's decoders, by number.

use std::collections::BTreeMap;
use std::sync::Arc;

use bytes::Bytes;
use lodestream_client::core::{Change, TextureChange, TexturePixels};
use lodestream_scene::asset::{Planes, TextureKind};

/// A file to decode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Picture {
    pub(crate) number: u32,
    /// Number of changes that name it.
    pub(crate) uses: u32,
    pub(crate) file: Bytes,
    /// Width and height that it must have.
    pub(crate) size: [u32; 2],
    /// It is made of planes, which [`Pictures::texels`] makes texels of.
    pub(crate) has_planes: bool,
    /// It is a height map: grey, of 8 or 16 bits, which the browser's decoder would round to 8.
    pub(crate) is_height: bool,
}

/// The first change that names a picture: asset, texture, level and tile.
pub(crate) type Level = (u32, u16, u8, Option<u16>);

/// Pictures whose decoding has not been reported.
#[derive(Debug, Default)]
pub(crate) struct Pictures {
    next: u32,
    open: BTreeMap<u32, (Level, Option<Planes>)>,
}

impl Pictures {
    /// Replaces the files in a step by numbers, and returns the files. Changes that share texels share a number.
    pub(crate) fn take(&mut self, step: &mut [Change]) -> Vec<Picture> {
        let mut taken: Vec<(Arc<TexturePixels>, Picture)> = Vec::new();
        for change in step {
            let Change::Texture(TextureChange { asset, texture, level, tile, pixels }) = change else {
                continue;
            };
            let TexturePixels::File { file, kind, size, planes } = &**pixels else { continue };
            let bytes = u32::try_from(pixels.bytes()).unwrap_or(u32::MAX);
            let known = taken.iter_mut().find(|(other, _)| Arc::ptr_eq(other, pixels));
            let number = if let Some((_, picture)) = known {
                picture.uses += 1;
                picture.number
            } else {
                let number = self.next;
                self.next = self.next.wrapping_add(1);
                self.open.insert(number, ((*asset, *texture, *level, *tile), *planes));
                let is_height = *kind == TextureKind::Height;
                let size = planes.map_or(*size, |planes| planes.stacked(*size));
                let has_planes = planes.is_some();
                let picture = Picture { number, uses: 1, file: file.clone(), size, has_planes, is_height };
                taken.push((Arc::clone(pixels), picture));
                number
            };
            *pixels = TexturePixels::Held { number, bytes }.into();
        }
        taken.into_iter().map(|(_, picture)| picture).collect()
    }

    /// Notes that a picture is decoded, or is not; gives its level.
    pub(crate) fn report(&mut self, number: u32) -> Option<Level> {
        self.open.remove(&number).map(|(level, _)| level)
    }

    /// The texels of a picture that is made of planes, from its pixels of four bytes; empty for others.
    pub(crate) fn texels(&self, number: u32, pixels: &[u8]) -> Vec<u8> {
        let planes = self.open.get(&number).and_then(|(_, planes)| *planes);
        planes.map_or_else(Vec::new, |planes| planes.texels(pixels.as_chunks::<4>().0))
    }

    /// Whether decoding of a picture has not been reported.
    pub(crate) fn is_decoding(&self) -> bool {
        !self.open.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_that_share_texels_share_a_number_and_reports_name_the_level() {
        let file = |side| {
            let (file, kind) = (Bytes::from_static(b"file"), TextureKind::Height);
            Arc::new(TexturePixels::File { file, kind, size: [side, side], planes: None })
        };
        let (one, other) = (file(8), file(4));
        let change = |asset, level, pixels: &Arc<_>| {
            Change::Texture(TextureChange {
                asset,
                texture: 1,
                level,
                tile: None,
                pixels: Arc::clone(pixels),
            })
        };
        let mut step = [change(3, 2, &one), Change::FirstFrame, change(5, 2, &one), change(3, 1, &other)];
        let mut pictures = Pictures::default();
        let taken = pictures.take(&mut step);
        let found: Vec<_> = taken.iter().map(|p| (p.number, p.uses, p.size, p.is_height)).collect();
        assert_eq!(found, [(0, 2, [8, 8], true), (1, 1, [4, 4], true)]);
        let numbers: Vec<_> = step
            .iter()
            .filter_map(|change| match change {
                Change::Texture(texture) => Some((*texture.pixels).clone()),
                _ => None,
            })
            .collect();
        let held = |number, bytes| TexturePixels::Held { number, bytes };
        assert_eq!(numbers, [held(0, 256), held(0, 256), held(1, 64)]);
        assert_eq!((pictures.report(1), pictures.report(1)), (Some((3, 1, 1, None)), None));
        assert!(pictures.is_decoding());
        assert_eq!(pictures.report(0), Some((3, 1, 2, None)));
        assert!(!pictures.is_decoding());
    }
}
