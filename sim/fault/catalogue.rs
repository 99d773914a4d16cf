//! Every fault with its parameters: one table, from which types, schema and documentation come.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sim_settings::{
    Current, Force, Length, Mass, Percent, Power, Resistance, Span, Temperature, Torque, Voltage,
};

use super::defaults;
use super::parameters::{
    Direction, EchoSensor, FuseName, HexBytes, Key, LinkName, Motors, PairName, PortName,
    Probability, RailName, WrongLength,
};
use super::{FaultInfo, FaultLevel, ParameterInfo};
use crate::device_kind::DeviceKind;

const BOTH: &[DeviceKind] = &DeviceKind::ALL;
const R150: &[DeviceKind] = &[DeviceKind::R150];
const CAR: &[DeviceKind] = &[DeviceKind::Mecanum];

/// Declares the type [`Fault`] and its catalogue. A parameter without `#[serde(…)]` must be given.
macro_rules! faults {
    ($(
        $(#[doc = $summary:literal])+
        $variant:ident = $id:literal, $level:ident, $devices:ident,
        sees $sees:literal, counts $counts:literal,
        { $(
            $(#[doc = $about:literal])+
            $(#[serde($($serde:tt)*)])?
            $field:ident: $type:ty,
        )* }
    )+) => {
        /// Something that goes wrong. In files a table with the fault's id as `kind` and its
        /// parameters beside it.
        #[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
        #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
        pub enum Fault { $(
            $(#[doc = $summary])+
            #[serde(rename = $id)]
            $variant { $(
                $(#[doc = $about])+
                $(#[serde($($serde)*)])?
                $field: $type,
            )* },
        )+ }

        impl Fault {
            /// What the catalogue says of it.
            #[must_use]
            pub fn info(&self) -> &'static FaultInfo {
                let mut place = 0;
                $(
                    if let Self::$variant { .. } = self {
                        return &CATALOGUE[place];
                    }
                    place += 1;
                )+
                &CATALOGUE[place % CATALOGUE.len()]
            }
        }

        const CATALOGUE: &[FaultInfo] = &[$( FaultInfo {
            id: $id,
            level: FaultLevel::$level,
            devices: $devices,
            parameters: &[$( ParameterInfo {
                name: stringify!($field),
                description: concat!($($about),+).trim_ascii_start(),
                required: {
                    let given: &[&str] = &[$(stringify!($($serde)*),)?];
                    given.is_empty()
                },
            } ),*],
            client_sees: $sees,
            counts: $counts,
            summary: concat!($($summary),+).trim_ascii_start(),
        } ),+];
    };
}

faults! {
    /// Single bits change on the wire.
    BitFlips = "bit-flips", Wire, BOTH,
    sees "Frames whose CRC is wrong, or packets with wrong values; its own requests get no answer.",
    counts "A bit was flipped.",
    {
        /// For each byte; 0.01 unless given.
        #[serde(default = "defaults::rarely")]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// Which way; both unless given.
        #[serde(default)]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Bytes are lost on the wire.
    DroppedBytes = "dropped-bytes", Wire, BOTH,
    sees "Frames that are too short, so that the next one is taken for their end.",
    counts "A byte was lost.",
    {
        /// For each byte; 0.01 unless given.
        #[serde(default = "defaults::rarely")]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// Which way; both unless given.
        #[serde(default)]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Bytes arrive twice.
    DuplicatedBytes = "duplicated-bytes", Wire, BOTH,
    sees "Frames with a byte too many.",
    counts "A byte was doubled.",
    {
        /// For each byte; 0.01 unless given.
        #[serde(default = "defaults::rarely")]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// Which way; both unless given.
        #[serde(default)]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Random bytes appear between the others.
    InsertedBytes = "inserted-bytes", Wire, BOTH,
    sees "Frames with a foreign byte in or before them.",
    counts "A byte was inserted.",
    {
        /// Before each byte; 0.01 unless given.
        #[serde(default = "defaults::rarely")]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// Which way; both unless given.
        #[serde(default)]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Interference makes several bytes in a row random.
    Burst = "burst", Wire, BOTH,
    sees "Runs of garbage inside frames and across them.",
    counts "A burst began.",
    {
        /// Bytes of a burst; 8 unless given.
        #[serde(default = "defaults::burst_length")]
        length: u16,
        /// That a burst begins, for each byte; 0.01 unless given.
        #[serde(default = "defaults::rarely")]
        probability: Probability,
        /// At most so many bursts.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// Which way; both unless given.
        #[serde(default)]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Bytes take longer, all by the same or by a random time. They never overtake one another.
    Delay = "delay", Wire, BOTH,
    sees "Replies that come late; frames torn by pauses if there is jitter.",
    counts "A byte came late.",
    {
        /// By which every byte is late; 50 ms unless given.
        #[serde(default = "defaults::delay")]
        by: Span,
        /// Most of what a random further delay adds to each byte; none unless given.
        #[serde(default)]
        jitter: Span,
        /// Which way; both unless given.
        #[serde(default)]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Pauses tear what is sent in one piece.
    Fragmentation = "fragmentation", Wire, BOTH,
    sees "A reply that comes in pieces over several reads.",
    counts "A pause was put between two bytes.",
    {
        /// Bytes of a piece; 3 unless given.
        #[serde(default = "defaults::piece")]
        size: u16,
        /// Pause after each; 5 ms unless given. The R150 gives an unfinished request up after 20 ms.
        #[serde(default = "defaults::pause")]
        pause: Span,
        /// Which way; to-client unless given.
        #[serde(default = "defaults::to_client")]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Bytes stop, and all come at once when the stall ends, as with a busy USB adapter.
    Stall = "stall", Wire, BOTH,
    sees "Silence, then everything at once, old replies first.",
    counts "A byte was held up.",
    {
        /// Which way; both unless given.
        #[serde(default)]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// One wire of the cable is broken: nothing arrives that way.
    Mute = "mute", Wire, BOTH,
    sees "No replies; to-device, a vehicle that does nothing and whose watchdog fires.",
    counts "A byte was lost.",
    {
        /// Which way; to-client unless given.
        #[serde(default = "defaults::to_client")]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// The device's serial port runs at a wrong speed.
    WrongBaud = "wrong-baud", Wire, BOTH,
    sees "Garbage instead of replies, and no answer to what it sends.",
    counts "Something was sent at mismatched speeds.",
    {
        /// Bits per second of the device's end; 9600 unless given.
        #[serde(default = "defaults::wrong_baud")]
        baud: u32,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Random bytes come out of an idle line.
    IdleNoise = "idle-noise", Wire, BOTH,
    sees "Bytes between replies that belong to nothing.",
    counts "A byte came out of nothing.",
    {
        /// Mean time between two; 100 ms unless given, at least 1 ms.
        #[serde(default = "defaults::noise_every")]
        every: Span,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// Which way; to-client unless given.
        #[serde(default = "defaults::to_client")]
        direction: Direction,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// The cable is pulled, and plugged in again at the end.
    CablePulled = "cable-pulled", Wire, BOTH,
    sees "Its port hangs up, as a pulled USB adapter does, and can be opened again afterwards.",
    counts "A client had the port open, or something was sent.",
    {
        /// Of which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }

    /// Replies have a wrong CRC.
    BadCrc = "bad-crc", Protocol, R150,
    sees "A reply that it must throw away.",
    counts "A reply was spoilt.",
    {
        /// Only replies to this command; to all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each reply; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
    }
    /// Replies carry another command byte, packets another type, lines another letter; a CRC fits.
    WrongCommand = "wrong-command", Protocol, BOTH,
    sees "A well-formed answer to something that it did not ask.",
    counts "A frame was changed.",
    {
        /// The byte to put there; the right one with its lowest bit flipped unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        with: Option<u8>,
        /// Only replies to this command, or packets of this type; all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each frame; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Replies are too short or too long.
    WrongLength = "wrong-length", Protocol, BOTH,
    sees "A well-formed frame with parameters missing or too many; or one whose length field lies.",
    counts "A frame was changed.",
    {
        /// By how many bytes; −1 unless given.
        #[serde(default = "defaults::one_less")]
        by: i8,
        /// Whether `parameters` are missing, or the `field` lies; parameters unless given.
        #[serde(default)]
        what: WrongLength,
        /// Only replies to this command, or packets of this type; all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each frame; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Only the first half of a reply is sent.
    TornReply = "torn-reply", Protocol, BOTH,
    sees "A frame that never ends; the next one seems to be its rest.",
    counts "A frame was cut.",
    {
        /// Only replies to this command, or packets of this type; all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each frame; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Replies are sent late. A later one may overtake them.
    LateReply = "late-reply", Protocol, BOTH,
    sees "No reply in time, and one that it no longer waits for.",
    counts "A frame was put off.",
    {
        /// By how much; 500 ms unless given.
        #[serde(default = "defaults::late")]
        by: Span,
        /// Only replies to this command, or packets of this type; all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each frame; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Replies are sent twice.
    ReplyTwice = "reply-twice", Protocol, BOTH,
    sees "The same frame again at once, which it may take for the answer to its next request.",
    counts "A frame was sent twice.",
    {
        /// Only replies to this command, or packets of this type; all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each frame; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// Replies are not sent.
    MissingReply = "missing-reply", Protocol, BOTH,
    sees "No reply, although the command took effect.",
    counts "A frame was not sent.",
    {
        /// Only replies to this command, or packets of this type; all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each frame; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// The frame before is sent again in place of the right one.
    PreviousReply = "previous-reply", Protocol, BOTH,
    sees "An old answer: other values than asked for, or the answer to another command.",
    counts "An old frame was sent. The first one after the start has none before it.",
    {
        /// Only in place of replies to this command, or packets of this type; all unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        command: Option<u8>,
        /// For each frame; 1 unless given.
        #[serde(default)]
        probability: Probability,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }
    /// The device sends something that nobody asked for.
    UnsolicitedFrame = "unsolicited-frame", Protocol, BOTH,
    sees "A frame without a request: a heartbeat reply, a status packet of zeros, or a line.",
    counts "The frame was sent.",
    {
        /// What; unless given a well-formed frame of the device.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        bytes: Option<HexBytes>,
        /// Again after this; once unless given. At least 1 ms.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        every: Option<Span>,
        /// At most so many.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        count: Option<u64>,
        /// On which link; main unless given.
        #[serde(default)]
        link: LinkName,
    }

    /// The firmware restarts: everything it drives goes off, and it hears nothing until it is up.
    Reset = "reset", Firmware, BOTH,
    sees "Silence for the boot time; then rails and PWM off, control with the app, motions forgotten.",
    counts "The firmware ran and was reset.",
    {
        /// Until it is up again; 500 ms unless given. It takes that long even if the fault ends.
        #[serde(default = "defaults::boot")]
        boot: Span,
    }
    /// The firmware hangs: nothing is answered or timed out, and outputs stay as they are.
    Hang = "hang", Firmware, BOTH,
    sees "Silence, while the vehicle goes on with what it last did.",
    counts "A byte was not heard, or a packet not sent.",
    {}
    /// The firmware is slow to answer; a car's to send its next packet.
    SlowReplies = "slow-replies", Firmware, BOTH,
    sees "Replies that come later; status packets that come more rarely.",
    counts "A frame was late.",
    {
        /// By how much; 200 ms unless given.
        #[serde(default = "defaults::slow")]
        by: Span,
    }
    /// The firmware no longer updates the status it reports.
    StuckStatus = "stuck-status", Firmware, BOTH,
    sees "`sysStatus`, modes and switched outputs, or `moto_state`, as they were; the rest is live.",
    counts "A reply carried old status that is no longer true.",
    {}
    /// The firmware no longer reads its sensors, and acts on what it read last.
    FrozenSensors = "frozen-sensors", Firmware, BOTH,
    sees "Speeds, voltages, currents and temperatures, or distances, tag and strip, that never change.",
    counts "A sensor would have read something else.",
    {}
    /// The firmware's watchdog does not fire: an R150's for motor commands; a car's `link_timeout`.
    WatchdogOff = "watchdog-off", Firmware, BOTH,
    sees "A vehicle that goes on although it sends nothing.",
    counts "The watchdog should have stopped it.",
    {}

    /// Something else hangs on an output. Give one of power, resistance and current.
    RailLoad = "rail-load", Electrical, R150,
    sees "Another current in 0x06; above the limit the output trips and `sysStatus` says so.",
    counts "The output was on.",
    {
        /// Which output.
        rail: RailName,
        /// What it draws.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        power: Option<Power>,
        /// What it is.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        resistance: Option<Resistance>,
        /// What it draws at the output's nominal voltage; its power stays the same at others.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        current: Option<Current>,
    }
    /// An output is shorted.
    RailShort = "rail-short", Electrical, R150,
    sees "The output trips within a millisecond and `sysStatus` says so; 0x02 may answer false.",
    counts "The output was on.",
    {
        /// Which output.
        rail: RailName,
    }
    /// What hangs on an output is off.
    RailOpen = "rail-open", Electrical, R150,
    sees "No current from an output that is on.",
    counts "The output was on.",
    {
        /// Which output.
        rail: RailName,
    }
    /// The supply sags.
    SupplySag = "supply-sag", Electrical, R150,
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
    OverTemperature = "over-temperature", Electrical, R150,
    sees "A high `temp_12v`; above 85 °C the pair goes off and `sysStatus` says so.",
    counts "The sensor read more than without the fault.",
    {
        /// Which pair.
        pair: PairName,
        /// How hot at least; 95 °C unless given.
        #[serde(default = "defaults::hot")]
        temperature: Temperature,
    }
    /// The power module is faulty.
    PowerModuleFault = "power-module-fault", Electrical, R150,
    sees "Bit 6 of `sysStatus`, and all outputs off.",
    counts "The module was powered.",
    {}
    /// The battery is empty; at the end it has what it would have had.
    BatteryEmpty = "battery-empty", Electrical, R150,
    sees "`soc` 0, a low voltage with the power module fault, and motors that do not turn.",
    counts "The battery had charge.",
    {}
    /// The battery suddenly has less charge, as with a bad cell; at the end it has it again.
    ChargeDrop = "charge-drop", Electrical, R150,
    sees "`soc` falls at once, and the voltage with it.",
    counts "The battery had charge.",
    {
        /// How much less, of the full charge; 50 % unless given.
        #[serde(default = "defaults::half")]
        by: Percent,
    }
    /// A fuse is blown; it is replaced at the end.
    FuseBlown = "fuse-blown", Electrical, R150,
    sees "A side that the other drags along; or, without the tail supply, a module that is silent.",
    counts "Current would have flowed through it.",
    {
        /// Which fuse.
        fuse: FuseName,
    }
    /// Board and motors have no supply.
    SupplyLost = "supply-lost", Electrical, CAR,
    sees "Silence, then a board that has forgotten motions and position.",
    counts "The board was powered.",
    {}

    /// Wheels cannot turn.
    Blocked = "blocked", Mechanical, BOTH,
    sees "No speed from there although driven; an R150's bus voltage falls and fuses may blow; a car's motion does not end.",
    counts "A blocked wheel was driven.",
    {
        /// Which.
        motors: Motors,
    }
    /// Something drags on wheels.
    Dragging = "dragging", Mechanical, BOTH,
    sees "Less speed, and a vehicle that pulls to one side.",
    counts "A dragged wheel was driven or turned.",
    {
        /// Which.
        motors: Motors,
        /// How much at the wheels of a side, or at one wheel of a car; 100 N*m for an R150 and
        /// 0.5 N*m for a car unless given.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        torque: Option<Torque>,
    }
    /// Motors neither drive nor hold their wheels.
    FreeWheeling = "free-wheeling", Mechanical, BOTH,
    sees "Wheels that turn only as the others drag them, and less speed.",
    counts "A motor without effect was driven.",
    {
        /// Which.
        motors: Motors,
    }
    /// The cables of encoders are off.
    EncoderLost = "encoder-lost", Mechanical, BOTH,
    sees "Speed 0 while driving; a car's motion does not end.",
    counts "A wheel turned unseen.",
    {
        /// Which.
        motors: Motors,
    }
    /// Encoders repeat what they gave last.
    EncoderStuck = "encoder-stuck", Mechanical, BOTH,
    sees "A speed that does not change; a car's pulses come all at once at the end.",
    counts "A wheel turned at another speed than the encoder gave.",
    {
        /// Which.
        motors: Motors,
    }
    /// Interference spoils encoders.
    EncoderNoisy = "encoder-noisy", Mechanical, BOTH,
    sees "Speeds that jump about; a car that thinks it has gone farther, even standing.",
    counts "A reading was spoilt.",
    {
        /// Which.
        motors: Motors,
        /// Spread of an R150's readings, in r/min of the motor; 50 unless given.
        #[serde(default = "defaults::spread")]
        spread_rpm: u16,
        /// Pulses a second that a car gets on top; 20 unless given.
        #[serde(default = "defaults::pulses")]
        pulses_per_second: u16,
    }
    /// Motors are wired backwards; their encoders are not.
    WiredBackwards = "wired-backwards", Mechanical, BOTH,
    sees "An R150's speed with the wrong sign; a car that turns away while its packets say all is well.",
    counts "Such a motor was driven.",
    {
        /// Which.
        motors: Motors,
    }
    /// Two motors are plugged into one another's ports.
    PortsSwapped = "ports-swapped", Mechanical, CAR,
    sees "A car that moves otherwise than its packets say.",
    counts "One of the two ports was driven.",
    {
        /// One port.
        port: PortName,
        /// The other.
        with: PortName,
    }
    /// The cables of the two sides, motors and encoders, are swapped.
    SidesSwapped = "sides-swapped", Mechanical, R150,
    sees "Left turns become right turns, although the reported speeds are as expected.",
    counts "The sides were driven differently.",
    {}
    /// The ground under the wheels is slippery.
    Ice = "ice", Mechanical, BOTH,
    sees "Speeds of wheels that spin; the vehicle itself lags behind and slides.",
    counts "The vehicle was driven or moved.",
    {
        /// Most friction; 0.05 unless given.
        #[serde(default = "defaults::ice")]
        friction: Probability,
    }
    /// Something heavy lies on the deck.
    Payload = "payload", Mechanical, BOTH,
    sees "Slower starts and longer stops; more current.",
    counts "The vehicle was driven or moved.",
    {
        /// How heavy.
        mass: Mass,
    }
    /// Something pushes the vehicle.
    Push = "push", Mechanical, BOTH,
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
    BrakeStuckOn = "brake-stuck-on", Mechanical, BOTH,
    sees "Little or no speed although driven.",
    counts "A braked wheel was driven.",
    {
        /// Which; all unless given.
        #[serde(default = "defaults::all_motors")]
        motors: Motors,
    }
    /// Brakes do not hold: the R150's parking brake, or the motor brakes of the car.
    BrakeStuckOpen = "brake-stuck-open", Mechanical, BOTH,
    sees "A parked vehicle that rolls on a slope or when pushed.",
    counts "The brake should have held.",
    {
        /// Which; all unless given.
        #[serde(default = "defaults::all_motors")]
        motors: Motors,
    }

    /// The emergency stop is pushed in, and pulled out at the end.
    EmergencyStop = "emergency-stop", Operator, R150,
    sees "0x12 is answered but moves nothing; the vehicle coasts to a stand.",
    counts "It was out before.",
    {}
    /// Somebody takes the vehicle over with the remote control, and gives it back at the end.
    RemoteControlTakesOver = "remote-control-takes-over", Operator, R150,
    sees "0x12 is answered but moves nothing; the speeds are those of the remote control.",
    counts "The vehicle was in autonomous mode, or a key is held.",
    {
        /// Key that is held down; none unless given, so that the vehicle rolls freely.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        key: Option<Key>,
    }
    /// Somebody locks the vehicle, and unlocks it at the end.
    Locked = "locked", Operator, R150,
    sees "0x12 is answered but moves nothing; the vehicle stops.",
    counts "It was unlocked before.",
    {}
    /// The parking brake is put on, and released at the end.
    Parked = "parked", Operator, R150,
    sees "0x12 is answered but moves nothing; the vehicle stops.",
    counts "It was released before.",
    {}
    /// The app takes control and keeps it, and gives it back at the end.
    AppTakesControl = "app-takes-control", Operator, R150,
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

    /// Ultrasonic sensors hear nothing.
    UltrasonicMissing = "ultrasonic-missing", Sensor, CAR,
    sees "4500 mm, whatever is there.",
    counts "An echo was not heard.",
    {
        /// Which; all unless given.
        #[serde(default)]
        sensor: EchoSensor,
    }
    /// Ultrasonic sensors repeat what they read at the start.
    UltrasonicStuck = "ultrasonic-stuck", Sensor, CAR,
    sees "A distance that does not change.",
    counts "The true distance was another.",
    {
        /// Which; all unless given.
        #[serde(default)]
        sensor: EchoSensor,
    }
    /// Ultrasonic sensors hear an echo that is none.
    UltrasonicGhost = "ultrasonic-ghost", Sensor, CAR,
    sees "An obstacle where there is none.",
    counts "The ghost was nearer than anything real.",
    {
        /// Which; all unless given.
        #[serde(default)]
        sensor: EchoSensor,
        /// How far off; 0.3 m unless given.
        #[serde(default = "defaults::ghost")]
        distance: Length,
    }
    /// The reader misreads tags.
    TagMisread = "tag-misread", Sensor, CAR,
    sees "A wrong number in `rfid`, or none.",
    counts "A tag was misread.",
    {
        /// What any tag is read as; 0, which is no tag, unless given.
        #[serde(default)]
        reads_as: u32,
    }
    /// The magnetic bar does not feel the strip.
    StripLost = "strip-lost", Sensor, CAR,
    sees "`magn` 0 over a strip.",
    counts "A strip was not felt.",
    {}
    /// The infrared sensor always says the same.
    InfraredStuck = "infrared-stuck", Sensor, CAR,
    sees "`infra` that does not change.",
    counts "The truth was another.",
    {
        /// Whether it sees something; yes unless given.
        #[serde(default = "defaults::yes")]
        sees: bool,
    }
}

/// Every fault, by level.
#[must_use]
pub fn catalogue() -> &'static [FaultInfo] {
    CATALOGUE
}
