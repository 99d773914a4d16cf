//! A case: one scenario to be played, with its parameters and seed, and what came of it.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use anyhow::Context as _;
use rigsim_embed::ports::ShownPort;
use rigsim_embed::serve::Stalls;
use rigsim_pty::paths::Results;
use rigsim_runner::scenario::OTHER_VEHICLES;
use rigsim_runner::{Outcome, Run, Scenario, run};
use rustix::fs::{OFlags, fcntl_setfl};
use serde::{Deserialize, Serialize};

use crate::args::{RunArgs, TimeArg};
use crate::control::RequestQueue;
use crate::exit::{Exit, Failure};
use crate::export::ExportFormat;
use crate::print::complain;
use crate::scenario_files::Loaded;
use crate::supervise::ClientEnd;
use crate::visible;

/// Real time that a scenario may take beyond twice its own.
const ALLOWANCE: Duration = Duration::from_secs(30);

/// Why a failure proves nothing.
const STALLED: &str = "the machine stalled the simulator for longer than --max-stall; what follows may be its \
                       doing";

/// A scenario to be played, with its parameters and seed.
#[derive(Clone)]
pub(crate) struct Case<'a> {
    pub(crate) loaded: &'a Loaded,
    pub(crate) args: &'a RunArgs,
    pub(crate) seed: u64,
    /// Its number among the cases of all shards, from 0.
    pub(crate) number: usize,
    /// Which time it is, from 0, if it is played several times.
    pub(crate) repeat: Option<u32>,
    /// Simulated seconds for each second of real time.
    pub(crate) speed: f64,
    /// Real time that it may take.
    pub(crate) allowed: Duration,
    /// Where traces and reports go.
    pub(crate) output: Option<&'a Path>,
    /// Folder for a recording that only the page or the results need.
    pub(crate) scratch: Option<&'a Path>,
}

impl<'a> Case<'a> {
    /// The time number `repeat` of a scenario, the first of all; `base` is the seed if none is given.
    pub(crate) fn new(args: &'a RunArgs, loaded: &'a Loaded, repeat: u32, base: u64) -> Self {
        let scenario = &loaded.scenario;
        let seed = args.seed.or(scenario.rig.seed).unwrap_or(base);
        let speed = args.speed.unwrap_or(1.0);
        let usual = scenario.limit.div_f64(speed).saturating_mul(2) + ALLOWANCE;
        let timeout = args.timeout.map(|timeout| timeout.0);
        Self {
            loaded,
            args,
            seed: seed.wrapping_add(u64::from(repeat)),
            number: 0,
            repeat: (args.repeat > 1).then_some(repeat),
            speed,
            allowed: timeout.unwrap_or(usual),
            output: args.output.as_deref(),
            scratch: None,
        }
    }

    /// The scenario as it is played.
    pub(super) fn scenario(&self) -> Arc<Scenario> {
        let other = self.other_vehicles();
        other.map_or_else(|| Arc::clone(&self.loaded.scenario), Arc::new)
    }

    /// After the first time, the scenario with other vehicles of the same make.
    fn other_vehicles(&self) -> Option<Scenario> {
        let again = self.repeat.is_some_and(|repeat| repeat > 0);
        again.then(|| self.loaded.scenario.with_other_vehicles())?
    }

    pub(crate) fn is_live(&self) -> bool {
        !self.args.client.is_empty()
    }

    /// Returns whether a real client plays in the simulator's time.
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

    /// Finds out whether its files can be written.
    ///
    /// # Errors
    /// When something else than an earlier result is there.
    pub(crate) fn check_files(&self) -> anyhow::Result<()> {
        self.report_file()?;
        self.client_log().map(drop)
    }

    /// The file of its report, if there is to be one.
    pub(crate) fn report_file(&self) -> anyhow::Result<Option<Results>> {
        self.results("report.json", "report", &["\"armed\": ["])
    }

    /// Opens the file into which the client writes: its log, or one that is gone afterwards.
    pub(super) fn client_output(&self) -> anyhow::Result<File> {
        match self.client_log()? {
            Some(log) => log.into_file().context("cannot write the client's output"),
            None => {
                let what = "cannot make a file for the client's output";
                let file = tempfile::tempfile().context(what)?;
                fcntl_setfl(&file, OFlags::APPEND).context(what)?;
                Ok(file)
            }
        }
    }

    /// The file of what the client writes, if there is to be one.
    fn client_log(&self) -> anyhow::Result<Option<Results>> {
        // A client may write anything, so its output is known by the trace beside it.
        let has_trace = self.file("trace.jsonl").is_some_and(|trace| trace.exists());
        let marks: &[&str] = if has_trace { &[""] } else { &[] };
        self.results("client.log", "client's output", marks)
    }

