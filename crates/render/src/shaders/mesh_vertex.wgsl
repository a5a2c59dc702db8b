// Vertex stage of flat meshes.

struct VertexIn {
    @location(0) position: vec3<f32>,
    @location(1) birth_s: f32,
    @location(2) morph_from: vec3<f32>,
    @location(3) level: u32,
    @location(4) uv: vec2<f32>,
    @location(5) normal: vec4<f32>,
    @location(6) colour: vec4<f32>, // sRGB-encoded
    @location(7) offset_scale: vec4<f32>,
    @location(8) rotation: vec4<f32>,
}

// Position of a vertex now, world axes, relative to the eye.
fn placed(v: VertexIn) -> vec3<f32> {
    let local = mix(v.morph_from, v.position, morph_weight(frame.time_s - v.birth_s));
    return in_world(local, v.offset_scale, v.rotation);
}

@vertex
fn vs_surface(v: VertexIn) -> Surface {
    var out: Surface;
    out.position = placed(v);
    out.clip = clip_position(out.position);
    out.normal = rotate(v.rotation, v.normal.xyz);
    out.uv = vec2(v.uv.x, 1.0 - v.uv.y);
    out.level = v.level;
    out.colour = vec4(linear_from_srgb(v.colour.rgb), v.colour.a);
    return out;
}

// Shadow caster: `frame` then holds the sun's view.
@vertex
fn vs_caster(v: VertexIn) -> @builtin(position) vec4<f32> {
    return clip_position(placed(v));
}

@vertex
fn vs_pierced(v: VertexIn) -> Pierced {
    return Pierced(clip_position(placed(v)), vec2(v.uv.x, 1.0 - v.uv.y), v.colour.a);
}

// Edges, counted. Moved towards the eye by two thousandths of their depth, which keeps them in
// front of the faces they belong to.
@vertex
fn vs_wire(v: VertexIn) -> @builtin(position) vec4<f32> {
    var clip = clip_position(placed(v));
    clip.z *= 1.002;
    return clip;
}
