//! What events are called, and whom they are held against.

/// Whom an event is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blame {
    /// Nobody: it only happened.
    Nobody,
    /// The client: the protocol forbids it, or it is risky.
    Client,
    /// The client, unless something disturbed its line: then it may be what that looks like.
    ClientUnlessDisturbed,
}

macro_rules! codes {
    ($( $(#[doc = $about:literal])+ $variant:ident = $word:literal, $blame:ident; )+) => {
        /// What an event is called. One list for all devices and lines, in which what means the same
        /// has one name.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Code { $( $(#[doc = $about])+ $variant, )+ }

        impl Code {
            /// All of them.
            pub const ALL: &[Self] = &[$( Self::$variant ),+];

            /// A short stable name, the same in logs, reports and documentation.
            #[must_use]
            pub const fn word(self) -> &'static str {
                match self { $( Self::$variant => $word, )+ }
            }

            /// Whom such events are held against.
            #[must_use]
            pub const fn blame(self) -> Blame {
                match self { $( Self::$variant => Blame::$blame, )+ }
            }
        }
    };
}

codes! {
    /// A valid request, packet or line of a client.
    Request = "request", Nobody;
    /// A reply, packet or line of a device.
    Reply = "reply", Nobody;
    /// A fault may act from now on.
    FaultArmed = "fault_armed", Nobody;
    /// A fault acted for the first time.
    FaultTriggered = "fault_triggered", Nobody;
    /// A fault has ended.
    FaultCleared = "fault_cleared", Nobody;

    /// A port was opened.
    ClientAttached = "client_attached", Nobody;
    /// A port was closed.
    ClientDetached = "client_detached", Nobody;
    /// The client's speed is not the device's.
    BaudMismatch = "baud_mismatch", Client;
    /// It is again.
    BaudMatched = "baud_matched", Nobody;
    /// The client's port changes what passes.
    LineNotRaw = "line_not_raw", Client;
    /// The client has set two stop bits.
    StopBits = "stop_bits", Client;
    /// The client asks for a parity bit.
    Parity = "parity", Client;
    /// The client waits for CTS.
    FlowControl = "flow_control", Client;
    /// The client has set its speed to 0.
    HungUp = "hung_up", Client;
    /// The client sent more than the line holds.
    SentTooMuch = "sent_too_much", Client;
    /// The simulator was held up.
    SimulatorLate = "simulator_late", Nobody;
    /// The machine is too slow.
    SimulatorTooSlow = "simulator_too_slow", Nobody;
    /// The client does not read.
    Overrun = "overrun", Client;
    /// The line was too full for a reply.
    LineFull = "line_full", Client;

    /// A whole frame with a wrong CRC.
    BadCrc = "bad_crc", ClientUnlessDisturbed;
    /// A frame was begun and not finished.
    PartialFrame = "partial_frame", ClientUnlessDisturbed;
    /// Bytes outside of any frame or packet.
    Noise = "noise", ClientUnlessDisturbed;
    /// A frame with an unknown command.
    UnknownCommand = "unknown_command", ClientUnlessDisturbed;
    /// A frame with the wrong number of parameters.
    WrongLength = "wrong_length", ClientUnlessDisturbed;
    /// A PWM duty above 1000.
    DutyOutOfRange = "duty_out_of_range", ClientUnlessDisturbed;
    /// A motor PWM beyond 1000.
    MotorsOutOfRange = "motors_out_of_range", ClientUnlessDisturbed;
    /// Reserved bits in a power control request.
    ReservedBits = "reserved_bits", ClientUnlessDisturbed;
    /// A motor command came too soon.
    OverRate = "over_rate", Client;
    /// A command was refused because the app holds control.
    AppInControl = "app_in_control", Nobody;
    /// A motor command does not move the vehicle.
    NotDriving = "not_driving", Nobody;
    /// The motor watchdog stopped the motors; held against the client if the vehicle was driving.
    WatchdogFired = "watchdog_fired", ClientUnlessDisturbed;
    /// The client took control.
    ControlTaken = "control_taken", Nobody;
    /// The heartbeat stopped.
    HeartbeatLost = "heartbeat_lost", ClientUnlessDisturbed;
    /// A protection switched outputs off for their current.
    Overcurrent = "overcurrent", Nobody;
    /// A protection switched outputs off for their temperature.
    OverTemperature = "over_temperature", Nobody;
    /// Outputs may be switched on again.
    TripCleared = "trip_cleared", Nobody;
    /// Outputs have cooled down.
    Cooled = "cooled", Nobody;
    /// The power module reports a fault.
    PowerModuleFault = "power_module_fault", Nobody;
    /// It no longer does.
    PowerModuleRecovered = "power_module_recovered", Nobody;
    /// Too many replies waited.
    ReplyDropped = "reply_dropped", Nobody;

    /// A packet was begun and not finished.
    PartialPacket = "partial_packet", ClientUnlessDisturbed;
    /// A line that is no command.
    BadLine = "bad_line", ClientUnlessDisturbed;
    /// A line with a number out of range.
    BadNumber = "bad_number", ClientUnlessDisturbed;
    /// A line without an end.
    LineTooLong = "line_too_long", ClientUnlessDisturbed;
    /// A speed out of range.
    SpeedClamped = "speed_clamped", ClientUnlessDisturbed;
    /// A speed out of range that was not clamped.
    SpeedOutOfRange = "speed_out_of_range", ClientUnlessDisturbed;
    /// `is_reset` is neither 0 nor 1.
    BadIsReset = "bad_is_reset", ClientUnlessDisturbed;
    /// `moving_idx` is unknown.
    BadMovingIdx = "bad_moving_idx", ClientUnlessDisturbed;
    /// The control type is unknown.
    BadControlType = "bad_control_type", ClientUnlessDisturbed;
    /// A motion was refused because too many wait.
    QueueFull = "queue_full", Client;
    /// A motion was ignored because the remote control drives.
    IgnoredInRemote = "ignored_in_remote", Client;
    /// A motion was ignored because the other link drives.
    IgnoredForRos = "ignored_for_ros", Client;
    /// A motion began.
    MotionStarted = "motion_started", Nobody;
    /// A motion came to its end.
    MotionDone = "motion_done", Nobody;
    /// The link timed out.
    LinkTimeout = "link_timeout", ClientUnlessDisturbed;
    /// Motions were discarded.
    MotionsDiscarded = "motions_discarded", Nobody;
    /// Who drives has changed.
    ControlMode = "control_mode", Nobody;
    /// A key that does nothing now.
    KeyIgnored = "key_ignored", Nobody;

    /// Somebody pressed a button or key.
    Operated = "operated", Nobody;
    /// The device lost its supply.
    PowerLost = "power_lost", Nobody;
    /// The firmware restarts by itself.
    FirmwareReset = "firmware_reset", Nobody;
    /// The device has started.
    Started = "started", Nobody;
}

impl Code {
    /// Whether such events may be held against a client at all.
    #[must_use]
    pub fn is_client_fault(self) -> bool {
        self.blame() != Blame::Nobody
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_has_a_word_of_its_own() {
        for (at, code) in Code::ALL.iter().enumerate() {
            assert!(
                Code::ALL[..at]
                    .iter()
                    .all(|other| other.word() != code.word())
            );
        }
    }
}
