//! Limits below which a vehicle counts as standing.

use std::time::Duration;

sim_settings::settings! {
    /// Limits below which a vehicle counts as standing.
    pub struct RestSettings {
        /// Speed of body and tyres under which it may stand.
        speed: f64 = 0.001, unit "m/s", range 0.0..=0.1, assumed "a millimetre a second";
        /// Time for which it must stay under that speed.
        settle_time: Duration = Duration::from_millis(250),
            range Duration::from_millis(10)..=Duration::from_secs(60),
            assumed "longer than half a swing on the tyres";
    }
}
