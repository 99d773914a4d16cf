//! The `mcp` subcommand: a server of the Model Context Protocol on standard input and output.
//!
//! A tool is a command line of this program, by the table in `mcp/tools.json`; its output is the answer.

use std::collections::{BTreeMap, VecDeque};
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufRead as _, BufReader, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rigsim_core::device::Devices;
use rigsim_pty::paths::Held;
use rmcp::model::{
    CallToolRequestParams, CallToolResponse, CallToolResult, ContentBlock, Implementation,
    JsonObject, ListToolsResult, PaginatedRequestParams, ServerCapabilities, ServerConfig, Tool,
    object,
};
use rmcp::service::{RequestContext, RoleServer, ServerInitializeError, ServiceExt as _};
use rmcp::transport::async_rw::AsyncRwTransport;
use rmcp::{ErrorData, ServerHandler};
use rustix::process::{Pid, Signal, kill_process};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::process::{Child, Command};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{Mutex, Semaphore};
use tokio::time::{Instant, sleep, timeout};

use crate::exit::{Exit, Failure};
use crate::run::scratch;

const TOOLS: &str = include_str!("mcp/tools.json");
/// Most bytes of a request.
const MOST_LINE: usize = 1 << 20;
/// Most bytes of an answer, at its beginning and at its end.
const MOST_SHOWN: u64 = 6000;
/// Most calls at a time.
const MOST_CALLS: u32 = 8;
/// Most failures, and most events and frames before the first, that are explained.
const MOST_FAILURES: usize = 30;
const MOST_BEFORE: [usize; 2] = [12, 8];
/// Most real time that a call of `control` takes: what waits for time to pass waits for ever while none does.
const MOST_WAIT: Duration = Duration::from_secs(60);
/// Time within which a simulator has to be there.
const START: Duration = Duration::from_secs(20);
const NOT_STARTED: &str = "no simulator was started";
/// Time that is left to programs when the server ends.
const END: Duration = Duration::from_secs(5);
const INSTRUCTIONS: &str = "Tests a program that drives a vehicle over a serial port, the client, against \
    simulated vehicles. Begin with `list`, write a scenario file, `check` it, `run` it with the client, and \
    `explain` a failure. `hunt` searches for faults that break the client. `start` serves a vehicle that \
    `control` breaks and moves step by step.";

/// A row of the table.
#[derive(Deserialize)]
struct Row {
    name: String,
    description: String,
    /// JSON schemas by name.
    arguments: JsonObject,
    required: Vec<String>,
    /// Words. An argument is the last of its line; the others are left out if it is not given, and a flag
    /// stands before each of its words.
    command: Vec<Vec<String>>,
    /// What to do after success and after failure.
    next: [String; 2],
}

/// Arguments by name, each as its words.
type Arguments = BTreeMap<String, Vec<String>>;

impl Row {
    fn tool(&self) -> Tool {
        let schema =
            json!({"type": "object", "properties": self.arguments, "required": self.required});
        Tool::new(self.name.clone(), self.description.clone(), object(schema))
    }

    fn read(&self, given: &JsonObject) -> Result<Arguments, String> {
        let is_unknown = |name: &&String| !self.arguments.contains_key(*name);
        if let Some(unknown) = given.keys().find(is_unknown) {
            let known: Vec<&str> = self.arguments.keys().map(String::as_str).collect();
            let known = known.join(", ");
            return Err(format!(
                "no argument is called `{unknown}`; allowed: {known}"
            ));
        }
        let mut read = Arguments::new();
        for (name, schema) in &self.arguments {
            let about = schema["description"].as_str().unwrap_or_default();
            let Some(value) = given.get(name).or(schema.get("default")) else {
                if self.required.contains(name) {
                    return Err(format!("the argument `{name}` is missing: {about}"));
                }
                continue;
            };
            let (kind, words) = match schema["type"].as_str() {
                Some("array") => (
                    "a list of texts",
                    serde_json::from_value(value.clone()).ok(),
                ),
                Some("integer") => (
                    "a whole number",
                    value.as_u64().map(|it| vec![it.to_string()]),
                ),
                _ => ("a text", value.as_str().map(|it| vec![it.to_owned()])),
            };
            let words = words.ok_or_else(|| format!("`{name}` has to be {kind}: {about}"))?;
            let allowed = serde_json::from_value(schema["enum"].clone());
            let allowed: Vec<String> = allowed.unwrap_or_else(|_| words.clone());
            if !words.iter().all(|word| allowed.contains(word)) {
                return Err(format!("`{name}` has to be one of: {}", allowed.join(", ")));
            }
            read.insert(name.clone(), words);
        }
        Ok(read)
    }

