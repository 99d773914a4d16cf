//! The client report: what the client did that the protocol forbids, or that is risky.

use sim_core::device::Devices;
use sim_core::event::code;

/// Every kind that a client report can have, of these devices and of the line.
pub fn client_faults(devices: Devices) -> impl Iterator<Item = &'static str> {
    let own = devices.iter().map(|device| device.codes);
    let all = std::iter::once(code::CODES).chain(own).flatten();
    all.filter(|code| code.may_blame_client())
        .map(|code| code.as_str())
}
