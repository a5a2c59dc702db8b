//! How a surface reflects light: `brdf.wgsl`, and octahedral directions of `common.wgsl`.

use super::surface::{V3, dot, scale};

/// Reflectance of dielectrics looking straight at them.
pub const DIELECTRIC: f64 = 0.04;

/// What a dielectric reflects (Schlick 1994), and a clear coat.
#[derive(Clone, Copy, Debug)]
pub struct Specular {
    /// Looking straight at it.
    pub f0: V3,
    /// Along it.
    pub f90: f64,
    /// Share of the surface that a coat covers.
    pub coat: f64,
    /// The coat's perceptual roughness, above 0.
    pub coat_roughness: f64,
    /// The coat's normal, if it is not the surface's.
    pub coat_normal: Option<V3>,
    /// Share of the base's light that is not transmitted.
    pub base: f64,
}

impl Specular {
    /// Without extensions.
    pub const USUAL: Self =
        Self { f0: [DIELECTRIC; 3], f90: 1.0, coat: 0.0, coat_roughness: 1.0, coat_normal: None, base: 1.0 };

    /// What stands in a G-buffer: `specular_of` of `brdf.wgsl`.
    #[must_use]
    pub fn of_words([dielectric, coat]: [u32; 2]) -> Self {
        let share = |of: u32, first: u32, bits: u32| {
            let most = (1_u32 << bits) - 1;
            f64::from(of >> first & most) / f64::from(most)
        };
        let place = [12, 22].map(|first| f64::from(coat >> first & 1023) / 511.0 - 1.0);
        Self {
            f0: [0, 8, 16].map(|first| share(dielectric, first, 8).powi(2)),
            f90: share(dielectric, 24, 8),
            coat: share(coat, 0, 5),
            coat_roughness: 0.05 + 0.95 * share(coat, 5, 7),
            coat_normal: (coat >> 12 != 0xf_ffff).then(|| from_octahedral(place)),
            base: 1.0,
        }
    }
}

/// A surface seen from a direction.
#[derive(Clone, Copy, Debug)]
pub struct Reflector {
    /// Base colour, linear.
    pub albedo: V3,
    /// 0: dielectric, 1: metal.
    pub metal: f64,
    /// Perceptual roughness, above 0.
    pub roughness: f64,
    /// Unit normal.
    pub normal: V3,
    /// Unit direction towards the eye.
    pub to_eye: V3,
    /// Without metal.
    pub specular: Specular,
}

fn normalized(a: V3) -> V3 {
    scale(a, 1.0 / dot(a, a).sqrt())
}

/// A direction on the square −1..1 (Cigolle et al. 2014).
#[must_use]
pub fn octahedral(n: V3) -> [f64; 2] {
    let sum = n[0].abs() + n[1].abs() + n[2].abs();
    let (x, y) = (n[0] / sum, n[1] / sum);
    if n[2] >= 0.0 { [x, y] } else { folded(x, y) }
}

/// The direction at a place of the square.
#[must_use]
pub fn from_octahedral([x, y]: [f64; 2]) -> V3 {
    let z = 1.0 - x.abs() - y.abs();
    let [x, y] = if z >= 0.0 { [x, y] } else { folded(x, y) };
    normalized([x, y, z])
}

fn folded(x: f64, y: f64) -> [f64; 2] {
    let sign = |v: f64| if v >= 0.0 { 1.0 } else { -1.0 };
    [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)]
}

/// Distribution of microfacets times their visibility, over 4 cos cos: 1/sr (GGX, Walter et al. 2007; height-correlated
/// Smith, Heitz 2014).
#[must_use]
pub fn microfacets(roughness: f64, normal_half: f64, normal_light: f64, normal_eye: f64) -> f64 {
    let squared = roughness.powi(4);
    let lobe = 1.0 + (squared - 1.0) * normal_half * normal_half;
    let distribution = squared / (std::f64::consts::PI * lobe * lobe);
    let masked = normal_light * (normal_eye * normal_eye * (1.0 - squared) + squared).sqrt();
    let shadowed = normal_eye * (normal_light * normal_light * (1.0 - squared) + squared).sqrt();
    distribution * 0.5 / (masked + shadowed)
}

