//! Specular reflection of materials: `KHR_materials_ior`, `KHR_materials_specular` and `KHR_materials_clearcoat`. Their
//! textures are left out.

use gltf::json::extensions::material::Material as Extensions;
use lodestream_scene::asset::{ClearCoat, Specular};
use serde_json::Value;

use super::root::{CLEAR_COAT, IOR, SPECULAR};

/// The number of a name; `None` without it or if it is not finite.
fn number(of: &Value, name: &str) -> Option<f64> {
    of.get(name)?.as_f64().filter(|number| number.is_finite())
}

/// What a dielectric reflects: `((ior − 1) / (ior + 1))²` times colour, at most 1, times factor, and along it the factor.
pub(super) fn specular(extensions: &Extensions) -> Specular {
    let stated = extensions.others.get(SPECULAR);
    let ior = extensions.others.get(IOR).and_then(|of| number(of, "ior"));
    // Below 1 only 0 has a meaning: everything is reflected.
    let ior = ior.filter(|&ior| ior == 0.0 || ior >= 1.0).unwrap_or(1.5);
    let factor = stated.and_then(|of| number(of, "specularFactor")).unwrap_or(1.0).clamp(0.0, 1.0);
    let color = stated.and_then(|of| of.get("specularColorFactor"));
    let color = [0, 1, 2].map(|i| {
        let channel = color.and_then(|color| color.get(i)?.as_f64());
        channel.filter(|channel| channel.is_finite()).unwrap_or(1.0).max(0.0)
    });
    let straight = ((ior - 1.0) / (ior + 1.0)).powi(2);
    Specular { f0: color.map(|color| ((straight * color).min(1.0) * factor) as f32), f90: factor as f32 }
}

/// The clear coat; missing factors are 0.
pub(super) fn clear_coat(extensions: &Extensions) -> ClearCoat {
    let stated = extensions.others.get(CLEAR_COAT);
    let share = |name| stated.and_then(|of| number(of, name)).unwrap_or(0.0).clamp(0.0, 1.0) as f32;
    ClearCoat { factor: share("clearcoatFactor"), roughness: share("clearcoatRoughnessFactor") }
}
