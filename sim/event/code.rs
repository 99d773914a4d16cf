//! Codes of events, and whom they are held against.

use std::fmt;
use std::time::Duration;

/// Party that an event is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Blame {
    /// Nobody: it only happened.
    Nobody,
    /// The client: the protocol forbids it, or it is risky.
    Client,
    /// The client, unless something disturbed its line: then it may be what that looks like.
    ClientUnlessDisturbed,
    /// The client, unless the simulator was late: what a client does in steady time can look like
    /// this when a busy machine delivers it at once.
    ClientUnlessLate,
    /// The client, unless either was so.
    ClientUnlessDisturbedOrLate,
    /// The client, unless something disturbed its line in the second before: what it sends at a
    /// steady rate may come in a burst then.
    ClientUnlessHeldBack,
}

impl Blame {
    /// Tells whether nobody is to blame while something disturbs the line.
    #[must_use]
    pub const fn spares_disturbed(self) -> bool {
        matches!(
            self,
            Self::ClientUnlessDisturbed
                | Self::ClientUnlessDisturbedOrLate
                | Self::ClientUnlessHeldBack
        )
    }

    /// For how long what has happened counts for it.
    #[must_use]
    pub const fn looks_back(self) -> Duration {
        match self {
            Self::ClientUnlessHeldBack => Duration::from_secs(1),
            _ => Duration::ZERO,
        }
    }

    /// Tells whether nobody is to blame when the simulator was late.
    #[must_use]
    pub const fn spares_late(self) -> bool {
        matches!(
            self,
            Self::ClientUnlessLate | Self::ClientUnlessDisturbedOrLate
        )
    }
}

/// Name of an event. What means the same has the same name on every device and line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Code {
    name: &'static str,
    blame: Blame,
}

impl Code {
    /// A code of a device or line; `name` is lower-case, with `_` between words.
    #[must_use]
    pub const fn new(name: &'static str, blame: Blame) -> Self {
        Self { name, blame }
    }

    /// A short stable name, the same in logs, reports and documentation.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        self.name
    }

    /// Returns whom such events are held against.
    #[must_use]
    pub const fn blame(self) -> Blame {
        self.blame
    }

    /// Tells whether such events may be held against a client at all.
    #[must_use]
    pub fn may_blame_client(self) -> bool {
        self.blame != Blame::Nobody
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name)
    }
}

/// Declares codes, and `CODES`, a list of them.
///
/// ```
/// mod code {
///     sim_core::codes! {
///         /// The wheels turn while nobody drives.
///         ROLLED_AWAY = "rolled_away", Nobody;
///     }
/// }
/// assert_eq!(code::CODES, [code::ROLLED_AWAY]);
/// ```
#[macro_export]
macro_rules! codes {
    ($( $(#[doc = $about:literal])+ $code:ident = $name:literal, $blame:ident; )+) => {
        $(
            $(#[doc = $about])+
            pub const $code: $crate::event::Code =
                $crate::event::Code::new($name, $crate::event::Blame::$blame);
        )+

        /// All of these codes.
        pub const CODES: &[$crate::event::Code] = &[$( $code ),+];
    };
}

codes! {
    /// A valid request, packet or line of a client.
    REQUEST = "request", Nobody;
    /// A reply, packet or line of a device.
    REPLY = "reply", Nobody;
    /// A fault may act from now on.
    FAULT_ARMED = "fault_armed", Nobody;
    /// A fault acted for the first time.
    FAULT_TRIGGERED = "fault_triggered", Nobody;
    /// A fault has ended.
    FAULT_CLEARED = "fault_cleared", Nobody;
    /// Somebody did something to the vehicle, or changed something around it.
    DEED_DONE = "deed_done", Nobody;
    /// That was undone.
    DEED_UNDONE = "deed_undone", Nobody;
    /// A port was opened.
    CLIENT_ATTACHED = "client_attached", Nobody;
    /// A port was closed.
    CLIENT_DETACHED = "client_detached", Nobody;
    /// A wheel would lift: the vehicle would tip over.
    TIPPING = "tipping", Nobody;
    /// The client's speed is not the device's.
    BAUD_MISMATCH = "baud_mismatch", Client;
    /// It is again.
    BAUD_MATCHED = "baud_matched", Nobody;
    /// The client's port changes what passes.
    LINE_NOT_RAW = "line_not_raw", Client;
    /// The client has set two stop bits.
    STOP_BITS = "stop_bits", Client;
    /// The client has set its modem lines.
    MODEM_LINES = "modem_lines", Nobody;
    /// The client asks for a parity bit.
    PARITY = "parity", Client;
    /// The client waits for CTS.
    FLOW_CONTROL = "flow_control", Client;
    /// The client has set its speed to 0.
    HUNG_UP = "hung_up", Client;
    /// The client sent more than the line holds.
    SENT_TOO_MUCH = "sent_too_much", Client;
    /// The simulator was held up.
    SIMULATOR_LATE = "simulator_late", Nobody;
    /// The machine is too slow.
    SIMULATOR_TOO_SLOW = "simulator_too_slow", Nobody;
    /// The client does not read.
    OVERRUN = "overrun", ClientUnlessLate;
    /// The line was too full for all replies.
    LINE_FULL = "line_full", ClientUnlessLate;
    /// Bytes outside of any frame or packet.
    NOISE = "noise", ClientUnlessDisturbed;
    /// Somebody pressed a button or key.
    OPERATED = "operated", Nobody;
    /// The device lost its supply.
    POWER_LOST = "power_lost", Nobody;
    /// The firmware restarts by itself.
    FIRMWARE_RESET = "firmware_reset", Nobody;
    /// The device has started.
    STARTED = "started", Nobody;
}
