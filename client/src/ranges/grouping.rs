//! Groups neighbours into one request: a request costs a round trip and some hundred bytes, and a server answers only
//! some at once.

use std::ops::Range;

use lodestream_scene::published::Segment;
use lodestream_select::Priority;

use super::directory::Item;
use super::session::Object;

/// Bounds on requests.
#[derive(Clone, Copy, Debug)]
pub struct RangeSettings {
    /// Most requests at once. Browsers and servers allow six connections of HTTP/1.1; more bring nothing on a slow link.
    pub max_requests: usize,
    /// Most bytes between two items of a request: they are fetched and thrown away, and cost less than a request.
    pub gap_bytes: u64,
    /// Least and greatest length of a request, unless one item alone is longer. Between them, a request takes about a
    /// third of what should be in flight: shorter ones follow the view sooner, longer ones are fewer.
    pub request_bytes: [u64; 2],
    /// How much less urgent a neighbour may be, as a priority ([`lodestream_select::priority`]: 2²³ is a factor of two).
    pub priority_span: Priority,
}

impl Default for RangeSettings {
    fn default() -> Self {
        Self { max_requests: 6, gap_bytes: 512, request_bytes: [8 << 10, 256 << 10], priority_span: 4 << 23 }
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
/// bounds the range. Takes the candidates of the group out of the list.
pub(super) fn take_group(
    candidates: &mut Vec<Candidate>,
    length: u64,
    settings: &RangeSettings,
) -> Option<(Vec<Candidate>, Range<u64>)> {
    let first = candidates.iter().max_by_key(|one| (one.priority, std::cmp::Reverse(one.item)))?;
    let (object, reload) = (first.object.clone(), first.reload);
    let least = first.priority.saturating_sub(settings.priority_span);
    let mut range = first.range.clone();
    let mut near: Vec<usize> = (0..candidates.len())
        .filter(|&at| {
            let one = &candidates[at];
            one.object == object && one.priority >= least && one.reload == reload
        })
        .collect();
    near.sort_unstable_by_key(|&at| candidates[at].range.start);
    let middle = near.iter().position(|&at| candidates[at].range == range)?;
    let (mut low, mut high) = (middle, middle);
    let joins = |range: &Range<u64>, next: &Range<u64>| {
        let (start, end) = (range.start.min(next.start), range.end.max(next.end));
        let gap = next.start.saturating_sub(range.end).max(range.start.saturating_sub(next.end));
        (gap <= settings.gap_bytes && end - start <= length.max(range.end - range.start))
            .then_some(start..end)
    };
    loop {
        // Blobs of finer levels follow in a pack, so what lies behind is taken first.
        if let Some(&at) = near.get(high + 1)
            && let Some(wider) = joins(&range, &candidates[at].range)
        {
            (range, high) = (wider, high + 1);
        } else if let Some(before) = low.checked_sub(1)
            && let Some(wider) = joins(&range, &candidates[near[before]].range)
        {
            (range, low) = (wider, before);
        } else {
            break;
        }
    }
    let mut taken = near[low..=high].to_vec();
    let group = taken.iter().map(|&at| candidates[at].clone()).collect();
    taken.sort_unstable();
    for at in taken.into_iter().rev() {
        candidates.swap_remove(at);
    }
    Some((group, range))
}
