//! A case: one scenario to be played, with its parameters and seed, and what came of it.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use sim_embed::ports::ShownPort;
use sim_embed::serve::HeldUp;
use sim_runner::{Outcome, Run};
use sim_settings::show_duration;

use crate::args::{RandomArg, RunArgs, TimeArg};
use crate::control::Desk;
use crate::exit::Failure;
use crate::print::complain;
use crate::report::Report;
use crate::scenario_files::Loaded;
use crate::supervise::ClientEnd;
use crate::visible;

/// Real time that a scenario may take beyond twice its own.
const ALLOWANCE: Duration = Duration::from_secs(30);

/// The date on which clients begin unless another is asked for: 2025-01-01.
const DATE: Duration = Duration::from_secs(1_735_689_600);

/// A scenario to be played, with its parameters and seed.
#[derive(Clone)]
pub(crate) struct Case<'a> {
    pub(crate) loaded: &'a Loaded,
    pub(crate) args: &'a RunArgs,
    pub(crate) seed: u64,
    /// Which time it is, from 0, if it is played several times.
    pub(crate) repeat: Option<u32>,
    /// Simulated seconds for each second of real time.
    pub(crate) speed: f64,
    /// Real time that it may take.
    pub(crate) allowed: Duration,
    /// Where traces and reports go.
    pub(crate) output: Option<&'a Path>,
    /// The page that shows it.
    pub(crate) report: Option<&'a Report>,
}

impl<'a> Case<'a> {
    /// The time number `repeat` of a scenario; `base` is the seed if none is given.
    pub(crate) fn new(args: &'a RunArgs, loaded: &'a Loaded, repeat: u32, base: u64) -> Self {
        let scenario = &loaded.scenario;
        let seed = args.seed.or(scenario.rig.seed).unwrap_or(base);
        let speed = args.speed.unwrap_or(1.0);
        let own = scenario.limit.div_f64(speed).saturating_mul(2) + ALLOWANCE;
        let timeout = args.timeout.map(|timeout| timeout.0);
        Self {
            loaded,
            args,
            seed: seed.wrapping_add(u64::from(repeat)),
            repeat: (args.repeat > 1).then_some(repeat),
            speed,
            allowed: timeout.or(scenario.wall_limit).unwrap_or(own),
            output: args.output.as_deref(),
            report: None,
        }
    }

    pub(crate) fn is_live(&self) -> bool {
        !self.args.client.is_empty()
    }

    /// Tells whether a real client plays in the simulator's time.
    pub(crate) fn is_lockstep(&self) -> bool {
        self.is_live() && self.args.time == TimeArg::Lockstep
    }

