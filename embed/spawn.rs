//! A simulation that is served in real time by its own thread.

use std::io::PipeWriter;
use std::path::{Path, PathBuf};
use std::thread::{Builder as ThreadBuilder, JoinHandle};

use rigsim_core::rig::PortId;
use rigsim_pty::{PtySetup, Waiter};
use rigsim_runner::{Outcome, Run};

use crate::error::Error;
use crate::ports::open_all;
use crate::serve::{Begin, Server, Wants};

/// Devices served on pseudo-terminals, for clients that open a path. When this is dropped, the
/// ports are gone and the thread has ended.
///
/// ```no_run
/// let served = rigsim_embed::Simulation::builder().device("r150").spawn()?;
/// let mut port = serialport::new(served.path().to_string_lossy(), 115_200).open()?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Spawned {
    paths: Vec<(PortId, PathBuf)>,
    names: Vec<String>,
    /// Closing it ends the loop.
    stop: Option<PipeWriter>,
    thread: Option<JoinHandle<Result<Outcome, Error>>>,
}

impl Spawned {
    pub(crate) fn start(run: Run, folder: &Path, speed: f64) -> Result<Self, Error> {
        let plan = &run.scenario().rig;
        let names = plan.devices.iter().map(|device| device.name.clone());
        let names = names.collect();
        let ports = open_all(run.scenario(), folder, None, None, PtySetup::raw(0))?;
        let paths = ports.iter().map(|port| (port.id, port.path.clone()));
        let paths = paths.collect();
        let waiter = Waiter::new()?;
        waiter.check_headroom()?;
        let begin = if run.scenario().is_endless() {
            Begin::Now
        } else {
            Begin::WithClient
        };
        let (stopped, stop) = std::io::pipe().map_err(Error::Thread)?;
        let serve = move || {
            let mut server = Server::new(run, ports, waiter, begin, speed)?;
            server.watch(&stopped)?;
            server.serve(|run, _, _| {
                while run.poll_event().is_some() {}
                Ok(Wants::default())
            })?;
            server.close_ports();
            Ok(server.run_mut().end().clone())
        };
        let thread = ThreadBuilder::new().name("sim".to_owned()).spawn(serve);
        Ok(Self {
            paths,
            names,
            stop: Some(stop),
            thread: Some(thread.map_err(Error::Thread)?),
        })
    }

    /// Path of the first device's main port.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.paths.first().map_or(Path::new(""), |(_, path)| path)
    }

    /// Path of a link of the device of this name; its main link has index 0.
    ///
    /// # Errors
    /// When there is no such device or link.
    pub fn path_of(&self, device: &str, link: usize) -> Result<&Path, Error> {
        let index = self.names.iter().position(|name| name == device);
        let found = self
            .paths
            .iter()
            .find(|(id, _)| Some(id.device) == index && id.link == link);
        found.map_or_else(
            || {
                Err(Error::NoSuchPort {
                    wanted: format!("{device}, link {link}"),
                    known: self.names.join(", "),
                })
            },
            |(_, path)| Ok(path.as_path()),
        )
    }

    /// Ends it, and says what came of it: the counts of each device, and the verdict of a scenario
    /// as far as it was played.
    ///
    /// # Errors
    /// When serving has failed.
    pub fn stop(mut self) -> Result<Outcome, Error> {
        // Only this and dropping it join the thread, so there is one.
        self.join().unwrap_or(Err(Error::Panicked))
    }

    fn join(&mut self) -> Option<Result<Outcome, Error>> {
        drop(self.stop.take());
        let thread = self.thread.take()?;
        Some(thread.join().unwrap_or(Err(Error::Panicked)))
    }
}

impl Drop for Spawned {
    fn drop(&mut self) {
        // A caller that wants to know how it ended has called `stop`.
        let _ = self.join();
    }
}
