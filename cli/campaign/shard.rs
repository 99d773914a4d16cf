//! The part of a campaign that one process plays.

use std::fmt;
use std::hash::Hasher as _;
use std::str::FromStr;

use anyhow::anyhow;
use siphasher::sip::SipHasher13;

use crate::exit::Failure;

use super::engine;

/// Most shards of a campaign.
const MOST_SHARDS: u32 = 100_000;

/// What `--shard` says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ShardArg {
    /// The variables of the engine say it.
    Auto,
    Given(Shard),
}

impl FromStr for ShardArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let (index, of) = text
            .split_once('/')
            .ok_or("wanted: K/N with K from 1 to N, as in 3/20, or auto")?;
        let number = |text: &str| text.parse().map_err(|_| format!("`{text}` is no number"));
        Shard::new(number(index)?, number(of)?).map(Self::Given)
    }
}

impl ShardArg {
    /// Returns the shard that this process is, and the engine whose variables said so.
    ///
    /// # Errors
    /// When no engine, two that differ, or half of one is found.
    pub(crate) fn find(self) -> Result<(Shard, Option<&'static str>), Failure> {
        match self {
            Self::Given(shard) => Ok((shard, None)),
            Self::Auto => engine::find(|name| std::env::var(name).ok())
                .map(|(shard, engine)| (shard, Some(engine)))
                .map_err(|why| Failure::usage(anyhow!("--shard auto: {why}"))),
        }
    }
}

/// One of equal parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shard {
    /// From 1.
    pub(crate) index: u32,
    pub(crate) of: u32,
}

impl Shard {
    /// All of it.
    pub(crate) const WHOLE: Self = Self { index: 1, of: 1 };

    /// # Errors
    /// When `index` is not from 1 to `of`.
    pub(crate) fn new(index: u64, of: u64) -> Result<Self, String> {
        let small = |number: u64| u32::try_from(number).ok().filter(|n| *n <= MOST_SHARDS);
        let (Some(index), Some(of)) = (small(index), small(of)) else {
            return Err(format!("at most {MOST_SHARDS} shards"));
        };
        if index == 0 || index > of {
            return Err(format!(
                "shard {index} of {of}: shards count from 1 to {of}"
            ));
        }
        Ok(Self { index, of })
    }

    /// Returns the number, from 1, of the shard that has a case. It depends on the case alone, so
    /// that a new file moves no other case.
    pub(crate) fn owner(
        of: u32,
        file: &str,
        parameters: &[(String, String)],
        set: &[String],
        seed: u64,
    ) -> u32 {
        let mut hasher = SipHasher13::new();
        let mut part = |text: &str| {
            hasher.write(text.as_bytes());
            hasher.write_u8(0);
        };
        part(file);
        for (name, value) in parameters {
            part(name);
            part(value);
        }
        part("");
        for set in set {
            part(set);
        }
        hasher.write(&seed.to_le_bytes());
        let place = hasher.finish() % u64::from(of);
        u32::try_from(place).unwrap_or_default() + 1
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

#[cfg(test)]
mod tests;
