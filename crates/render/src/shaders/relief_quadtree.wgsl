// Traversal of a maximum pyramid, from large free cells down to the patch between four texel centres, where clearance
// along the ray is a quadratic (Tevs, Ihrke and Seidel, "Maximum mipmaps", 2008; Drobot, "Quadtree displacement
// mapping with height blending", GPU Pro, 2010). CPU reference: cpu_reference/relief/pyramid.rs.

// Level 0: the maximum of four adjacent texels; each further level: of four cells.
@group(3) @binding(0) var relief_pyramid: texture_2d<f32>;

// Offset that moves a position on a cell's edge into the next cell, in cells.
const RELIEF_NUDGE: f32 = 1e-4;
// Infinity.
const RELIEF_ENDLESS: f32 = 1e30;

fn relief_largest(cell: vec2<i32>, level: i32) -> f32 {
    let size = vec2<i32>(textureDimensions(relief_pyramid, level));
    return textureLoad(relief_pyramid, (cell % size + size) % size, level).r;
}

fn relief_texel(texel: vec2<i32>) -> f32 {
    let size = vec2<i32>(textureDimensions(height_map));
    return textureLoad(height_map, (texel % size + size) % size, 0).r;
}

// Over the surface, in depths: heights of a patch's corners, and a place in it.
fn relief_clearance(corners: vec4<f32>, within: vec2<f32>, at: f32) -> f32 {
    let rows = mix(corners.xz, corners.yw, within.x);
    return 1.0 - mix(rows.x, rows.y, within.y) - at;
}

// Smallest root of a t² + b t + c in 0..1; 2 where there is none.
fn relief_root(a: f32, b: f32, c: f32) -> f32 {
    var roots = vec2(-c / b, 2.0);
    if (abs(a) >= 1e-7) {
        let discriminant = b * b - 4.0 * a * c;
        if (discriminant < 0.0) {
            return 2.0;
        }
        let q = -0.5 * (b + select(-1.0, 1.0, b >= 0.0) * sqrt(discriminant));
        roots = vec2(q / a, c / q);
    }
    let first = select(2.0, roots.x, roots.x >= 0.0 && roots.x <= 1.0);
    let second = select(2.0, roots.y, roots.y >= 0.0 && roots.y <= 1.0);
    return min(first, second);
}

fn relief_found(start: vec2<f32>, span: vec2<f32>, lod: f32, steps: f32) -> f32 {
    if (lod >= RELIEF_FINEST) {
        return relief_trace(start, span, lod, steps);
    }
    let size = vec2<f32>(textureDimensions(height_map));
    // In texels, whose middles lie at whole numbers; near 0, for what is left of 24 bits.
    let from_texel = fract(start) * size - 0.5;
    let way = span * size;
    let coarsest = i32(textureNumLevels(relief_pyramid)) - 1;
    if (relief_height(start, 0.0) >= 1.0) {
        return 0.0;
    }
    let nudge = select(vec2(0.0), sign(way) * RELIEF_NUDGE, way != vec2(0.0));
    var at = 0.0;
    var level = coarsest;
    // Descending to a patch and ascending again makes no progress along the ray.
    let most = steps + 2.0 * f32(coarsest);
    for (var i = 0.0; i < most; i += 1.0) {
        if (at >= 1.0) {
            break;
        }
        let width = exp2(f32(level));
        let cell = floor((from_texel + way * at) / width + nudge);
        let edge = (cell + select(vec2(0.0), vec2(1.0), way > vec2(0.0))) * width;
        let exits = select(vec2(RELIEF_ENDLESS), (edge - from_texel) / way, way != vec2(0.0));
        let leaves = max(min(min(exits.x, exits.y), 1.0), at);
        // Lowest where it leaves.
        if (1.0 - leaves > relief_largest(vec2<i32>(cell), level)) {
            at = leaves;
            level = min(level + 1, coarsest);
        } else if (level > 0) {
            level -= 1;
        } else {
            let texel = vec2<i32>(cell);
            let corners = vec4(
                relief_texel(texel), relief_texel(texel + vec2(1, 0)),
                relief_texel(texel + vec2(0, 1)), relief_texel(texel + vec2(1, 1)),
            );
            let middle = 0.5 * (at + leaves);
            let c0 = relief_clearance(corners, from_texel + way * at - cell, at);
            let ch = relief_clearance(corners, from_texel + way * middle - cell, middle);
            let c1 = relief_clearance(corners, from_texel + way * leaves - cell, leaves);
            if (c0 <= 0.0) {
                // Rounding has let it through the last patch's edge.
                return at;
            }
            var root = relief_root(2.0 * (c0 + c1) - 4.0 * ch, 4.0 * ch - 3.0 * c0 - c1, c0);
            if (root > 1.0 && c1 <= 0.0) {
                // It goes through, though rounding has lost where.
                root = c0 / (c0 - c1);
            }
            if (root <= 1.0) {
                return at + root * (leaves - at);
            }
            at = leaves;
            level = min(level + 1, coarsest);
        }
    }
    return min(at, 1.0);
}
