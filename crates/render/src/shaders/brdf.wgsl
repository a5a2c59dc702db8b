// How a surface reflects light: metallic–roughness as glTF 2.0 states it (appendix B), a Lambertian base below a layer
// of microfacets. CPU reference: cpu_reference/brdf.rs.

// Reflectance of dielectrics looking straight at them.
const DIELECTRIC: f32 = 0.04;

// What a dielectric reflects (KHR_materials_ior, KHR_materials_specular), and a clear coat (KHR_materials_clearcoat).
struct Specular {
    f0: vec3<f32>, // looking straight at it
    f90: f32, // along it
    coat: f32, // share of the surface that it covers
    coat_roughness: f32,
    coat_normal: vec3<f32>,
    base: f32, // share of the base's light that is not transmitted (KHR_materials_transmission)
}

const USUAL_SPECULAR: Specular = Specular(
    vec3<f32>(DIELECTRIC, DIELECTRIC, DIELECTRIC), 1.0, 0.0, 1.0, vec3<f32>(0.0, 0.0, 1.0), 1.0,
);

// Stands for the surface's normal in place of the coat's.
const COAT_FOLLOWS: u32 = 0xfffffu;

// Lowest bits first: roots of f0, and f90, in 255ths (51 are the usual 0.04); the coat's factor in 31sts, its roughness
// beyond 0.05 in 127ths of the rest, its octahedral normal in 511ths, from -1 on, or COAT_FOLLOWS.
fn specular_of(packed: vec2<u32>, normal: vec3<f32>) -> Specular {
    let stored = unpack4x8unorm(packed.x);
    let coat = f32(packed.y & 31u) / 31.0;
    let roughness = 0.05 + f32((packed.y >> 5u) & 127u) * (0.95 / 127.0);
    let place = packed.y >> 12u;
    var coat_normal = normal;
    if (place != COAT_FOLLOWS) {
        coat_normal = from_octahedral(vec2(f32(place & 1023u), f32(place >> 10u)) / 511.0 - 1.0);
    }
    return Specular(stored.rgb * stored.rgb, stored.w, coat, roughness, coat_normal, 1.0);
}

struct Reflector {
    albedo: vec3<f32>,
    metal: f32,
    roughness: f32, // perceptual: the square root of the microfacets'
    normal: vec3<f32>,
    to_eye: vec3<f32>,
    open: f32, // share of the sky that occlusion leaves
    specular: Specular, // without metal
}

// As metal mixes it.
fn mixed_specular(r: Reflector) -> Specular {
    var specular = r.specular;
    specular.f0 = mix(specular.f0, r.albedo, r.metal);
    specular.f90 += (1.0 - specular.f90) * r.metal;
    return specular;
}

// What a tinted reflection takes from the base beyond itself, per `1 - rise`: as much of each colour as of its strongest,
// so that the base does not turn to the complementary colour.
fn tint_excess(r: Reflector) -> vec3<f32> {
    let f0 = r.specular.f0;
    return (max(f0.r, max(f0.g, f0.b)) - f0) * (1.0 - r.metal);
}

// Normalised distribution of microfacets over their visibility: GGX (Walter et al., "Microfacet models for refraction
// through rough surfaces", 2007) with Smith's shadowing and masking that know of each other (Heitz, "Understanding the
// masking-shadowing function", 2014); times 4 cos cos, which the visibility divides by.
fn microfacets(roughness: f32, normal_half: f32, normal_light: f32, normal_eye: f32) -> f32 {
    let alpha = roughness * roughness;
    let squared = alpha * alpha;
    // 1 + (a² - 1) cos², without the difference of two numbers near 1.
    let sine = 1.0 - normal_half * normal_half;
    let lobe = max(sine + squared * normal_half * normal_half, 1e-12);
    let distribution = squared / (PI * lobe * lobe);
    let masked = normal_light * sqrt(normal_eye * normal_eye * (1.0 - squared) + squared);
    let shadowed = normal_eye * sqrt(normal_light * normal_light * (1.0 - squared) + squared);
    return distribution * 0.5 / max(masked + shadowed, 1e-6);
}

// Share of the way from `f0` to `f90` at a cosine (Schlick, "An inexpensive BRDF model", 1994).
fn rise(cosine: f32) -> f32 {
    return pow(clamp(1.0 - cosine, 0.0, 1.0), 5.0);
}

// What the coat takes from all below it.
fn coat_cover(r: Reflector) -> f32 {
    let risen = rise(dot(r.specular.coat_normal, r.to_eye));
    return r.specular.coat * (DIELECTRIC + (1.0 - DIELECTRIC) * risen);
}

