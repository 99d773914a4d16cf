//! Conditions of the names, operators and functions that there are.

use sim_core::device::DeviceSpec;
use sim_core::device::names::Unit;

use super::choices::Choices;

/// How deeply they are nested.
const MOST_DEPTH: usize = 4;

/// A condition about these devices.
pub(super) fn condition(
    choices: &mut Choices<'_>,
    devices: &[(String, &'static DeviceSpec)],
) -> String {
    flag(choices, devices, MOST_DEPTH)
}

fn flag(
    choices: &mut Choices<'_>,
    devices: &[(String, &'static DeviceSpec)],
    depth: usize,
) -> String {
    if choices.is_odd() {
        return number(choices, devices, depth.min(1));
    }
    let kind = if depth == 0 {
        choices.below(3)
    } else {
        choices.below(8)
    };
    match kind {
        0 => name(choices, devices, true),
        1 => ["true", "false"][choices.below(2)].to_owned(),
        2..=4 => {
            let operator = ["<", ">", "<=", ">=", "==", "!="][choices.below(6)];
            let depth = depth.saturating_sub(2);
            let left = number(choices, devices, depth);
            format!("{left} {operator} {}", number(choices, devices, depth))
        }
        5 => format!("!({})", flag(choices, devices, depth - 1)),
        6 => {
            let [one, two, three] = [0; 3].map(|_| flag(choices, devices, depth - 1));
            format!("({one} ? {two} : {three})")
        }
        _ => {
            let operator = ["&&", "||"][choices.below(2)];
            let left = flag(choices, devices, depth - 1);
            format!("({left} {operator} {})", flag(choices, devices, depth - 1))
        }
    }
}

fn number(
    choices: &mut Choices<'_>,
    devices: &[(String, &'static DeviceSpec)],
    depth: usize,
) -> String {
    if choices.is_odd() {
        return flag(choices, devices, depth.min(1));
    }
    let kind = if depth == 0 {
        choices.below(3)
    } else {
        choices.below(6)
    };
    match kind {
        0 => name(choices, devices, false),
        1 => {
            let numbers = ["0", "1", "0.5", "-1", "2", "100", "1e308", "0.1", "1e-300"];
            numbers[choices.below(numbers.len())].to_owned()
        }
        2 => "t".to_owned(),
        3 => format!("abs({})", number(choices, devices, depth - 1)),
        4 => {
            let function = ["min", "max"][choices.below(2)];
            let left = number(choices, devices, depth - 1);
            format!(
                "{function}({left}, {})",
                number(choices, devices, depth - 1)
            )
        }
        _ => {
            let operator = ["+", "-", "*", "/"][choices.below(4)];
            let left = number(choices, devices, depth - 1);
            format!(
                "({left} {operator} {})",
                number(choices, devices, depth - 1)
            )
        }
    }
}

/// A name of a device's tree, true or false or a number; or one that is not there.
fn name(
    choices: &mut Choices<'_>,
    devices: &[(String, &'static DeviceSpec)],
    is_flag: bool,
) -> String {
    if choices.is_odd() {
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
        return odd[choices.below(odd.len())].to_owned();
    }
    let Some((device, kind)) = choices.pick(devices) else {
        return "t".to_owned();
    };
    let names: Vec<&str> = kind
        .all_names()
        .filter(|info| (info.unit == Unit::Flag) == is_flag)
        .map(|info| info.name)
        .collect();
    let name = choices.pick(&names).copied().unwrap_or("t");
    if devices.len() == 1 && choices.once_in(2) {
        name.to_owned()
    } else {
        format!("{}.{name}", device.replace('-', "_"))
    }
}
