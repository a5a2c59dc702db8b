//! What the parts of a scene are called, pages of records and their directory, and how they move.

use lodestream_scene::animation::AnimatedModel;
use lodestream_scene::parts::{check_page, decode_directory, decode_record, encode_page, records_of};

use crate::input::Input;
use crate::meter::{Ceiling, within};

/// The first byte selects the format, the second the number of entries: a page of records or a page of their directory,
/// in a scene of 1000 records, or an animated model. What is accepted survives encoding and decoding.
pub fn parts(data: &[u8]) -> bool {
    let mut input = Input::new(data);
    let (kind, count) = (input.u8(), u32::from(input.u8()) + 1);
    let bytes = input.rest();
    if kind % 3 == 2 {
        return within(ANIMATIONS, bytes.len(), || animation(bytes));
    }
    within(PARTS, bytes.len(), || if kind % 3 == 0 { page(bytes, count) } else { directory(bytes, count) })
}

/// A record may repeat 5,375 bytes of the one before it in 6 bytes: two are in memory at once, and all are encoded again.
const PARTS: Ceiling =
    Ceiling { base_bytes: 4 << 20, bytes_per_byte: 64, base_steps: 1 << 20, steps_per_byte: 1 << 12 };

/// A model takes up to 64 times its bytes, and is evaluated and encoded again.
const ANIMATIONS: Ceiling =
    Ceiling { base_bytes: 1 << 18, bytes_per_byte: 512, base_steps: 1 << 20, steps_per_byte: 1 << 12 };

fn animation(bytes: &[u8]) -> bool {
    let Ok(model) = AnimatedModel::from_bytes(bytes) else { return false };
    assert_eq!(model.to_bytes().as_deref(), Ok(bytes), "an accepted model has one encoding");
    for clip in model.clips.first().into_iter().chain(model.clips.last()) {
        for time_s in [0.0, 0.4, model.duration_s(clip)] {
            let transforms = model.transforms_at(Some(clip), time_s);
            assert_eq!(transforms.len(), model.parts.len());
        }
    }
    true
}

fn page(bytes: &[u8], count: u32) -> bool {
    if check_page(bytes, count).is_err() {
        assert!(decode_record(bytes, count, 0).is_err(), "a page is refused whichever record is read");
        return false;
    }
    // Few of many: each reads the whole page.
    let some = [0, 1, count / 2, count - 1].map(|number| number.min(count - 1));
    let records = some.map(|number| decode_record(bytes, count, number).expect("the page was checked"));
    let records = records.map(|record| record.expect("the page has the record"));
    let again = encode_page(&records).expect("accepted records are encoded");
    for (number, record) in (0..).zip(&records) {
        assert_eq!(decode_record(&again, 4, number).as_ref(), Ok(&Some(record.clone())));
    }
    assert_eq!(decode_record(bytes, count, count), Ok(None));
    true
}

fn directory(bytes: &[u8], count: u32) -> bool {
    let Ok(runs) = decode_directory(bytes, count, 1000) else { return false };
    for instance in 0..count {
        let records = records_of(&runs, instance).expect("every instance has records");
        assert!(records.start < records.end && records.end <= 1000, "{records:?}");
    }
    assert_eq!(records_of(&runs, count), None);
    true
}
