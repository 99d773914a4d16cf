//! Faults of the firmware: bugs in the device's program.

/// Hands these faults on, behind those that come before them, to the next in the row.
macro_rules! firmware {
    ({ $next:ident $($later:ident)* } $($before:tt)*) => { $next! { { $($later)* } $($before)*

    /// Faults of the firmware: bugs in the device's program.
    Firmware FirmwareFault {

    /// The firmware restarts: everything it drives goes off, and it hears nothing until it is up.
    Reset = "reset", false,
    sees "Silence for the boot time; then rails and PWM off, control with the app, motions forgotten.",
    counts "The firmware ran and was reset.",
    {
        /// Until it is up again; 500 ms unless given. It takes that long even if the fault ends.
        #[serde(default = "defaults::boot")]
        boot: Span,
    }
    /// The firmware hangs: nothing is answered or timed out, and outputs stay as they are.
    Hang = "hang", false,
    sees "Silence, while the vehicle goes on with what it last did.",
    counts "A byte was not heard, or a packet not sent.",
    {}
    /// The firmware is slow to answer; a car's to send its next packet.
    SlowReplies = "slow-replies", false,
    sees "Replies that come later; status packets that come more rarely.",
    counts "A frame was late.",
    {
        /// By how much; 200 ms unless given.
        #[serde(default = "defaults::slow")]
        by: Span,
    }
    /// The firmware no longer updates the status it reports.
    StuckStatus = "stuck-status", false,
    sees "`sysStatus`, modes and switched outputs, or `moto_state`, as they were; the rest is live.",
    counts "A reply carried old status that is no longer true.",
    {}
    /// The firmware no longer reads its sensors, and acts on what it read last.
    FrozenSensors = "frozen-sensors", false,
    sees "Speeds, voltages, currents and temperatures, or distances, tag and strip, that never change.",
    counts "A sensor would have read something else.",
    {}
    /// The firmware's watchdog does not fire: an R150's for motor commands; a car's `link_timeout`.
    WatchdogOff = "watchdog-off", false,
    sees "A vehicle that goes on although it sends nothing.",
    counts "The watchdog should have stopped it.",
    {}

    } } };
}
