//! Campaigns: many cases, played by many processes, and put together afterwards.
//!
//! The engine that starts the processes is the user's. Each process plays the shard that it is, and
//! keeps its results in a folder; `sim merge` reads the folders.

mod engine;
mod merge;
mod plan;
mod results;
mod shard;
mod summary;

pub(crate) use merge::{MergeArgs, merge};
pub(crate) use plan::Plan;
pub(crate) use results::Results;
pub(crate) use shard::{Shard, ShardArg};
