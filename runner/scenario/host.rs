//! Deeds and expectations of the scripted client.

use std::time::Duration;

use sim_core::device::host::{Field, Fields};
use sim_core::rig::PortId;
use toml::de::{DeValue, ValueDeserializer};
use toml::{Spanned, Value};

use super::document::{HostText, PortText, ReplyText};
use super::problems::Problems;
use crate::rig_file::DevicePlan;
use crate::suggest::or_allowed;

/// Most bytes that a step sends or expects.
const MOST_BYTES: usize = 1024;

/// Deed of the scripted client at a port.
#[derive(Debug, Clone)]
pub(crate) struct HostAction {
    pub port: PortId,
    pub does: HostDoes,
    pub expect: Option<ReplyWanted>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum HostDoes {
    Send(Vec<u8>),
    Open,
    Close,
    Baud(u32),
    /// Only expects.
    Nothing,
}

/// Reply that has to come back, and by when.
#[derive(Debug, Clone)]
pub(crate) struct ReplyWanted {
    pub within: Duration,
    /// The reply's command byte, where it is known.
    pub command: Option<u8>,
    pub wanted: Wanted,
}

#[derive(Debug, Clone)]
pub(crate) enum Wanted {
    /// Any answer.
    Any,
    Fields(Vec<(String, FieldWanted)>),
    Bytes(Vec<u8>),
    Silence,
}

/// Value that a field has to have.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum FieldWanted {
    Exactly(Field),
    Between(f64, f64),
}

/// Tells whether a reply is as wanted; if not, which field is not.
pub(crate) fn matches_fields(
    fields: &Fields,
    wanted: &[(String, FieldWanted)],
) -> Result<(), String> {
    for (name, wanted) in wanted {
        let found = fields.iter().find(|(known, _)| known == name);
        let fits = match (found.map(|(_, field)| field), wanted) {
            (Some(field), FieldWanted::Exactly(exact)) => field == exact,
            (Some(Field::Number(number)), FieldWanted::Between(low, high)) => {
                (low..=high).contains(&number)
            }
            _ => false,
        };
        if !fits {
            return Err(match found {
                Some((_, field)) => format!("`{name}` is {field:?}, wanted {wanted:?}"),
                None => format!("it has no `{name}`"),
            });
        }
    }
    Ok(())
}

impl HostAction {
    pub(super) fn read(
        text: &HostText,
        at: std::ops::Range<usize>,
        send: Option<&Spanned<DeValue<'_>>>,
        (device, plan): (usize, &DevicePlan),
        problems: &mut Problems<'_>,
    ) -> Option<Self> {
        let spec = plan.device;
        let message = match (send, plan.own_settings()) {
            (Some(send), Some(settings)) => {
                let read = (spec.host.read)(ValueDeserializer::from(send.clone()), settings);
                Some(problems.read(send.span(), read)?)
            }
            _ => None,
        };
        let link = match (&text.link, &message) {
            (Some(name), _) => {
                let all: Vec<&str> = spec.links.iter().map(|link| link.id).collect();
                let found = spec.link(name.get_ref()).ok_or_else(|| {
                    let allowed = or_allowed(name.get_ref(), &all);
                    format!("{} has no link `{}`; {allowed}", spec.title, name.get_ref())
                });
                problems.take(name.span(), found)?
            }
            (None, Some(message)) => message.link,
            (None, None) => 0,
        };
        if let Some(message) = message.as_ref().filter(|message| message.link != link) {
            let of = |index: usize| spec.links.get(index).map_or("?", |link| link.id);
            let why = format!("this is a command of the {} link", of(message.link));
            problems.add(at, &why);
            return None;
        }
        if link >= plan.ports.len() {
            problems.add(at, &plan.lacks_link(link));
            return None;
        }
        let mut does = Vec::new();
        let command = message.as_ref().and_then(|message| message.command);
        does.extend(message.map(|message| HostDoes::Send(message.bytes)));
        if let Some(bytes) = &text.bytes {
            let bytes = problems.take(bytes.span(), read_hex(bytes.get_ref()))?;
            does.push(HostDoes::Send(bytes));
        }
        does.extend(text.port.map(|port| match port {
            PortText::Open => HostDoes::Open,
            PortText::Close => HostDoes::Close,
        }));
        does.extend(text.baud.map(HostDoes::Baud));
        let expect = match &text.expect {
            Some(expect) => {
                let names = (spec.host.fields)(link, command);
                Some(ReplyWanted::read(expect, &names, command, problems)?)
            }
            None => None,
        };
        if does.len() > 1 || (does.is_empty() && expect.is_none()) {
            let why = "exactly one of `send`, `bytes`, `port` and `baud` says what to do; \
                       without any, `expect` has to be there";
            problems.add(at, why);
            return None;
        }
        Some(Self {
            port: PortId { device, link },
            does: does.pop().unwrap_or(HostDoes::Nothing),
            expect,
        })
    }
}

