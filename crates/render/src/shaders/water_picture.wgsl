// Water with screen-space reflections, and the sky where they find nothing.

@group(1) @binding(2) var lit_map: texture_2d<f32>;
@group(1) @binding(3) var pyramid: texture_2d<f32>;
@group(1) @binding(4) var<uniform> tracing: Tracing;

fn mirrored_at(s: Surface, direction: vec3<f32>, sky: vec3<f32>) -> vec3<f32> {
    let place = (frame.view_from_world * vec4(s.position, 0.0)).xyz;
    let level = (frame.view_from_world * vec4(0.0, 1.0, 0.0, 0.0)).xyz;
    let met = trace(place, level, (frame.view_from_world * vec4(direction, 0.0)).xyz);
    if (met.share <= 0.0) {
        return sky;
    }
    return mix(sky, textureLoad(lit_map, met.pixel, 0).rgb, met.share * mirrors(s.roughness));
}