impl Reflector {
    fn coat_normal(&self) -> V3 {
        self.specular.coat_normal.unwrap_or(self.normal)
    }

    /// What the coat takes from all below it (KHR_materials_clearcoat).
    fn coat_cover(&self) -> f64 {
        let rise = (1.0 - dot(self.coat_normal(), self.to_eye)).clamp(0.0, 1.0).powi(5);
        self.specular.coat * (DIELECTRIC + (1.0 - DIELECTRIC) * rise)
    }

    /// The coat's BRDF times π and the light's cosine to it.
    fn coat_pi(&self, to_light: V3) -> f64 {
        let normal = self.coat_normal();
        let normal_light = dot(normal, to_light).max(0.0);
        let half_way = normalized([0, 1, 2].map(|i| self.to_eye[i] + to_light[i]));
        let normal_eye = dot(normal, self.to_eye).max(1e-3);
        let normal_half = dot(normal, half_way).clamp(0.0, 1.0);
        let rise = (1.0 - dot(self.to_eye, half_way)).clamp(0.0, 1.0).powi(5);
        let lobe = microfacets(self.specular.coat_roughness, normal_half, normal_light, normal_eye);
        let reflectance = DIELECTRIC + (1.0 - DIELECTRIC) * rise;
        self.specular.coat * reflectance * std::f64::consts::PI * lobe * normal_light
    }

    /// The BRDF times π for light from a unit direction; 0 from below.
    #[must_use]
    pub fn brdf_pi(&self, to_light: V3) -> V3 {
        let cosine = dot(self.normal, to_light);
        if cosine <= 0.0 {
            return [0.0; 3];
        }
        let (cover, coat) = (self.coat_cover(), self.coat_pi(to_light) / cosine);
        self.base_pi(to_light).map(|base| base * (1.0 - cover) + coat)
    }

    fn base_pi(&self, to_light: V3) -> V3 {
        let normal_light = dot(self.normal, to_light);
        if normal_light <= 0.0 {
            return [0.0; 3];
        }
        let half_way = normalized([0, 1, 2].map(|i| self.to_eye[i] + to_light[i]));
        let normal_eye = dot(self.normal, self.to_eye).max(1e-3);
        let normal_half = dot(self.normal, half_way).clamp(0.0, 1.0);
        let rise = (1.0 - dot(self.to_eye, half_way)).clamp(0.0, 1.0).powi(5);
        let layer = std::f64::consts::PI * microfacets(self.roughness, normal_half, normal_light, normal_eye);
        // KHR_materials_specular: the base loses as much of each colour as of the one that is reflected most.
        let most = self.specular.f0.into_iter().fold(0.0, f64::max);
        [0, 1, 2].map(|i| {
            let (albedo, dielectric, f90) = (self.albedo[i], self.specular.f0[i], self.specular.f90);
            let at = |f0: f64, f90: f64| f0 + (f90 - f0) * rise;
            let mixed = |a: f64, b: f64| a + (b - a) * self.metal;
            let reflectance = at(mixed(dielectric, albedo), mixed(f90, 1.0));
            let excess = (at(most, f90) - at(dielectric, f90)) * (1.0 - self.metal);
            let entering = (1.0 - reflectance - excess) * albedo * (1.0 - self.metal);
            entering * self.specular.base + reflectance * layer
        })
    }

    /// Radiance towards the eye under light of irradiance π `light` from a direction.
    #[must_use]
    pub fn from_light(&self, to_light: V3, light: V3) -> V3 {
        let cosine = dot(self.normal, to_light).max(0.0);
        let (cover, base, coat) = (self.coat_cover(), self.base_pi(to_light), self.coat_pi(to_light));
        [0, 1, 2].map(|i| light[i] * (cosine * base[i] * (1.0 - cover) + coat))
    }
}

