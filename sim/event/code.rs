//! Codes of events, and the party that they are attributed to.

use std::fmt;
use std::time::Duration;

/// Party that an event is attributed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Attribution {
    /// No party: it only happened.
    NoParty,
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

impl Attribution {
    /// Returns whether no party is charged while something disturbs the line.
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

    /// Returns whether no party is charged when the simulator was late.
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
    count: &'static str,
    about: &'static str,
    attribution: Attribution,
}

impl Code {
    /// Creates a code of a device or line. `name` is lower-case, with `_` between words; `count` is the
    /// same behind `count.`, and `about` its meaning in a sentence.
    #[must_use]
    pub const fn new(
        name: &'static str,
        count: &'static str,
        about: &'static str,
        attribution: Attribution,
    ) -> Self {
        Self {
            name,
            count,
            about: about.trim_ascii(),
            attribution,
        }
    }

    /// Returns its meaning, in a sentence.
    #[must_use]
    pub const fn about(self) -> &'static str {
        self.about
    }

    /// Returns the name of conditions for the number of such events.
    #[must_use]
    pub const fn count(self) -> &'static str {
        self.count
    }

    /// A short stable name, the same in logs, reports and documentation.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        self.name
    }

    /// Returns the party that such events are attributed to.
    #[must_use]
    pub const fn attribution(self) -> Attribution {
        self.attribution
    }

    /// Returns whether such events may be attributed to a client at all.
    #[must_use]
    pub fn may_be_client_error(self) -> bool {
        self.attribution != Attribution::NoParty
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
///     rigsim_core::codes! {
///         /// The wheels turn without a command.
///         ROLLED_AWAY = "rolled_away", NoParty;
///     }
/// }
/// assert_eq!(code::CODES, [code::ROLLED_AWAY]);
/// ```
#[macro_export]
macro_rules! codes {
    ($( $(#[doc = $about:literal])+ $code:ident = $name:literal, $attribution:ident; )+) => {
        $(
            $(#[doc = $about])+
            pub const $code: $crate::event::Code =
                $crate::event::Code::new(
                    $name,
                    concat!("count.", $name),
                    concat!($($about),+),
                    $crate::event::Attribution::$attribution,
                );
        )+

        /// All of these codes.
        pub const CODES: &[$crate::event::Code] = &[$( $code ),+];
    };
}

codes! {
    /// A valid request, packet or line of a client.
    REQUEST = "request", NoParty;
    /// A reply, packet or line of a device.
    REPLY = "reply", NoParty;
    /// A fault may act from now on.
    FAULT_ARMED = "fault_armed", NoParty;
    /// A fault acted for the first time.
    FAULT_TRIGGERED = "fault_triggered", NoParty;
    /// A fault has ended.
    FAULT_CLEARED = "fault_cleared", NoParty;
    /// An action was applied to the vehicle or around it.
    ACTION_APPLIED = "action_applied", NoParty;
    /// That was undone.
    ACTION_REVERTED = "action_reverted", NoParty;
    /// A port was opened.
    CLIENT_ATTACHED = "client_attached", NoParty;
    /// A port was closed.
    CLIENT_DETACHED = "client_detached", NoParty;
    /// A wheel would lift: the vehicle would tip over.
    TIPPING = "tipping", NoParty;
    /// The client's speed is not the device's.
    BAUD_MISMATCH = "baud_mismatch", Client;
    /// It is again.
    BAUD_MATCHED = "baud_matched", NoParty;
    /// The client's port changes what passes.
    LINE_NOT_RAW = "line_not_raw", Client;
    /// The client has set two stop bits.
    STOP_BITS = "stop_bits", Client;
    /// The client has set its modem lines.
    MODEM_LINES = "modem_lines", NoParty;
    /// The client asks for a parity bit.
    PARITY = "parity", Client;
    /// The client waits for CTS.
    FLOW_CONTROL = "flow_control", Client;
    /// The client has set its speed to 0.
    HUNG_UP = "hung_up", Client;
    /// The client sent more than the line holds.
    SENT_TOO_MUCH = "sent_too_much", Client;
    /// The simulator was stalled.
    SIMULATOR_STALLED = "simulator_stalled", NoParty;
    /// The machine is too slow.
    SIMULATOR_TOO_SLOW = "simulator_too_slow", NoParty;
    /// A line that the client published is not used.
    BAD_PUBLICATION = "bad_publication", NoParty;
    /// The client does not read.
    OVERRUN = "overrun", ClientUnlessLate;
    /// The line was too full for all replies.
    LINE_FULL = "line_full", ClientUnlessLate;
    /// Bytes outside of any frame or packet.
    NOISE = "noise", ClientUnlessDisturbed;
    /// An operator pressed a button or key.
    OPERATED = "operated", NoParty;
    /// The device lost its supply.
    POWER_LOST = "power_lost", NoParty;
    /// The firmware restarts by itself.
    FIRMWARE_RESET = "firmware_reset", NoParty;
    /// The device has started.
    STARTED = "started", NoParty;
}