    /// Name of the run's kind of time.
    pub(crate) fn time_word(&self) -> &'static str {
        if self.is_live() {
            self.args.time.word()
        } else {
            "simulated"
        }
    }

    /// The file's path, and which time it is.
    pub(crate) fn name(&self) -> String {
        let path = self.loaded.name();
        match self.repeat {
            Some(repeat) => format!("{path} #{}", repeat + 1),
            None => path,
        }
    }

    /// Where to write what ends with `end`, if anything is to be written.
    pub(crate) fn file(&self, end: &str) -> Option<PathBuf> {
        Some(self.file_in(self.output?, end))
    }

    fn file_in(&self, folder: &Path, end: &str) -> PathBuf {
        let mut name = self.loaded.stem();
        if let Some(repeat) = self.repeat {
            name.push(format!("-{}", repeat + 1));
        }
        name.push(format!(".{end}"));
        folder.join(name)
    }

    /// The file of its trace, if anybody wants one.
    pub(crate) fn recording(&self) -> Option<PathBuf> {
        let wanted = self.file("trace.jsonl");
        wanted.or_else(|| Some(self.file_in(self.report?.folder.path(), "trace.jsonl")))
    }

    /// Shows it on the page, if there is one.
    pub(crate) fn show(&self, played: &Played, stop: &AtomicBool) -> Result<(), Failure> {
        let Some(report) = self.report else {
            return Ok(());
        };
        report.add(self, played, stop)?;
        if let (None, Some(trace)) = (self.output, self.recording()) {
            // A thousand of them need not be there at a time.
            let _ = std::fs::remove_file(trace);
        }
        Ok(())
    }

    /// Opens the socket on which a run is controlled, if there is to be one, and tells the client.
    pub(crate) fn desk(
        &self,
        run: &Run,
        ports: Vec<ShownPort>,
        environment: &mut Vec<(String, OsString)>,
    ) -> Result<Option<Desk>, Failure> {
        let Some(listen) = self.args.control else {
            return Ok(None);
        };
        let desk = Desk::open(listen, run, ports)?;
        environment.push(("SIM_CONTROL".to_owned(), desk.control.url().into()));
        complain(&format!(
            "{}: control on {}",
            self.name(),
            desk.control.url()
        ));
        Ok(Some(desk))
    }

    /// Command that shows the same again.
    pub(crate) fn command(&self) -> String {
        let mut words: Vec<OsString> = ["sim", "run", "--seed"].map(OsString::from).into();
        words.push(self.seed.to_string().into());
        if self.is_live() && self.args.time == TimeArg::Real {
            words.extend(["--time".into(), self.args.time.word().into()]);
        }
        if self.is_lockstep() && self.args.date != DATE {
            let date = std::time::UNIX_EPOCH + self.args.date;
            let date = humantime::format_rfc3339_seconds(date).to_string();
            words.extend(["--date".into(), date.into()]);
        }
        if self.is_lockstep() && self.args.random == RandomArg::Real {
            words.extend(["--random".into(), "real".into()]);
        }
        if self.is_live() && self.speed != 1.0 {
            words.extend(["--speed".into(), self.speed.to_string().into()]);
        }
        if let Some(timeout) = self.args.timeout {
            words.extend(["--timeout".into(), show_duration(timeout.0).into()]);
        }
        let mut flag = |flag: &str, value: OsString| words.extend([flag.into(), value]);
        if let Some(listen) = self.args.control.filter(|_| self.is_live()) {
            flag("--control", listen.to_string().into());
        }
        if let Some(job) = &self.args.given.job {
            flag("--job", job.into());
        }
        for (name, value) in &self.loaded.parameters {
            flag("--param", format!("{name}={value}").into());
        }
        if let Some(world) = &self.args.given.world {
            flag("--world", world.into());
        }
        if let Some(config) = &self.args.settings.config {
            flag("--config", config.into());
        }
        for set in &self.args.settings.set {
            flag("--set", set.into());
        }
        words.push(self.loaded.path.clone().into());
        if self.is_live() {
            words.push("--".into());
            words.extend(self.args.client.iter().cloned());
        }
        visible::command(words.iter().map(OsString::as_os_str))
    }
}

/// Result of a case.
pub(crate) enum CaseResult {
    /// It was played to an end.
    Played(Box<Played>),
    /// It was being played when a signal asked for the end.
    BrokenOff,
    /// The simulator or the system failed.
    Broken(String),
}

/// A scenario that has been played.
pub(crate) struct Played {
    pub(crate) outcome: Outcome,
    /// The client, if there was a real one.
    pub(crate) client: Option<PlayedClient>,
    /// Real time that it took.
    pub(crate) took: Duration,
    /// Delays by the machine; nothing can be done to what runs in simulated time.
    pub(crate) held_up: Option<HeldUp>,
    /// It failed, and the machine held it up for so long that this proves nothing.
    pub(crate) is_spoilt: bool,
}

/// A verdict, and whom it is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Verdict {
    Passed,
    /// The client failed, or the vehicle did what it should not.
    Failed,
    /// The machine held the simulator up so much that a failure says nothing of the client.
    Spoilt,
    /// The simulator or the system failed.
    Broken,
    /// A signal asked for the end.
    BrokenOff,
    /// It was not played.
    Skipped,
}

/// A client that has ended.
pub(crate) struct PlayedClient {
    pub(crate) end: ClientEnd,
    /// It was asked to end, so how it did says nothing.
    pub(crate) stopped: bool,
    /// The end of what it wrote.
    pub(crate) output: String,
    /// Things outside of the simulation that it waited for, so that the run is not repeatable.
    pub(crate) outside: Vec<String>,
    /// Calls that lockstep refused it.
    pub(crate) refused: Vec<String>,
}

impl CaseResult {
    pub(crate) fn verdict(&self) -> Verdict {
        match self {
            Self::Played(played) if played.outcome.passed => Verdict::Passed,
            Self::Played(played) if played.is_spoilt => Verdict::Spoilt,
            Self::Played(_) => Verdict::Failed,
            Self::BrokenOff => Verdict::BrokenOff,
            Self::Broken(_) => Verdict::Broken,
        }
    }
}
