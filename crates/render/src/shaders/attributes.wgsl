// Attributes that few assets have (scene/attribute_table.rs), for vertices that have numbers of them.

@group(1) @binding(8) var attributes: texture_2d<u32>;

const ATTRIBUTES_WIDTH: u32 = 1024u;
// The number that is beside a vertex's level is that of its attributes, which include its part.
const NUMBERED: u32 = 0x80000000u;

struct Attributes {
    // Joints, a byte each, or the part where there are no weights. The part of skinned vertices is the first.
    joints: u32,
    weights: u32, // a byte each; 0: not skinned
    second_uv: vec2<f32>, // v down, as textures are stored
}

fn attributes_of(part_and_level: u32) -> Attributes {
    let number = (part_and_level & ~NUMBERED) >> 8u;
    var words = vec4(number, 0u, 0u, 0u);
    if ((part_and_level & NUMBERED) != 0u) {
        words = textureLoad(attributes, vec2(number % ATTRIBUTES_WIDTH, number / ATTRIBUTES_WIDTH), 0);
    }
    let uv = bitcast<vec2<f32>>(words.zw);
    return Attributes(words.x, words.y, vec2(uv.x, 1.0 - uv.y));
}
