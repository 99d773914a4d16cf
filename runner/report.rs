//! The client report: what the client did that the protocol forbids, or that is risky.

use sim_core::event::code;
use sim_core::{mecanum, r150};

/// Every kind that a client report can have, of all devices and of the line.
pub fn client_faults() -> impl Iterator<Item = &'static str> {
    let all = [
        code::CODES,
        r150::event::CODES,
        r150::watch::CODES,
        mecanum::event::CODES,
    ];
    let all = all.into_iter().flatten();
    all.filter(|code| code.may_blame_client())
        .map(|code| code.as_str())
}
