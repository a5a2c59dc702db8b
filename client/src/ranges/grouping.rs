//! Groups neighbours into one request: a request costs a round trip and some hundred bytes, and a server answers only
//! some at once.

use std::ops::Range;

use lodestream_select::Priority;
use lodestream_select::priority::is_hidden;

use super::directory::{Item, Segment};
use super::request::Object;

/// Bounds on requests.
#[derive(Clone, Copy, Debug)]
pub struct RangeSettings {
    /// Most requests at once. Browsers and servers allow six connections of HTTP/1.1; more bring nothing on a slow link.
    pub max_requests: usize,
    /// Least and most bytes between two items of a request, which are fetched and thrown away. Between them, a share of
    /// what the link carries in a round trip.
    pub gap_bytes: [u64; 2],
    /// Least and greatest length of a request, unless one item alone is longer. Between them, a request takes its share
    /// of what should be in flight: shorter ones follow the view sooner, longer ones are fewer.
    pub request_bytes: [u64; 2],
    /// How much less urgent a neighbour may be, as a priority ([`lodestream_select::priority`]: 2²³ is a factor of two).
    pub priority_span: Priority,
}

impl Default for RangeSettings {
    fn default() -> Self {
        Self {
            max_requests: 6,
            gap_bytes: [128, 4 << 10],
            request_bytes: [8 << 10, 256 << 10],
            priority_span: 4 << 23,
        }
    }
}

/// An item that can be requested: what of it is missing.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    pub(super) item: Item,
    pub(super) priority: Priority,
    pub(super) object: Object,
    /// Missing bytes in the object.
    pub(super) range: Range<u64>,
    /// Runs to check: those that the range covers.
    pub(super) segments: Vec<Segment>,
    pub(super) reload: bool,
}

/// The most urgent candidate with its neighbours, in the order of the object, and the range that covers them. `length`
/// bounds the range, unless the first candidate alone is longer.
pub(super) fn group(
    candidates: &[Candidate],
    length: u64,
    gap_bytes: u64,
    settings: &RangeSettings,
) -> Option<(Vec<Candidate>, Range<u64>)> {
    let first = candidates.iter().max_by_key(|one| (one.priority, std::cmp::Reverse(one.item)))?;
    let mut near: Vec<&Candidate> =
        candidates.iter().filter(|one| one.object == first.object && one.reload == first.reload).collect();
    near.sort_unstable_by_key(|one| (one.range.start, one.item));
    // Hidden parts come last even as neighbours.
    let hidden = is_hidden(first.priority);
    let urgent = first.priority.saturating_sub(settings.priority_span);
    let (mut found, mut range) = grow(first, &near, length, gap_bytes, |one| one.priority >= urgent);
    if range.end - range.start < length / 2 {
        // A short request wastes its place among few: less urgent neighbours fill it.
        (found, range) = grow(first, &near, length, gap_bytes, |one| hidden || !is_hidden(one.priority));
    }
    Some((found, range))
}

/// Takes neighbours of the first candidate, as long as `is_taken` and gap and length allow it. `near` is in the order of
/// the object.
fn grow(
    first: &Candidate,
    near: &[&Candidate],
    length: u64,
    gap_bytes: u64,
    is_taken: impl Fn(&Candidate) -> bool,
) -> (Vec<Candidate>, Range<u64>) {
    let near: Vec<&Candidate> =
        near.iter().copied().filter(|one| one.item == first.item || is_taken(one)).collect();
    let middle = near.iter().position(|one| one.item == first.item).unwrap_or(0);
    let (mut low, mut high, mut range) = (middle, middle, first.range.clone());
    let joined = |range: &Range<u64>, next: &Range<u64>| {
        let (start, end) = (range.start.min(next.start), range.end.max(next.end));
        let gap = next.start.saturating_sub(range.end).max(range.start.saturating_sub(next.end));
        (gap <= gap_bytes && end - start <= length.max(range.end - range.start)).then_some(start..end)
    };
    loop {
        // Finer chunks follow in a pack, so what lies behind is taken first.
        if let Some(wider) = near.get(high + 1).and_then(|one| joined(&range, &one.range)) {
            (range, high) = (wider, high + 1);
        } else if let Some(before) = low.checked_sub(1)
            && let Some(wider) = joined(&range, &near[before].range)
        {
            (range, low) = (wider, before);
        } else {
            break;
        }
    }
    (near[low..=high].iter().map(|one| (*one).clone()).collect(), range)
}

#[cfg(test)]
mod tests {
    use lodestream_scene::blob::BlobId;

    use super::*;

    fn candidate(chunk: u32, range: Range<u64>, benefit: f32) -> Candidate {
        Candidate {
            item: Item::Blob(BlobId::chunk(0, chunk)),
            priority: benefit.to_bits(),
            object: Object::Scene,
            range,
            segments: Vec::new(),
            reload: false,
        }
    }

    fn grouped(candidates: &[Candidate], length: u64, gap_bytes: u64) -> (Vec<u64>, Range<u64>) {
        let (group, range) = group(candidates, length, gap_bytes, &RangeSettings::default()).unwrap();
        (group.iter().map(|one| one.range.start).collect(), range)
    }

    #[test]
    fn the_most_urgent_takes_its_neighbours_over_short_gaps() {
        let list = [candidate(0, 0..100, 1.0), candidate(1, 150..200, 9.0), candidate(2, 400..500, 1.0)];
        assert_eq!(grouped(&list, 1000, 50), (vec![0, 150], 0..200));
        assert_eq!(grouped(&list, 1000, 200), (vec![0, 150, 400], 0..500));
        assert_eq!(grouped(&list, 150, 200), (vec![150], 150..200), "the range would be too long");
        assert_eq!(grouped(&list, 10, 200), (vec![150], 150..200), "one alone may be longer");
    }

    #[test]
    fn less_urgent_neighbours_only_fill_short_requests() {
        let list = [candidate(0, 0..400, 100.0), candidate(1, 400..800, 1.0)];
        assert_eq!(grouped(&list, 800, 0).0, [0]);
        assert_eq!(grouped(&list, 1000, 0).0, [0, 400]);
    }

    #[test]
    fn other_objects_and_hidden_parts_are_no_neighbours() {
        let pack = |mut one: Candidate| {
            one.object = Object::Pack([1; 32], 9999);
            one
        };
        let list = [
            candidate(0, 0..10, 9.0),
            pack(candidate(1, 10..20, 9.0)),
            candidate(2, 20..30, 1e-30),
            candidate(3, 30..40, 1e-31),
        ];
        assert_eq!(grouped(&list, 1000, 100).0, [0]);
        assert_eq!(grouped(&list[2..], 1000, 100).0, [20, 30], "hidden parts join one another");
    }
}
