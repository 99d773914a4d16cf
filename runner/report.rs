//! The client report: what the client did that the protocol forbids, or that is risky.

use sim_core::event::Code;

/// Every kind that a client report can have, of all devices and of the line.
pub fn client_faults() -> impl Iterator<Item = &'static str> {
    let all = Code::ALL.iter().filter(|code| code.is_client_fault());
    all.map(|code| code.word())
}