    fn words(&self, arguments: &Arguments, output: &Path) -> Vec<String> {
        let output = output.to_string_lossy();
        let mut words = Vec::new();
        for line in &self.command {
            let last = line.last().and_then(|word| word.strip_prefix('{'));
            let name = last.and_then(|word| word.strip_suffix('}'));
            let Some(name) = name else {
                words.extend(line.iter().map(|word| word.replace("OUTPUT", &output)));
                continue;
            };
            let flags = &line[..line.len() - 1];
            for (index, word) in arguments.get(name).into_iter().flatten().enumerate() {
                // What is behind `--` is one command line.
                if index == 0 || flags != ["--"] {
                    words.extend_from_slice(flags);
                }
                // A file is not a flag; what stands for a whole command line has flags.
                let is_flag = word.starts_with('-') && !matches!(name, "client" | "words");
                words.push(format!("{}{word}", if is_flag { "./" } else { "" }));
            }
        }
        words
    }
}

/// A simulator that was started.
struct Live {
    simulator: Child,
    url: String,
    log: PathBuf,
}

impl Live {
    async fn stop(mut self) -> io::Result<String> {
        end(&self.simulator);
        self.simulator.wait().await?;
        excerpt(&self.log)
    }
}

/// Asks a program to end, unless it has.
fn end(program: &Child) {
    let pid = program.id().and_then(|pid| i32::try_from(pid).ok());
    // It may be ending by itself.
    let _ = pid
        .and_then(Pid::from_raw)
        .map(|pid| kill_process(pid, Signal::TERM));
}

struct Server {
    devices: Devices,
    rows: Vec<Row>,
    folder: Held,
    /// Number of the newest call.
    number: AtomicU64,
    /// One permit for each call.
    calls: Semaphore,
    /// Locked for as long as one is being started.
    live: Mutex<Option<Live>>,
}

/// Serves until its input ends, or a signal comes.
pub(crate) fn serve(devices: Devices) -> Result<Exit, Failure> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    let runtime = runtime.map_err(Failure::system)?;
    let served = runtime.block_on(serve_until_end(devices));
    // Nothing interrupts a thread that reads standard input.
    runtime.shutdown_background();
    served.map(|()| Exit::Clean).map_err(Failure::system)
}

async fn serve_until_end(devices: Devices) -> anyhow::Result<()> {
    let server = Arc::new(Server {
        devices,
        rows: serde_json::from_str(TOOLS)?,
        folder: scratch()?,
        number: AtomicU64::new(0),
        calls: Semaphore::new(MOST_CALLS as usize),
        live: Mutex::default(),
    });
    let mut hang_up = signal(SignalKind::hangup())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let transport = AsyncRwTransport::new_server(tokio::io::stdin(), tokio::io::stdout());
    let transport = transport.with_max_line_length(MOST_LINE);
    let serving = async {
        match Arc::clone(&server).serve(transport).await {
            Ok(running) => running.waiting().await.map(drop).map_err(Into::into),
            Err(ServerInitializeError::ConnectionClosed(_)) => Ok(()),
            Err(error) => Err(error.into()),
        }
    };
    let served: anyhow::Result<()> = tokio::select! {
        served = serving => served,
        _ = hang_up.recv() => Ok(()),
        _ = terminate.recv() => Ok(()),
        interrupted = tokio::signal::ctrl_c() => interrupted.map_err(Into::into),
    };
    // All calls are cancelled by now; they end their programs.
    let _ended = timeout(END, server.calls.acquire_many(MOST_CALLS)).await;
    if let Some(live) = server.live.lock().await.take() {
        live.stop().await?;
    }
    served
}

impl ServerHandler for Server {
    fn get_info(&self) -> ServerConfig {
        ServerConfig::new(ServerCapabilities::builder().enable_tools().build())
            .with_server_info(Implementation::new("sim", env!("CARGO_PKG_VERSION")))
            .with_instructions(INSTRUCTIONS)
    }

