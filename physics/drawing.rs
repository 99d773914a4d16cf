//! Outlines of vehicles from above.

use crate::mecanum::MecanumPlant;
use crate::r150::R150Plant;

/// Width of a wheel as it is drawn, as a share of its diameter; of no effect on anything else.
const WIDTH: f64 = 0.4;

/// Outline of a vehicle from above, in its own axes: m ahead and left of its middle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Drawing {
    /// Its wheels.
    pub wheels: Vec<WheelDrawing>,
    /// Its sensors that measure distances.
    pub echoes: Vec<EchoDrawing>,
}

/// A wheel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelDrawing {
    /// Its middle.
    pub place: [f64; 2],
    /// Its diameter, m.
    pub length: f64,
    /// m
    pub width: f64,
    /// Speed at which it turns, rad/s, positive ahead.
    pub speed: f64,
}

/// A sensor that measures distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EchoDrawing {
    /// Place of it.
    pub place: [f64; 2],
    /// Direction in which it looks, rad.
    pub heading: f64,
    /// From side to side of what it sees, rad.
    pub opening: f64,
    /// Range, m.
    pub range: f64,
    /// Distance that it has seen last, m.
    pub distance: Option<f64>,
}

fn wheel(place: [f64; 2], radius: f64, speed: f64) -> WheelDrawing {
    WheelDrawing {
        place,
        length: 2.0 * radius,
        width: 2.0 * radius * WIDTH,
        speed,
    }
}

impl R150Plant {
    /// Draws it as it is now.
    pub(crate) fn outline(&self) -> Drawing {
        let body = &self.settings.body;
        let radius = self.settings.tyre.wheel_radius;
        let (x, y) = (body.wheelbase / 2.0, body.track / 2.0);
        let speed = self.truth().wheel_speed;
        let wheels = [x, -x].into_iter().flat_map(|x| {
            [(y, speed.left), (-y, speed.right)].map(|(y, speed)| wheel([x, y], radius, speed))
        });
        Drawing {
            wheels: wheels.collect(),
            echoes: Vec::new(),
        }
    }
}

impl MecanumPlant {
    /// Draws it as it is now.
    pub(crate) fn outline(&self) -> Drawing {
        let settings = &self.settings;
        let (x, y) = (settings.body.half_wheelbase, settings.body.half_track);
        let radius = settings.wheel.radius;
        let places = [[x, y], [x, -y], [-x, y], [-x, -y]];
        let speeds = self.truth().wheel_speed;
        let wheels = places.into_iter().zip(speeds);
        let ultrasonic = &settings.ultrasonic;
        let echoes = self.measurements().echoes.into_iter().enumerate();
        let echo = |(index, distance): (usize, Option<f64>)| EchoDrawing {
            place: [ultrasonic.x[index], ultrasonic.y[index]],
            heading: ultrasonic.angle[index].to_radians(),
            opening: 2.0 * ultrasonic.half_angle.to_radians(),
            range: ultrasonic.range,
            distance,
        };
        Drawing {
            wheels: wheels
                .map(|(place, speed)| wheel(place, radius, speed))
                .collect(),
            echoes: echoes.map(echo).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mecanum::signals::Wheel;
    use crate::{MecanumPlantSettings, Pose, R150PlantSettings, World, WorldSettings};

    #[test]
    fn wheels_are_where_the_settings_have_them_and_in_the_order_of_their_speeds() {
        let mut world = World::new(&WorldSettings::default());
        let settings = R150PlantSettings::default();
        let r150 = R150Plant::new(&settings, &mut world, Pose::default()).outline();
        assert_eq!(r150.wheels.len(), 4);
        assert_eq!(r150.wheels[0].place[0] * 2.0, settings.body.wheelbase);
        assert_eq!(r150.wheels[1].place[1] * -2.0, settings.body.track);
        // Beside nothing.
        let mut world = World::new(&WorldSettings::default());
        let settings = MecanumPlantSettings::default();
        let car = MecanumPlant::new(&settings, &mut world, Pose::default()).outline();
        for wheel in Wheel::ALL {
            let drawn = car.wheels[wheel.index()];
            assert_eq!(drawn.place[1] > 0.0, wheel.is_left(), "{}", wheel.name());
        }
        assert!(
            car.echoes
                .iter()
                .all(|echo| echo.distance.is_none() && echo.range > 0.0)
        );
    }
}
