//! Devices that drive.

use std::collections::BTreeMap;
use std::time::Duration;

use rigsim_core::device::DeviceSpec;
use toml::Value;
use toml::de::DeValue;

use super::Player;

impl Player {
    /// Drives all devices for so many rounds of this length, or of a step of the physics: in every tenth, each
    /// gets one more command.
    pub(crate) fn drive(&mut self, pace: Option<Duration>, rounds: usize) {
        let pace = pace.unwrap_or(self.rig.world().step_length());
        let commands = self.plan.devices.iter().map(|plan| driving(plan.device));
        let commands: Vec<_> = commands.collect();
        for round in 0..rounds {
            for port in 0..self.clients.len() {
                let id = self.clients[port].port;
                if id.link == 0 && round.is_multiple_of(10) {
                    let commands = &commands[id.device];
                    self.send(port, &commands[round / 10 % commands.len()]);
                }
            }
            self.advance(self.now + pace);
            self.read_all();
            self.check();
        }
    }
}

/// Commands that drive, one after another: of what the plan of the device sends, the kind that it sends
/// most often.
fn driving(device: &DeviceSpec) -> Vec<Vec<u8>> {
    let plan = device.host.plan.parse();
    let plan = Value::Table(plan.unwrap_or_else(|error| panic!("{error}")));
    let list = |value: &Value, key| value.get(key).and_then(Value::as_array).cloned();
    let parts = list(&plan, "manoeuvre").into_iter().flatten();
    let parts = parts.flat_map(|part| list(&part, "do").into_iter().flatten());
    let mut kinds: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for command in parts.flat_map(|part| list(&part, "send").into_iter().flatten()) {
        let kind = command.as_table().and_then(|command| command.keys().next());
        // What stops it is sent often, too.
        let text = command.to_string();
        if let Some(kind) = kind.filter(|_| text.contains(|digit| matches!(digit, '1'..='9'))) {
            kinds.entry(kind.clone()).or_default().push(text);
        }
    }
    let most = kinds.into_values().max_by_key(Vec::len).unwrap_or_default();
    assert!(!most.is_empty(), "nothing is known to drive {device:?}");
    most.iter().map(|text| command(device, text)).collect()
}

/// A command as it is on the wire, by the settings as they are by default.
fn command(device: &DeviceSpec, text: &str) -> Vec<u8> {
    let value = DeValue::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    let read = (device.host.read)(&value, &*(device.settings)());
    read.unwrap_or_else(|error| panic!("{text}: {error}")).bytes
}
