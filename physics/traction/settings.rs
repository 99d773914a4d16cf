//! Settings of tyres.

rigsim_settings::settings! {
    /// Wheels and tyres.
    pub struct TyreSettings {
        /// Rolling radius of a wheel.
        wheel_radius: f64 = 0.25, unit "m", range 0.01..=2.0,
            assumed "the manual's 1.4 m/s then needs about 1513 motor rpm";
        /// Force along the wheel per unit of slip, as a multiple of the load.
        longitudinal_stiffness: f64 = 10.0, range 0.5..=100.0,
            assumed "tyres on soil, 5 to 20 in the literature";
        /// Force across the wheel per radian of slip angle, as a multiple of the load.
        lateral_stiffness: f64 = 6.0, range 0.5..=100.0,
            assumed "tyres on soil give sideways sooner than along, about 0.6 to 1";
        /// Distance rolled in which the tyre takes up most of a change of slip.
        relaxation_length: f64 = 0.1, unit "m", range 0.005..=2.0,
            assumed "a fraction of the wheel radius for a stout low-pressure tyre";
        /// Rolling resistance, as a share of the load.
        rolling_resistance: f64 = 0.05, range 0.0..=0.5,
            assumed "tyres on grass or firm soil, 0.03 to 0.08 in textbooks";
    }
}
