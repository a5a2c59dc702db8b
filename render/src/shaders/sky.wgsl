// Light from the sky: what is seen of it, what falls on a surface, and what one reflects.

fn sky(direction: vec3<f32>) -> vec3<f32> {
    let height = dot(direction, frame.up.xyz);
    let above = mix(frame.sky_horizon.rgb, frame.sky_zenith.rgb, pow(max(height, 0.0), 0.5));
    return mix(frame.ground.rgb, above, smoothstep(-0.12, 0.0, height));
}

// Light from the whole sky on a surface, as seen from its normal.
fn ambient(normal: vec3<f32>) -> vec3<f32> {
    let height = dot(normal, frame.up.xyz);
    let above = 0.5 * (frame.sky_horizon.rgb + frame.sky_zenith.rgb);
    return mix(frame.ground.rgb, above, 0.5 + 0.5 * height);
}

// Light from the sky that a surface of this perceptual roughness reflects towards the eye, before Fresnel's share;
// `direction` is the mirrored one.
fn reflected(direction: vec3<f32>, roughness: f32) -> vec3<f32> {
    return mix(sky(direction), ambient(direction), roughness);
}

// What a layer of microfacets mirrors of an even sky: this much of its reflectance straight on, and so much besides
// (Karis, "Physically based shading on mobile", 2014: a fit by Lazarov's form).
fn environment_brdf(cosine: f32, roughness: f32) -> vec2<f32> {
    let r = roughness * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
    let a = min(r.x * r.x, exp2(-9.28 * cosine)) * r.x + r.y;
    return vec2(-1.04, 1.04) * a + r.zw;
}
