//! Deeds of people at the worst time.

/// Hands these faults on, behind those that come before them, to the next in the row.
macro_rules! operator {
    ({ $next:ident $($later:ident)* } $($before:tt)*) => { $next! { { $($later)* } $($before)*

    /// Deeds of people at the worst time.
    Operator OperatorFault {

    /// The emergency stop is pushed in, and pulled out at the end.
    EmergencyStop = "emergency-stop", false,
    sees "0x12 is answered but moves nothing; the parking brake stops the vehicle.",
    counts "It was out before.",
    {}
    /// Somebody takes the vehicle over with the remote control, and gives it back at the end.
    RemoteControlTakesOver = "remote-control-takes-over", false,
    sees "0x12 is answered but moves nothing; the speeds are those of the remote control.",
    counts "The vehicle was in autonomous mode, or a key is held.",
    {
        /// Key that is held down; none unless given, so that the vehicle rolls freely.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        key: Option<Key>,
    }
    /// Somebody locks the vehicle, and unlocks it at the end.
    Locked = "locked", false,
    sees "0x12 is answered but moves nothing; the vehicle stops.",
    counts "It was unlocked before.",
    {}
    /// The parking brake is put on, and released at the end.
    Parked = "parked", false,
    sees "0x12 is answered but moves nothing; the vehicle stops.",
    counts "It was released before.",
    {}
    /// The app takes control and keeps it, and gives it back at the end.
    AppTakesControl = "app-takes-control", false,
    sees "0x02 or 0x03 answer false; `powerCtrlMode` or `pwmCtrlMode` 1, and outputs go off.",
    counts "The app did not hold it before.",
    {
        /// Of the power outputs; yes unless given.
        #[serde(default = "defaults::yes")]
        power: bool,
        /// Of the PWM outputs; yes unless given.
        #[serde(default = "defaults::yes")]
        pwm: bool,
    }

    } } };
}
