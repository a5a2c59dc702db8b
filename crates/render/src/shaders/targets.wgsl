// G-buffer encoding, besides depth.

struct GBuffer {
    @location(0) normal: vec4<f32>, // octahedral, roughness, occlusion
    @location(1) albedo: vec4<f32>, // with metal
}

// Marks unlit surfaces in place of a normal.
const UNLIT: vec2<f32> = vec2(2.0, 2.0);

fn g_buffer(
    normal: vec3<f32>, roughness: f32, occlusion: f32, albedo: vec3<f32>, metal: f32, unlit: bool,
) -> GBuffer {
    return GBuffer(vec4(select(octahedral(normal), UNLIT, unlit), roughness, occlusion), vec4(albedo, metal));
}

fn is_unlit(stored: vec4<f32>) -> bool {
    return stored.x > 1.5;
}

// Ambient occlusion is stored with a sign: negative where the relief shadows itself from the sun.
fn hidden_from_sun(occlusion: f32) -> f32 {
    return -max(occlusion, 1e-3);
}
