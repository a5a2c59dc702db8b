use image::{DynamicImage, Rgba, RgbaImage};

use super::boxes::Container;
use super::color::Samples;
use super::*;

/// 37 × 22 pixels: red grows along x, green along y, blue along both. Encoded by ravif 0.13 at quality 90: as YCbCr of 8
/// bits, as RGB, and as YCbCr of 10 bits with an opacity of 64 in the right half.
const RAMP: &[u8] = include_bytes!("ramp.avif");
const RAMP_RGB: &[u8] = include_bytes!("ramp-rgb.avif");
const RAMP_ALPHA: &[u8] = include_bytes!("ramp-alpha.avif");
const SIZE: (u32, u32) = (37, 22);

fn ramp(has_opacity: bool) -> RgbaImage {
    RgbaImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let opacity = if has_opacity && x >= 18 { 64 } else { 255 };
        Rgba([x * 255 / 36, y * 255 / 21, (x + y) * 255 / 57, opacity].map(|value| value as u8))
    })
}

fn decoded(bytes: &[u8]) -> Result<DynamicImage, String> {
    Avif::open(bytes)?.decode()
}

/// Mean difference of channels.
fn off(found: &DynamicImage, wanted: &RgbaImage) -> f64 {
    let found = found.to_rgba8();
    assert_eq!(found.dimensions(), wanted.dimensions());
    let sum: u64 = found.iter().zip(wanted.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / wanted.len() as f64
}

fn number(value: usize, bytes: usize) -> Vec<u8> {
    value.to_be_bytes()[8 - bytes..].to_vec()
}

fn part(kind: &str, body: &[&[u8]]) -> Vec<u8> {
    let body = body.concat();
    [&number(body.len() + 8, 4), kind.as_bytes(), &body].concat()
}

/// A file around AV1 data, of which the metadata is written anew.
struct File {
    kind: &'static str,
    /// Kinds and bodies; those from the third on are stated to be needed.
    properties: Vec<(&'static str, Vec<u8>)>,
    extents: Vec<(usize, usize)>,
    references: Vec<u8>,
    data: Vec<u8>,
}

impl File {
    fn new() -> Self {
        let container = Container::open(RAMP_RGB).unwrap();
        let data = container.data(container.primary).unwrap();
        let size = [number(0, 4), number(37, 4), number(22, 4)].concat();
        let color = [b"nclx".to_vec(), number(1, 2), number(13, 2), number(0, 2), vec![0x80]].concat();
        Self {
            kind: "av01",
            properties: vec![("ispe", size), ("colr", color)],
            extents: vec![(0, data.len())],
            references: Vec::new(),
            data,
        }
    }

    /// With its data in the metadata.
    fn written(&self) -> Vec<u8> {
        let extents: Vec<u8> = self
            .extents
            .iter()
            .flat_map(|(at, length)| [number(*at, 4), number(*length, 4)].concat())
            .collect();
        let count = number(self.extents.len(), 2);
        let place = [
            &number(1 << 24, 4),
            &[0x44, 0][..],
            &number(1, 2),
            &number(7, 2),
            &number(1, 2),
            &[0; 2],
            &count,
            &extents,
        ];
        let entry = part("infe", &[&number(2 << 24, 4), &number(7, 2), &[0; 2], self.kind.as_bytes(), &[0]]);
        let properties: Vec<u8> =
            self.properties.iter().flat_map(|(kind, body)| part(kind, &[body])).collect();
        let uses: Vec<u8> =
            (1..).zip(&self.properties).map(|(i, _)| if i > 2 { 0x80 | i } else { i }).collect();
        let associations = [number(0, 4), number(1, 4), number(7, 2), vec![uses.len() as u8], uses].concat();
        let meta = [
            number(0, 4),
            part("pitm", &[&number(0, 4), &number(7, 2)]),
            part("iloc", &place.map(|field| field)),
            part("iinf", &[&number(0, 4), &number(1, 2), &entry]),
            self.references.clone(),
            part("iprp", &[&part("ipco", &[&properties]), &part("ipma", &[&associations])]),
            part("idat", &[&self.data]),
        ];
        [part("ftyp", &[b"avif\0\0\0\0mif1"]), part("meta", &[&meta.concat()])].concat()
    }

    fn with(mut self, kind: &'static str, body: &[u8]) -> Self {
        self.properties.push((kind, body.to_vec()));
        self
    }
}

#[test]
fn files_of_each_coding_show_their_picture() {
    for (file, has_opacity, is_deep) in
        [(RAMP, false, false), (RAMP_RGB, false, false), (RAMP_ALPHA, true, true)]
    {
        let image = decoded(file).unwrap();
        assert_eq!(image.color().has_alpha(), has_opacity);
        assert_eq!(image.color().bytes_per_pixel() > 4, is_deep, "{:?}", image.color());
        let off = off(&image, &ramp(has_opacity));
        assert!(off < 2.0, "{off}");
    }
}

#[test]
fn data_may_lie_in_the_metadata_and_in_parts() {
    let mut file = File::new();
    assert_eq!(decoded(&file.written()).unwrap(), decoded(RAMP_RGB).unwrap());
    file.extents = vec![(0, 100), (100, file.data.len() - 100)];
    assert_eq!(decoded(&file.written()).unwrap(), decoded(RAMP_RGB).unwrap());
}

#[test]
fn images_are_turned_in_the_order_that_the_file_states() {
    let plain = decoded(RAMP_RGB).unwrap();
    let quarter = File::new().with("irot", &[1]).written();
    assert_eq!(Avif::open(&quarter).unwrap().size(), (22, 37));
    assert_eq!(decoded(&quarter).unwrap(), plain.rotate270());
    let both = File::new().with("irot", &[3]).with("imir", &[1]).written();
    assert_eq!(decoded(&both).unwrap(), plain.rotate90().fliph());
    assert_eq!(decoded(&File::new().with("imir", &[0]).written()).unwrap(), plain.flipv());
}

/// Width, height and the distance from the middle in halves of a pixel.
fn crop(halves: [i32; 4]) -> Vec<u8> {
    let [width, height, x, y] = halves;
    [width, 1, height, 1, x, 2, y, 2].iter().flat_map(|field| field.to_be_bytes()).collect()
}

#[test]
fn a_part_is_shown_where_the_file_says() {
    let part = File::new().with("clap", &crop([20, 10, -9, 4])).with("irot", &[2]).written();
    assert_eq!(Avif::open(&part).unwrap().size(), (20, 10));
    // Half of 37 − 20 − 9, and of 22 − 10 + 4.
    assert_eq!(decoded(&part).unwrap(), decoded(RAMP_RGB).unwrap().crop_imm(4, 8, 20, 10).rotate180());
}

#[test]
fn samples_of_limited_range_are_stretched() {
    let mut file = File::new();
    *file.properties[1].1.last_mut().unwrap() = 0;
    let (limited, full) = (decoded(&file.written()).unwrap().to_rgb8(), decoded(RAMP_RGB).unwrap().to_rgb8());
    for (limited, full) in limited.iter().zip(full.iter()) {
        let wanted = ((f64::from(*full) - 16.0) * 255.0 / 219.0).clamp(0.0, 255.0);
        assert!((f64::from(*limited) - wanted).abs() <= 0.51, "{full} {limited}");
    }
}

#[test]
fn halved_chroma_is_linear_between_its_samples() {
    let samples = Samples {
        plane: vec![0, 100, 200, 40, 140, 240],
        stride: 3,
        is_deep: false,
        halved: [true, true],
        last: [2, 1],
        zero: 0.0,
        scale: 1.0,
    };
    let row = |y: u32| [0, 1, 2, 3, 4, 5].map(|x| samples.between(x, y));
    assert_eq!(row(0), [0.0, 25.0, 75.0, 125.0, 175.0, 200.0]);
    assert_eq!(row(1), [10.0, 35.0, 85.0, 135.0, 185.0, 210.0]);
    assert_eq!(row(3), [40.0, 65.0, 115.0, 165.0, 215.0, 240.0]);
}

#[test]
fn what_is_not_read_is_named() {
    let refused = |file: File, why: &str| {
        let found = decoded(&file.written()).unwrap_err();
        assert!(found.contains(why), "{found}");
    };
    refused(File { kind: "hvc1", ..File::new() }, "its image is hvc1, not AV1");
    refused(File { kind: "grid", ..File::new() }, "a grid of others");
    refused(File::new().with("clap", &[0; 32]), "not within it");
    refused(File::new().with("clap", &crop([38, 22, 0, 0])), "not within it");
    refused(File::new().with("what", &[]), "it needs what");
    let multiplied =
        part("iref", &[&number(0, 4), &part("prem", &[&number(7, 2), &number(1, 2), &number(8, 2)])]);
    refused(File { references: multiplied, ..File::new() }, "multiplied by opacity");
    refused(File { extents: vec![(0, 100_000)], ..File::new() }, "beyond its end");
    refused(File { extents: vec![(0, 0); 60], ..File::new() }, "overlaps");
    refused(File { data: vec![0; 40], extents: vec![(0, 40)], ..File::new() }, "AV1");
    let mut other_size = File::new();
    other_size.properties[0].1[7] = 40;
    refused(other_size, "another size");
    let mut vast = File::new().with("clap", &crop([20, 10, 0, 0]));
    vast.properties[0].1 = [0, 30_000, 30_000].map(|field: u32| field.to_be_bytes()).concat();
    assert_eq!(Avif::open(&vast.written()).unwrap().size(), (20, 10));
    refused(vast, "a part of 30000 × 30000 pixels");
    let mut matrix = File::new();
    matrix.properties[1].1[9] = 8;
    refused(matrix, "matrix coefficients 8");
    refused(File { properties: vec![("ispe", vec![0; 3])], ..File::new() }, "cut short");
    refused(File { properties: Vec::new(), ..File::new() }, "it states no size");
}

#[test]
fn damaged_bytes_are_refused_or_change_the_picture() {
    let try_it = |bytes: &[u8]| {
        // Large sizes are refused before a file is decoded.
        if let Ok(file) = Avif::open(bytes)
            && u64::from(file.size().0) * u64::from(file.size().1) < 10_000
        {
            let _ = file.decode();
        }
    };
    (0..RAMP_ALPHA.len()).step_by(9).for_each(|length| try_it(&RAMP_ALPHA[..length]));
    for at in 0..RAMP_ALPHA.len() {
        let mut file = RAMP_ALPHA.to_vec();
        file[at] ^= [1, 0x10, 0x80, 0xFF][at % 4];
        try_it(&file);
    }
}
