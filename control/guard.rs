//! Guard of who may ask, and how often.

use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::Refusal;
use crate::http::Head;

/// Between two requests, on average.
const INTERVAL: Duration = Duration::from_millis(1);
/// By how much requests may be ahead of that.
const BURST: Duration = Duration::from_millis(50);

/// A token that cannot be guessed.
pub(crate) fn new_token() -> io::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(io::Error::other)?;
    Ok(format!("{:032x}", u128::from_be_bytes(bytes)))
}

/// Refuses clients that must not ask.
#[derive(Debug)]
pub(crate) struct Guard {
    pub(crate) address: SocketAddr,
    pub(crate) token: String,
}

impl Guard {
    /// Refuses what a browser sends on behalf of another site: to a name that merely leads here, or
    /// from a page that is not ours.
    pub(crate) fn check_site(&self, head: &Head) -> Result<(), Refusal> {
        let host = head
            .host
            .as_deref()
            .filter(|host| self.is_own(host))
            .ok_or_else(|| {
                let why = format!(
                    "the Host of a request has to be the address itself, as {}",
                    self.address
                );
                Refusal::new(403, why)
            })?;
        let is_this_site = |origin: &str| origin.strip_prefix("http://") == Some(host);
        match head.origin.as_deref() {
            Some(origin) if !is_this_site(origin) => {
                Err(Refusal::new(403, "pages of other sites may not ask"))
            }
            _ => Ok(()),
        }
    }

    /// Refuses a request without the token.
    pub(crate) fn check_token(&self, head: &Head) -> Result<(), Refusal> {
        let given = head
            .authorization
            .as_deref()
            .and_then(|text| text.strip_prefix("Bearer "))
            .unwrap_or_default();
        if is_same(given.as_bytes(), self.token.as_bytes()) {
            return Ok(());
        }
        let why = "the token is missing or wrong; the simulator prints it in its URL, and it is sent as \
                   `Authorization: Bearer TOKEN`";
        Err(Refusal::new(401, why))
    }

    /// Returns whether a `Host` means this address. Names other than `localhost` do not, since they
    /// may come to lead here without consent.
    fn is_own(&self, host: &str) -> bool {
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !port.ends_with(']') => (name, port.parse().ok()),
            _ => (host, Some(80)),
        };
        let bound = self.address.ip();
        let bare = name.strip_prefix('[').and_then(|n| n.strip_suffix(']'));
        let address: Option<IpAddr> = bare.unwrap_or(name).parse().ok();
        let is_here = match address {
            Some(address) => address == bound || bound.is_unspecified(),
            None => name == "localhost" && (bound.is_loopback() || bound.is_unspecified()),
        };
        is_here && port == Some(self.address.port())
    }
}

/// Compares in a time that does not tell how much is right.
fn is_same(given: &[u8], wanted: &[u8]) -> bool {
    let differs = given
        .iter()
        .zip(wanted)
        .fold(0, |differs, (a, b)| differs | (a ^ b));
    given.len() == wanted.len() && differs == 0
}

/// Holds requests back that are too many.
#[derive(Debug, Default)]
pub(crate) struct Pace(Mutex<Option<Instant>>);

impl Pace {
    /// Waits until it is this request's turn.
    pub(crate) fn wait(&self) {
        thread::sleep(self.turn(Instant::now()));
    }

    /// The time from `now` for which the next request has to wait.
    fn turn(&self, now: Instant) -> Duration {
        let mut next = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let earliest = now.checked_sub(BURST).unwrap_or(now);
        let turn = next.map_or(earliest, |next| next.max(earliest));
        *next = Some(turn + INTERVAL);
        turn.saturating_duration_since(now)
    }
}

#[cfg(test)]
mod tests;
