//! Encodes the punctual lights of a scene: pages of nearby lights, and a directory of the space that each page lights.

use bytes::Bytes;
use lodestream_scene::PunctualLightBlob;
use lodestream_scene::punctual_lights::{
    FEW_PAGES, FEW_PUNCTUAL_LIGHTS, LISTED_PER_PAGE, MAX_PUNCTUAL_LIGHTS, PUNCTUAL_LIGHTS_PER_PAGE,
    PunctualLight, PunctualLightPageEntry, PunctualLights, PunctualLightsError, decode_page,
    encode_directory, encode_page,
};

/// Bits per axis of the Morton curve.
const CURVE_BITS: u32 = 21;

/// Encoded punctual lights, made once when a scene is opened.
#[derive(Clone, Debug, Default)]
pub struct PunctualLightBlobs {
    /// Sent with the scene; `None` without lights.
    summary: Option<PunctualLights>,
    directory: Vec<Bytes>,
    pages: Vec<Bytes>,
}

/// Punctual lights that cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum PunctualLightBlobsError {
    /// More than the protocol numbers.
    #[error("the scene has {count} punctual lights; at most {MAX_PUNCTUAL_LIGHTS} are supported")]
    TooMany {
        /// How many.
        count: usize,
    },
    /// A light outside the protocol's ranges, for example of a model that is too far out.
    #[error("a punctual light cannot be described: {0}; check the position of its model")]
    Refused(#[from] PunctualLightsError),
}

impl PunctualLightBlobs {
    /// Encodes the punctual lights of a scene.
    ///
    /// # Errors
    /// See [`PunctualLightBlobsError`].
    pub fn new(punctual_lights: &[PunctualLight]) -> Result<Self, PunctualLightBlobsError> {
        let Some(count) =
            u32::try_from(punctual_lights.len()).ok().filter(|count| *count <= MAX_PUNCTUAL_LIGHTS)
        else {
            return Err(PunctualLightBlobsError::TooMany { count: punctual_lights.len() });
        };
        if count == 0 {
            return Ok(Self::default());
        }
        let ordered = along_curve(punctual_lights);
        let (mut pages, mut listed) = (Vec::new(), Vec::new());
        for group in ordered.chunks(PUNCTUAL_LIGHTS_PER_PAGE as usize) {
            let page = encode_page(group)?;
            // Encoding may enlarge ranges a little, so the directory uses the decoded lights.
            let decoded = decode_page(&page, group.len() as u32)?;
            listed.push(PunctualLightPageEntry::of(&decoded, page.len() as u32));
            pages.push(Bytes::from(page));
        }
        let directory = listed.chunks(LISTED_PER_PAGE as usize).map(encode_directory);
        let directory: Vec<Bytes> = directory.map(|page| page.map(Bytes::from)).collect::<Result<_, _>>()?;
        Ok(Self { summary: summary(count, &directory, &pages), directory, pages })
    }

    /// The blobs of `count` punctual lights, encoded before; `None` if there are too many lights, or not as many pages
    /// as they need.
    pub(crate) fn of_parts(count: u32, directory: Vec<Bytes>, pages: Vec<Bytes>) -> Option<Self> {
        let complete = count <= MAX_PUNCTUAL_LIGHTS
            && pages.len() == PunctualLights::pages_of(count) as usize
            && directory.len() == PunctualLights::directory_pages_of(count) as usize;
        complete.then(|| Self { summary: summary(count, &directory, &pages), directory, pages })
    }

    /// The pages of the directory, and the pages.
    pub fn parts(&self) -> (&[Bytes], &[Bytes]) {
        (&self.directory, &self.pages)
    }

    /// The message about them; `None` without lights.
    #[must_use]
    pub const fn punctual_lights(&self) -> Option<&PunctualLights> {
        self.summary.as_ref()
    }

    /// A blob; `None` if there is none of this number.
    #[must_use]
    pub fn get(&self, blob: PunctualLightBlob) -> Option<&Bytes> {
        match blob {
            PunctualLightBlob::DirectoryPage(page) => self.directory.get(page as usize),
            PunctualLightBlob::Page(page) => self.pages.get(page as usize),
        }
    }

    /// All bytes, for fingerprints.
    pub fn all(&self) -> impl Iterator<Item = &Bytes> {
        self.directory.iter().chain(&self.pages)
    }
}

/// The message about the punctual lights, which carries the only page of few lights, or the only directory page of few
/// pages; `None` without lights.
fn summary(count: u32, directory: &[Bytes], pages: &[Bytes]) -> Option<PunctualLights> {
    let first = if count <= FEW_PUNCTUAL_LIGHTS {
        pages.first()
    } else {
        directory.first().filter(|_| pages.len() <= FEW_PAGES as usize)
    };
    (count > 0)
        .then(|| PunctualLights { count, first: first.map(|bytes| bytes.to_vec()).unwrap_or_default() })
}

