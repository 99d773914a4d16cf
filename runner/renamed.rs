//! Names that users have known and that are called otherwise now: an old one is an error that says
//! the new one. This file alone may have the old words.

use std::fmt;

use rigsim_settings::SettingsError;

/// Where a name stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Key of a table of scenario files, with the header of the table.
    Key(&'static str),
    /// Action or fault of a step, with its key.
    Effect(&'static str),
    /// Name in conditions.
    Name,
    /// Setting.
    Setting,
    /// Flag of the command line, with its subcommand.
    Flag(&'static str),
    /// Subcommand of `sim ctl`.
    Ctl,
}

/// A name that was changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Renamed {
    /// Where it stands.
    pub kind: Kind,
    /// The former name; with `*` at its end, all that begin so.
    pub old: &'static str,
    /// What stands in its place; empty for nothing.
    pub new: &'static str,
}

const fn renamed(kind: Kind, old: &'static str, new: &'static str) -> Renamed {
    Renamed { kind, old, new }
}

/// All old names.
#[rustfmt::skip]
pub const RENAMED: &[Renamed] = &[
    renamed(Kind::Key(""), "takes", "nominal_duration"),
    renamed(Kind::Key("[[step]]"), "may_not_trigger", "optional"),
    renamed(Kind::Key("[[response]]"), "may_not_trigger", "optional"),
    renamed(Kind::Effect("fault"), "battery-empty", "fault = { kind = \"charge-drop\", by = \"100 %\" }"),
    renamed(Kind::Effect("fault"), "rail-open", "fault = { kind = \"rail-load\", power = \"0 W\", … }"),
    renamed(Kind::Effect("fault"), "emergency-stop", "operator = { emergency_stop = true }"),
    renamed(Kind::Effect("fault"), "remote-control-takes-over", "operator = \"take_over\" or { press = … }"),
    renamed(Kind::Effect("fault"), "locked", "operator = \"lock\""),
    renamed(Kind::Effect("fault"), "parked", "operator = \"park\""),
    renamed(Kind::Effect("fault"), "app-takes-control", "operator = { app_holds = … }"),
    renamed(Kind::Effect("operator"), "push", "fault = { kind = \"push\", … }"),
    renamed(Kind::Effect("operator"), "payload", "fault = { kind = \"payload\", mass = … }"),
    renamed(Kind::Effect("world"), "friction", "fault = { kind = \"ice\", friction = … }"),
    renamed(Kind::Effect("world"), "load", "fault = { kind = \"rail-load\", … }"),
    renamed(Kind::Name, "count.deeds", "count.actions"),
    renamed(Kind::Name, "truth.charge_drawn_ah", "truth.soc_percent"),
    renamed(Kind::Name, "truth.driver_right_c", "truth.motor_right_derated"),
    renamed(Kind::Name, "truth.driver_left_c", "truth.motor_left_derated"),
    renamed(Kind::Name, "truth.temperature_ab_c", "reported.temperature_ab_c"),
    renamed(Kind::Name, "truth.temperature_cd_c", "reported.temperature_cd_c"),
    renamed(Kind::Name, "truth.fuse_motor_right_blown", "count.fuse_blown"),
    renamed(Kind::Name, "truth.fuse_motor_left_blown", "count.fuse_blown"),
    renamed(Kind::Name, "truth.fuse_tail_blown", "count.fuse_blown"),
    renamed(Kind::Name, "truth.fuse_small_modules_blown", "count.fuse_blown"),
    renamed(Kind::Name, "sensor.magnetic_bar", "sensor.strip"),
    renamed(Kind::Name, "wheel.*", ""),
    renamed(Kind::Name, "mode.board_powered", "count.power_lost"),
    renamed(Kind::Name, "mode.client_has_pwm", "host = { send = \"system_info\", expect = { reply = { pwm_ctrl_mode = … } } }"),
    renamed(Kind::Name, "client.last_request_age_s", "count.requests"),
    renamed(Kind::Name, "client.travel_since_motion_m", "truth.distance_m"),
    renamed(Kind::Name, "client.motions", "count.command_motion and count.command_line_X, …"),
    renamed(Kind::Setting, "r150.app_power", "operator = { app_sets = { on = … } }"),
    renamed(Kind::Setting, "r150.app_pwm", "operator = { app_sets = { pwm = … } }"),
    renamed(Kind::Setting, "r150.battery.pack_resistance", "r150.battery.resistance"),
    renamed(Kind::Setting, "r150.battery.wiring_resistance", "r150.battery.resistance"),
    renamed(Kind::Setting, "r150.body.payload", "fault = { kind = \"payload\", mass = … }"),
    renamed(Kind::Setting, "mecanum.body.payload", "fault = { kind = \"payload\", mass = … }"),
    renamed(Kind::Setting, "mecanum.wheel.axial_stiffness", "mecanum.wheel.roller_stiffness"),
    renamed(Kind::Setting, "mecanum.wiring", "fault = { kind = \"ports-swapped\", … }"),
    renamed(Kind::Setting, "mecanum.plugs", "fault = { kind = \"ports-swapped\", … }"),
    renamed(Kind::Setting, "r150.measurement_noise", "r150.noise.voltage, .current, .temperature and .speed"),
    renamed(Kind::Flag("run"), "--max-hold-up", "--max-stall"),
    renamed(Kind::Flag("trace"), "--export", "--to"),
    renamed(Kind::Ctl, "go-on", "resume"),
    renamed(Kind::Ctl, "step-by", "advance"),
];

/// Settings whose value is fixed now, a group a line: no client can tell it, or no vehicle has another.
const FIXED: &str = include_str!("renamed/fixed.txt");

/// Keys of scenario files that were removed, with one that stands beside each, and what to do instead.
#[rustfmt::skip]
const REMOVED: &[(&str, &str, &str)] = &[
    ("wall_limit", "limit", "`--timeout` limits a run"),
    ("overlap", "every", "a repetition waits until the last one is over"),
    ("clear", "every", "`until` or `for` ends a step"),
];

/// Names that are taken for others, where they stand and what is meant.
#[rustfmt::skip]
const CONFUSED: &[(&str, &str)] = &[
    // The modes of an R150 are two, of which the condition is one.
    ("mode.remote", "!mode.autonomous"),
    ("mode.manual", "!mode.autonomous"),
    ("mode.unlocked", "!mode.locked"),
    ("mode.estop", "mode.emergency_stop"),
    ("truth.speed", "truth.speed_mps"),
    ("truth.velocity", "truth.speed_mps"),
    ("truth.stopped", "truth.at_rest"),
    ("truth.x", "truth.x_m"),
    ("truth.y", "truth.y_m"),
    ("truth.distance", "truth.distance_m"),
    ("truth.heading", "truth.heading_deg"),
    ("time", "t"),
];

impl fmt::Display for Renamed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.new {
            "" => write!(f, "`{}` was removed", self.old),
            // Another quantity.
            new if self.kind == Kind::Name
                && new.starts_with("count.")
                && !self.old.starts_with("count.") =>
            {
                write!(f, "`{}` was removed; see `{new}`", self.old)
            }
            new => write!(f, "`{}` is now `{new}`", self.old),
        }
    }
}