/// Reference for image-based lighting: reflection of a whole sky, by `side`² samples of the specular lobe, as many of
/// the coat's and as many of the cosine lobe, combined with the balance heuristic (Veach and Guibas, "Optimally
/// combining sampling techniques", 1995).
pub fn from_sky(r: &Reflector, side: usize, sky: impl Fn(V3) -> V3) -> V3 {
    let across = if r.normal[0].abs() < 0.5 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let right = normalized(super::surface::cross(r.normal, across));
    let ahead = super::surface::cross(r.normal, right);
    let world = |[x, y, z]: V3| [0, 1, 2].map(|i| x * right[i] + y * ahead[i] + z * r.normal[i]);
    let coat = (r.specular.coat > 0.0).then_some(r.specular.coat_roughness);
    let lobes: Vec<f64> = [Some(r.roughness), coat].into_iter().flatten().map(|lobe| lobe.powi(4)).collect();
    let pi = std::f64::consts::PI;
    let density = |to_light: V3| {
        let half_way = normalized([0, 1, 2].map(|i| r.to_eye[i] + to_light[i]));
        let cosine = dot(r.normal, half_way).clamp(0.0, 1.0);
        let facets = |squared: &f64| {
            let lobe = 1.0 + (squared - 1.0) * cosine * cosine;
            squared / (pi * lobe * lobe) * cosine / (4.0 * dot(r.to_eye, half_way).abs().max(1e-9))
        };
        lobes.iter().map(facets).sum::<f64>() + dot(r.normal, to_light).max(0.0) / pi
    };
    let mut sum = [0.0; 3];
    let mut add = |to_light: V3| {
        let cosine = dot(r.normal, to_light);
        if cosine > 0.0 {
            let density = density(to_light);
            let (brdf, light) = (r.brdf_pi(to_light), sky(to_light));
            for i in 0..3 {
                sum[i] += brdf[i] / pi * light[i] * cosine / density;
            }
        }
    };
    for i in 0..side * side {
        let (u, v) = (((i / side) as f64 + 0.5) / side as f64, ((i % side) as f64 + 0.5) / side as f64);
        let (sin, cos) = (2.0 * pi * v).sin_cos();
        for squared in &lobes {
            let height = ((1.0 - u) / (1.0 + (squared - 1.0) * u)).sqrt();
            let wide = (1.0 - height * height).max(0.0).sqrt();
            let half_way = world([wide * cos, wide * sin, height]);
            let twice = 2.0 * dot(r.to_eye, half_way);
            add([0, 1, 2].map(|i| twice * half_way[i] - r.to_eye[i]));
        }
        let wide = u.sqrt();
        add(world([wide * cos, wide * sin, (1.0 - u).sqrt()]));
    }
    scale(sum, 1.0 / (side * side) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_come_back_from_their_square() {
        for i in 0..1000 {
            let t = f64::from(i) * 0.37;
            let n = normalized([t.sin(), (1.7 * t).cos(), (2.3 * t).sin()]);
            let back = from_octahedral(octahedral(n));
            assert!([0, 1, 2].iter().all(|&k| (back[k] - n[k]).abs() < 1e-12), "{n:?} {back:?}");
        }
    }

    #[test]
    fn the_roughest_mirror_looked_at_straight_gives_back_what_its_integral_says() {
        let up = [0.0, 0.0, 1.0];
        let r = Reflector {
            albedo: [1.0; 3],
            metal: 1.0,
            roughness: 1.0,
            normal: up,
            to_eye: up,
            specular: Specular::USUAL,
        };
        // The integral of 1 / (2 π (1 + μ)), with the cosine μ, over the hemisphere.
        let want = 1.0 - 2.0_f64.ln();
        assert!((from_sky(&r, 64, |_| [1.0; 3])[0] - want).abs() < 1e-3);
    }

    #[test]
    fn a_white_mirror_of_any_roughness_gives_back_no_more_than_it_gets() {
        for (roughness, least) in [(0.1, 0.97), (0.5, 0.8), (1.0, 0.3)] {
            for cosine in [1.0_f64, 0.7, 0.3] {
                let to_eye = [(1.0 - cosine * cosine).sqrt(), 0.0, cosine];
                let r = Reflector {
                    albedo: [1.0; 3],
                    metal: 1.0,
                    roughness,
                    normal: [0.0, 0.0, 1.0],
                    to_eye,
                    specular: Specular::USUAL,
                };
                let [out, ..] = from_sky(&r, 128, |_| [1.0; 3]);
                assert!((least..=1.003).contains(&out), "{roughness} {cosine}: {out}");
            }
        }
    }
}
