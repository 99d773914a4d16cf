//! Mechanical faults: motors, wheels, brakes, load, ground.

/// Hands these faults on, behind those that come before them, to the next in the row.
macro_rules! mechanical {
    ({ $next:ident $($later:ident)* } $($before:tt)*) => { $next! { { $($later)* } $($before)*

    /// Mechanical faults: motors, wheels, brakes, load, ground.
    Mechanical MechanicalFault {

    /// Wheels cannot turn.
    Blocked = "blocked", false,
    sees "No speed from there although driven; an R150's bus voltage falls and fuses may blow; a car's motion does not end.",
    counts "A blocked wheel was driven.",
    motors "Motors, or wheels of a car."
    {}
    /// Something drags on wheels.
    Dragging = "dragging", false,
    sees "Less speed, and a vehicle that pulls to one side.",
    counts "A dragged wheel was driven or turned.",
    motors "Motors, or wheels of a car."
    {
        /// Torque at the wheels of a side, or at one wheel of a car; 100 N*m for an R150 and
        /// 0.5 N*m for a car unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        torque: Option<Torque>,
    }
    /// Motors neither drive nor hold their wheels.
    FreeWheeling = "free-wheeling", false,
    sees "Wheels that turn only as the others drag them, and less speed.",
    counts "A motor without effect was driven.",
    motors "Motors, or wheels of a car."
    {}
    /// The cables of encoders are off.
    EncoderLost = "encoder-lost", false,
    sees "Speed 0 while driving; a car's motion does not end.",
    counts "A wheel turned unseen.",
    motors "Motors, or wheels of a car."
    {}
    /// Encoders repeat what they gave last.
    EncoderStuck = "encoder-stuck", false,
    sees "A speed that does not change; a car's pulses come all at once at the end.",
    counts "A wheel turned at another speed than the encoder gave.",
    motors "Motors, or wheels of a car."
    {}
    /// Interference spoils encoders.
    EncoderNoisy = "encoder-noisy", false,
    sees "Speeds that jump about; a car that thinks it has gone farther, even standing.",
    counts "A reading was spoilt.",
    motors "Motors, or wheels of a car."
    {
        /// Spread of an R150's readings, in r/min of the motor; 50 unless given.
        #[serde(default = "defaults::spread")]
        spread_rpm: u16,
        /// Pulses a second that a car gets on top; 20 unless given.
        #[serde(default = "defaults::pulses")]
        pulses_per_second: u16,
    }
    /// Motors are wired backwards; their encoders are not.
    WiredBackwards = "wired-backwards", false,
    sees "An R150's speed with the wrong sign; a car that turns away while its packets say all is well.",
    counts "Such a motor was driven.",
    motors "Motors, or wheels of a car."
    {}
    /// Two motors are plugged into one another's ports.
    PortsSwapped = "ports-swapped", false,
    sees "A car that moves otherwise than its packets say.",
    counts "One of the two ports was driven.",
    {
        /// One port.
        port: PortName,
        /// The other.
        with: PortName,
    }
    /// The cables of the two sides, motors and encoders, are swapped.
    SidesSwapped = "sides-swapped", false,
    sees "Left turns become right turns, although the reported speeds are as expected.",
    counts "The sides were driven differently.",
    {}
    /// The ground under the wheels is slippery.
    Ice = "ice", true,
    sees "Speeds of wheels that spin; the vehicle itself lags behind and slides.",
    counts "The vehicle was driven or moved.",
    {
        /// Most friction; 0.05 unless given.
        #[serde(default = "defaults::ice")]
        friction: Probability,
    }
    /// Something heavy lies on the deck.
    Payload = "payload", true,
    sees "Slower starts and longer stops; more current.",
    counts "The vehicle was driven or moved.",
    {
        /// Mass of the payload.
        mass: Mass,
    }
    /// Something pushes the vehicle.
    Push = "push", true,
    sees "Speeds that it did not ask for, or none; it may be pushed with its brakes on.",
    counts "The push was there.",
    {
        /// Ahead; 0 unless given.
        #[serde(default = "defaults::no_force")]
        ahead: Force,
        /// To the left; 0 unless given.
        #[serde(default = "defaults::no_force")]
        left: Force,
        /// Counter-clockwise; 0 unless given.
        #[serde(default = "defaults::no_torque")]
        turn: Torque,
    }
    /// Brakes do not release: the R150's parking brake, or the motor brakes of the car.
    BrakeStuckOn = "brake-stuck-on", false,
    sees "Little or no speed although driven.",
    counts "A braked wheel was driven.",
    motors "Motors, or wheels of a car; all unless given." or "defaults::all_motors"
    {}
    /// Brakes do not hold: the R150's parking brake, or the motor brakes of the car.
    BrakeStuckOpen = "brake-stuck-open", false,
    sees "A parked vehicle that rolls on a slope or when pushed.",
    counts "The brake should have held.",
    motors "Motors, or wheels of a car; all unless given." or "defaults::all_motors"
    {}

    } } };
}
