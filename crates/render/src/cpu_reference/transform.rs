//! Placement of vertices: `rotate` of `common.wgsl`, `morph_weight` and `in_world` of `placement.wgsl`.

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `v` turned by the unit quaternion `q` (x y z w).
#[must_use]
pub fn rotate(v: [f64; 3], q: [f64; 4]) -> [f64; 3] {
    let axis = [q[0], q[1], q[2]];
    let t = cross(axis, v).map(|x| 2.0 * x);
    let c = cross(axis, t);
    [0, 1, 2].map(|i| v[i] + q[3] * t[i] + c[i])
}

/// Position relative to the eye of a vertex at `local`, for an instance at `offset`.
#[must_use]
pub fn place(local: [f64; 3], offset: [f64; 3], scale: f64, rotation: [f64; 4]) -> [f64; 3] {
    let r = rotate(local.map(|x| x * scale), rotation);
    [0, 1, 2].map(|i| r[i] + offset[i])
}

/// Share of the way from `morph_from` to `position` after `age_s`.
#[must_use]
pub fn morph_weight(age_s: f64, morph_s: f64) -> f64 {
    if morph_s <= 0.0 {
        return 1.0;
    }
    let t = (age_s / morph_s).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn morph_starts_and_ends_at_its_positions() {
        assert_eq!(morph_weight(-1.0, 0.25), 0.0);
        assert_eq!(morph_weight(0.125, 0.25), 0.5);
        assert_eq!(morph_weight(1e9, 0.25), 1.0);
        assert_eq!(morph_weight(0.0, 0.0), 1.0);
    }
}
