//! Listeners, which get messages about what happens.

use std::sync::atomic::Ordering;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use crossbeam_channel::{Receiver, Sender, TrySendError, bounded};
use serde_json::Value;

use crate::Refusal;
use crate::watch::Watch;

/// Most messages that wait for a reader.
const MOST_MESSAGES: usize = 256;
/// Most names of one stream.
const MOST_NAMES: usize = 256;
/// Most messages a second of one kind that come at a rate.
const MOST_RATE: f64 = 60.0;

/// Wishes of a stream.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Wants {
    /// Names whose values are sent.
    pub names: Vec<String>,
    /// Between two messages of values.
    pub values_every: Option<Duration>,
    /// Between two messages of where everything is.
    pub picture_every: Option<Duration>,
    /// Set if every request and reply is sent, beside what else happens.
    pub traffic: bool,
}

impl Wants {
    /// Reads the parameters of a request.
    pub(crate) fn read(query: &[(String, String)]) -> Result<Self, Refusal> {
        let mut wants = Self::default();
        let mut rate = 10.0;
        for (name, value) in query {
            match name.as_str() {
                "names" => wants.names.extend(names(value)),
                "rate" => rate = read_rate(name, value)?,
                "picture" => wants.picture_every = Some(every(read_rate(name, value)?)),
                "traffic" => wants.traffic = flag(name, value)?,
                other => return Err(unknown(other, "names, rate, picture, traffic")),
            }
        }
        if wants.names.len() > MOST_NAMES {
            return Err(Refusal::new(400, format!("at most {MOST_NAMES} names")));
        }
        if !wants.names.is_empty() {
            wants.values_every = Some(every(rate));
        }
        Ok(wants)
    }
}

/// The names in a list.
pub(crate) fn names(list: &str) -> impl Iterator<Item = String> {
    let names = list.split(',').map(str::trim);
    names.filter(|name| !name.is_empty()).map(str::to_owned)
}

/// A parameter that is on or off.
pub(crate) fn flag(name: &str, value: &str) -> Result<bool, Refusal> {
    match value {
        "1" | "true" | "" => Ok(true),
        "0" | "false" => Ok(false),
        _ => Err(Refusal::new(400, format!("{name} is true or false"))),
    }
}

/// A parameter that does not exist.
pub(crate) fn unknown(name: &str, allowed: &str) -> Refusal {
    let name: String = name.chars().take(80).collect();
    Refusal::new(400, format!("no parameter `{name}`; allowed: {allowed}"))
}

fn read_rate(name: &str, value: &str) -> Result<f64, Refusal> {
    let rate: Option<f64> = value.parse().ok();
    rate.filter(|rate| (0.1..=MOST_RATE).contains(rate))
        .ok_or_else(|| {
            Refusal::new(
                400,
                format!("{name} is a number a second, 0.1 to {MOST_RATE}"),
            )
        })
}

fn every(rate: f64) -> Duration {
    Duration::from_secs_f64(1.0 / rate)
}

/// A listener; its stream ends when it is dropped.
#[derive(Debug)]
pub struct Listener {
    /// The kinds of message that it subscribes to.
    pub wants: Wants,
    messages: Sender<Message>,
    watch: Arc<Watch>,
}

impl Listener {
    /// A listener, and the other end of it.
    pub(crate) fn new(wants: Wants, watch: Arc<Watch>) -> (Self, Receiver<Message>) {
        let (messages, other_end) = bounded(MOST_MESSAGES);
        let listener = Self {
            wants,
            messages,
            watch,
        };
        (listener, other_end)
    }

    /// Sends a message, without waiting: what it has no room for is lost, and it learns how many.
    /// Returns whether there still is a client.
    pub fn send(&self, message: &Message) -> bool {
        match self.messages.try_send(message.clone()) {
            Ok(()) => {
                self.watch.queued();
                true
            }
            Err(TrySendError::Full(_)) => {
                self.lose();
                true
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }

    /// Counts a message as lost.
    pub fn lose(&self) {
        self.watch.lost.fetch_add(1, Ordering::Relaxed);
    }
}

/// A message, the same for all listeners.
///
/// It is written down by the connection that sends it first, so that this takes no time of the
/// simulation's.
#[derive(Clone)]
pub struct Message(Arc<LazyLock<String, Write>>);

type Write = Box<dyn FnOnce() -> String + Send>;

impl Message {
    /// A message of a kind.
    pub fn new(kind: &'static str, data: impl FnOnce() -> Value + Send + 'static) -> Self {
        // JSON has no line feeds in it.
        let write = move || format!("event: {kind}\ndata: {}\n\n", data());
        Self(Arc::new(LazyLock::new(Box::new(write))))
    }

    pub(crate) fn text(&self) -> &str {
        &self.0
    }
}

#[cfg(test)]
mod tests;
