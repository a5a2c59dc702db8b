// Section planes: what lies beyond one is cut away, and solids are capped there. Places are relative to the eye.

const SECTION_PLANES: u32 = 3u;

// Roughness that marks caps in the G-buffer: as a half-precision number the next above 1, which is the most of others.
const CAP_ROUGHNESS: f32 = 1.001;

fn is_cap(stored: vec4<f32>) -> bool {
    return stored.z > 1.0;
}

fn is_cut(at: vec3<f32>) -> bool {
    var cut = false;
    for (var i = 0u; i < SECTION_PLANES; i++) {
        cut = cut || dot(frame.sections[i].xyz, at) > frame.sections[i].w;
    }
    return cut;
}

// Where a ray from the eye comes out of what is cut away: through which plane, and at how many of its lengths. The eye is in
// what is kept if there is no such plane.
struct SectionEntry {
    plane: u32, // SECTION_PLANES: none
    at: f32,
}

fn section_entry(ray: vec3<f32>) -> SectionEntry {
    var entry = SectionEntry(SECTION_PLANES, 0.0);
    for (var i = 0u; i < SECTION_PLANES; i++) {
        let plane = frame.sections[i];
        let slope = dot(plane.xyz, ray);
        if (plane.w < 0.0 && slope < 0.0 && plane.w / slope > entry.at) {
            entry = SectionEntry(i, plane.w / slope);
        }
    }
    return entry;
}
