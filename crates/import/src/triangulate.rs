//! Triangulation of polygons.
//!
//! Convex polygons become a fan; others are cut by ears (Meisters, "Polygons have ears", 1975) in
//! the plane of their Newell normal. Polygons without an ear (self-crossing or collapsed) become a fan.

/// Most tests per corner, on average, in the search for ears. The search is quadratic for ordinary polygons and cubic for
/// adversarial ones, which become a fan at this limit.
const MAX_TESTS_PER_CORNER: usize = 1024;

/// Triangles as indices into `points`, keeping their winding; nothing for fewer than 3 points.
pub(super) fn triangulate(points: &[[f64; 3]]) -> Vec<[usize; 3]> {
    let n = points.len();
    if n <= 3 {
        return fan(n);
    }
    let flat = project(points);
    let convex = (0..n).all(|i| cross(flat[i], flat[(i + 1) % n], flat[(i + 2) % n]) >= 0.0);
    if convex { fan(n) } else { cut_ears(&flat).unwrap_or_else(|| fan(n)) }
}

/// Cuts ears off, going round the ring; `None` where there is no ear or the search takes too long.
fn cut_ears(flat: &[[f64; 2]]) -> Option<Vec<[usize; 3]>> {
    let mut ring: Vec<usize> = (0..flat.len()).collect();
    let mut triangles = Vec::with_capacity(flat.len() - 2);
    let mut tests_left = flat.len() * MAX_TESTS_PER_CORNER;
    let mut i = 0;
    while ring.len() > 3 {
        let m = ring.len();
        let turn = (0..m).find(|k| is_ear(flat, &ring, (i + k) % m, &mut tests_left))?;
        i = (i + turn) % m;
        triangles.push([ring[(i + m - 1) % m], ring[i], ring[(i + 1) % m]]);
        ring.remove(i);
        i %= m - 1;
    }
    triangles.push([ring[0], ring[1], ring[2]]);
    Some(triangles)
}

/// Whether the corner at `i` turns left and no other is inside its triangle. Counts down `tests_left` by
/// the corners that it tests, and returns false once that is 0.
fn is_ear(flat: &[[f64; 2]], ring: &[usize], i: usize, tests_left: &mut usize) -> bool {
    let m = ring.len();
    let [a, b, c] = [(i + m - 1) % m, i, (i + 1) % m].map(|k| flat[ring[k]]);
    let mut count_test = || {
        let left = *tests_left > 0;
        *tests_left = tests_left.saturating_sub(1);
        left
    };
    count_test()
        && cross(a, b, c) > 0.0
        && ring.iter().all(|&p| {
            let p = flat[p];
            // By place, not by index: a hole's bridge visits the same place twice.
            count_test() && ([a, b, c].contains(&p) || !inside(p, a, b, c))
        })
}

fn fan(n: usize) -> Vec<[usize; 3]> {
    (2..n).map(|i| [0, i - 1, i]).collect()
}

/// Drops the axis along which the Newell normal is longest, keeping the winding positive.
fn project(points: &[[f64; 3]]) -> Vec<[f64; 2]> {
    let plane = |axis: usize| ((axis + 1) % 3, (axis + 2) % 3);
    let normal = [0, 1, 2].map(|axis| doubled_area(points, plane(axis)));
    let axis = (0..3).fold(0, |best, i| if normal[i].abs() > normal[best].abs() { i } else { best });
    let (u, v) = plane(axis);
    points.iter().map(|p| if normal[axis] < 0.0 { [p[v], p[u]] } else { [p[u], p[v]] }).collect()
}

/// Twice the signed area in one coordinate plane: a component of the Newell normal.
fn doubled_area(points: &[[f64; 3]], (u, v): (usize, usize)) -> f64 {
    let origin = points[0];
    let mut area = 0.0;
    for pair in points.windows(2) {
        let (p, q) = (pair[0], pair[1]);
        area += (p[u] - origin[u]) * (q[v] - origin[v]) - (q[u] - origin[u]) * (p[v] - origin[v]);
    }
    area
}

fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn inside(p: [f64; 2], a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> bool {
    cross(a, b, p) >= 0.0 && cross(b, c, p) >= 0.0 && cross(c, a, p) >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(points: &[[f64; 3]], t: [usize; 3]) -> f64 {
        let [a, b, c] = t.map(|i| [points[i][0], points[i][1]]);
        cross(a, b, c) / 2.0
    }

    #[test]
    fn a_concave_quad_is_cut_along_the_inner_diagonal() {
        // An arrow head: the fan from corner 0 would cover area outside.
        let points = [[0.0, 2.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];
        for rotate in 0..4 {
            let mut p = points;
            p.rotate_left(rotate);
            let triangles = triangulate(&p);
            assert_eq!(triangles.len(), 2);
            assert!(triangles.iter().all(|&t| area(&p, t) > 0.0), "{triangles:?}");
        }
    }

    #[test]
    fn a_comb_keeps_its_area_and_winding_on_every_axis() {
        let outline = [
            [0.0, 0.0],
            [6.0, 0.0],
            [6.0, 3.0],
            [5.0, 3.0],
            [5.0, 1.0],
            [4.0, 1.0],
            [4.0, 3.0],
            [2.0, 3.0],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [0.0, 3.0],
        ];
        for axis in 0..3 {
            let points: Vec<[f64; 3]> = outline
                .iter()
                .map(|p| {
                    let mut q = [0.5; 3];
                    q[(axis + 1) % 3] = p[0];
                    q[(axis + 2) % 3] = p[1];
                    q
                })
                .collect();
            let triangles = triangulate(&points);
            assert_eq!(triangles.len(), outline.len() - 2);
            let flat: Vec<[f64; 3]> = outline.iter().map(|p| [p[0], p[1], 0.0]).collect();
            let areas: Vec<f64> = triangles.iter().map(|&t| area(&flat, t)).collect();
            assert!(areas.iter().all(|&a| a >= 0.0));
            assert!((areas.iter().sum::<f64>() - 14.0).abs() < 1e-12, "{}", areas.iter().sum::<f64>());
        }
    }

    /// A sawtooth outline of `n` corners on a bar.
    fn saw(n: u32) -> Vec<[f64; 3]> {
        let mut points: Vec<[f64; 3]> = (0..n).map(|i| [f64::from(i), f64::from(i % 2), 0.0]).collect();
        points.extend([[f64::from(n), -1.0, 0.0], [-1.0, -1.0, 0.0]]);
        points.reverse();
        points
    }

    #[test]
    fn a_saw_of_a_thousand_teeth_keeps_its_area() {
        let points = saw(2000);
        let triangles = triangulate(&points);
        assert_eq!(triangles.len(), 2000);
        assert!(triangles.iter().all(|&t| area(&points, t) >= 0.0));
        let total: f64 = triangles.iter().map(|&t| area(&points, t)).sum();
        assert!((total - (1999.0 * 1.5 + 1.0)).abs() < 2.0, "{total}");
    }

    #[test]
    fn a_polygon_made_to_be_slow_becomes_a_fan() {
        // An inward spiral of triangles: each corner's triangle contains all later corners, so the search for the ear
        // at the inner end would examine n² / 4 corners.
        let spiral = |n: u32| -> Vec<[f64; 2]> {
            let corners = [[1.0, 0.0], [-0.5, 0.9], [-0.5, -0.9]];
            let at = |i: u32| corners[i as usize % 3].map(|x| x * (1.0 - f64::from(i) / f64::from(n + 1)));
            (0..n).map(at).chain([[2.0, 0.5]]).collect()
        };
        let long = spiral(20_000);
        let ring: Vec<usize> = (0..long.len()).collect();
        assert!((0..long.len()).rev().any(|i| is_ear(&long, &ring, i, &mut usize::MAX.clone())), "no ear");
        assert!(!is_ear(&long, &ring, 100, &mut usize::MAX.clone()));
        assert!(cut_ears(&long).is_none());
        let points: Vec<[f64; 3]> = long.iter().map(|p| [p[0], p[1], 0.0]).collect();
        assert_eq!(triangulate(&points), fan(points.len()));
    }

    #[test]
    fn collapsed_and_crossing_polygons_still_give_n_minus_2_triangles() {
        assert_eq!(triangulate(&[[1.0; 3]; 5]).len(), 3);
        let bow = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(triangulate(&bow).len(), 2);
        assert!(triangulate(&[[0.0; 3]; 2]).is_empty());
    }
}
