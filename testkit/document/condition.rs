//! Conditions of the names, operators and functions that there are.

use sim_core::device::names::Unit;

use super::Writer;

/// Deepest nesting of them.
const MOST_DEPTH: usize = 4;

impl Writer<'_> {
    /// A condition about the devices.
    pub(super) fn condition(&mut self) -> String {
        self.flag(MOST_DEPTH)
    }

    fn flag(&mut self, depth: usize) -> String {
        if self.choices.is_odd() {
            return self.numeric(depth.min(1));
        }
        match self.choices.below(if depth == 0 { 3 } else { 8 }) {
            0 => self.name(true),
            1 => ["true", "false"][self.choices.below(2)].to_owned(),
            2..=4 => {
                let operator = ["<", ">", "<=", ">=", "==", "!="][self.choices.below(6)];
                let [left, right] = [0; 2].map(|_| self.numeric(depth.saturating_sub(2)));
                format!("{left} {operator} {right}")
            }
            5 => format!("!({})", self.flag(depth - 1)),
            6 => {
                let [one, two, three] = [0; 3].map(|_| self.flag(depth - 1));
                format!("({one} ? {two} : {three})")
            }
            _ => {
                let operator = ["&&", "||"][self.choices.below(2)];
                let [left, right] = [0; 2].map(|_| self.flag(depth - 1));
                format!("({left} {operator} {right})")
            }
        }
    }

    fn numeric(&mut self, depth: usize) -> String {
        if self.choices.is_odd() {
            return self.flag(depth.min(1));
        }
        match self.choices.below(if depth == 0 { 3 } else { 6 }) {
            0 => self.name(false),
            1 => {
                let numbers = ["0", "1", "0.5", "-1", "2", "100", "1e308", "0.1", "1e-300"];
                numbers[self.choices.below(numbers.len())].to_owned()
            }
            2 => "t".to_owned(),
            3 => format!("abs({})", self.numeric(depth - 1)),
            4 => {
                let function = ["min", "max"][self.choices.below(2)];
                let [left, right] = [0; 2].map(|_| self.numeric(depth - 1));
                format!("{function}({left}, {right})")
            }
            _ => {
                let operator = ["+", "-", "*", "/"][self.choices.below(4)];
                let [left, right] = [0; 2].map(|_| self.numeric(depth - 1));
                format!("({left} {operator} {right})")
            }
        }
    }

    /// A name of a device's tree, true or false or a number; or one that is not there.
    fn name(&mut self, is_flag: bool) -> String {
        if self.choices.is_odd() {
            let odd = [
                "nobody.truth.speed_mps",
                "truth",
                "t.t",
                "r150.",
                "x[0]",
                "size(1)",
                "\"a\"",
                "1 +",
            ];
            return odd[self.choices.below(odd.len())].to_owned();
        }
        let Some((device, kind)) = self.choices.pick(&self.devices) else {
            return "t".to_owned();
        };
        let names: Vec<&str> = kind
            .all_names()
            .filter(|info| (info.unit == Unit::Flag) == is_flag)
            .map(|info| info.name)
            .collect();
        let name = self.choices.pick(&names).copied().unwrap_or("t");
        if self.devices.len() == 1 && self.choices.once_in(2) {
            name.to_owned()
        } else {
            format!("{}.{name}", device.replace('-', "_"))
        }
    }
}
