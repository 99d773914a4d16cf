//! Codes of events, their importance, and the party that they are attributed to.

use std::fmt;
use std::time::Duration;

rigsim_settings::words! {
    /// Importance of an event to the developer of a client.
    pub enum Level {
        /// Ordinary requests and replies; shown when asked for.
        Traffic = "traffic",
        /// Worth knowing.
        Notice = "notice",
        /// Something is wrong, or a command had no effect.
        Warning = "warning",
    }
}

/// Part of an event in the counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Role {
    /// A client came.
    Attached,
    /// A client left.
    Detached,
    /// Something valid came from a client.
    Request,
    /// Something went to a client.
    Reply,
    /// A client was silent for too long.
    HeartbeatLost,
    /// Something broke, or came close to it, that the firmware does not know of.
    Damage,
    /// Anything else that is worth knowing.
    Notice,
    /// Anything else that is wrong, or a command without effect.
    Warning,
}

impl Role {
    /// Returns how much such events matter.
    #[must_use]
    pub const fn level(self) -> Level {
        match self {
            Self::Request | Self::Reply => Level::Traffic,
            Self::Attached | Self::Detached | Self::Notice => Level::Notice,
            Self::HeartbeatLost | Self::Damage | Self::Warning => Level::Warning,
        }
    }
}

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
    /// steady rate may come in a burst then, and a spoilt request may have changed a mode.
    ClientUnlessLatelyDisturbed,
}

impl Attribution {
    /// Returns whether no party is charged while something disturbs the line.
    #[must_use]
    pub const fn spares_disturbed(self) -> bool {
        matches!(
            self,
            Self::ClientUnlessDisturbed
                | Self::ClientUnlessDisturbedOrLate
                | Self::ClientUnlessLatelyDisturbed
        )
    }

    /// For how long what has happened counts for it.
    #[must_use]
    pub const fn looks_back(self) -> Duration {
        match self {
            Self::ClientUnlessLatelyDisturbed => Duration::from_secs(1),
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
    /// A short stable name, the same in logs, reports and documentation: lower-case, with `_`
    /// between words.
    pub name: &'static str,
    /// Name of conditions for the number of such events: the same behind `count.`.
    pub count: &'static str,
    /// Meaning, in a sentence.
    pub about: &'static str,
    /// Part of such events in the counts, and how much they matter.
    pub role: Role,
    /// Party that such events are attributed to.
    pub attribution: Attribution,
}

impl Code {
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
///         ROLLED_AWAY = "rolled_away", Warning, NoParty;
///     }
/// }
/// assert_eq!(code::CODES, [code::ROLLED_AWAY]);
/// ```
#[macro_export]
macro_rules! codes {
    ($( $(#[doc = $about:literal])+ $code:ident = $name:literal, $role:ident, $attribution:ident; )+) => {
        $(
            $(#[doc = $about])+
            pub const $code: $crate::event::Code = $crate::event::Code {
                name: $name,
                count: concat!("count.", $name),
                about: concat!($($about),+).trim_ascii(),
                role: $crate::event::Role::$role,
                attribution: $crate::event::Attribution::$attribution,
            };
        )+

        /// All of these codes.
        pub const CODES: &[$crate::event::Code] = &[$( $code ),+];
    };
}

codes! {
    /// A valid request, packet or line of a client.
    REQUEST = "request", Request, NoParty;
    /// A reply, packet or line of a device.
    REPLY = "reply", Reply, NoParty;
    /// A fault may act from now on.
    FAULT_ARMED = "fault_armed", Notice, NoParty;
    /// A fault acted for the first time.
    FAULT_TRIGGERED = "fault_triggered", Notice, NoParty;
    /// A fault has ended.
    FAULT_CLEARED = "fault_cleared", Notice, NoParty;
    /// An action was applied to the vehicle or around it.
    ACTION_APPLIED = "action_applied", Notice, NoParty;
    /// An action was reverted.
    ACTION_REVERTED = "action_reverted", Notice, NoParty;
    /// A port was opened.
    CLIENT_ATTACHED = "client_attached", Attached, NoParty;
    /// A port was closed.
    CLIENT_DETACHED = "client_detached", Detached, NoParty;
    /// A wheel would lift: the vehicle would tip over.
    TIPPING = "tipping", Damage, NoParty;
    /// The client's speed is not the device's.
    BAUD_MISMATCH = "baud_mismatch", Warning, Client;
    /// The client's speed is the device's again.
    BAUD_MATCHED = "baud_matched", Notice, NoParty;
    /// The client's port changes what passes.
    LINE_NOT_RAW = "line_not_raw", Warning, Client;
    /// The client has set two stop bits.
    STOP_BITS = "stop_bits", Warning, Client;
    /// The client has set its modem lines.
    MODEM_LINES = "modem_lines", Notice, NoParty;
    /// The client asks for a parity bit.
    PARITY = "parity", Warning, Client;
    /// The client waits for CTS.
    FLOW_CONTROL = "flow_control", Warning, Client;
    /// The client has set its speed to 0.
    HUNG_UP = "hung_up", Warning, Client;
    /// The client sent more than the line holds.
    SENT_TOO_MUCH = "sent_too_much", Warning, Client;
    /// The simulator was stalled.
    SIMULATOR_STALLED = "simulator_stalled", Warning, NoParty;
    /// The machine is too slow.
    SIMULATOR_TOO_SLOW = "simulator_too_slow", Warning, NoParty;
    /// A line that the client published is not used.
    BAD_PUBLICATION = "bad_publication", Warning, NoParty;
    /// The client does not read.
    OVERRUN = "overrun", Warning, ClientUnlessLate;
    /// The line was too full for all replies.
    LINE_FULL = "line_full", Warning, ClientUnlessLate;
    /// Bytes outside of any frame or packet.
    NOISE = "noise", Warning, ClientUnlessDisturbed;
    /// An operator pressed a button or key.
    OPERATED = "operated", Notice, NoParty;
    /// The device lost its supply.
    POWER_LOST = "power_lost", Warning, NoParty;
    /// The firmware restarts by itself.
    FIRMWARE_RESET = "firmware_reset", Warning, NoParty;
    /// The device has started.
    STARTED = "started", Notice, NoParty;
}
