// Classification of edges as strokes. CPU reference: cpu_reference/ink.rs.

// Bits of what the triangles of an edge are.
const LEFT: u32 = 1u;
const RIGHT: u32 = 2u;
// One has no area, or is seen edge-on: it lies on no side.
const NEITHER: u32 = 4u;
// Two meet at more than the angle of a crease.
const CREASE: u32 = 8u;

// A crease is no wider than this share of how high the higher of its triangles looks over it: where many lie side by side,
// as along a fluted column far away, they leave two thirds of what is between them.
const CREASE_SHARE: f32 = 0.33333333;

// Least height of a triangle over its edge that is one, in lengths of the edge.
const LEAST_HEIGHT: f32 = 1e-6;

// The normal of a triangle of an edge, not of unit length, with its side: of the plane through the eye and the edge. Whether
// faces are wound alike does not matter.
fn side_of(from_eye: vec3<f32>, along: vec3<f32>, normal: vec3<f32>) -> u32 {
    let side = dot(from_eye, normal);
    let height = dot(normal, normal);
    let length = dot(along, along);
    if (!(height > LEAST_HEIGHT * LEAST_HEIGHT * length * length)) {
        return NEITHER;
    }
    if (side > 0.0) {
        return LEFT;
    }
    return select(NEITHER, RIGHT, side < 0.0);
}

// Whether two triangles of an edge are a crease. Of two alone those go on that face away from each other; of more, pairs may
// also lie on each other.
fn is_crease(first: vec3<f32>, second: vec3<f32>, cosine: f32, more: bool) -> bool {
    let turned = dot(first, second);
    let sizes = sqrt(dot(first, first)) * sqrt(dot(second, second));
    let on = select(-turned, abs(turned), more);
    return sizes > 0.0 && on < cosine * sizes;
}

// Whether all of an edge's triangles lie on one side of what the eye sees it along, of which a border has one.
fn is_contour(found: u32) -> bool {
    let side = found & ~CREASE;
    return side == LEFT || side == RIGHT;
}

// Whether an edge is drawn: it is a contour, or two of its triangles meet in a crease.
fn is_stroke(found: u32) -> bool {
    return is_contour(found) || (found & CREASE) != 0u;
}