    fn results(
        &self,
        end: &str,
        what: &str,
        marks: &'static [&'static str],
    ) -> anyhow::Result<Option<Results>> {
        let find = |path: PathBuf| {
            Results::at(&path, marks)
                .with_context(|| format!("cannot write the {what} {}", visible::name(&path)))
        };
        self.file(end).map(find).transpose()
    }

    /// The file of its trace, if that is only for the page or the results.
    pub(crate) fn scratch_recording(&self) -> Option<PathBuf> {
        let scratch = self.scratch.filter(|_| self.output.is_none())?;
        Some(self.file_in(scratch, "trace.jsonl"))
    }

    /// The file of its trace, if there is to be one.
    pub(crate) fn recording(&self) -> Option<PathBuf> {
        let wanted = self.file("trace.jsonl");
        wanted.or_else(|| self.scratch_recording())
    }

    /// Returns whether its trace has what each thread of the client waits for.
    pub(crate) fn records_waits(&self) -> bool {
        self.args.export.contains(&ExportFormat::Perfetto)
    }

    /// Opens the socket on which a run is controlled, if there is to be one, and tells the client.
    pub(crate) fn requests(
        &self,
        run: &Run,
        ports: Vec<ShownPort>,
        environment: &mut Vec<(String, OsString)>,
    ) -> Result<Option<RequestQueue>, Failure> {
        let Some(listen) = self.args.control else {
            return Ok(None);
        };
        let requests = RequestQueue::open(listen, self.loaded.beginning(), run, ports)?;
        environment.push(("SIM_CONTROL".to_owned(), requests.control.url().into()));
        complain(&format!(
            "{}: control on {}",
            self.name(),
            requests.control.url()
        ));
        Ok(Some(requests))
    }

    /// Date at which the client's time begins, since 1970.
    pub(crate) fn date(&self) -> Duration {
        match self.time_word() {
            "real" => UNIX_EPOCH.elapsed().unwrap_or_default(),
            _ => self.args.date,
        }
    }

    /// Command that shows the same again.
    pub(crate) fn command(&self) -> String {
        format!("sim run --seed {} {}", self.seed, self.again())
    }

    /// The words of that command after the seed.
    pub(crate) fn again(&self) -> String {
        let mut words = self.args.again.clone();
        let mut flag = |flag: &str, value: OsString| words.extend([flag.into(), value]);
        for (name, value) in &self.loaded.parameters {
            flag("--param", format!("{name}={value}").into());
        }
        if self.other_vehicles().is_some() {
            flag("--set", OTHER_VEHICLES.into());
        }
        words.push(self.loaded.path.clone().into());
        if self.is_live() {
            words.push("--".into());
            words.extend(self.args.client.iter().cloned());
        }
        visible::command(words.iter().map(OsString::as_os_str))
    }
}

/// Cases of a file that have no result.
pub(super) struct Unplayed<'a> {
    pub(super) first: &'a Case<'a>,
    pub(super) count: usize,
}

impl Unplayed<'_> {
    /// Name of the case, or of the file of several.
    pub(super) fn name(&self) -> String {
        match self.count {
            1 => self.first.name(),
            _ => self.first.loaded.name(),
        }
    }
}

/// The cases that have no result, by files.
pub(super) fn unplayed<'a>(
    cases: &'a [Case<'a>],
    is_known: impl Fn(usize) -> bool,
) -> Vec<Unplayed<'a>> {
    let mut unplayed: Vec<Unplayed<'_>> = Vec::new();
    let cases = cases.iter().enumerate();
    for (_, case) in cases.filter(|(index, _)| !is_known(*index)) {
        match unplayed.last_mut() {
            Some(last) if std::ptr::eq(last.first.loaded, case.loaded) => last.count += 1,
            _ => unplayed.push(Unplayed {
                first: case,
                count: 1,
            }),
        }
    }
    unplayed
}

/// Result of a case.
pub(crate) struct CaseResult {
    pub(crate) verdict: Verdict,
    /// Reason for which there is no verdict about the client.
    pub(crate) why: Option<String>,
    /// What there is to be shown of it, if it has begun.
    pub(crate) played: Option<Box<Played>>,
}

/// A scenario that has been played.
pub(crate) struct Played {
    pub(crate) outcome: Outcome,
    /// The client, if there was a real one.
    pub(crate) client: Option<PlayedClient>,
    /// Real time that it took.
    pub(crate) took: Duration,
    /// Digest of its trace, if there is one.
    pub(crate) trace: Option<String>,
    /// Delays by the machine; `None` in simulated time.
    pub(crate) stalled: Option<Stalls>,
}

