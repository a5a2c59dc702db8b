// Shared by all passes: the frame's uniform block and small helpers.
// Conventions: positions are relative to the eye; view space has x right, y up and looks along -z;
// depth is reversed (near / view depth), 0 where there is no surface.

struct Frame {
    clip_from_view: mat4x4<f32>,
    view_from_world: mat4x4<f32>, // rotation only
    to_sun: vec4<f32>, // w: factor on tolerances that are shares of the depth, 1 but in parallel projection
    sun: vec4<f32>, // w: extinction of green light by water per world unit
    up: vec4<f32>, // w: height of the eye over water, 0 where there is none; both only where frames are added up
    sky_side: vec4<f32>, // across up, towards where the sun stands; w: extinction by haze per world unit
    sun_disc: vec4<f32>, // radiance; w: angular radius
    before: mat4x4<f32>, // to clip space of the frame before, without jitter, from places relative to this frame's eye
    irradiance: array<vec4<f32>, 9>, // see ambient() in sky.wgsl
    sections: array<vec4<f32>, 3>, // what lies where dot(xyz, place) > w is cut away; (0, 0, 0, 1): none
    background: vec4<f32>, // radiance that is shown in place of the sky where w is 1
    size_px: vec2<f32>,
    tan_half_fov: vec2<f32>,
    near: f32,
    time_s: f32,
    morph_s: f32,
    exposure: f32,
    occlusion_radius_world: f32,
    occlusion_radius_depth: f32,
    occlusion_strength: f32,
    scale_px: f32, // pixels per world unit at depth 1
    shade: u32,
    occlusion_samples: u32,
    relief_steps: f32, // linear steps at grazing angles
    target_px: u32, // width, and height shifted by 16 bits, of what is shown: more than size_px where that is enlarged
    tone_mapping: u32,
    dither: f32, // of display values
    jitter: vec2<f32>, // where in its pixels this frame looks, off their centres, pixels
    before_s: f32, // time_s of the frame before
    history: f32, // frames that what earlier ones showed counts for at most; 0: there is nothing
    flags: u32, // 1: nothing has changed since the frame before; 2: surfaces give off light; 4, 8: way of relief mapping
    // (relief_methods.wgsl); 16: relief hides the sun; 32: tiled textures show their nearest level alone; from bit 8 on, four bits: by how much occlusion's rotations are turned; from bit 12 on: this frame's
    // number in its mean, 0 alone
    lookups: f32, // of a texture along a footprint; negative where samplers do that, but for tiled textures
    kernel: array<vec4<f32>, 64>, // as many as there are samples; w: what each counts
}

@group(0) @binding(0) var<uniform> frame: Frame;

const PI: f32 = 3.14159265;

// Most that a picture of radiance holds, 16-bit floating point.
const MAX_RADIANCE: f32 = 65504.0;

// What an edge of a triangle adds to the count of a pixel that it crosses.
const EDGE: f32 = 0.0625;

// Share of their depth by which edges are drawn before their faces.
const WIRE_AHEAD: f32 = 0.002;

// View depth where nothing was drawn.
const FAR: f32 = 1e30;

// Position on the image plane at depth 1 of a pixel's centre, or wherever in it this frame looks, view space.
fn view_ray(pixel: vec2<i32>) -> vec3<f32> {
    let uv = (vec2<f32>(pixel) + 0.5 + frame.jitter) / frame.size_px;
    let ndc = vec2(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0);
    return vec3(ndc * frame.tan_half_fov, -1.0);
}

// View depth from stored depth.
fn view_depth(stored: f32) -> f32 {
    return select(FAR, frame.near / stored, stored > 0.0);
}

// v turned by the unit quaternion q (x y z w).
fn rotate(q: vec4<f32>, v: vec3<f32>) -> vec3<f32> {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}

// Colours that tell levels apart: steps of the golden angle round the hue circle.
fn level_colour(level: u32) -> vec3<f32> {
    let hue = fract(f32(level) * 0.61803399 + 0.02) * 6.0;
    let rgb = clamp(vec3(abs(hue - 3.0) - 1.0, 2.0 - abs(hue - 2.0), 2.0 - abs(hue - 4.0)), vec3(0.0), vec3(1.0));
    return 0.15 + 0.65 * rgb;
}

// Decoding curve of sRGB (IEC 61966-2-1).
fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    return select(pow((c + 0.055) / 1.055, vec3(2.4)), c / 12.92, c <= vec3(0.04045));
}

// A direction on the square -1..1, as on an octahedron that is unfolded (Cigolle et al., "A survey of efficient
// representations for independent unit vectors", 2014).
fn octahedral(n: vec3<f32>) -> vec2<f32> {
    let p = n.xy / (abs(n.x) + abs(n.y) + abs(n.z));
    let folded = (1.0 - abs(p.yx)) * select(vec2(-1.0), vec2(1.0), p >= vec2(0.0));
    return select(folded, p, n.z >= 0.0);
}

fn from_octahedral(p: vec2<f32>) -> vec3<f32> {
    let z = 1.0 - abs(p.x) - abs(p.y);
    let folded = (1.0 - abs(p.yx)) * select(vec2(-1.0), vec2(1.0), p >= vec2(0.0));
    return normalize(vec3(select(folded, p, z >= 0.0), z));
}