/// Returns what became of a name that stands where `is_kind` says.
pub fn find(is_kind: impl Fn(Kind) -> bool, name: &str) -> Option<&'static Renamed> {
    let mut all = RENAMED.iter();
    all.find(|renamed| {
        let start = renamed.old.strip_suffix('*');
        let is_it = start.map_or_else(
            || is_like(renamed.old, name),
            |start| name.starts_with(start),
        );
        is_it && is_kind(renamed.kind)
    })
}

/// An error of a setting, which says what became of a former one.
#[must_use]
pub fn in_words(error: &SettingsError) -> String {
    let SettingsError::UnknownKey { origin, key, .. } = error else {
        return error.to_string();
    };
    match find(|kind| kind == Kind::Setting, key) {
        Some(renamed) => format!("{origin}: {renamed}"),
        None if is_fixed(key) => format!("{origin}: `{key}` was removed: its value is fixed now"),
        None => error.to_string(),
    }
}

fn is_fixed(key: &str) -> bool {
    let (group, name) = key.rsplit_once('.').unwrap_or_default();
    let rows = FIXED.lines().filter_map(|row| row.split_once(": "));
    let mut names = rows
        .filter(|row| row.0 == group)
        .flat_map(|row| row.1.split(' '));
    names.any(|fixed| fixed == name)
}

/// Returns whether two names differ by `-` and `_` at most.
pub(crate) fn is_like(one: &str, other: &str) -> bool {
    let plain = |c: char| if c == '_' { '-' } else { c };
    one.chars().map(plain).eq(other.chars().map(plain))
}

/// Returns what to do instead of using a removed key, where these keys are `allowed`.
pub(crate) fn instead(key: &str, allowed: &[&'static str]) -> Option<String> {
    let is_it = |(removed, beside, _): &&(&str, _, _)| *removed == key && allowed.contains(beside);
    let (_, _, instead) = REMOVED.iter().find(is_it)?;
    Some(format!("`{key}` was removed: {instead}"))
}

/// Returns what is meant by a name in a condition that is none, if that is known.
pub(crate) fn meant(name: &str) -> Option<&'static str> {
    let found = CONFUSED.iter().find(|(confused, _)| *confused == name);
    found.map(|(_, meant)| *meant)
}

#[cfg(test)]
mod tests;
