// Relaxed cone stepping, then bisection (Policarpo and Oliveira, "Relaxed cone stepping for relief mapping", GPU Gems
// 3, 2007). CPU reference: cpu_reference/relief/cones.rs.

// Per texel, the radius of its cone over the height above it, in texture widths per depth.
@group(3) @binding(0) var relief_cones: texture_2d<f32>;

// Largest step along the surface in texture widths: cones beyond were not searched.
const RELIEF_CONE_WINDOW: f32 = 0.25;

fn relief_cone_at(texel: vec2<i32>, size: vec2<i32>) -> f32 {
    return textureLoad(relief_cones, (texel % size + size) % size, 0).r;
}

// The narrowest of the four surrounding cones. Interpolated, the wide cones on top of a wall would let rays beside it
// jump over obstacles.
fn relief_cone(uv: vec2<f32>) -> f32 {
    let size = vec2<i32>(textureDimensions(relief_cones));
    let texel = vec2<i32>(floor(fract(uv) * vec2<f32>(size) - 0.5));
    let top = min(relief_cone_at(texel, size), relief_cone_at(texel + vec2(1, 0), size));
    return min(top, min(relief_cone_at(texel + vec2(0, 1), size), relief_cone_at(texel + vec2(1, 1), size)));
}

fn relief_found(start: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32) -> f32 {
    if (lod >= RELIEF_FINEST) {
        return relief_trace(start, span, lod, steps);
    }
    let way = length(span);
    var before = 0.0;
    var at = 0.0;
    for (var i = 0.0; i < steps; i += 1.0) {
        let place = start + span * at;
        let over = 1.0 - relief_height(place, 0.0) - at;
        if (over <= 0.0 || at >= 1.0) {
            break;
        }
        before = at;
        let cone = relief_cone(place);
        let step = cone * over / (way + cone);
        at = min(at + min(step, RELIEF_CONE_WINDOW / max(way, 1e-30)), 1.0);
    }
    return relief_halved(start, span, 0.0, before, at);
}
