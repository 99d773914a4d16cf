//! Virtual devices inside your own Rust tests and programs.

mod clock;
pub mod fairness;
pub mod ports;
pub mod serve;
pub mod served;
pub mod simulation;
mod slowness;
