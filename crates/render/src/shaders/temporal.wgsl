// Temporal anti-aliasing: each frame samples another point of its pixels, and the history is reprojected (Karis,
// "High-quality temporal supersampling", 2014; Salvi, "An excursion in temporal supersampling", 2016). CPU reference:
// cpu_reference/temporal.rs.

// Whether objects move.
override MOTION: bool = false;

@group(0) @binding(1) var radiance_map: texture_2d<f32>;
@group(0) @binding(2) var depth_map: texture_2d<f32>;
@group(0) @binding(3) var motion_map: texture_2d<f32>;
// Weighted colours and their number of frames.
@group(0) @binding(4) var history_map: texture_2d<f32>;
@group(0) @binding(5) var history_sampler: sampler;

// Allowed distance of the history from the neighbourhood's mean, in standard deviations.
const DEVIATIONS: f32 = 1.0;
// Share of its depth by which one surface is nearer than another to count as in front of it.
const BEFORE: f32 = 0.1;
// Reduction of the history's weight per pixel of motion: fast objects need less sharpness, and contours of round
// objects do not move with their surface.
const HASTE: f32 = 0.4;
// Motion below this is rounding, in pixels.
const LEAST_MOTION: f32 = 0.01;

// Bits of an infinite floating-point number without its sign; above are NaNs. Bit tests, because compilers may assume
// that there are no NaNs.
const INFINITE: u32 = 0x7f800000u;
const WITHOUT_SIGN: u32 = 0x7fffffffu;

// Brightness weight, so that one highlight does not outweigh all other samples of its pixel; and 1 or 0 for whether
// the sample is a number. Infinity counts as the largest brightness.
fn weighed(radiance: vec3<f32>) -> vec4<f32> {
    let exposed = radiance * frame.exposure;
    if (any((bitcast<vec3<u32>>(exposed) & vec3(WITHOUT_SIGN)) > vec3(INFINITE))) {
        return vec4(0.0);
    }
    let x = clamp(exposed, vec3(0.0), vec3(MAX_RADIANCE));
    return vec4(x / (1.0 + max(x.r, max(x.g, x.b))), 1.0);
}

// A history sample, or black without weight if it is not finite: a NaN would persist and spread.
fn finite(history: vec4<f32>) -> vec4<f32> {
    let bits = bitcast<vec4<u32>>(history) & vec4(WITHOUT_SIGN);
    return select(history, vec4(0.0), any(bits >= vec4(INFINITE)));
}

fn luma_chroma(c: vec3<f32>) -> vec3<f32> {
    return vec3(0.25 * c.r + 0.5 * c.g + 0.25 * c.b, 0.5 * (c.r - c.b), 0.5 * c.g - 0.25 * (c.r + c.b));
}

fn from_luma_chroma(c: vec3<f32>) -> vec3<f32> {
    let t = c.x - c.z;
    return vec3(t + c.y, c.x + c.z, t - c.y);
}

// Catmull and Rom's cubic through the history's texels, of nine bilinear lookups the five that weigh most (Jimenez,
// "Filmic SMAA", 2016).
fn history_at(place: vec2<f32>) -> vec4<f32> {
    let size = frame.size_px;
    let centre = floor(place - 0.5) + 0.5;
    let f = place - centre;
    let w0 = f * (-0.5 + f * (1.0 - 0.5 * f));
    let w1 = 1.0 + f * f * (-2.5 + 1.5 * f);
    let w2 = f * (0.5 + f * (2.0 - 1.5 * f));
    let w3 = f * f * (-0.5 + 0.5 * f);
    let w12 = w1 + w2;
    let at0 = (centre - 1.0) / size;
    let at12 = (centre + w2 / w12) / size;
    let at3 = (centre + 2.0) / size;
    var sum = vec4(0.0);
    var weight = 0.0;
    let places = array<vec2<f32>, 5>(at12, vec2(at12.x, at0.y), vec2(at0.x, at12.y), vec2(at3.x, at12.y), vec2(at12.x, at3.y));
    let weights = array<f32, 5>(w12.x * w12.y, w12.x * w0.y, w0.x * w12.y, w3.x * w12.y, w12.x * w3.y);
    for (var i = 0; i < 5; i++) {
        sum += textureSampleLevel(history_map, history_sampler, places[i], 0.0) * weights[i];
        weight += weights[i];
    }
    return max(finite(sum / weight), vec4(0.0));
}