fn coat_from_light(r: Reflector, to_light: vec3<f32>, light: vec3<f32>) -> vec3<f32> {
    let normal = r.specular.coat_normal;
    let normal_light = dot(normal, to_light);
    if (normal_light <= 0.0) {
        return vec3(0.0);
    }
    let half_way = normalize(r.to_eye + to_light);
    let normal_eye = max(dot(normal, r.to_eye), 1e-3);
    let normal_half = clamp(dot(normal, half_way), 0.0, 1.0);
    let reflectance = DIELECTRIC + (1.0 - DIELECTRIC) * rise(dot(r.to_eye, half_way));
    let lobe = PI * microfacets(r.specular.coat_roughness, normal_half, normal_light, normal_eye);
    return light * (r.specular.coat * normal_light * reflectance * lobe);
}

// Radiance towards the eye from light out of one direction, `light` as irradiance over π on what faces it.
fn from_light(r: Reflector, to_light: vec3<f32>, light: vec3<f32>) -> vec3<f32> {
    let below = base_from_light(r, to_light, light);
    if (r.specular.coat <= 0.0) {
        return below;
    }
    return below * (1.0 - coat_cover(r)) + coat_from_light(r, to_light, light);
}

fn base_from_light(r: Reflector, to_light: vec3<f32>, light: vec3<f32>) -> vec3<f32> {
    let normal_light = dot(r.normal, to_light);
    if (normal_light <= 0.0) {
        return vec3(0.0);
    }
    let half_way = normalize(r.to_eye + to_light);
    let normal_eye = max(dot(r.normal, r.to_eye), 1e-3);
    let normal_half = clamp(dot(r.normal, half_way), 0.0, 1.0);
    let specular = mixed_specular(r);
    let risen = rise(dot(r.to_eye, half_way));
    let reflectance = specular.f0 + (specular.f90 - specular.f0) * risen;
    let taken = reflectance + tint_excess(r) * (1.0 - risen);
    let base = (1.0 - taken) * r.albedo * (1.0 - r.metal) * r.specular.base;
    let layer = reflectance * PI * microfacets(r.roughness, normal_half, normal_light, normal_eye);
    return light * normal_light * (base + layer);
}

// Share of what is mirrored that occlusion leaves: what is smooth looks at less of the sky (Lagarde, "Moving Frostbite
// to physically based rendering", 2014, 4.10.2).
fn mirror_open(open: f32, normal_eye: f32, roughness: f32) -> f32 {
    return clamp(pow(normal_eye + open, exp2(-16.0 * roughness - 1.0)) - 1.0 + open, 0.0, 1.0);
}

// Share of a uniform sky's light that comes back from the base, or goes through it, of what enters.
fn entering(r: Reflector, mirrored: vec3<f32>, share: vec2<f32>) -> vec3<f32> {
    return (1.0 - mirrored - tint_excess(r) * share.x) * r.albedo * (1.0 - r.metal);
}

// What a thin wall transmits of what is seen through it.
fn transmitted(r: Reflector) -> vec3<f32> {
    let specular = mixed_specular(r);
    let share = environment_brdf(clamp(dot(r.normal, r.to_eye), 1e-3, 1.0), r.roughness);
    let mirrored = specular.f0 * share.x + specular.f90 * share.y;
    return entering(r, mirrored, share) * (1.0 - specular.base) * (1.0 - coat_cover(r));
}

// Radiance towards the eye from the sky: what its mean makes of the base, and what it mirrors, split into a sum (Karis,
// "Real shading in Unreal Engine 4", 2013).
fn from_sky(r: Reflector) -> vec3<f32> {
    let normal_eye = clamp(dot(r.normal, r.to_eye), 1e-3, 1.0);
    let specular = mixed_specular(r);
    let share = environment_brdf(normal_eye, r.roughness);
    let mirrored = specular.f0 * share.x + specular.f90 * share.y;
    let base = entering(r, mirrored, share) * specular.base;
    let seen = reflected(reflect(-r.to_eye, r.normal), r.roughness);
    let below = base * ambient(r.normal) * r.open + mirrored * seen * mirror_open(r.open, normal_eye, r.roughness);
    if (r.specular.coat <= 0.0) {
        return below;
    }
    let coat_eye = clamp(dot(r.specular.coat_normal, r.to_eye), 1e-3, 1.0);
    let coat_seen = reflected(reflect(-r.to_eye, r.specular.coat_normal), r.specular.coat_roughness);
    let open = mirror_open(r.open, coat_eye, r.specular.coat_roughness);
    return below * (1.0 - coat_cover(r)) + coat_mirrored(r, coat_eye) * coat_seen * open;
}

// Share of a uniform sky that the coat mirrors.
fn coat_mirrored(r: Reflector, normal_eye: f32) -> f32 {
    let share = environment_brdf(normal_eye, r.specular.coat_roughness);
    return r.specular.coat * (DIELECTRIC * share.x + share.y);
}

// Both, of a sun of which a share arrives.
fn lit(r: Reflector, sun: vec3<f32>) -> vec3<f32> {
    return min(from_light(r, frame.to_sun.xyz, sun) + from_sky(r), vec3(MAX_RADIANCE));
}
