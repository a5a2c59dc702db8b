//! What the parts of a scene are called: pages of records, and their directory.

use lodestream_scene::parts::{check_page, decode_directory, decode_record, encode_page, records_of};

use crate::input::Input;
use crate::meter::{Ceiling, within};

/// The first byte selects the format, the second the number of entries: a page of records or a page of their directory,
/// in a scene of 1000 records. Accepted records survive encoding and decoding.
pub fn parts(data: &[u8]) -> bool {
    let mut input = Input::new(data);
    let (kind, count) = (input.u8(), u32::from(input.u8()) + 1);
    let bytes = input.rest();
    within(PARTS, bytes.len(), || if kind % 2 == 0 { page(bytes, count) } else { directory(bytes, count) })
}

/// A record may repeat 5,375 bytes of the one before it in 6 bytes: two are in memory at once, and all are encoded again.
const PARTS: Ceiling =
    Ceiling { base_bytes: 4 << 20, bytes_per_byte: 64, base_steps: 1 << 20, steps_per_byte: 1 << 12 };

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
