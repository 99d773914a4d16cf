//! The sensors that look at the world, each at its own pace.

use std::time::Duration;

use super::settings::MecanumPlantSettings;
use super::signals::{ECHOES, MecanumMeasurements};
use crate::noise::Noise;
use crate::pose::BodyMotion;
use crate::world::{BodyId, Cone, World};

/// Distance between two channels of the magnetic bar, m; assumed: common bars, 16 channels on 160 mm.
const CHANNEL_SPACING: f64 = 0.01;
/// Distance from the middle line of a strip at which a channel sees it, m; assumed: tape of 50 mm.
const STRIP_HALF_WIDTH: f64 = 0.025;

/// Place of the bar's middle ahead of the car's, m; assumed: near the front edge.
const BAR_AHEAD: f64 = 0.15;
/// Place of the infrared sensor ahead of the car's middle, m; assumed: on the front edge.
const BEAM_AHEAD: f64 = 0.17;
/// Distance up to which the infrared sensor detects something, m; assumed: a reflective switch.
const BEAM_RANGE: f64 = 0.3;
/// Distance from the reader, under the middle of the car, at which a tag may lie, m; assumed: a small coil
/// just above the ground.
const READER_RADIUS: f64 = 0.04;

/// Time between two readings of the infrared sensor: short compared with the status packet.
const BEAM_PERIOD: Duration = Duration::from_millis(20);
/// Time between two readings of RFID: common readers, 20 tags a second.
const READER_PERIOD: Duration = Duration::from_millis(50);
/// Time between two readings of the magnetic bar: common bars, 100 a second.
const BAR_PERIOD: Duration = Duration::from_millis(10);

/// All sensors with their mounting.
#[derive(Debug, Clone)]
pub(super) struct Sensors {
    cones: [Mount; ECHOES],
    beam: Mount,
    channels: [[f64; 2]; 16],
    /// Of ultrasonic, infrared, reader and bar.
    paces: [Pace; 4],
    /// Of a distance, m.
    noise: f64,
    crosstalk: f64,
    pub(super) chance: Noise,
    /// The last readings; supply and pulses are not theirs.
    pub(super) readings: MecanumMeasurements,
}

/// A cone in the axes of the body.
#[derive(Debug, Clone, Copy)]
struct Mount {
    /// Ahead, left, m.
    place: [f64; 2],
    /// Unit vector ahead, left.
    direction: [f64; 2],
    /// Cosine and sine.
    half_opening: [f64; 2],
    /// Cosine of the greatest angle of an echo.
    grazing: f64,
    range: f64,
}

/// When a sensor looks.
#[derive(Debug, Clone, Copy)]
struct Pace {
    period: Duration,
    since: Duration,
    /// The world as it was when the sensor last looked.
    changes: u64,
}

impl Sensors {
    pub(super) fn new(settings: &MecanumPlantSettings) -> Self {
        let ultrasonic = &settings.ultrasonic;
        let mount = |x: f64, y: f64, degrees: f64, half_angle: f64, grazing: f64, range: f64| {
            let (angle, half) = (degrees.to_radians(), half_angle.to_radians());
            Mount {
                place: [x, y],
                direction: [libm::cos(angle), libm::sin(angle)],
                half_opening: [libm::cos(half), libm::sin(half)],
                grazing,
                range,
            }
        };
        // At 90° a surface is visible from every angle.
        let grazing = if ultrasonic.incidence < 90.0 {
            libm::cos(ultrasonic.incidence.to_radians())
        } else {
            0.0
        };
        let periods = [ultrasonic.period, BEAM_PERIOD, READER_PERIOD, BAR_PERIOD];
        Self {
            cones: std::array::from_fn(|index| {
                mount(
                    ultrasonic.x[index],
                    ultrasonic.y[index],
                    ultrasonic.angle[index],
                    ultrasonic.half_angle,
                    grazing,
                    ultrasonic.range,
                )
            }),
            beam: mount(BEAM_AHEAD, 0.0, 0.0, 0.0, 0.0, BEAM_RANGE),
            channels: [
                7.5, 6.5, 5.5, 4.5, 3.5, 2.5, 1.5, 0.5, -0.5, -1.5, -2.5, -3.5, -4.5, -5.5, -6.5,
                -7.5,
            ]
            .map(|place| [BAR_AHEAD, place * CHANNEL_SPACING]),
            paces: periods.map(|period| Pace {
                period,
                since: Duration::ZERO,
                changes: 0,
            }),
            noise: ultrasonic.noise,
            crosstalk: ultrasonic.crosstalk / 100.0,
            chance: Noise::new(0, "ultrasonic"),
            readings: MecanumMeasurements::default(),
        }
    }

