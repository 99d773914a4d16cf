//! Motions: the one that runs, those that wait, and when each wheel has turned far enough.

use std::collections::VecDeque;
use std::fmt;

use sim_physics::mecanum::WHEELS;

use super::kinematics::Movement;

/// A movement with its distance and speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Which way.
    pub movement: Movement,
    /// How far each driven wheel turns, 1/10 revolution.
    pub tenths: u32,
    /// How fast it turns, r/min, never negative.
    pub speed_rpm: f64,
}

impl Motion {
    /// Whether there is nothing to do: no distance, or no speed.
    #[must_use]
    pub fn is_nothing(&self) -> bool {
        self.tenths == 0 || self.speed_rpm <= 0.0
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (whole, tenth) = (self.tenths / 10, self.tenths % 10);
        let (movement, speed) = (self.movement, self.speed_rpm);
        write!(f, "{movement} {whole}.{tenth} rev at {speed} rpm")
    }
}

/// The motion that runs.
#[derive(Debug, Clone)]
struct Running {
    motion: Motion,
    /// Pulses that each wheel has still to turn.
    pulses_left: [u64; WHEELS],
}

/// What happened to a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// It runs.
    Started(Motion),
    /// Its wheels have turned far enough.
    Done(Motion),
}

/// The motion that runs and those that wait.
#[derive(Debug, Clone)]
pub struct Motions {
    most_waiting: usize,
    pulses_per_revolution: u32,
    running: Option<Running>,
    waiting: VecDeque<Motion>,
}

impl Motions {
    /// None, with room for `most_waiting` beside the one that runs.
    #[must_use]
    pub fn new(most_waiting: usize, pulses_per_revolution: u32) -> Self {
        Self {
            most_waiting,
            pulses_per_revolution,
            running: None,
            waiting: VecDeque::new(),
        }
    }

    /// Appends a motion; false if there is no room.
    pub fn append(&mut self, motion: Motion, changed: &mut impl FnMut(Change)) -> bool {
        if self.running.is_some() && self.waiting.len() >= self.most_waiting {
            return false;
        }
        self.waiting.push_back(motion);
        self.start_next(changed);
        true
    }

    /// Discards all; says how many there were.
    pub fn discard(&mut self) -> usize {
        let waiting = std::mem::take(&mut self.waiting).len();
        waiting + usize::from(self.running.take().is_some())
    }

    /// The wheels have turned by these pulses, whichever way.
    pub fn turned(&mut self, pulses: [u32; WHEELS], changed: &mut impl FnMut(Change)) {
        let Some(running) = &mut self.running else {
            return;
        };
        for (left, pulses) in running.pulses_left.iter_mut().zip(pulses) {
            *left = left.saturating_sub(u64::from(pulses));
        }
        if running.pulses_left == [0; WHEELS] {
            changed(Change::Done(running.motion));
            self.running = None;
            self.start_next(changed);
        }
    }

    /// The motion that runs.
    #[must_use]
    pub fn running(&self) -> Option<&Motion> {
        self.running.as_ref().map(|running| &running.motion)
    }

    /// How many motions wait.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// How each wheel is driven now; one that has turned far enough has stopped.
    #[must_use]
    pub fn rotations(&self) -> [i8; WHEELS] {
        let Some(running) = &self.running else {
            return [0; WHEELS];
        };
        let rotations = running.motion.movement.rotations();
        std::array::from_fn(|wheel| match running.pulses_left[wheel] {
            0 => 0,
            _ => rotations[wheel],
        })
    }

