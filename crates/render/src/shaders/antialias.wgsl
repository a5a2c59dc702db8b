// Edges smoothed in the finished picture: fast approximate anti-aliasing (Lottes, "FXAA", 2009; the search along edges
// of version 3.11, 2011). CPU reference: cpu_reference/antialias.rs.

// Whether the target applies the sRGB curve, so that it takes linear values.
override DECODE_SRGB: bool = false;

// As it is shown: sRGB-encoded, so that differences are about as large as they look.
@group(0) @binding(1) var display_map: texture_2d<f32>;

// Least contrast of an edge, of what is brightest there and at all.
const RELATIVE_CONTRAST: f32 = 0.125;
const LEAST_CONTRAST: f32 = 0.03;
// Share of the contrast at the edge from which on it is taken to end.
const END: f32 = 0.25;
// Texels that an edge is followed in each direction.
const STEPS: i32 = 12;
// By how much single bright or dark pixels are blurred.
const SUBPIXEL: f32 = 0.5;

fn shown(at: vec2<i32>) -> vec3<f32> {
    let last = vec2<i32>(frame.size_px) - 1;
    return textureLoad(display_map, clamp(at, vec2(0), last), 0).rgb;
}

fn luma(at: vec2<i32>) -> f32 {
    return dot(shown(at), vec3(0.299, 0.587, 0.114));
}

fn smoothed(at: vec2<i32>) -> vec3<f32> {
    let own = shown(at);
    let m = luma(at);
    let n = luma(at + vec2(0, -1));
    let s = luma(at + vec2(0, 1));
    let w = luma(at + vec2(-1, 0));
    let e = luma(at + vec2(1, 0));
    let most = max(m, max(max(n, s), max(w, e)));
    let contrast = most - min(m, min(min(n, s), min(w, e)));
    if (contrast < max(LEAST_CONTRAST, most * RELATIVE_CONTRAST)) {
        return own;
    }
    let nw = luma(at + vec2(-1, -1));
    let ne = luma(at + vec2(1, -1));
    let sw = luma(at + vec2(-1, 1));
    let se = luma(at + vec2(1, 1));

    // Which way the edge runs, by second differences across both axes.
    let across_rows = abs(nw - 2.0 * w + sw) + 2.0 * abs(n - 2.0 * m + s) + abs(ne - 2.0 * e + se);
    let across_columns = abs(nw - 2.0 * n + ne) + 2.0 * abs(w - 2.0 * m + e) + abs(sw - 2.0 * s + se);
    let horizontal = across_rows >= across_columns;

    // On which side of the pixel it lies.
    let before = select(w, n, horizontal);
    let after = select(e, s, horizontal);
    let is_before = abs(before - m) >= abs(after - m);
    let across = select(vec2(1, 0), vec2(0, 1), horizontal) * select(1, -1, is_before);
    let along = select(vec2(0, 1), vec2(1, 0), horizontal);
    let beyond = select(after, before, is_before);
    let middle = 0.5 * (m + beyond);
    let end = END * abs(beyond - m);

    // How far it goes on in both directions, and how it ends.
    var reach = vec2(STEPS, STEPS);
    var last = vec2(0.0, 0.0);
    for (var side = 0; side < 2; side++) {
        let direction = along * select(-1, 1, side == 1);
        for (var i = 1; i <= STEPS; i++) {
            let place = at + direction * i;
            last[side] = 0.5 * (luma(place) + luma(place + across)) - middle;
            if (abs(last[side]) >= end) {
                reach[side] = i;
                break;
            }
        }
    }
    let nearer = select(1, 0, reach.x < reach.y);
    // An edge that ends on the pixel's own side of it is somebody else's step.
    let bends = (last[nearer] < 0.0) != (m < middle);
    var offset = 0.0;
    if (bends) {
        offset = 0.5 - f32(reach[nearer]) / f32(reach.x + reach.y);
    }

    let mean = (2.0 * (n + s + w + e) + nw + ne + sw + se) / 12.0;
    let single = smoothstep(0.0, 1.0, clamp(abs(mean - m) / contrast, 0.0, 1.0));
    offset = max(offset, SUBPIXEL * single * single);
    return mix(own, shown(at + across), offset);
}

@fragment
fn fs_antialias(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let colour = smoothed(vec2<i32>(at.xy));
    if (DECODE_SRGB) {
        return vec4(linear_from_srgb(colour), 1.0);
    }
    return vec4(colour, 1.0);
}
