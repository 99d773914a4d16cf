//! Address to listen at.

use std::net::{Ipv4Addr, SocketAddr};

/// Not an address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is no address and port; as in 127.0.0.1:0, where 0 is any free port")]
pub struct AddressError(String);

/// Reads an address and a port to listen on; port 0 is any that is free.
///
/// # Errors
/// When it is none.
pub fn listen(text: &str) -> Result<SocketAddr, AddressError> {
    let local = text
        .strip_prefix("localhost:")
        .and_then(|port| port.parse().ok())
        .map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    local
        .or_else(|| text.parse().ok())
        .ok_or_else(|| AddressError(text.chars().take(80).collect()))
}