rigsim_settings::words! {
    /// A verdict, the best first.
    #[derive(Hash, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub(crate) enum Verdict {
        Passed = "passed",
        /// It was not played, or the client gave no occasion for what it is about.
        Skipped = "skipped",
        /// The client failed, or the vehicle did what it should not.
        Failed = "failed",
        /// It was played twice, with different results.
        #[serde(rename = "not repeatable")]
        NotRepeatable = "not repeatable",
        /// Caused by the file, the client's command, the machine or the simulator.
        Error = "error",
        /// No result of it is known.
        Missing = "missing",
        /// A signal asked for the end.
        Aborted = "aborted",
    }
}

impl Verdict {
    /// The word for it at the beginning of a line of a terminal, where what needs attention stands out.
    pub(crate) fn heading(self) -> String {
        match self {
            Self::Passed | Self::Skipped | Self::Aborted => self.to_string(),
            _ => self.as_str().to_uppercase(),
        }
    }

    /// The verdict of what was not played. Where all others passed it is an error, so that no result is taken for
    /// complete.
    pub(crate) fn of_unplayed(is_clean: bool) -> Self {
        match is_clean {
            true => Self::Missing,
            false => Self::Skipped,
        }
    }

    /// Exit code of a program that has played nothing else.
    pub(crate) fn exit(self) -> Exit {
        match self {
            Self::Passed | Self::Skipped => Exit::Clean,
            Self::Failed | Self::NotRepeatable => Exit::Failed,
            Self::Error | Self::Missing | Self::Aborted => Exit::System,
        }
    }
}

/// Counts of cases in words: `990 passed, 10 failed, 0 skipped`.
pub(crate) fn counts(of: &BTreeMap<Verdict, usize>) -> String {
    let count = |verdict| of.get(&verdict).copied().unwrap_or_default();
    let [passed, failed] = [Verdict::Passed, Verdict::Failed].map(count);
    let skipped = count(Verdict::Skipped);
    let mut text = format!("{passed} passed, {failed} failed, {skipped} skipped");
    let others = of.iter().filter(|(verdict, _)| **verdict > Verdict::Failed);
    for (verdict, count) in others.filter(|(_, count)| **count > 0) {
        let is_plural = *verdict == Verdict::Error && *count > 1;
        text += &format!(", {count} {verdict}{}", if is_plural { "s" } else { "" });
    }
    text
}

/// A client that has ended.
pub(crate) struct PlayedClient {
    pub(crate) end: ClientEnd,
    /// It was asked to end, so how it did says nothing.
    pub(crate) stopped: bool,
    /// The end of what it wrote, in the simulator's time with the time of each line.
    pub(crate) output: String,
    /// Things outside of the simulation that it waited for, so that the run is not repeatable.
    pub(crate) outside: Vec<String>,
    /// The system refused to fix the addresses of its memory by the seed.
    pub(crate) random_addresses: bool,
    /// Calls that lockstep refused it.
    pub(crate) refused: Vec<String>,
    /// Syscalls that lockstep answered with `ENOSYS`.
    pub(crate) missing: Vec<String>,
    /// Processes that ran when it ended, and were ended with it.
    pub(crate) left: Vec<String>,
    /// Bytes that it has written and that are not in the file of its output.
    pub(crate) lost: u64,
}

impl CaseResult {
    /// It was being played when a signal came.
    pub(crate) fn aborted() -> Self {
        Self {
            verdict: Verdict::Aborted,
            why: Some("a signal ended it".to_owned()),
            played: None,
        }
    }

    /// Nothing could be played.
    pub(crate) fn error(why: String) -> Self {
        Self {
            verdict: Verdict::Error,
            why: Some(why),
            played: None,
        }
    }

    /// It has ended. `why` says why this is not a verdict about the client, if it is none; nor is a
    /// failure after the machine has stalled for longer than `most`.
    pub(crate) fn of(played: Played, why: Option<String>, most: Duration) -> Self {
        let outcome = &played.outcome;
        let stalled = played.stalled.is_some_and(|stalled| stalled.total > most);
        let proves_nothing = stalled && !outcome.failures.is_empty();
        let why = why.or_else(|| proves_nothing.then(|| STALLED.to_owned()));
        let verdict = match why {
            Some(_) => Verdict::Error,
            None if outcome.passed => Verdict::Passed,
            None if outcome.is_skipped() => Verdict::Skipped,
            None => Verdict::Failed,
        };
        Self {
            verdict,
            why,
            played: Some(Box::new(played)),
        }
    }

    /// What failed first, of a verdict about the client.
    pub(crate) fn failed(&self) -> Option<&run::Failure> {
        let played = self.played.as_ref();
        let played = played.filter(|_| self.verdict == Verdict::Failed)?;
        played.outcome.failures.first()
    }

    /// Returns `true` if it failed, and the machine may be the cause.
    pub(crate) fn has_stalled(&self) -> bool {
        self.why.as_deref() == Some(STALLED)
    }
}