impl ReplyWanted {
    fn read(
        text: &ReplyText,
        names: &[&str],
        command: Option<u8>,
        problems: &mut Problems<'_>,
    ) -> Option<Self> {
        let wanted = match (&text.reply, &text.bytes, text.silence) {
            (None, None, false) => Wanted::Any,
            (None, None, true) => Wanted::Silence,
            (None, Some(bytes), false) => {
                Wanted::Bytes(problems.take(bytes.span(), read_hex(bytes.get_ref()))?)
            }
            (Some(reply), None, false) => {
                let mut fields = Vec::new();
                for (name, value) in reply.get_ref() {
                    let field = if names.contains(&name.as_str()) {
                        read_field(value).map_err(|why| format!("`{name}`: {why}"))
                    } else {
                        let allowed = or_allowed(name, names);
                        Err(format!("that reply has no field `{name}`; {allowed}"))
                    };
                    fields.push((name.clone(), problems.take(reply.span(), field)?));
                }
                Wanted::Fields(fields)
            }
            _ => {
                let why = "only one of `reply`, `bytes` and `silence` can be expected";
                problems.add(text.within.span(), why);
                return None;
            }
        };
        Some(Self {
            within: text.within.get_ref().0,
            command,
            wanted,
        })
    }
}

fn read_field(value: &Value) -> Result<FieldWanted, String> {
    let allowed = "allowed: a number, true, false, a list of numbers, or { min = …, max = … }";
    #[expect(clippy::cast_precision_loss, reason = "fields have at most 32 bits")]
    let number = |value: &Value| match value {
        Value::Integer(whole) => Some(*whole as f64),
        Value::Float(number) => Some(*number),
        _ => None,
    };
    let exactly = |field| Ok(FieldWanted::Exactly(field));
    match value {
        Value::Boolean(flag) => exactly(Field::Flag(*flag)),
        Value::Array(values) => {
            let numbers: Option<Vec<f64>> = values.iter().map(number).collect();
            exactly(Field::List(numbers.ok_or(allowed)?))
        }
        Value::Table(range) => {
            if let Some(unknown) = range.keys().find(|key| *key != "min" && *key != "max") {
                return Err(format!("`{unknown}` is not known; {allowed}"));
            }
            let end = |key: &str, without: f64| match range.get(key) {
                Some(value) => number(value).ok_or(allowed),
                None => Ok(without),
            };
            let low = end("min", f64::NEG_INFINITY)?;
            Ok(FieldWanted::Between(low, end("max", f64::INFINITY)?))
        }
        other => exactly(Field::Number(number(other).ok_or(allowed)?)),
    }
}

fn read_hex(text: &str) -> Result<Vec<u8>, String> {
    let digits: Vec<char> = text.chars().filter(|c| !c.is_whitespace()).collect();
    let wrong = || "bytes are pairs of hexadecimal digits, as in \"AA 55 00 07\"".to_owned();
    if digits.is_empty() || digits.len() % 2 == 1 {
        return Err(wrong());
    }
    if digits.len() > 2 * MOST_BYTES {
        let count = digits.len() / 2;
        return Err(format!(
            "{count} bytes are too many; at most {MOST_BYTES} are allowed"
        ));
    }
    let byte = |pair: &[char]| {
        let pair: String = pair.iter().collect();
        // A sign would be read as part of a number.
        let digits = pair.chars().all(|c| c.is_ascii_hexdigit());
        digits.then(|| u8::from_str_radix(&pair, 16).ok()).flatten()
    };
    digits
        .chunks(2)
        .map(byte)
        .collect::<Option<_>>()
        .ok_or_else(wrong)
}
