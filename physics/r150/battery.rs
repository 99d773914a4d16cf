//! Two packs in parallel.

use super::settings::BatterySettings;

/// The packs as one source.
#[derive(Debug, Clone)]
pub(super) struct Battery {
    /// Open-circuit voltage from empty to full in steps of 10 %, V.
    open_circuit: [f64; 11],
    /// Of the packs and their wiring, Ω.
    pub(super) resistance: f64,
    /// A·s
    capacity: f64,
    /// 0–1
    soc: f64,
    /// Share of the capacity that a fault has taken away for as long as it lasts.
    pub(super) missing: f64,
    /// It takes no more charge: its management opens the path, and a brake resistor turns what the
    /// drivers feed back into heat.
    pub(super) full: bool,
}

/// Cells in series: 48.1 V nominal is 13 cells of 3.7 V.
const CELLS: f64 = 13.0;
/// A battery that was full takes charge again when it has lost this share.
const ROOM: f64 = 0.005;

impl Battery {
    pub(super) fn new(settings: &BatterySettings) -> Self {
        Self {
            open_circuit: settings.cell_voltage.map(|cell| cell * CELLS),
            resistance: settings.resistance,
            capacity: settings.capacity * 3600.0,
            soc: settings.initial_soc / 100.0,
            missing: 0.0,
            full: settings.initial_soc >= 100.0,
        }
    }

    /// Voltage without current, V.
    pub(super) fn open_circuit(&self) -> f64 {
        let place = self.soc() * 10.0;
        let mut below = 0;
        // Ten comparisons cost less than a conversion that must be proven to be in range.
        while below < 9 && place >= [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0][below] {
            below += 1;
        }
        let (low, high) = (self.open_circuit[below], self.open_circuit[below + 1]);
        let fraction = place - [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0][below];
        low + (high - low) * fraction
    }

    pub(super) fn soc(&self) -> f64 {
        (self.soc - self.missing).max(0.0)
    }

    /// Without what is missing.
    pub(super) fn own_soc(&self) -> f64 {
        self.soc
    }

    /// Counts charge. A full battery takes no more and an empty one stays at its lowest voltage.
    pub(super) fn discharge(&mut self, current: f64, seconds: f64) {
        let charge = current * seconds;
        self.soc = (self.soc - charge / self.capacity).clamp(0.0, 1.0);
        let least = if self.full { 1.0 - ROOM } else { 1.0 };
        self.full = self.soc > least || self.soc >= 1.0;
    }
}
