//! Dissectors of the protocols of devices for Wireshark, from the declarations of their messages.

use rigsim_core::device::{DeviceSpec, Form};
use rigsim_core::message::{FieldInfo, MessageInfo, Sender, WireType};
use serde_json::{Value, json};

/// What is the same for all protocols.
const TEMPLATE: &str = include_str!("dissector.lua");

/// Name of the dissector of a link.
pub(super) fn dissector_name(device: &DeviceSpec, link: usize) -> String {
    match device.links.get(link) {
        Some(spec) if link > 0 => format!("{}_{}", device.id, spec.id),
        _ => device.id.to_owned(),
    }
}

/// The dissector of all links of a device, in Lua.
pub(crate) fn dissector(spec: &DeviceSpec) -> String {
    let mut text = format!(
        "-- Dissector for {} in Wireshark. `sim schema {} --format lua` prints it; do not edit.\n{TEMPLATE}",
        spec.title, spec.id
    );
    for (link, link_spec) in spec.links.iter().enumerate() {
        let messages = spec.all_messages().filter(|info| info.link == link);
        let form = match link_spec.framing.form {
            Form::Frames {
                id_at,
                fields_at,
                check,
                ..
            } => json!({"id_at": id_at, "fields_at": fields_at, "checked": check.is_some()}),
            Form::Lines => json!({"lines": true}),
        };
        let name = dissector_name(spec, link);
        let link = json!({
            "name": name,
            "title": format!("{} ({})", spec.id, link_spec.name),
            "form": form,
            "messages": messages.map(message).collect::<Vec<_>>(),
        });
        text += &format!("\ndissector({})\n", lua(&link, 0));
    }
    text
}

fn message(info: &MessageInfo) -> Value {
    let layout = info.layout();
    json!({
        "id": info.id,
        "name": info.name,
        "text": info.text.trim(),
        "sender": match info.sender { Sender::Client => "request", Sender::Device => "reply" },
        "fields": layout.map(|(offset, field)| self::field(offset, field)).collect::<Vec<_>>(),
    })
}

fn field(offset: usize, field: &FieldInfo) -> Value {
    let (wire, prefix) = match field.wire {
        WireType::Bool => ("bool", None),
        WireType::U8 => ("uint8", None),
        WireType::U16 => ("uint16", None),
        WireType::U32 => ("uint32", None),
        WireType::I16 => ("int16", None),
        WireType::I32 => ("int32", None),
        WireType::Decimal { prefix } => ("int32", Some(prefix)),
    };
    json!({
        "name": field.name,
        "wire": wire,
        "size": field.wire.size(),
        "offset": offset,
        "prefix": prefix,
        "count": field.count,
        "per": Some(field.per).filter(|per| *per > 1),
        "unit": Some(field.unit).filter(|unit| !unit.is_empty()),
        "hex": field.hex.then_some(true),
        "bits": Some(field.bits).filter(|bits| !bits.is_empty()),
        "values": Some(field.values).filter(|values| !values.is_empty()),
    })
}

/// A value as Lua writes it.
fn lua(value: &Value, depth: usize) -> String {
    let wide = depth < 3;
    let around = |parts: Vec<String>| {
        let line = |depth| format!("\n{}", "  ".repeat(depth));
        let [gap, end] = match wide && !parts.is_empty() {
            true => [line(depth + 1), line(depth)],
            false => [" ", " "].map(str::to_owned),
        };
        let parts: String = parts.iter().map(|part| format!("{gap}{part},")).collect();
        format!("{{{parts}{end}}}")
    };
    match value {
        Value::Array(all) => around(all.iter().map(|one| lua(one, depth + 1)).collect()),
        Value::Object(all) => {
            // What is not there is nil.
            let all = all.iter().filter(|(_, one)| !one.is_null());
            around(
                all.map(|(key, one)| format!("{key} = {}", lua(one, depth + 1)))
                    .collect(),
            )
        }
        other => other.to_string(),
    }
}