    async fn list_tools(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListToolsResult, ErrorData> {
        let tools = self.rows.iter().map(Row::tool).collect();
        Ok(ListToolsResult::with_all_items(tools))
    }

    async fn call_tool(
        &self,
        request: CallToolRequestParams,
        context: RequestContext<RoleServer>,
    ) -> Result<CallToolResponse, ErrorData> {
        let row = self.rows.iter().find(|row| row.name == request.name);
        let row = row.ok_or_else(|| {
            ErrorData::invalid_params(format!("no tool is called `{}`", request.name), None)
        })?;
        let busy = |_| ErrorData::internal_error("too many calls at a time", None);
        let _permit = self.calls.try_acquire().map_err(busy)?;
        let (is_good, text, next) = match row.read(&request.arguments.unwrap_or_default()) {
            Ok(arguments) => {
                let done = self.carry_out(row, &arguments, &context).await;
                let (is_good, text) = done.unwrap_or_else(|error| (false, error.to_string()));
                (is_good, text, row.next[usize::from(!is_good)].clone())
            }
            Err(why) => (
                false,
                why,
                format!("Call `{}` again without this mistake.", row.name),
            ),
        };
        let text = match text.trim_end() {
            "" => "There is nothing to show.",
            text => text,
        };
        let content = vec![ContentBlock::text(format!("{text}\n\nNext: {next}"))];
        let result = match is_good {
            true => CallToolResult::success(content),
            false => CallToolResult::error(content),
        };
        Ok(result.into())
    }
}

impl Server {
    /// Returns whether it went well, and what there is to say.
    async fn carry_out(
        &self,
        row: &Row,
        arguments: &Arguments,
        context: &RequestContext<RoleServer>,
    ) -> io::Result<(bool, String)> {
        let number = self.number.fetch_add(1, Ordering::Relaxed);
        let output = self.folder.path().join(number.to_string());
        let log = output.with_extension("log");
        let words = row.words(arguments, &output);
        let is_good = match row.name.as_str() {
            "start" => return self.start(&words, log, context).await,
            "stop" => {
                let live = self.live.lock().await.take();
                let live = live.ok_or(io::Error::other(NOT_STARTED))?;
                return Ok((true, live.stop().await?));
            }
            "control" => {
                let url = self.live.lock().await.as_ref().map(|live| live.url.clone());
                let url = url.ok_or(io::Error::other(NOT_STARTED))?;
                sim(&words, Some(&url), &log, context).await?
            }
            "list" if words[0] == "devices" => {
                let devices = self.devices.iter();
                let devices = devices.map(|one| format!("{}: {}\n", one.id, one.about));
                return Ok((true, devices.collect()));
            }
            _ => sim(&words, None, &log, context).await?,
        };
        match row.name.as_str() {
            "list" if is_good => {
                let matching = arguments.get("matching").and_then(|words| words.first());
                fs::write(&log, list(&fs::read_to_string(&log)?, matching))?;
            }
            "run" if fs::metadata(&log)?.len() > 2 * MOST_SHOWN => {
                fs::write(&log, heads(&fs::read_to_string(&log)?))?;
            }
            "explain" if is_good => fs::write(&log, explanation(&log)?)?,
            _ => {}
        }
        let text = excerpt(&log)?;
        fs::remove_file(&log)?;
        Ok((is_good, text))
    }

