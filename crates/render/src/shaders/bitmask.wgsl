// Ambient occlusion by visibility bitmasks (Therrien, Levesque and Gilet, "Screen space indirect lighting with visibility
// bitmask", 2023): each slice has 32 sectors, and what is drawn hides those between its front and its back, which is
// taken to lie a thickness behind. Sectors have equal shares of the slice's integral, so that their number is the cosine's
// weight, and count with the falloff of the first that hides them. CPU reference: cpu_reference/occlusion/bitmask.rs.

// Of all that is drawn, as a fraction of the radius.
const THICKNESS: f32 = 0.5;

// The sectors between two shares of a slice's integral. Where within a sector it begins differs by pixel: so means are
// exact.
fn sectors(low: f32, high: f32, dither: f32) -> u32 {
    let first = u32(clamp(low * 32.0 + dither, 0.0, 32.0));
    let last = u32(clamp(high * 32.0 + dither, 0.0, 32.0));
    if (last <= first) {
        return 0u;
    }
    return (0xffffffffu >> (32u - (last - first))) << first;
}

fn occlusion_sums(r: Receiver) -> vec2<f32> {
    let steps = step_count();
    let dither = (f32((r.rotation * 7u + 1u) & 15u) + 0.5) / 16.0;
    var sums = vec2(0.0);
    for (var i = 0u; i < slice_count(); i++) {
        let slice = slice_of(r, i);
        let begin = signed_arc(slice, slice.angle - 0.5 * PI);
        let whole = signed_arc(slice, slice.angle + 0.5 * PI) - begin;
        var hidden = 0u;
        var occluded = 0.0;
        var last = array<vec3<f32>, 2>();
        for (var k = 0u; k < steps; k++) {
            for (var end = 0u; end < 2u; end++) {
                let side = 2.0 * f32(end) - 1.0;
                let to = drawn_at(r, slice.offset_px * (side * step_length(r, k)));
                let front = within(r, slice, to);
                let met = met_between(r, last[end], to);
                last[end] = to;
                if (front.y <= MIN_ELEVATION * length(front)) {
                    continue;
                }
                let back = front + THICKNESS * r.radius * vec2(slice.sine, -slice.cosine);
                // From the normal, towards the tangent; behind is the way away from the eye.
                let near = atan2(front.x, front.y);
                let far = atan2(back.x, back.y);
                var ends = vec2(near, far);
                if (near >= -slice.angle) {
                    ends.y = select(far, PI, far < near);
                } else {
                    ends = vec2(select(far, -PI, far > near), near);
                }
                ends = clamp(ends, vec2(-0.5 * PI), vec2(0.5 * PI)) + slice.angle;
                let low = (signed_arc(slice, ends.x) - begin) / whole;
                let high = (signed_arc(slice, ends.y) - begin) / whole;
                let covered = sectors(low, high, dither);
                occluded += met * f32(countOneBits(covered & ~hidden)) / 32.0;
                hidden |= covered;
            }
        }
        sums += slice.normal_length * whole * vec2(occluded, 1.0);
    }
    return vec2(sums.x, max(sums.y, 1e-6));
}
