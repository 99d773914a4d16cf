//! Port of each wheel's motor, as a setting.
//!
//! The text names the ports of the wheels LF, RF, LR, RR in that order, joined by `-`; a `!` before
//! a port says that FR turns the motor there the other way round. `"x-y-e0-e1"` is the article's
//! table, `"y-x-e0-e1"` has the front motors swapped, `"x-!y-e0-e1"` has one reversed.

use std::convert::Infallible;
use std::fmt;

use rigsim_settings::{Bounds, SettingValue, Value};
use schemars::{Schema, json_schema};

use super::{MecanumCommands, PORTS, Port, PortCommand, WHEELS, Wheel};

/// A port for each wheel, no port twice, and a polarity for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Wiring {
    ports: [Port; WHEELS],
    reversed: [bool; WHEELS],
}

impl Wiring {
    /// The article's table: X, Y, E0, E1.
    pub const X_Y_E0_E1: Self = Self {
        ports: [Port::X, Port::Y, Port::E0, Port::E1],
        reversed: [false; WHEELS],
    };

    /// Ports of LF, RF, LR, RR and whether FR is reversed there; `None` if a port comes twice.
    #[must_use]
    pub fn new(ports: [Port; WHEELS], reversed: [bool; WHEELS]) -> Option<Self> {
        let distinct = (1..WHEELS).all(|at| !ports[..at].contains(&ports[at]));
        distinct.then_some(Self { ports, reversed })
    }

    /// The port of a wheel.
    #[must_use]
    pub fn port(&self, wheel: Wheel) -> Port {
        self.ports[wheel.index()]
    }

    /// Returns whether FR low rolls this wheel backward, instead of forward.
    #[must_use]
    pub fn is_reversed(&self, wheel: Wheel) -> bool {
        self.reversed[wheel.index()]
    }

    /// This wiring after its plugs have changed places.
    #[must_use]
    pub fn swapped(self, swaps: PlugSwaps) -> Self {
        Self {
            ports: self.ports.map(|port| swaps.now_in(port)),
            ..self
        }
    }

    /// Command of the pins to a wheel: `reverse` then says that it is to roll backward.
    #[must_use]
    pub fn command(&self, commands: &MecanumCommands, wheel: Wheel) -> PortCommand {
        let PortCommand { reverse, brake } = commands.ports[self.port(wheel).index()];
        PortCommand {
            reverse: reverse != self.is_reversed(wheel),
            brake,
        }
    }
}

/// Plugs that have changed places, pair by pair: for each port where its own plug is now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlugSwaps([Port; PORTS]);

impl PlugSwaps {
    /// After these, the plugs that are in two ports change places, too; either port may be empty.
    #[must_use]
    pub fn and(self, one: Port, other: Port) -> Self {
        Self(self.0.map(|port| match port {
            port if port == one => other,
            port if port == other => one,
            port => port,
        }))
    }

    /// Place where the plug of this port is now.
    #[must_use]
    pub fn now_in(self, port: Port) -> Port {
        self.0[port.index()]
    }
}

impl Default for PlugSwaps {
    fn default() -> Self {
        Self(Port::ALL)
    }
}

impl Default for Wiring {
    fn default() -> Self {
        Self::X_Y_E0_E1
    }
}

impl fmt::Display for Wiring {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for wheel in Wheel::ALL {
            let dash = if wheel == Wheel::ALL[0] { "" } else { "-" };
            let polarity = if self.is_reversed(wheel) { "!" } else { "" };
            write!(f, "{dash}{polarity}{}", self.port(wheel))?;
        }
        Ok(())
    }
}

impl SettingValue for Wiring {
    type Bound = Infallible;

    fn read(value: &Value, _unit: &str) -> Result<Self, String> {
        let Value::Text(text) = value else {
            return Err(format!("{value} is not a wiring"));
        };
        let mut ports = [Port::X; WHEELS];
        let mut reversed = [false; WHEELS];
        let names: Vec<&str> = text.split('-').collect();
        if names.len() != WHEELS {
            return Err(format!("{value} does not name {WHEELS} ports"));
        }
        for (at, name) in names.iter().enumerate() {
            let bare = name.strip_prefix('!');
            reversed[at] = bare.is_some();
            let bare = bare.unwrap_or(name);
            ports[at] = Port::ALL
                .into_iter()
                .find(|port| port.as_str() == bare)
                .ok_or_else(|| format!("the board has no motor port `{bare}`"))?;
        }
        Self::new(ports, reversed).ok_or_else(|| format!("{value} names a port twice"))
    }

    fn show(&self, _unit: &str) -> String {
        format!("\"{self}\"")
    }

    fn allowed(_unit: &str, _bounds: Option<&Bounds<Infallible>>) -> String {
        "ports of LF, RF, LR, RR joined by \"-\", each of x, y, z, e0, e1, none twice, with \"!\" \
         before one that turns the other way: \"x-y-e0-e1\", \"x-y-z-e0\", \"x-!y-e0-e1\", …"
            .to_owned()
    }

    fn schema(_unit: &str, _bounds: Option<&Bounds<Infallible>>) -> Schema {
        json_schema!({"type": "string", "pattern": "^!?(x|y|z|e0|e1)(-!?(x|y|z|e0|e1)){3}$",
            "examples": ["x-!y-e0-e1"]})
    }
}

#[cfg(test)]
mod tests;