/// Punctual lights in the order of a Morton curve through their bounding box (Morton, "A computer oriented geodetic data
/// base", 1966), which keeps nearby lights together.
fn along_curve(punctual_lights: &[PunctualLight]) -> Vec<PunctualLight> {
    let of_axis =
        |axis: usize| punctual_lights.iter().map(move |punctual_light| punctual_light.position[axis]);
    let low = [0, 1, 2].map(|axis| of_axis(axis).fold(f64::INFINITY, f64::min));
    let high = [0, 1, 2].map(|axis| of_axis(axis).fold(f64::NEG_INFINITY, f64::max));
    // Scaled to a cube, so that a flat scene is split along its length and width only.
    let side = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let cells = f64::from((1_u32 << CURVE_BITS) - 1);
    let key = |punctual_light: &PunctualLight| {
        let cell = |axis: usize| {
            let share = if side > 0.0 { (punctual_light.position[axis] - low[axis]) / side } else { 0.0 };
            (share * cells) as u64
        };
        spread(cell(0)) | spread(cell(1)) << 1 | spread(cell(2)) << 2
    };
    let mut ordered = punctual_lights.to_vec();
    // Stable: punctual lights in one place stay in the file's order.
    ordered.sort_by_cached_key(key);
    ordered
}

/// The lowest 21 bits of a number with two zeros between each and the next.
fn spread(x: u64) -> u64 {
    let mut x = x & 0x1f_ffff;
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff_u64),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        x = (x | x << shift) & mask;
    }
    x
}

#[cfg(test)]
mod tests {
    use lodestream_scene::punctual_lights::{First, decode_directory};

    use super::*;

    fn grid(count: u32) -> Vec<PunctualLight> {
        let at = |i: u32| [f64::from(i * 7919 % 641) * 4.0, 5.0, f64::from(i * 104_729 % 643) * 4.0];
        let punctual_light =
            |i| PunctualLight { position: at(i), intensity: [100.0, 80.0, 50.0], range: 15.0, spot: None };
        (0..count).map(punctual_light).collect()
    }

    #[test]
    fn a_scene_without_punctual_lights_has_no_message_about_them() {
        let none = PunctualLightBlobs::new(&[]).unwrap();
        assert_eq!((none.punctual_lights(), none.all().count()), (None, 0));
    }

    #[test]
    fn every_punctual_light_is_on_one_page_and_what_a_page_lights_is_small() {
        let punctual_lights = grid(4000);
        let blobs = PunctualLightBlobs::new(&punctual_lights).unwrap();
        let said = blobs.punctual_lights().unwrap();
        assert_eq!((said.count, said.first().unwrap()), (4000, First::Nothing));
        let directory = blobs.get(PunctualLightBlob::DirectoryPage(0)).unwrap();
        let listed = decode_directory(directory, 63).unwrap();
        let mut found = 0;
        for (number, entry) in (0..).zip(&listed) {
            let page = blobs.get(PunctualLightBlob::Page(number)).unwrap();
            assert_eq!(page.len(), entry.bytes as usize);
            for punctual_light in decode_page(page, PunctualLights::on_page(4000, number)).unwrap() {
                found += 1;
                let near = |a: &PunctualLight| {
                    (0..3).all(|axis| (a.position[axis] - punctual_light.position[axis]).abs() < 0.01)
                };
                assert!(punctual_lights.iter().any(near), "{punctual_light:?} is not one of the scene's");
            }
        }
        assert_eq!((found, blobs.get(PunctualLightBlob::Page(63))), (4000, None));
        // Of a square of 2,564 units a page in place of 63 has a square of 323.
        let mean = listed.iter().map(|entry| f64::from(entry.radius)).sum::<f64>() / 63.0;
        assert!(mean < 450.0, "{mean}");
        let bytes: usize = blobs.all().map(Bytes::len).sum();
        assert!(bytes <= 4000 * 10, "{bytes}");
    }

    #[test]
    fn few_punctual_lights_or_a_short_directory_are_in_the_first_message() {
        let first = |count| {
            PunctualLightBlobs::new(&grid(count)).unwrap().punctual_lights().unwrap().first().unwrap()
        };
        assert!(matches!(first(16), First::PunctualLights(punctual_lights) if punctual_lights.len() == 16));
        assert!(matches!(first(400), First::Directory(pages) if pages.len() == 7));
    }

    #[test]
    fn punctual_lights_beyond_the_limits_are_refused_by_name() {
        let many = PunctualLightBlobs::new(&vec![grid(1)[0]; MAX_PUNCTUAL_LIGHTS as usize + 1])
            .unwrap_err()
            .to_string();
        assert!(many.contains("262145 punctual lights; at most 262144"), "{many}");
        let far = PunctualLight { position: [1e20, 0.0, 0.0], ..grid(1)[0] };
        assert!(PunctualLightBlobs::new(&[far]).unwrap_err().to_string().contains("1e12"));
    }

    #[test]
    fn bits_are_spread_by_threes() {
        assert_eq!([0, 1, 2, 3, 0x1f_ffff].map(spread), [0, 1, 8, 9, 0x1249_2492_4924_9249]);
    }
}