    /// Starts the next motion if none runs; those with nothing to do end as they come.
    fn start_next(&mut self, changed: &mut impl FnMut(Change)) {
        while self.running.is_none() {
            let Some(motion) = self.waiting.pop_front() else {
                return;
            };
            if motion.is_nothing() {
                continue;
            }
            let pulses = u64::from(motion.tenths) * u64::from(self.pulses_per_revolution);
            // The first pulse at or beyond the distance ends it.
            let pulses = pulses.div_ceil(10);
            self.running = Some(Running {
                motion,
                pulses_left: motion.movement.rotations().map(|rotation| match rotation {
                    0 => 0,
                    _ => pulses,
                }),
            });
            changed(Change::Started(motion));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::Course;
    use super::*;

    fn motion(course: Course, tenths: u32) -> Motion {
        Motion {
            movement: Movement {
                course,
                negative: false,
            },
            tenths,
            speed_rpm: 30.0,
        }
    }

    fn changes(of: impl FnOnce(&mut dyn FnMut(Change))) -> Vec<Change> {
        let mut seen = Vec::new();
        of(&mut |change| seen.push(change));
        seen
    }

    #[test]
    fn each_wheel_stops_by_itself_and_the_last_ends_the_motion() {
        let mut motions = Motions::new(16, 60);
        let ahead = motion(Course::Ahead, 10);
        let left = motion(Course::LeftFront, 1);
        assert!(motions.append(ahead, &mut |_| ()));
        assert!(motions.append(left, &mut |_| ()));
        assert_eq!(motions.rotations(), [1; 4]);
        assert_eq!(
            changes(|c| motions.turned([59, 60, 61, 59], &mut |x| c(x))),
            []
        );
        assert_eq!(motions.rotations(), [1, 0, 0, 1]);
        assert_eq!(changes(|c| motions.turned([1, 9, 9, 0], &mut |x| c(x))), []);
        assert_eq!(motions.rotations(), [0, 0, 0, 1]);
        let seen = changes(|c| motions.turned([0, 0, 0, 1], &mut |x| c(x)));
        assert_eq!(seen, [Change::Done(ahead), Change::Started(left)]);
        assert_eq!(motions.rotations(), [0, 1, 1, 0]);
        let seen = changes(|c| motions.turned([0, 6, 6, 0], &mut |x| c(x)));
        assert_eq!(seen, [Change::Done(left)]);
        assert_eq!(motions.rotations(), [0; 4]);
    }

    #[test]
    fn the_queue_has_its_length_beside_the_motion_that_runs() {
        let mut motions = Motions::new(2, 60);
        let one = motion(Course::Ahead, 1);
        for _ in 0..3 {
            assert!(motions.append(one, &mut |_| ()));
        }
        assert!(!motions.append(one, &mut |_| ()));
        assert_eq!(motions.waiting(), 2);
        assert_eq!(motions.discard(), 3);
        assert_eq!(motions.discard(), 0);
        assert_eq!(motions.running(), None);
    }

    #[test]
    fn motions_without_distance_or_speed_end_as_they_come() {
        let mut motions = Motions::new(16, 60);
        let nothing = motion(Course::Strafe, 0);
        let still = Motion {
            speed_rpm: 0.0,
            ..motion(Course::Strafe, 5)
        };
        let ahead = motion(Course::Ahead, 1);
        assert!(motions.append(nothing, &mut |_| ()));
        assert_eq!(motions.running(), None);
        for next in [ahead, nothing, still, ahead] {
            assert!(motions.append(next, &mut |_| ()));
        }
        let seen = changes(|c| motions.turned([6; 4], &mut |x| c(x)));
        assert_eq!(seen, [Change::Done(ahead), Change::Started(ahead)]);
    }

    #[test]
    fn a_distance_between_pulses_ends_at_the_pulse_beyond() {
        let mut motions = Motions::new(16, 7);
        motions.append(motion(Course::Ahead, 1), &mut |_| ());
        assert_eq!(motions.rotations(), [1; 4]);
        motions.turned([1; 4], &mut |_| ());
        assert_eq!(motions.running(), None);
        motions.append(motion(Course::Ahead, 15), &mut |_| ());
        motions.turned([10; 4], &mut |_| ());
        assert_eq!(motions.rotations(), [1; 4]);
        motions.turned([1; 4], &mut |_| ());
        assert_eq!(motions.running(), None);
    }
}
