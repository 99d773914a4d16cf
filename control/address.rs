//! Address to listen at.

use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

/// An address and a port to listen on; port 0 is any that is free.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Listen(SocketAddr);

/// Not an address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("\"{0}\" is no address and port; as in 127.0.0.1:0, where 0 is any free port")]
pub struct AddressError(String);

impl Listen {
    /// As given.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.0
    }

    /// Tells whether it is one port, and not any that is free.
    #[must_use]
    pub fn is_fixed(&self) -> bool {
        self.0.port() != 0
    }

    /// Tells whether other machines can reach it.
    #[must_use]
    pub fn is_public(&self) -> bool {
        !self.0.ip().is_loopback()
    }
}

impl FromStr for Listen {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let local = text
            .strip_prefix("localhost:")
            .and_then(|port| port.parse().ok())
            .map(|port| SocketAddr::new(IpAddr::from([127, 0, 0, 1]), port));
        local
            .or_else(|| text.parse().ok())
            .map(Self)
            .ok_or_else(|| AddressError(text.chars().take(80).collect()))
    }
}

impl fmt::Display for Listen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
