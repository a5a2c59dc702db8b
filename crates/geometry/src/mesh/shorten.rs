//! Lists that give up memory as they become shorter.

/// Capacity that a list may have beyond twice its length.
const SPARE: usize = 256;

/// Shortens a list. A list that uses less than half of its memory keeps a quarter of reserve: by then as many elements
/// have gone as are copied.
pub(crate) fn shorten<T>(list: &mut Vec<T>, len: usize) {
    list.truncate(len);
    if list.capacity() > 2 * list.len() + SPARE {
        list.shrink_to(list.len() + list.len() / 4);
    }
}
