//! Limits on the size of a texture.

/// Longest side of a texture, in pixels.
pub const MAX_SIDE_PX: u32 = 1 << 15;
/// Most pixels of a texture: a square of the longest side.
pub const MAX_PIXELS: u64 = 1 << 30;
/// Most pixels of heights, which are not cut into tiles, of maps that are combined from images of several sizes, and of
/// KTX2 and AVIF: all of them are in memory at once, several times up to 8 bytes each.
pub(super) const MAX_WHOLE_PIXELS: u64 = 1 << 26;
/// Most bytes of an image that is decoded as a whole: all but PNG, and PNG that is interlaced.
pub(super) const MAX_DECODED_BYTES: u64 = 1 << 30;
