//! Virtual devices inside your own Rust tests and programs.

mod clock;
pub mod ports;
pub mod serve;
pub mod served;
mod slowness;
