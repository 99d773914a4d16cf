//! The world outside the firmware: bodies, tyres, motors, battery, rails.
//!
//! A [`World`] holds every body in one top-down rapier2d world, with what a [`WorldMap`] puts into
//! it. A plant, [`R150Plant`] or [`MecanumPlant`], is the hardware of one vehicle: it takes the pins
//! that the firmware drives, solves the electrics and the wheels, and returns what the firmware's
//! sensors would read. The world and its plants advance together:
//!
//! ```
//! use rigsim_physics::{Plant as _, Pose, R150Commands, R150Plant, R150PlantSettings, World, WorldSettings};
//!
//! let mut world = World::new(&WorldSettings::default());
//! let mut plant = R150Plant::new("r150", &R150PlantSettings::default(), &mut world, Pose::default());
//! let mut commands = R150Commands::default();
//! commands.motor_duty.right = 0.5;
//! commands.motor_duty.left = 0.5;
//! plant.set_commands(&commands);
//! for _ in 0..200 {
//!     plant.before_step(&mut world);
//!     world.step()?;
//!     plant.after_step(&mut world);
//! }
//! assert!(plant.truth().motion.pose.x > 0.3);
//! # Ok::<(), rigsim_physics::PhysicsError>(())
//! ```
//!
//! # Conventions
//!
//! SI units throughout; x points forward (east for the world), y to the left, angles and yaw rates
//! are counter-clockwise. Everything is `f64`.
//!
//! # Determinism
//!
//! The same calls in the same order give bit-identical results in debug and release builds and on
//! every platform with IEEE 754 arithmetic: rapier is built with `enhanced-determinism`, and the
//! transcendental functions here come from `libm`, never from the platform.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

mod drawing;
pub mod faults;
pub mod mecanum;
pub mod noise;
mod plant;
mod pose;
pub mod r150;
mod running_gear;
mod tolerance;
pub mod traction;
mod twist;
mod vehicle_body;
pub mod world;

pub use drawing::{Drawing, EchoDrawing, WheelDrawing};
pub use faults::Bounds;
pub use mecanum::{
    MecanumCommands, MecanumMeasurements, MecanumPlant, MecanumPlantSettings, MecanumTruth,
};
pub use plant::{Motion, Plant};
pub use pose::{BodyMotion, Pose};
pub use r150::{R150Commands, R150Measurements, R150Plant, R150PlantSettings, R150Truth};
pub use running_gear::{Energy, RunningGear};
pub use tolerance::Tolerances;
pub use twist::{Twist, Wrench};
pub use vehicle_body::{Build, VehicleBody};
pub use world::{BodyId, BodyShape, Ground, PhysicsError, World, WorldMap, WorldSettings};