    /// Reads the sensors that are due, if anything has changed since their last reading.
    pub(super) fn measure_due(
        &mut self,
        step: Duration,
        world: &World,
        body: BodyId,
        motion: &BodyMotion,
    ) {
        let changes = world.changes();
        let [ultrasonic, beam, reader, bar] =
            self.paces.each_mut().map(|pace| pace.is_due(step, changes));
        if ultrasonic {
            self.listen(world, body, motion);
        }
        if beam {
            self.look_ahead(world, body, motion);
        }
        if reader {
            self.read_tag(world, motion);
        }
        if bar {
            self.read_bar(world, motion);
        }
    }

    /// Reads all sensors at once.
    pub(super) fn look(&mut self, world: &World, body: BodyId, motion: &BodyMotion) {
        for pace in &mut self.paces {
            pace.since = Duration::ZERO;
            pace.changes = world.changes();
        }
        self.listen(world, body, motion);
        self.look_ahead(world, body, motion);
        self.read_tag(world, motion);
        self.read_bar(world, motion);
    }

    fn listen(&mut self, world: &World, body: BodyId, motion: &BodyMotion) {
        let echoes = self
            .cones
            .map(|mount| world.nearest_echo(&mount.cone(motion), Some(body)));
        for (index, heard) in self.readings.echoes.iter_mut().enumerate() {
            let mut echo = echoes[index];
            // The neighbour of each of the pairs on either side.
            if self.crosstalk > 0.0 && self.chance.uniform() < self.crosstalk {
                echo = echo.into_iter().chain(echoes[index ^ 1]).reduce(f64::min);
            }
            *heard = echo.map(|distance| {
                if self.noise > 0.0 {
                    (distance + self.noise * self.chance.normal())
                        .clamp(0.0, self.cones[index].range)
                } else {
                    distance
                }
            });
        }
    }

    fn look_ahead(&mut self, world: &World, body: BodyId, motion: &BodyMotion) {
        let cone = self.beam.cone(motion);
        self.readings.obstacle_ahead = world.nearest_echo(&cone, Some(body)).is_some();
    }

    fn read_tag(&mut self, world: &World, motion: &BodyMotion) {
        let tag = world.tag_near([motion.x, motion.y], READER_RADIUS);
        self.readings.tag = tag.map_or(0, |tag| tag.number);
    }

    fn read_bar(&mut self, world: &World, motion: &BodyMotion) {
        let points = self.channels.map(|place| in_world(motion, place));
        self.readings.magnetic_bar = world.strips_under(&points, STRIP_HALF_WIDTH);
    }
}

impl Mount {
    fn cone(&self, motion: &BodyMotion) -> Cone {
        Cone {
            origin: in_world(motion, self.place),
            direction: motion.to_world(self.direction),
            half_opening: self.half_opening,
            grazing: self.grazing,
            range: self.range,
        }
    }
}

impl Pace {
    fn is_due(&mut self, step: Duration, changes: u64) -> bool {
        self.since += step;
        if self.since < self.period {
            return false;
        }
        // Steps that do not divide the period must not slow it, and a long rest is made up for once.
        self.since = (self.since - self.period).min(self.period);
        let due = self.changes != changes;
        self.changes = changes;
        due
    }
}

fn in_world(motion: &BodyMotion, place: [f64; 2]) -> [f64; 2] {
    let [x, y] = motion.to_world(place);
    [motion.x + x, motion.y + y]
}
