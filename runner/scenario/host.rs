//! Actions and expectations of the scripted client.

use std::ops::Range;
use std::time::Duration;

use rigsim_core::device::host::{Field, Fields, Message};
use rigsim_core::event::read_hex;
use rigsim_core::rig::PortId;
use rigsim_settings::or_allowed;
use toml::de::DeValue;
use toml::{Spanned, Value};

use super::document::{HostText, PortText, ReplyText};
use crate::forgiving::{self, LeftOut};
use crate::problems::Problems;
use crate::rig_file::DevicePlan;

/// Most bytes that a step sends.
const MOST_BYTES: usize = 1024;

/// Action of the scripted client at a port.
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
    Silence,
}

/// Value that a field has to have.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum FieldWanted {
    Exactly(Field),
    Between(f64, f64),
}

/// Returns whether a reply is as wanted; if not, which field is not.
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

/// Reads what the scripted client of a device does.
pub(super) struct HostReader<'r, 'p> {
    /// Index and plan of the device.
    pub plan: (usize, &'r DevicePlan),
    /// Some of it could not be read.
    pub is_cut: bool,
    pub problems: &'r mut Problems<'p>,
}

impl HostReader<'_, '_> {
    /// Reads it, and reports all that is wrong with it.
    pub(super) fn read(
        mut self,
        text: &HostText,
        at: Range<usize>,
        send: Option<&Spanned<DeValue<'_>>>,
    ) -> Option<HostAction> {
        let (device, plan) = self.plan;
        let message = send.and_then(|send| self.message(send));
        let link = match &text.link {
            Some(name) => self.link(name),
            None => Some(message.as_ref().map_or(0, |message| message.link)),
        };
        if let (Some(message), Some(link)) = (&message, link)
            && message.link != link
        {
            let of = |index: usize| plan.device.links.get(index).map_or("?", |link| link.id);
            let why = format!("this is a command of the {} link", of(message.link));
            self.problems.add(at.clone(), &why);
        } else if let Some(link) = link.filter(|link| *link >= plan.ports.len()) {
            self.problems.add(at.clone(), &plan.device.lacks_link(link));
        }
        let command = message.as_ref().and_then(|message| message.command);
        let mut does = Vec::new();
        if send.is_some() {
            does.push(message.map(|message| HostDoes::Send(message.bytes)));
        }
        if let Some(bytes) = &text.bytes {
            let bytes = self.problems.take(bytes.span(), bytes_of(bytes.get_ref()));
            does.push(bytes.map(HostDoes::Send));
        }
        if let Some(port) = text.port {
            does.push(Some(match port {
                PortText::Open => HostDoes::Open,
                PortText::Close => HostDoes::Close,
            }));
        }
        does.extend(text.baud.map(|baud| Some(HostDoes::Baud(baud))));
        // Which fields there are is said by the command.
        let is_known = link.is_some() && (send.is_none() || matches!(does[..], [Some(_), ..]));
        let names = is_known.then(|| plan.device.reply_fields(link.unwrap_or(0), command));
        let expect = text.expect.as_ref();
        let expect = expect.map(|expect| self.reply(expect, names.as_deref(), command));
        if (does.len() > 1 || (does.is_empty() && expect.is_none())) && !self.is_cut {
            let why = "exactly one of `send`, `bytes`, `port` and `baud` says what to do; \
                       without any, `expect` has to be there";
            self.problems.add(at, why);
        }
        Some(HostAction {
            port: PortId {
                device,
                link: link?,
            },
            does: does.pop().unwrap_or(Some(HostDoes::Nothing))?,
            expect: expect.flatten(),
        })
    }

    fn message(&mut self, send: &Spanned<DeValue<'_>>) -> Option<Message> {
        let (_, plan) = self.plan;
        let settings = plan.own_settings()?;
        let (send, left_out) = (&mut send.clone(), &mut LeftOut::default());
        forgiving::read(send, left_out, self.problems, &|send| {
            (plan.device.host.read)(send, settings)
        })
    }

    fn link(&mut self, name: &Spanned<String>) -> Option<usize> {
        let spec = self.plan.1.device;
        let found = spec.link(name.get_ref()).ok_or_else(|| {
            let all: Vec<&str> = spec.links.iter().map(|link| link.id).collect();
            let allowed = or_allowed(name.get_ref(), &all);
            format!("{} has no link `{}`; {allowed}", spec.title, name.get_ref())
        });
        self.problems.take(name.span(), found)
    }

    /// Reply that has to come, whose fields have these names if they are known.
    fn reply(
        &mut self,
        text: &ReplyText,
        names: Option<&[&str]>,
        command: Option<u8>,
    ) -> Option<ReplyWanted> {
        if text.reply.is_some() && text.silence {
            let why = "only one of `reply` and `silence` can be expected";
            self.problems.add(text.within.span(), why);
        }
        let wanted = if let Some(reply) = &text.reply {
            let mut fields = Vec::new();
            for (name, value) in reply.get_ref() {
                let field = match names.filter(|names| !names.contains(&name.as_str())) {
                    None => read_field(value).map_err(|why| format!("`{name}`: {why}")),
                    Some(names) => {
                        let allowed = or_allowed(name, names);
                        Err(format!("that reply has no field `{name}`; {allowed}"))
                    }
                };
                let field = self.problems.take(reply.span(), field);
                fields.extend(field.map(|field| (name.clone(), field)));
            }
            Wanted::Fields(fields)
        } else if text.silence {
            Wanted::Silence
        } else {
            Wanted::Any
        };
        Some(ReplyWanted {
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

fn bytes_of(text: &str) -> Result<Vec<u8>, String> {
    let bytes = read_hex(text.chars().filter(|c| !c.is_whitespace()));
    let bytes = bytes
        .filter(|bytes| !bytes.is_empty())
        .ok_or("bytes are pairs of hexadecimal digits, as in \"AA 55 00 07\"")?;
    match bytes.len() {
        ..=MOST_BYTES => Ok(bytes),
        count => Err(format!(
            "{count} bytes are too many; at most {MOST_BYTES} are allowed"
        )),
    }
}
