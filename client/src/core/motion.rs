//! How fast the eye moves.

use std::time::Duration;

use lodestream_protocol::time::Time;

/// An eye that has not moved for so long rests; one that moves after so long has jumped.
const REST: Duration = Duration::from_millis(250);

/// Speed of the eye, by its last two places.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Motion {
    moved: Option<Time>,
    /// World units a second.
    speed: f64,
}

impl Motion {
    /// The eye is at another place now.
    pub(crate) fn moved(&mut self, now: Time, from: Option<[f64; 3]>, to: [f64; 3]) {
        let since = self.moved.map(|moved| now.since(moved)).filter(|since| *since <= REST);
        let squares = from.map(|from| (0..3).map(|axis| (to[axis] - from[axis]).powi(2)).sum::<f64>());
        self.speed = match (since, squares) {
            (Some(since), Some(squares)) if !since.is_zero() => squares.sqrt() / since.as_secs_f64(),
            // Moved twice at a time.
            (Some(_), Some(_)) => self.speed,
            _ => 0.0,
        };
        self.moved = Some(now);
    }

    /// How far it gets within a time, in world units; 0 while it rests.
    pub(crate) fn way(&self, now: Time, within: Duration) -> f32 {
        let moves = self.moved.is_some_and(|moved| now.since(moved) <= REST);
        if moves { (self.speed * within.as_secs_f64()) as f32 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_eye_that_moves_has_a_way_and_one_that_jumps_or_rests_has_none() {
        let round_trip = Duration::from_millis(100);
        let mut motion = Motion::default();
        motion.moved(Time::from_ms(0), Some([0.0; 3]), [0.0, 0.0, 5.0]);
        assert_eq!(motion.way(Time::from_ms(1), round_trip), 0.0, "its first place");
        motion.moved(Time::from_ms(100), Some([0.0, 0.0, 5.0]), [3.0, 4.0, 5.0]);
        assert_eq!(motion.way(Time::from_ms(110), round_trip), 5.0);
        motion.moved(Time::from_ms(100), Some([3.0, 4.0, 5.0]), [3.0, 4.0, 6.0]);
        assert_eq!(motion.way(Time::from_ms(110), round_trip), 5.0);
        assert_eq!(motion.way(Time::from_ms(400), round_trip), 0.0, "it rests");
        motion.moved(Time::from_ms(900), Some([3.0, 4.0, 6.0]), [99.0, 4.0, 6.0]);
        assert_eq!(motion.way(Time::from_ms(901), round_trip), 0.0, "it has jumped");
    }
}
