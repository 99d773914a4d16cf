//! Settings of the firmware that are one of a few words.

use rigsim_settings::words;

words! {
    /// Treatment of a motor command that comes sooner than the reply interval allows.
    pub enum OverRate {
        /// It takes effect and gets no reply.
        Silent = "silent",
        /// It takes effect and is answered like any other.
        Answer = "answer",
        /// It takes effect and is answered when the interval has passed, one at a time and with
        /// what is measured then.
        Delay = "delay",
        /// It changes nothing and gets no reply.
        Ignore = "ignore",
    }

    /// State of the outputs when the client's heartbeat stops.
    pub enum OnHeartbeatLoss {
        /// They follow the app's set-points, which are all off unless the app set them.
        App = "app",
        /// They stay as they are.
        Hold = "hold",
        /// They switch off.
        Off = "off",
    }

    /// State of a rail after a protection has switched it off.
    pub enum OvercurrentRecovery {
        /// It stays off until the client commands it off; the next "on" tries again.
        Latch = "latch",
        /// It tries again by itself after the retry period.
        Retry = "retry",
    }

    /// Command byte of a reply.
    pub enum ReplyCommand {
        /// That of the request.
        Same = "same",
        /// That of the request with the highest bit set.
        HighBit = "high-bit",
    }

    /// Answer to a request that the module does not understand.
    pub enum RefusalReply {
        /// No reply.
        Silent = "silent",
        /// The reply `false`, one parameter byte 0.
        False = "false",
    }

    /// Answer to a motor command that is refused.
    pub enum MotorsRefusalReply {
        /// No reply.
        Silent = "silent",
        /// The reply `false`, one parameter byte 0.
        False = "false",
        /// The reply that any motor command gets: speeds and charge.
        Speeds = "speeds",
    }

    /// In which states of the vehicle motor commands are answered.
    pub enum MotorsAnswered {
        /// In all.
        Always = "always",
        /// Only while they drive: unlocked, released, autonomous, not stopped.
        WhenDriving = "when-driving",
    }

    /// Meaning of a heartbeat.
    pub enum HeartbeatBy {
        /// Each of the eight requests, if its number of parameter bytes is right.
        Requests = "requests",
        /// Every frame with the right CRC, unknown commands and wrong lengths too.
        Frames = "frames",
    }

    /// Request by which a client takes RS232 control.
    pub enum ControlTakenBy {
        /// Any request takes control of power and PWM.
        AnyRequest = "any-request",
        /// 0x02 takes control of power and 0x03 of PWM.
        OwnCommand = "own-command",
    }

    /// Control of the outputs; the words are the manual's.
    pub enum ControlMode {
        /// The app.
        App = "app",
        /// The client.
        Rs232 = "rs232",
    }

    /// Treatment of a value that is out of its range.
    pub enum OutOfRange {
        /// The command changes nothing, feeds no watchdog, and is answered `false` where its reply
        /// is a boolean.
        Refuse = "refuse",
        /// The nearest allowed value is taken.
        Clamp = "clamp",
    }

    /// Order of the bytes of a version word.
    pub enum VersionOrder {
        /// The major version is the most significant byte, so it is sent last.
        MajorHigh = "major-high",
        /// The major version is the least significant byte, so it is sent first.
        MajorLow = "major-low",
    }

    /// Meaning of `voltage48v`.
    pub enum Voltage48v {
        /// The supply bus, whether or not the 48 V output is on.
        Supply = "supply",
        /// The 48 V output, 0 when it is off.
        Output = "output",
    }

    /// Meaning of `voltage12v`.
    pub enum Voltage12v {
        /// The outputs, 0 where one is off.
        Output = "output",
        /// The converter in front of the switch, whether or not the output is on.
        Converter = "converter",
    }

    /// Meaning of `current48v`.
    pub enum Current48v {
        /// The 48 V output's current.
        Output = "output",
        /// All that the module and its outputs draw from the supply.
        Supply = "supply",
    }

    /// State of the outputs when the client takes control.
    pub enum OnTakeover {
        /// They stay as the app had them.
        Keep = "keep",
        /// They return to what the client had set when it lost control.
        Restore = "restore",
    }

    /// Reaction of the module to a load, a temperature or a supply out of its limits.
    pub enum ProtectionAction {
        /// It sets the status bit and switches the outputs concerned off.
        SwitchOff = "switch-off",
        /// It sets the status bit for as long as it lasts, and leaves the outputs on.
        Report = "report",
    }
}
