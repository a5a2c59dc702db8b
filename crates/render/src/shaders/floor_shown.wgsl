// Darkens the background by the shadows on a studio's ground, by multiplication.

@group(0) @binding(3) var depth_map: texture_2d<f32>;
@group(0) @binding(4) var floor_picture: texture_2d<f32>;
@group(0) @binding(5) var floor_sampler: sampler;

// Share of the ground's light that comes from the key light, and from around.
const KEY: f32 = 0.42;
const AMBIENT: f32 = 0.58;

@fragment
fn fs_shown(on: OnFloor) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(on.position.xy);
    if (textureLoad(depth_map, pixel, 0).x > 0.0 || on.lowest <= 0.0) {
        return vec4(1.0);
    }
    let world = (transpose(frame.view_from_world) * vec4(view_ray(pixel), 0.0)).xyz;
    let axes = &studio.axes;
    let ray = vec3(dot(world, (*axes)[0].xyz), dot(world, (*axes)[1].xyz), dot(world, (*axes)[2].xyz));
    let eye = vec3((*axes)[0].w, (*axes)[1].w, (*axes)[2].w);
    let above = down_of(on.lowest) - eye.z;
    // Not seen from below, nor where rays do not meet it.
    if (above <= 0.0 || ray.z <= 0.0) {
        return vec4(1.0);
    }
    let at = eye.xy + ray.xy * (above / ray.z);
    let from_middle = (at - studio.picture.xy) / studio.picture.zw;
    if (!(max(abs(from_middle.x), abs(from_middle.y)) < 1.0)) {
        return vec4(1.0);
    }
    // Texels stand for their corners.
    let place = 0.5 + 0.5 * from_middle + 0.5 / vec2<f32>(textureDimensions(floor_picture));
    let light = textureSampleLevel(floor_picture, floor_sampler, place, 0.0).xy;
    return vec4(vec3(1.0 - KEY * (1.0 - light.x) - AMBIENT * (1.0 - light.y)), 1.0);
}
