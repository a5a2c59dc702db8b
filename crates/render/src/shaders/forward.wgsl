// Transparent surfaces: forward lighting, blended over the picture.

@fragment
fn fs_transparent(s: Surface, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let surface = shaded(s, front);
    if (SECTIONS && is_cut(s.position)) {
        discard;
    }
    let opacity = clamp(surface.opacity, 0.0, 1.0);
    if (material.unlit == 1u) {
        return vec4(surface.albedo * opacity, opacity);
    }
    let to_eye = -s.position / max(length(s.position), 1e-30);
    let cosine = dot(surface.normal, frame.to_sun.xyz);
    var sun = vec3(0.0);
    if (cosine > 0.0) {
        sun = frame.sun.rgb * sunlight_at(s.position, surface.normal, cosine).x;
    }
    var specular = USUAL_SPECULAR;
    if (SPECULAR) {
        var coat_normal = surface.normal;
        if (MAPS) {
            coat_normal = own_normal(s, front, dpdx(s.position), dpdy(s.position), -to_eye);
        }
        specular = specular_of(vec2(material.specular, material.coat | (COAT_FOLLOWS << 12u)), coat_normal);
    }
    let r = Reflector(surface.albedo, surface.metal, surface.roughness, surface.normal, to_eye, surface.occlusion, specular);
    let texel = emitted(s.uv);
    let given = select(vec3(0.0), material.emission * texel, (frame.flags & 2u) != 0u);
    let punctual_lights = from_punctual_lights(r, s.position, vec2<u32>(s.clip.xy), view_depth(s.clip.z));
    let seen = min(lit(r, sun) + punctual_lights + given, vec3(MAX_RADIANCE));
    return vec4(hazed(seen, -to_eye, length(s.position)) * opacity, opacity);
}
