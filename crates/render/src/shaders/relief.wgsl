// Relief mapping: intersection of the view ray with a height field below the surface. Linear then binary search
// (Policarpo, Oliveira, Comba, "Real-time relief mapping on arbitrary polygonal surfaces", 2005), a part of it, or
// relief_found() of another file with an acceleration texture (Settings::relief_method). CPU references:
// cpu_reference/relief/mod.rs, methods.rs.

// Share of the grazing angle's linear steps that head-on views take; bisections after them.
const RELIEF_STEPS_DOWN: f32 = 0.25;
const RELIEF_HALVINGS: i32 = 8;
// Largest distance along the surface that a ray is followed, in depths: as at 63° to the normal. Without a bound, the
// relief would slide along the surface by its depth times the tangent while its edges stay in place, and bricks would
// swim at corners.
const RELIEF_MOST_SHIFT: f32 = 2.0;

// Bits of frame.flags: search method.
const RELIEF_WAY_BIT: u32 = 2u;
const RELIEF_SECANT: u32 = 1u;
const RELIEF_STEEP: u32 = 2u;
const RELIEF_OFFSET: u32 = 3u;

// With more minification than this, in mip levels, linear steps replace a search with an acceleration texture, which
// exists for the finest level only: a ray crosses few texels then.
const RELIEF_FINEST: f32 = 0.5;

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

// Fraction of the way from `start` (surface) to `start + span` (full depth) at which the ray meets the height field.
fn relief_trace(start: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32) -> f32 {
    let way = frame.flags >> RELIEF_WAY_BIT & 3u;
    let step = 1.0 / steps;
    var below = step;
    // Clearance in depths at the last position above and the first below.
    var before = 1.0;
    var now = 1.0 - relief_height(start + span * below, lod) - below;
    for (var i = 1.0; i < steps; i += 1.0) {
        if (now <= 0.0) {
            break;
        }
        before = now;
        below = (i + 1.0) * step;
        now = 1.0 - relief_height(start + span * below, lod) - below;
    }
    if (way == RELIEF_STEEP || (way == RELIEF_SECANT && (now > 0.0 || before <= now))) {
        return below;
    }
    let above = below - step;
    if (way == RELIEF_SECANT) {
        return above + step * clamp(before / (before - now), 0.0, 1.0);
    }
    return relief_halved(start, span, lod, above, below);
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
    var below: f32; // in depths
    if ((frame.flags >> RELIEF_WAY_BIT & 3u) == RELIEF_OFFSET) {
        // Offset limiting: not divided by the cosine, so the shift is at most the depth.
        below = 1.0 - relief_height(uv, lod);
        hit.uv = uv + span * (below * depth / reach);
    } else {
        below = relief_found(uv, span, lod, steps);
        hit.uv = uv + span * below;
    }
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
