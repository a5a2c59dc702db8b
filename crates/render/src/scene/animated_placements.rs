//! Placements of assets of which a clip moves some.

use std::borrow::Cow;
use std::collections::BTreeMap;

use lodestream_scene::placement::Placement;

/// The placements of all assets, with those that are moved, by asset number.
pub(crate) fn all<'a>(
    placed: &'a [Vec<Placement>],
    animated: &BTreeMap<u32, Vec<Placement>>,
) -> Cow<'a, [Vec<Placement>]> {
    if animated.is_empty() {
        return Cow::Borrowed(placed);
    }
    let own = |(number, placed): (u32, &Vec<Placement>)| animated.get(&number).unwrap_or(placed).clone();
    Cow::Owned((0..).zip(placed).map(own).collect())
}
