//! A simulation in simulated time, and its devices.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::event::Event;
use rigsim_core::report::Report;
use rigsim_core::rig::Rig;
use rigsim_runner::condition::{ExpressionError, Reading};
use rigsim_runner::{Outcome, Run, RunError};
use toml::Value;

use crate::error::Error;
use crate::port_state::PortState;

/// Longest span that a condition is not looked at.
const LOOK: Duration = Duration::from_millis(5);

/// Devices in their world, in simulated time: it passes when you say so, or when a
/// [`ClientPort`](crate::ClientPort) waits. Clones are the same simulation.
///
/// ```
/// use std::io::{Read, Write};
/// use std::time::Duration;
///
/// let sim = rigsim_embed::Simulation::of("r150")?;
/// let mut port = sim.device("r150")?.open()?;
/// port.write_all(&[0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84])?;
/// let mut reply = [0; 7];
/// port.read_exact(&mut reply)?;
/// assert_eq!(reply[..5], [0xAA, 0x55, 1, 7, 1]);
/// // 13 bytes of ten bits at 115200 baud, and the moment that the module takes.
/// assert!(sim.now().as_nanos() > 13 * 86_806);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct Simulation(Arc<Mutex<State>>);

pub(crate) struct State {
    pub(crate) run: Run,
    pub(crate) ports: Vec<PortState>,
}

impl Simulation {
    pub(crate) fn new(run: Run) -> Self {
        let ports = run.ports().iter().map(|id| PortState::new(*id, &run));
        let ports = ports.collect();
        Self(Arc::new(Mutex::new(State { run, ports })))
    }

    pub(crate) fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The present in simulated time.
    #[must_use]
    pub fn now(&self) -> SimTime {
        self.state().run.rig().now()
    }

    /// Advances time.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn advance(&self, time: Duration) -> Result<(), Error> {
        let mut state = self.state();
        let to = state.run.rig().now() + time;
        Ok(state.advance(to)?)
    }

    /// Advances time until a condition over the names of `sim names` holds, as
    /// `truth.at_rest && count.bad_crc == 0`; looked at every 5 ms and at every event.
    ///
    /// # Errors
    /// When it has not come to hold `within` this time, with the values that its names had; or when
    /// it makes no sense.
    pub fn wait_until(&self, condition: &str, within: Duration) -> Result<(), Error> {
        let mut state = self.state();
        let checked = state.run.condition(condition)?;
        let due = state.run.rig().now() + within;
        while !state.run.holds(&checked)? {
            let now = state.run.rig().now();
            if now >= due || state.run.finished().is_some() {
                return Err(Error::NotHeld {
                    condition: condition.to_owned(),
                    at: now,
                    found: state.run.explain(&checked),
                });
            }
            let next = state.run.next_deadline().unwrap_or(due);
            state.advance(next.min(now + LOOK).min(due))?;
        }
        Ok(())
    }

    /// The value of an expression over the names of `sim names`, as `car.truth.speed_mps * 3.6`.
    /// With one device its name may be left out.
    ///
    /// # Errors
    /// When it makes no sense, or is not a number.
    pub fn number(&self, expression: &str) -> Result<f64, Error> {
        match self.value(expression)? {
            Reading::Number(number) => Ok(number),
            Reading::Flag(_) => Err(Error::Expression(ExpressionError::NoNumber {
                expression: expression.to_owned(),
            })),
        }
    }

    /// Returns whether a condition over the names of `sim names` holds now.
    ///
    /// # Errors
    /// When it makes no sense, or is a number.
    pub fn holds(&self, condition: &str) -> Result<bool, Error> {
        match self.value(condition)? {
            Reading::Flag(flag) => Ok(flag),
            Reading::Number(_) => Err(Error::Expression(ExpressionError::NoFlag {
                expression: condition.to_owned(),
            })),
        }
    }

    fn value(&self, expression: &str) -> Result<Reading, Error> {
        Ok(self.state().run.value(expression)?)
    }

    /// Adds a step, written as a `[[step]]` of scenario files: at once, or when its `at`
    /// (counted from now), `when` or `after` says.
    ///
    /// ```
    /// # let sim = rigsim_embed::Simulation::of("r150")?;
    /// sim.step(r#"world = { add = { circle = [{ at_m = [2, 0], radius = "0.2 m" }] } }"#)?;
    /// sim.step(
    ///     r#"
    ///     when = "truth.speed_mps > 0.5"
    ///     operator = { emergency_stop = true }
    ///     "#,
    /// )?;
    /// # Ok::<(), rigsim_embed::Error>(())
    /// ```
    ///
    /// # Errors
    /// When the text makes no sense, or the simulation cannot go on.
    pub fn step(&self, step: &str) -> Result<Step, Error> {
        let index = self.state().run.add_step(step)?;
        Ok(Step {
            simulation: self.clone(),
            index,
        })
    }

    /// The device of this name.
    ///
    /// # Errors
    /// When there is none.
    pub fn device(&self, name: &str) -> Result<Device, Error> {
        let state = self.state();
        let devices = &state.run.scenario().rig.devices;
        let index = devices.iter().position(|device| device.name == name);
        let index = index.ok_or_else(|| {
            let known: Vec<&str> = devices.iter().map(|device| device.name.as_str()).collect();
            Error::NoSuchPort {
                wanted: name.to_owned(),
                known: known.join(", "),
            }
        })?;
        drop(state);
        Ok(Device {
            simulation: self.clone(),
            index,
            name: name.to_owned(),
        })
    }

    /// Takes what has happened since this was last asked, at most the last 16384 events.
    #[must_use]
    pub fn events(&self) -> Vec<Event> {
        let mut state = self.state();
        std::iter::from_fn(|| state.run.poll_event()).collect()
    }

    /// Calls `look` with the devices and their world, down to every wheel.
    pub fn look<T>(&self, look: impl FnOnce(&Rig) -> T) -> T {
        look(self.state().run.rig())
    }

    /// Plays what is left of a scenario without a client, and says what came of it all.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn finish(&self) -> Result<Outcome, Error> {
        let mut state = self.state();
        if !state.run.scenario().is_endless() {
            state.advance(SimTime::MAX)?;
        }
        Ok(state.run.end().clone())
    }
}

