//! Electrical faults: supply, outputs, fuses.

/// Hands these faults on, behind those that come before them, to the next in the row.
macro_rules! electrical {
    ({ $next:ident $($later:ident)* } $($before:tt)*) => { $next! { { $($later)* } $($before)*

    /// Electrical faults: supply, outputs, fuses.
    Electrical ElectricalFault {

    /// Something else hangs on an output. Give one of power, resistance and current.
    RailLoad = "rail-load", false,
    sees "Another current in 0x06; above the limit the output trips and `sysStatus` says so.",
    counts "The output was on.",
    {
        /// Output.
        rail: RailName,
        /// Power that it draws.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<Power>,
        /// Resistance of the load.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        resistance: Option<Resistance>,
        /// Current at the output's nominal voltage; the power stays the same at other voltages.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        current: Option<Current>,
    }
    /// An output is shorted.
    RailShort = "rail-short", false,
    sees "The output trips within a millisecond and `sysStatus` says so; 0x02 may answer false.",
    counts "The output was on.",
    {
        /// Output.
        rail: RailName,
    }
    /// Nothing hangs on an output any more.
    RailOpen = "rail-open", false,
    sees "No current from an output that is on.",
    counts "The output was on.",
    {
        /// Output.
        rail: RailName,
    }
    /// The supply sags.
    SupplySag = "supply-sag", false,
    sees "A lower `voltage_48v` and speed; under 39 V the power module fault and all outputs off.",
    counts "The supply was lower by 0.1 V or more.",
    {
        /// By how much, whatever is drawn; 10 V unless given.
        #[serde(default = "defaults::sag")]
        by: Voltage,
        /// In the way of the current, up to 10 ohm; none unless given.
        #[serde(default = "defaults::no_resistance")]
        resistance: Resistance,
    }
    /// A pair of 12 V outputs gets hot.
    OverTemperature = "over-temperature", false,
    sees "A high `temp_12v`; above 85 °C the pair goes off and `sysStatus` says so.",
    counts "The sensor read more than without the fault.",
    {
        /// Pair of outputs.
        pair: PairName,
        /// Temperature at least; 95 °C unless given.
        #[serde(default = "defaults::hot")]
        temperature: Temperature,
    }
    /// The power module is faulty.
    PowerModuleFault = "power-module-fault", false,
    sees "Bit 6 of `sysStatus`, and all outputs off.",
    counts "The module was powered.",
    {}
    /// The battery is empty; at the end it has what it would have had.
    BatteryEmpty = "battery-empty", false,
    sees "`soc` 0, a low voltage with the power module fault, and motors that do not turn.",
    counts "The battery had charge.",
    {}
    /// The battery suddenly has less charge, as with a bad cell; at the end it has it again.
    ChargeDrop = "charge-drop", false,
    sees "`soc` falls at once, and the voltage with it.",
    counts "The battery had charge.",
    {
        /// Part of the full charge that is lost; 50 % unless given.
        #[serde(default = "defaults::half")]
        by: Percent,
    }
    /// A fuse is blown; it is replaced at the end.
    FuseBlown = "fuse-blown", false,
    sees "A side that the other drags along; or, without the tail supply, a module that is silent.",
    counts "Current would have flowed through it.",
    {
        /// Fuse.
        fuse: FuseName,
    }
    /// The CAN from the module to the vehicle's controller fails, and only the module's client
    /// could notice.
    CanFailing = "can-failing", false,
    sees "Answers as ever, and speeds that do not follow, or follow late; after a while 0.",
    counts "The vehicle had heard another command than the module gave.",
    {
        /// By how much later the vehicle hears; never unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        delay: Option<Span>,
    }
    /// Board and motors have no supply.
    SupplyLost = "supply-lost", false,
    sees "Silence, then a board that has forgotten motions and position.",
    counts "The board was powered.",
    {}

    } } };
}