    async fn start(
        &self,
        words: &[String],
        log: PathBuf,
        context: &RequestContext<RoleServer>,
    ) -> io::Result<(bool, String)> {
        let mut live = self.live.lock().await;
        if let Some(live) = live.take() {
            live.stop().await?;
        }
        // It ends with this server, however that ends.
        let mut supervisor = command(["supervise", "--"], &log)?;
        supervisor.arg(std::env::current_exe()?).args(words);
        let simulator = supervisor
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()?;
        let mut started = Live {
            simulator,
            url: String::new(),
            log,
        };
        let begun = Instant::now();
        let text = loop {
            let text = fs::read_to_string(&started.log)?;
            if text.lines().any(|line| line == "ready") {
                break text;
            }
            let is_over = started.simulator.try_wait()?.is_some() || context.ct.is_cancelled();
            if is_over || begun.elapsed() > START {
                return Ok((false, started.stop().await?));
            }
            sleep(Duration::from_millis(10)).await;
        };
        let url = text
            .lines()
            .find_map(|line| line.trim().strip_prefix("control on "));
        started.url = url.unwrap_or_default().to_owned();
        let pause = ["ctl".to_owned(), "pause".to_owned()];
        let paused = started.log.with_extension("paused");
        let is_paused = sim(&pause, Some(&started.url), &paused, context).await?;
        *live = Some(started);
        Ok((is_paused, text + &excerpt(&paused)?))
    }
}

/// This program; what it prints goes to a file.
fn command<W: AsRef<OsStr>>(words: impl IntoIterator<Item = W>, log: &Path) -> io::Result<Command> {
    let out = File::create(log)?;
    let mut program = Command::new(std::env::current_exe()?);
    program
        .args(words)
        .env_remove("SIM_CONTROL")
        .stdin(Stdio::null())
        .stderr(out.try_clone()?)
        .stdout(out);
    Ok(program)
}

/// Runs this program, and returns whether it went well. Ends it if the call is cancelled, or takes too long with
/// the control socket at `url`.
async fn sim(
    words: &[String],
    url: Option<&str>,
    log: &Path,
    context: &RequestContext<RoleServer>,
) -> io::Result<bool> {
    let mut program = command(words, log)?;
    let mut program = program.envs(url.map(|url| ("SIM_CONTROL", url))).spawn()?;
    let most = url.map_or(Duration::MAX, |_| MOST_WAIT);
    tokio::select! {
        ended = program.wait() => return Ok(ended?.success()),
        () = context.ct.cancelled() => {}
        () = sleep(most) => {
            let why = format!("not over after {} s of real time, and ended\n", most.as_secs());
            File::options().append(true).open(log)?.write_all(why.as_bytes())?;
        }
    }
    end(&program);
    Ok(program.wait().await?.success())
}

/// What failed, with the traces, of results that are too long to be shown.
fn heads(text: &str) -> String {
    let is_head = |line: &&str| match line.strip_prefix("  ") {
        Some(detail) => detail.starts_with("trace: "),
        None => !line.starts_with("passed ") && !line.starts_with("skipped "),
    };
    let heads = text.lines().filter(is_head);
    heads.map(|line| format!("{line}\n")).collect()
}

/// The entries of a printed list that contain a text; or what they are called, without their meanings.
fn list(text: &str, matching: Option<&String>) -> String {
    // Comments stand above a setting, and what a fault does below its name.
    let gap = if text.contains("\n\n") { "\n\n" } else { "\n" };
    let (mut table, mut shown) = (String::new(), String::new());
    for part in text.split(gap) {
        if let Some(head) = part.strip_prefix('[') {
            table = head.replace(']', ".");
            continue;
        }
        shown += &match (entry(part), matching) {
            (Some(name), None) => format!("{table}{name}\n"),
            (Some(name), Some(matching)) => {
                let part = part.replace(name, &format!("{table}{name}"));
                if !part.contains(matching) {
                    continue;
                }
                part + gap
            }
            // It says the key of those below.
            (None, None) if part.starts_with("## ") => format!("{part}\n"),
            (None, _) => continue,
        };
    }
    shown
}

/// What an entry of a list is called; `None` if it is none.
fn entry(part: &str) -> Option<&str> {
    let name = part.lines().find(|line| !line.starts_with("# "))?;
    match name.strip_prefix("### ") {
        Some(fault) => Some(fault),
        // A setting, or a name.
        None if name.contains(" = ") => Some(name),
        None => name.split(' ').next().filter(|name| name.contains('.')),
    }
}

/// The failures of a trace in JSON, and what came just before the first of them.
fn explanation(log: &Path) -> io::Result<String> {
    let mut failures = Vec::new();
    // Events and frames.
    let mut before = [VecDeque::new(), VecDeque::new()];
    for line in BufReader::new(File::open(log)?).lines() {
        let line = line?;
        // What is none is a warning.
        let about: Value = serde_json::from_str(&line).unwrap_or_default();
        let [code, text, device] =
            ["code", "text", "device"].map(|key| about[key].as_str().unwrap_or_default());
        let shown = match about["time_s"].as_f64() {
            Some(time) => format!("{time:.3} s {device} {text} [{code}]"),
            None => line.clone(),
        };
        if code == "failure" && failures.len() < MOST_FAILURES {
            failures.push(shown);
        } else if failures.is_empty() {
            let kind = usize::from(about["level"] == "traffic");
            before[kind].push_back(shown);
            let more = before[kind].len().saturating_sub(MOST_BEFORE[kind]);
            before[kind].drain(..more);
        }
    }
    if failures.is_empty() {
        failures.push("nothing failed".to_owned());
    }
    let [events, frames] = before.map(|lines| Vec::from(lines).join("\n"));
    let failures = failures.join("\n");
    Ok(format!(
        "{failures}\n\nWhat happened before:\n{events}\n\nThe last frames before:\n{frames}"
    ))
}

/// The beginning and the end of a long file.
fn excerpt(path: &Path) -> io::Result<String> {
    let mut file = File::open(path)?;
    let (mut begin, mut end) = (Vec::new(), Vec::new());
    (&mut file).take(MOST_SHOWN).read_to_end(&mut begin)?;
    let from = file
        .metadata()?
        .len()
        .saturating_sub(MOST_SHOWN)
        .max(MOST_SHOWN);
    file.seek(SeekFrom::Start(from))?;
    file.read_to_end(&mut end)?;
    let gap = match from - MOST_SHOWN {
        0 => String::new(),
        count => format!("\n… {count} bytes are left out …\n"),
    };
    let [begin, end] = [begin, end].map(|part| String::from_utf8_lossy(&part).into_owned());
    Ok(begin + &gap + &end)
}
