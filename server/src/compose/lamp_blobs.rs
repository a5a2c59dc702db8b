//! The lamps of a scene as they are sent: neighbours together in pages, and a directory of what each page lights.

use bytes::Bytes;
use lodestream_protocol::LampBlob;
use lodestream_protocol::lamps::{
    FEW_LAMPS, FEW_PAGES, LAMPS_PER_PAGE, LISTED_PER_PAGE, Lamp, Lamps, LampsError, ListedLamps, MAX_LAMPS,
    decode_page, encode_directory, encode_page,
};

/// Bits of a place along each axis of the curve.
const CURVE_BITS: u32 = 21;

/// See the module. Made once when a scene is opened.
#[derive(Clone, Debug, Default)]
pub struct LampBlobs {
    /// What is said of them at once; nothing where there are none.
    lamps: Option<Lamps>,
    directory: Vec<Bytes>,
    pages: Vec<Bytes>,
}

/// Lamps that cannot be sent.
#[derive(Debug, thiserror::Error)]
pub enum LampBlobsError {
    /// More than the protocol numbers.
    #[error("the scene has {count} lamps; at most {MAX_LAMPS} are supported")]
    TooMany {
        /// How many.
        count: usize,
    },
    /// One that the protocol refuses: a model placed too far out, say.
    #[error("a lamp cannot be described: {0}; look at where its model stands")]
    Refused(#[from] LampsError),
}

impl LampBlobs {
    /// Codes the lamps of a scene.
    ///
    /// # Errors
    /// See [`LampBlobsError`].
    pub fn new(lamps: &[Lamp]) -> Result<Self, LampBlobsError> {
        let Some(count) = u32::try_from(lamps.len()).ok().filter(|count| *count <= MAX_LAMPS) else {
            return Err(LampBlobsError::TooMany { count: lamps.len() });
        };
        if count == 0 {
            return Ok(Self::default());
        }
        let ordered = along_curve(lamps);
        let (mut pages, mut listed) = (Vec::new(), Vec::new());
        for group in ordered.chunks(LAMPS_PER_PAGE as usize) {
            let page = encode_page(group)?;
            // Of what comes back, whose ranges may be a little larger.
            let said = decode_page(&page, group.len() as u32)?;
            listed.push(ListedLamps::of(&said, page.len() as u32));
            pages.push(Bytes::from(page));
        }
        let directory = listed.chunks(LISTED_PER_PAGE as usize).map(encode_directory);
        let directory: Vec<Bytes> = directory.map(|page| page.map(Bytes::from)).collect::<Result<_, _>>()?;
        let first = if count <= FEW_LAMPS {
            pages.first()
        } else {
            directory.first().filter(|_| pages.len() <= FEW_PAGES as usize)
        };
        let lamps = Some(Lamps { count, first: first.map(|bytes| bytes.to_vec()).unwrap_or_default() });
        Ok(Self { lamps, directory, pages })
    }

    /// What is said, the directory's pages, and pages, as they were coded once.
    pub(crate) const fn of_parts(lamps: Option<Lamps>, directory: Vec<Bytes>, pages: Vec<Bytes>) -> Self {
        Self { lamps, directory, pages }
    }

    /// The pages of the directory, and the pages.
    pub(crate) fn parts(&self) -> (&[Bytes], &[Bytes]) {
        (&self.directory, &self.pages)
    }

    /// What is said of them at once; `None` where there are none.
    #[must_use]
    pub const fn lamps(&self) -> Option<&Lamps> {
        self.lamps.as_ref()
    }

    /// A blob, if there is such a one.
    #[must_use]
    pub fn get(&self, blob: LampBlob) -> Option<&Bytes> {
        match blob {
            LampBlob::DirectoryPage(page) => self.directory.get(page as usize),
            LampBlob::Page(page) => self.pages.get(page as usize),
        }
    }

