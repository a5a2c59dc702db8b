// Relief mapping: intersection of the view ray with a height field below the surface. relief_trace() and
// relief_intersection() are in relief_bisection.wgsl or, with all methods, in relief_methods.wgsl; relief_found() is in a
// file for each acceleration texture and one for none (Settings::relief_method). CPU references:
// cpu_reference/relief/mod.rs, methods.rs.

// Share of the grazing angle's linear steps that head-on views take; bisections after them.
const RELIEF_STEPS_DOWN: f32 = 0.25;
const RELIEF_HALVINGS: i32 = 8;
// Largest distance along the surface that a ray is followed, in depths: as at 63° to the normal. Without a bound, the
// relief would slide along the surface by its depth times the tangent while its edges stay in place, and bricks would
// swim at corners.
const RELIEF_MOST_SHIFT: f32 = 2.0;

// Bit of frame.flags: self-shadowing.
const RELIEF_SHADOWS: u32 = 16u;
// Shadow bias in depths: the ray may begin this far below the surface between two texels.
const RELIEF_SHADOW_BIAS: f32 = 0.02;
// Least sine of the sun's elevation over the surface; lower elevations are clamped.
const RELIEF_LOWEST_SUN: f32 = 0.1;

struct ReliefHit {
    uv: vec2<f32>,
    normal: vec3<f32>,
    sunlit: bool,
    sunk: vec3<f32>, // from the surface's own place, world axes
}

fn relief_height(uv: vec2<f32>, lod: f32) -> f32 {
    return textureSampleLevel(height_map, map_sampler, uv, lod).r;
}

// Bisection between a position above and one below the surface.
fn relief_halved(start: vec2<f32>, span: vec2<f32>, lod: f32, over: f32, under: f32) -> f32 {
    var above = over;
    var below = under;
    for (var i = 0; i < RELIEF_HALVINGS; i++) {
        let middle = 0.5 * (above + below);
        if (middle >= 1.0 - relief_height(start + span * middle, lod)) {
            below = middle;
        } else {
            above = middle;
        }
    }
    return 0.5 * (above + below);
}

// The last step of a linear search.
struct ReliefStep {
    below: f32, // where it ends, as a fraction of the way
    before: f32, // clearance in depths where it starts
    now: f32, // and where it ends
}

// Linear search from `start` (surface) to `start + span` (full depth), up to the first position below the surface.
fn relief_steps(start: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32) -> ReliefStep {
    let step = 1.0 / steps;
    var last = ReliefStep(step, 1.0, 1.0 - relief_height(start + span * step, lod) - step);
    for (var i = 1.0; i < steps; i += 1.0) {
        if (last.now <= 0.0) {
            break;
        }
        last.before = last.now;
        last.below = (i + 1.0) * step;
        last.now = 1.0 - relief_height(start + span * last.below, lod) - last.below;
    }
    return last;
}

// Whether the sun reaches the height field at a position. The sun's ray reaches the surface after `climb` times the
// position's depth.
fn relief_sunlit(place: vec2<f32>, climb: vec2<f32>, lod: f32, steps: f32) -> bool {
    let below = 1.0 - relief_height(place, lod);
    for (var i = 1.0; i < steps; i += 1.0) {
        let risen = below * (i / steps);
        if (relief_height(place + climb * risen, lod) > 1.0 - below + risen + RELIEF_SHADOW_BIAS) {
            return false;
        }
    }
    return true;
}

// Linear steps for a cosine between a ray and the normal.
fn relief_step_count(cosine: f32) -> f32 {
    return ceil(mix(frame.relief_steps, frame.relief_steps * RELIEF_STEPS_DOWN, cosine));
}

fn relief(
    uv: vec2<f32>, normal: vec3<f32>, view: vec3<f32>, view_length: f32, along: Gradients,
    duv_dx: vec2<f32>, duv_dy: vec2<f32>,
) -> ReliefHit {
    var hit = ReliefHit(uv, normal, true, vec3(0.0));
    let cosine = -dot(view, normal);
    if (cosine <= 0.0 || !along.exist) {
        return hit;
    }
    let grad_u = along.u;
    let grad_v = along.v;

    // Depth in world units. A relief thinner than half a pixel is omitted; it fades in up to one pixel.
    let density = sqrt(length(grad_u) * length(grad_v)); // texture widths per world unit
    let full_depth = material.relief_depth / max(density, 1e-30);
    let depth = full_depth * smoothstep(0.5, 1.0, full_depth * frame.scale_px / view_length);
    if (depth <= 0.0) {
        return hit;
    }

    let size = vec2<f32>(textureDimensions(height_map));
    let rho = max(length(duv_dx * size), length(duv_dy * size));
    let lod = max(log2(max(rho, 1e-6)), 0.0);

    // The ray reaches full depth after depth / cosine.
    let sine = sqrt(max(1.0 - cosine * cosine, 0.0));
    let reach = depth * min(1.0 / max(cosine, 1e-4), RELIEF_MOST_SHIFT / max(sine, 1e-4));
    let span = vec2(dot(grad_u, view), dot(grad_v, view)) * reach;
    let steps = relief_step_count(cosine);
    let hit_at = relief_intersection(uv, span, lod, steps, vec2(depth, reach));
    let below = hit_at.x; // in depths
    hit.uv = uv + span * hit_at.y;
    // Along the ray, but where that is followed less far along the surface.
    hit.sunk = (view + normal * cosine) * (reach * below) - normal * (depth * below);

    // Surface n·depth·(height − 1): its normal from central differences over one texel of that lod.
    let texel = exp2(lod) / size;
    let dh_du = relief_height(hit.uv + vec2(texel.x, 0.0), lod) - relief_height(hit.uv - vec2(texel.x, 0.0), lod);
    let dh_dv = relief_height(hit.uv + vec2(0.0, texel.y), lod) - relief_height(hit.uv - vec2(0.0, texel.y), lod);
    let slope = grad_u * (dh_du / (2.0 * texel.x)) + grad_v * (dh_dv / (2.0 * texel.y));
    hit.normal = normalize(normal - depth * slope);

    if ((frame.flags & RELIEF_SHADOWS) != 0u) {
        let sun = frame.to_sun.xyz;
        let up = dot(sun, normal);
        let climb = vec2(dot(grad_u, sun), dot(grad_v, sun)) * (depth / max(up, RELIEF_LOWEST_SUN));
        hit.sunlit = up > 0.0 && relief_sunlit(hit.uv, climb, lod, relief_step_count(up));
    }
    return hit;
}
