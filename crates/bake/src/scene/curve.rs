//! Curves through the positions of a river.

use glam::DVec2;
use lodestream_terrain::MAX_RIVER_POINTS;

/// A centripetal Catmull–Rom curve (Yuksel et al., "Parameterization and applications of Catmull–Rom curves", 2011)
/// through 2 to 8 positions, as many positions as a river bed may have: as many between each two. It has neither loops
/// nor cusps within a segment. Positions that are listed twice in a row count once.
pub(super) fn curve(line: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, String> {
    let mut through: Vec<DVec2> = line.iter().copied().map(DVec2::from).collect();
    through.dedup();
    let most = MAX_RIVER_POINTS / 2;
    if !(2..=most).contains(&through.len()) {
        return Err(format!(
            "a smooth line of {} positions, must have 2 and at most {most} positions",
            through.len()
        ));
    }
    let last = through.len() - 1;
    let between = (MAX_RIVER_POINTS - through.len()) / last;
    let mut curve = Vec::with_capacity(MAX_RIVER_POINTS);
    for i in 0..last {
        let [b, c] = [through[i], through[i + 1]];
        // Beyond its ends it goes on as a mirror of itself.
        let a = if i > 0 { through[i - 1] } else { 2.0 * b - c };
        let d = if i + 1 < last { through[i + 2] } else { 2.0 * c - b };
        curve.push(b);
        let share = |k: usize| k as f64 / (between + 1) as f64;
        curve.extend((1..=between).map(|k| at([a, b, c, d], share(k))));
    }
    curve.push(through[last]);
    Ok(curve.iter().map(DVec2::to_array).collect())
}

/// The place at a share of the way from the second to the third of four positions (Barry and Goldman's pyramid).
fn at([a, b, c, d]: [DVec2; 4], share: f64) -> DVec2 {
    let step = |p: DVec2, q: DVec2| p.distance(q).sqrt();
    let t0 = 0.0;
    let t1 = t0 + step(a, b);
    let t2 = t1 + step(b, c);
    let t3 = t2 + step(c, d);
    let t = t1 + (t2 - t1) * share;
    let mix = |p: DVec2, q: DVec2, from: f64, to: f64| p.lerp(q, (t - from) / (to - from));
    let (ab, bc, cd) = (mix(a, b, t0, t1), mix(b, c, t1, t2), mix(c, d, t2, t3));
    mix(mix(ab, bc, t0, t2), mix(bc, cd, t1, t3), t1, t2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_are_spread_over_the_positions_between() {
        let given = [[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [220.0, 130.0]];
        let turns = |line: &[[f64; 2]]| {
            let direction = |pair: &[[f64; 2]]| (DVec2::from(pair[1]) - DVec2::from(pair[0])).to_angle();
            let directions: Vec<f64> = line.windows(2).map(direction).collect();
            directions.windows(2).map(|pair| (pair[1] - pair[0]).abs().to_degrees()).fold(0.0, f64::max)
        };
        let smooth = curve(&given).unwrap();
        assert_eq!(smooth.len(), 16);
        assert!(given.iter().all(|position| smooth.contains(position)));
        assert!(turns(&given) > 75.0 && turns(&smooth) < 50.0, "{} {}", turns(&given), turns(&smooth));
        assert!(smooth.iter().flatten().all(|x| x.is_finite()));
    }

    #[test]
    fn a_straight_line_stays_one_and_repeated_positions_count_once() {
        let smooth = curve(&[[0.0, 0.0], [0.0, 0.0], [30.0, 60.0]]).unwrap();
        assert_eq!(smooth.len(), 16);
        assert!(smooth.iter().all(|[x, y]| (y - 2.0 * x).abs() < 1e-9));
        assert!(curve(&[[1.0, 1.0], [1.0, 1.0]]).is_err());
    }
}
