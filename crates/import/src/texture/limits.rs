//! Limits on the size of a texture.

/// Longest side of a texture, in pixels.
pub const MAX_SIDE_PX: u32 = 16_384;
/// Most pixels of a texture: its finest level takes 8 bytes each while mips are made.
pub const MAX_PIXELS: u64 = 1 << 26;
