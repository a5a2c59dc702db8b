// Water with a level surface: reflects the sky and transmits what lies below. CPU reference: cpu_reference/water.rs.

// Reflectance of water looking straight at it.
const WATER: f32 = 0.0204;
// Least microfacet roughness, squared.
const CALM: f32 = 4e-4;

struct Water {
    extinction: vec4<f32>, // per world unit of red, green and blue; w: height of the eye over the water, above 0
    scattered: vec4<f32>, // share of the light that deep water sends back
    // Wave vector along x and z in cycles per world unit, phase below the eye in cycles, steepest slope.
    waves: array<vec4<f32>, 12>,
}

@group(1) @binding(0) var<uniform> water: Water;
@group(1) @binding(1) var depth_map: texture_2d<f32>;

// Four triangles from the place below the eye to directions of the horizon, places whose fourth coordinate is 0.
@vertex
fn vs_water(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    let corner = index % 3u;
    let quarter = f32((index / 3u + corner + 3u) % 4u) * 0.5 * PI;
    let horizon = vec4(round(cos(quarter)), 0.0, round(sin(quarter)), 0.0);
    // Any multiple of (0, -height, 0, 1) is the same place.
    let place = select(horizon, vec4(0.0, -1.0, 0.0, 1.0 / water.extinction.w), corner == 0u);
    return frame.clip_from_view * vec4((frame.view_from_world * vec4(place.xyz, 0.0)).xyz, place.w);
}

struct Surface {
    position: vec3<f32>, // relative to the eye
    to_eye: vec3<f32>,
    normal: vec3<f32>,
    roughness: f32,
    mirrored: f32, // share of the sky that it mirrors
    left: vec3<f32>, // share of what is seen below that comes through water and surface
}

fn world(direction: vec3<f32>) -> vec3<f32> {
    return (transpose(frame.view_from_world) * vec4(direction, 0.0)).xyz;
}

fn surface_at(pixel: vec2<i32>) -> Surface {
    var s: Surface;
    let view = view_ray(pixel);
    let ray = world(view);
    let len = length(view);
    s.to_eye = -ray / len;
    let down = max(-ray.y, 1e-20);
    let along = min(water.extinction.w / down, 1e25);
    s.position = ray * along;

    // How far the place goes from pixel to pixel.
    let right = world(vec3(2.0 * frame.tan_half_fov.x / frame.size_px.x, 0.0, 0.0));
    let up = world(vec3(0.0, 2.0 * frame.tan_half_fov.y / frame.size_px.y, 0.0));
    let across = (right + ray * (right.y / down)).xz * along;
    let on = (up + ray * (up.y / down)).xz * along;
    var slope = vec2(0.0);
    var lost = CALM;
    for (var i = 0u; i < 12u; i++) {
        let wave = water.waves[i];
        // A Gaussian of half a pixel.
        let steps = vec2(dot(wave.xy, across), dot(wave.xy, on));
        let kept = exp(-min(4.9348022 * dot(steps, steps), 80.0));
        let cycles = fract(dot(wave.xy, s.position.xz) + wave.z);
        slope += normalize(wave.xy) * (wave.w * kept * cos(2.0 * PI * cycles));
        lost += 0.5 * wave.w * wave.w * (1.0 - kept * kept);
    }
    s.normal = normalize(vec3(-slope.x, 1.0, -slope.y));
    s.roughness = sqrt(sqrt(lost));
    let share = environment_brdf(clamp(dot(s.normal, s.to_eye), 1e-3, 1.0), s.roughness);
    s.mirrored = WATER * share.x + share.y;

    let below = max(view_depth(textureLoad(depth_map, pixel, 0).x) - along, 0.0) * len;
    // To what is seen, and from there up to the surface.
    let way = below * (1.0 + min(-ray.y / len, 1.0));
    s.left = (1.0 - s.mirrored) * exp(-min(water.extinction.rgb * way, vec3(80.0)));
    return s;
}

// Transmitted share of the picture.
@fragment
fn fs_water_left(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return vec4(surface_at(vec2<i32>(at.xy)).left, 1.0);
}

// Light added by the water.
@fragment
fn fs_water_added(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let s = surface_at(vec2<i32>(at.xy));
    let height = max(frame.to_sun.y, 0.0);
    var sun = vec3(0.0);
    if (height > 0.0) {
        sun = frame.sun.rgb * sunlight_at(s.position, vec3(0.0, 1.0, 0.0), height).x;
    }
    // As metals of this reflectance do: nothing of it goes into a base.
    let mirror = Reflector(vec3(WATER), 1.0, s.roughness, s.normal, s.to_eye, 1.0, USUAL_SPECULAR);
    // Ripples may point what they mirror below the horizon, where other ripples are.
    let away = reflect(-s.to_eye, s.normal);
    let up = vec3(away.x, abs(away.y), away.z);
    let sky = s.mirrored * mirrored_at(s, up, reflected(up, s.roughness));
    let light = ambient(vec3(0.0, 1.0, 0.0)) + sun * height;
    let sent_back = water.scattered.rgb * light * ((1.0 - s.mirrored) - s.left);
    let seen = from_light(mirror, frame.to_sun.xyz, sun) + sky + sent_back;
    // Haze of what is seen below was added with it already.
    let distance = length(s.position);
    let clear = select(1.0, exp(-min(frame.sky_side.w * distance, 80.0)), frame.sky_side.w > 0.0);
    let haze = (1.0 - s.left) * (1.0 - clear) * sky_without_sun(-s.to_eye);
    return vec4(min(seen * clear + haze, vec3(MAX_RADIANCE)), 0.0);
}
