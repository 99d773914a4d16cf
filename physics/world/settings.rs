//! Settings of the world.

use std::time::Duration;

sim_settings::settings! {
    /// The plane that all vehicles share.
    pub struct WorldSettings {
        /// Length of one physics step.
        step: Duration = Duration::from_millis(5),
            range Duration::from_micros(500)..=Duration::from_millis(10),
            assumed "short against the motors' response, 200 steps a second";
        /// Acceleration of gravity.
        gravity: f64 = 9.81, unit "m/s^2", range 0.1..=30.0, assumed "standard value near sea level";
        /// Coefficient of friction between tyre and ground.
        friction: f64 = 0.8, range 0.0..=2.0,
            assumed "rubber on dry firm ground, 0.7 to 0.9 in textbooks";
        /// Slope of the ground.
        slope: f64 = 0.0, unit "deg", range -45.0..=45.0, assumed "flat unless chosen";
        /// Direction in which the ground rises, counter-clockwise from the x axis.
        uphill: f64 = 0.0, unit "deg", range -360.0..=360.0, assumed "uphill is straight ahead";
        /// Coefficient of friction between a vehicle's body and what it hits.
        wall_friction: f64 = 0.3, range 0.0..=2.0, assumed "painted metal on a wall";
    }
}
