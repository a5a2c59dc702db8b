// Transparent surfaces: forward lighting, blended over the picture.

fn reflector(s: Surface, surface: Shaded, front: bool, to_eye: vec3<f32>) -> Reflector {
    var specular = USUAL_SPECULAR;
    if (SPECULAR) {
        var coat_normal = surface.normal;
        if (MAPS) {
            coat_normal = own_normal(s, front, dpdx(s.position), dpdy(s.position), -to_eye);
        }
        specular = specular_of(vec2(material.specular, material.coat | (COAT_FOLLOWS << 12u)), coat_normal);
    }
    if (TRANSMITS) {
        specular.base = 1.0 - material.transmission;
    }
    return Reflector(surface.albedo, surface.metal, surface.roughness, surface.normal, to_eye, surface.occlusion, specular);
}

// What is left of the picture behind a surface that transmits, by which the picture is multiplied before the surface's own
// light is added.
@fragment
fn fs_left(s: Surface, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let surface = shaded(s, front);
    let to_eye = -s.position / max(length(s.position), 1e-30);
    let r = reflector(s, surface, front, to_eye);
    if (SECTIONS && is_cut(s.position)) {
        discard;
    }
    return vec4(mix(vec3(1.0), transmitted(r), clamp(surface.opacity, 0.0, 1.0)), 1.0);
}

@fragment
fn fs_transparent(s: Surface, @builtin(front_facing) front: bool) -> @location(0) vec4<f32> {
    let surface = shaded(s, front);
    let to_eye = -s.position / max(length(s.position), 1e-30);
    let r = reflector(s, surface, front, to_eye);
    if (SECTIONS && is_cut(s.position)) {
        discard;
    }
    let opacity = clamp(surface.opacity, 0.0, 1.0);
    if (material.unlit == 1u) {
        return vec4(surface.albedo * opacity, opacity);
    }
    let cosine = dot(surface.normal, frame.to_sun.xyz);
    var sun = vec3(0.0);
    if (cosine > 0.0) {
        sun = frame.sun.rgb * sunlight_at(s.position, surface.normal, cosine).x;
    }
    let texel = emitted(uv_for(EMISSION, s.uv, s.second_uv));
    let given = select(vec3(0.0), material.emission * texel, (frame.flags & 2u) != 0u);
    let punctual_lights = from_punctual_lights(r, s.position, vec2<u32>(s.clip.xy), view_depth(s.clip.z));
    let seen = min(lit(r, sun) + punctual_lights + given, vec3(MAX_RADIANCE));
    if (TRANSMITS) {
        // Haze of what is seen through it was added with it.
        let away = length(s.position);
        let clear = select(1.0, exp(-min(frame.sky_side.w * away, 80.0)), frame.sky_side.w > 0.0);
        let haze = (1.0 - transmitted(r)) * (1.0 - clear) * sky_without_sun(-to_eye);
        return vec4((seen * clear + haze) * opacity, 0.0);
    }
    return vec4(hazed(seen, -to_eye, length(s.position)) * opacity, opacity);
}
