//! Spread between the pieces of a kind.

use crate::noise::Noise;

rigsim_settings::words! {
    /// Source of the spread between the vehicles of one make.
    pub enum Tolerances {
        /// In the first run of a repetition by the name, in each further one by the seed.
        FirstByName = "first-by-name",
        /// By the name: the same vehicle in every run.
        ByName = "by-name",
        /// By the name and the seed: another vehicle of the same make for each seed.
        BySeed = "by-seed",
    }
}

rigsim_settings::settings! {
    /// Spread of the parts of one vehicle. What each is off by is drawn from the vehicle's name,
    /// and with `world.tolerances = "by-seed"` from the seed of the run too.
    pub struct ToleranceSettings {
        /// Most by which a motor is stronger or weaker than it should be.
        motor: f64 = 0.3, unit "%", range 0.0..=20.0,
            assumed "motors of one batch; data sheets allow several percent";
        /// Most by which a wheel is larger or smaller than it should be.
        wheel: f64 = 0.1, unit "%", range 0.0..=20.0,
            assumed "a quarter of a millimetre on 250, a little less air in one tyre than in another";
    }
}

/// Draws factors near 1 for the parts of one vehicle.
pub(crate) struct Draw(Noise);

impl Draw {
    /// The stream of the vehicle of this name; seed 0 is that of the name alone.
    pub(crate) fn of(name: &str, seed: u64) -> Self {
        Self(Noise::new(seed, &format!("{name}.tolerance")))
    }

    /// A factor of 1 ± so many percent.
    pub(crate) fn factor(&mut self, percent: f64) -> f64 {
        1.0 + percent / 100.0 * (2.0 * self.0.uniform() - 1.0)
    }
}