impl State {
    /// Goes on to `to`, with ports that take what arrives.
    pub(crate) fn advance(&mut self, to: SimTime) -> Result<(), RunError> {
        self.run.advance(to)?;
        for port in &mut self.ports {
            port.update(&mut self.run)?;
        }
        Ok(())
    }
}

/// A device of a [`Simulation`].
#[derive(Clone)]
pub struct Device {
    pub(crate) simulation: Simulation,
    pub(crate) index: usize,
    pub(crate) name: String,
}

impl Device {
    /// Its name.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The value of a name of `sim names`, as `truth.speed_mps`.
    ///
    /// # Errors
    /// When there is no such name, or it is true or false.
    pub fn number(&self, name: &str) -> Result<f64, Error> {
        self.simulation.number(&self.qualified(name))
    }

    /// Returns whether a name of `sim names` is true, as `truth.at_rest`.
    ///
    /// # Errors
    /// When there is no such name, or it is a number.
    pub fn flag(&self, name: &str) -> Result<bool, Error> {
        self.simulation.holds(&self.qualified(name))
    }

    /// Calls `look` with the device itself, firmware and hardware, as one of its type.
    ///
    /// ```
    /// use rigsim_embed::rigsim_core::r150::R150;
    ///
    /// # let sim = rigsim_embed::Simulation::of("r150")?;
    /// let truth = sim.device("r150")?.look(|r150: &R150| r150.truth())?;
    /// let pose = truth.motion.pose;
    /// assert_eq!((pose.x, pose.heading), (0.0, 0.0));
    /// # Ok::<(), rigsim_embed::Error>(())
    /// ```
    ///
    /// # Errors
    /// When it is of another type.
    pub fn look<D: rigsim_core::device::Device, T>(
        &self,
        look: impl FnOnce(&D) -> T,
    ) -> Result<T, Error> {
        self.simulation
            .look(|rig| rig.device(self.index).map(look))
            .ok_or_else(|| Error::OtherDevice {
                device: self.name.clone(),
                wanted: std::any::type_name::<D>(),
            })
    }

    fn qualified(&self, name: &str) -> String {
        // Conditions write it so.
        format!("{}.{name}", self.name.replace('-', "_"))
    }

    /// Breaks something: a fault of `sim faults`, written as in scenario files. It lasts until the
    /// handle mends it, or as long as its `for` says.
    ///
    /// ```
    /// # let sim = rigsim_embed::Simulation::of("r150")?;
    /// let noise = sim
    ///     .device("r150")?
    ///     .fault(r#"kind = "bit-flips", probability = 0.01, direction = "to-client""#)?;
    /// # sim.advance(std::time::Duration::from_secs(1))?;
    /// noise.clear()?;
    /// assert_eq!(noise.hits(), 0); // No client asked anything.
    /// # Ok::<(), rigsim_embed::Error>(())
    /// ```
    ///
    /// # Errors
    /// When there is no such fault, or this device cannot have it.
    pub fn fault(&self, fault: &str) -> Result<Step, Error> {
        self.step(&format!("fault = {{ {fault} }}"))
    }

    /// Does something to it as an operator, as `"lock"` or `{ emergency_stop = true }` in scenario
    /// files.
    ///
    /// # Errors
    /// When this device has no such action.
    pub fn operator(&self, action: &str) -> Result<Step, Error> {
        if action.trim_start().starts_with('{') {
            self.step(&format!("operator = {action}"))
        } else {
            self.step(&format!("operator = {}", Value::from(action)))
        }
    }

    fn step(&self, what: &str) -> Result<Step, Error> {
        let device = Value::from(self.name.as_str());
        self.simulation.step(&format!("device = {device}\n{what}"))
    }

    /// Counts of what happened at it so far, and of what its client did that the protocol forbids.
    #[must_use]
    pub fn report(&self) -> Report {
        let state = self.simulation.state();
        let report = state.run.reports().nth(self.index);
        report.cloned().unwrap_or_default()
    }
}

/// A step: a fault, or an action.
#[derive(Clone)]
pub struct Step {
    simulation: Simulation,
    index: usize,
}

impl Step {
    /// Mends the fault that it has brought.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn clear(&self) -> Result<(), Error> {
        Ok(self.simulation.state().run.clear_step(self.index)?)
    }

    /// Number of times that its fault has hit something so far; `sim faults` says what counts.
    #[must_use]
    pub fn hits(&self) -> u64 {
        let state = self.simulation.state();
        let report = state.run.step_report(self.index);
        report.map_or(0, |step| step.hits)
    }
}
