//! Speed of the camera, to predict how far it moves within a round trip.

use std::time::Duration;

use lodestream_protocol::time::Time;

/// Time without movement after which the camera counts as resting; a later movement counts as a jump.
const REST: Duration = Duration::from_millis(250);

/// Speed of the camera, from its last two positions.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Motion {
    moved_at: Option<Time>,
    /// World units per second.
    speed: f64,
}

impl Motion {
    /// Records a movement of the eye.
    pub(crate) fn record_move(&mut self, now: Time, from: Option<[f64; 3]>, to: [f64; 3]) {
        let since = self.moved_at.map(|moved| now.since(moved)).filter(|since| *since <= REST);
        let squares = from.map(|from| (0..3).map(|axis| (to[axis] - from[axis]).powi(2)).sum::<f64>());
        self.speed = match (since, squares) {
            (Some(since), Some(squares)) if !since.is_zero() => squares.sqrt() / since.as_secs_f64(),
            // Two movements at the same time.
            (Some(_), Some(_)) => self.speed,
            _ => 0.0,
        };
        self.moved_at = Some(now);
    }

    /// Distance that the eye moves within a time, in world units; 0 while it rests.
    pub(crate) fn distance_within(&self, now: Time, within: Duration) -> f32 {
        let moves = self.moved_at.is_some_and(|moved| now.since(moved) <= REST);
        if moves { (self.speed * within.as_secs_f64()) as f32 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_eye_has_a_distance_and_a_jumping_or_resting_one_has_none() {
        let round_trip = Duration::from_millis(100);
        let mut motion = Motion::default();
        motion.record_move(Time::from_ms(0), Some([0.0; 3]), [0.0, 0.0, 5.0]);
        assert_eq!(motion.distance_within(Time::from_ms(1), round_trip), 0.0, "its first place");
        motion.record_move(Time::from_ms(100), Some([0.0, 0.0, 5.0]), [3.0, 4.0, 5.0]);
        assert_eq!(motion.distance_within(Time::from_ms(110), round_trip), 5.0);
        motion.record_move(Time::from_ms(100), Some([3.0, 4.0, 5.0]), [3.0, 4.0, 6.0]);
        assert_eq!(motion.distance_within(Time::from_ms(110), round_trip), 5.0);
        assert_eq!(motion.distance_within(Time::from_ms(400), round_trip), 0.0, "it rests");
        motion.record_move(Time::from_ms(900), Some([3.0, 4.0, 6.0]), [99.0, 4.0, 6.0]);
        assert_eq!(motion.distance_within(Time::from_ms(901), round_trip), 0.0, "it has jumped");
    }
}