// Share of a pixel's light that comes from its depth: under water, the transmitted share. Reflections and scattering
// in water move neither with its bed nor with its surface.
fn share_at_depth(pixel: vec2<i32>, stored: f32) -> f32 {
    let ray = (transpose(frame.view_from_world) * vec4(view_ray(pixel), 0.0)).xyz;
    let len = length(ray);
    let cosine = -ray.y / len;
    if (frame.up.w <= 0.0 || cosine <= 0.0) {
        return 1.0;
    }
    let along = frame.up.w / -ray.y;
    let below = (view_depth(stored) - along) * len;
    if (!(along >= frame.near && below > 0.0)) {
        return 1.0;
    }
    // As in water.wgsl, but that its surface is flat (Schlick 1994).
    let mirrored = 0.0204 + 0.9796 * pow(1.0 - min(cosine, 1.0), 5.0);
    return (1.0 - mirrored) * exp(-min(frame.sun.w * below * (1.0 + cosine), 80.0));
}

@fragment
fn fs_temporal(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let pixel = vec2<i32>(at.xy);
    let last = vec2<i32>(frame.size_px) - 1;
    let own = weighed(textureLoad(radiance_map, pixel, 0).rgb);
    if (frame.history <= 0.0) {
        return own;
    }
    if ((frame.flags & 1u) != 0u) {
        // A still picture: plain mean.
        let before = finite(textureLoad(history_map, pixel, 0));
        let count = min(before.a, frame.history);
        return vec4(mix(before.rgb, own.rgb, own.a / (count + 1.0)), count + own.a);
    }

    // Neighbourhood statistics, and the motion to use: that of the nearest surface around, so that edges move with
    // their object; of it the farthest pixel, which is its contour.
    var sum = vec3(0.0);
    var squares = vec3(0.0);
    var counted = 0.0;
    var nearest = pixel;
    let least = textureLoad(depth_map, pixel, 0).x * (1.0 + BEFORE * frame.to_sun.w);
    var depth = 1e30;
    for (var y = -1; y <= 1; y++) {
        for (var x = -1; x <= 1; x++) {
            let there = clamp(pixel + vec2(x, y), vec2(0), last);
            let seen = weighed(textureLoad(radiance_map, there, 0).rgb);
            let colour = luma_chroma(seen.rgb);
            sum += colour;
            squares += colour * colour;
            counted += seen.a;
            let stored = textureLoad(depth_map, there, 0).x;
            if (stored > least && stored < depth) {
                depth = stored;
                nearest = there;
            }
        }
    }
    depth = textureLoad(depth_map, nearest, 0).x;
    var motion = motion_of_camera(nearest, depth);
    if (MOTION) {
        let by_itself = textureLoad(motion_map, nearest, 0).xy;
        motion = select(motion, by_itself, by_itself.x < STANDS);
    }
    motion = select(motion, vec2(0.0), abs(motion) < vec2(LEAST_MOTION));
    let place = at.xy + motion;
    // Written so that NaN is not inside.
    if (!(all(place >= vec2(0.0)) && all(place <= frame.size_px))) {
        return own;
    }
    let before = history_at(place);

    // Clips the history towards the neighbourhood's mean.
    counted = max(counted, 1.0);
    let mean = sum / counted;
    let reach = DEVIATIONS * sqrt(max(squares / counted - mean * mean, vec3(0.0))) + 1e-4;
    let off = luma_chroma(before.rgb) - mean;
    let beyond = max(abs(off.x) / reach.x, max(abs(off.y) / reach.y, abs(off.z) / reach.z));
    let history = from_luma_chroma(mean + off / max(beyond, 1.0));
    let counted_for = frame.history * share_at_depth(nearest, depth) / (1.0 + HASTE * length(motion));
    let count = min(before.a, counted_for);
    return vec4(max(mix(history, own.rgb, own.a / (count + 1.0)), vec3(0.0)), count + own.a);
}
