// Settings of ink.

struct Ink {
    half_width: f32, // pixels
    blur: i32, // pixels to each side
    levels: f32, // of light; 0: as it is
    spatter: f32, // levels
    // The eye in cells of 2^(i - 32) world units, within 256 of them.
    eye: array<vec4<f32>, 64>,
}