    /// All bytes, for fingerprints.
    pub fn all(&self) -> impl Iterator<Item = &Bytes> {
        self.directory.iter().chain(&self.pages)
    }
}

/// Lamps in the order of a Morton curve through their bounding box ("A computer oriented geodetic data base", 1966):
/// what is near on it is near in the world.
fn along_curve(lamps: &[Lamp]) -> Vec<Lamp> {
    let of_axis = |axis: usize| lamps.iter().map(move |lamp| lamp.position[axis]);
    let low = [0, 1, 2].map(|axis| of_axis(axis).fold(f64::INFINITY, f64::min));
    let high = [0, 1, 2].map(|axis| of_axis(axis).fold(f64::NEG_INFINITY, f64::max));
    // A cube, so that a flat scene is cut along its length and width alone.
    let side = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let cells = f64::from((1_u32 << CURVE_BITS) - 1);
    let key = |lamp: &Lamp| {
        let cell = |axis: usize| {
            let share = if side > 0.0 { (lamp.position[axis] - low[axis]) / side } else { 0.0 };
            (share * cells) as u64
        };
        spread(cell(0)) | spread(cell(1)) << 1 | spread(cell(2)) << 2
    };
    let mut ordered = lamps.to_vec();
    // Stable: lamps in one place stay in the file's order.
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
    use lodestream_protocol::lamps::{First, decode_directory};

    use super::*;

    fn grid(count: u32) -> Vec<Lamp> {
        let at = |i: u32| [f64::from(i * 7919 % 641) * 4.0, 5.0, f64::from(i * 104_729 % 643) * 4.0];
        let lamp = |i| Lamp { position: at(i), intensity: [100.0, 80.0, 50.0], range: 15.0, spot: None };
        (0..count).map(lamp).collect()
    }

    #[test]
    fn a_scene_without_lamps_says_nothing_of_them() {
        let none = LampBlobs::new(&[]).unwrap();
        assert_eq!((none.lamps(), none.all().count()), (None, 0));
    }

    #[test]
    fn every_lamp_is_on_one_page_and_what_a_page_lights_is_small() {
        let lamps = grid(4000);
        let blobs = LampBlobs::new(&lamps).unwrap();
        let said = blobs.lamps().unwrap();
        assert_eq!((said.count, said.first().unwrap()), (4000, First::Nothing));
        let directory = blobs.get(LampBlob::DirectoryPage(0)).unwrap();
        let listed = decode_directory(directory, 63).unwrap();
        let mut found = 0;
        for (number, entry) in (0..).zip(&listed) {
            let page = blobs.get(LampBlob::Page(number)).unwrap();
            assert_eq!(page.len(), entry.bytes as usize);
            for lamp in decode_page(page, Lamps::on_page(4000, number)).unwrap() {
                found += 1;
                let near =
                    |a: &Lamp| (0..3).all(|axis| (a.position[axis] - lamp.position[axis]).abs() < 0.01);
                assert!(lamps.iter().any(near), "{lamp:?} is none of the scene's");
            }
        }
        assert_eq!((found, blobs.get(LampBlob::Page(63))), (4000, None));
        // Of a square of 2,564 units a page in place of 63 has a square of 323.
        let mean = listed.iter().map(|entry| f64::from(entry.radius)).sum::<f64>() / 63.0;
        assert!(mean < 450.0, "{mean}");
        let bytes: usize = blobs.all().map(Bytes::len).sum();
        assert!(bytes <= 4000 * 10, "{bytes}");
    }

    #[test]
    fn few_lamps_and_the_directory_of_few_pages_are_said_at_once() {
        let first = |count| LampBlobs::new(&grid(count)).unwrap().lamps().unwrap().first().unwrap();
        assert!(matches!(first(16), First::Lamps(lamps) if lamps.len() == 16));
        assert!(matches!(first(400), First::Directory(pages) if pages.len() == 7));
    }

    #[test]
    fn what_cannot_be_sent_is_named() {
        let many = LampBlobs::new(&vec![grid(1)[0]; MAX_LAMPS as usize + 1]).unwrap_err().to_string();
        assert!(many.contains("262145 lamps; at most 262144"), "{many}");
        let far = Lamp { position: [1e20, 0.0, 0.0], ..grid(1)[0] };
        assert!(LampBlobs::new(&[far]).unwrap_err().to_string().contains("1e12"));
    }

    #[test]
    fn bits_are_spread_by_threes() {
        assert_eq!([0, 1, 2, 3, 0x1f_ffff].map(spread), [0, 1, 8, 9, 0x1249_2492_4924_9249]);
    }
}
