//! The `mcp` subcommand: a server of the Model Context Protocol on standard input and output.
//!
//! A tool is a command line of this program, by the table in `mcp/tools.json`; its output is the answer.

use std::collections::{BTreeMap, VecDeque};
use std::fs::{self, File};
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rigsim_core::device::Devices;
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
use tempfile::TempDir;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, BufReader};
use tokio::net::unix::pipe::Receiver;
use tokio::process::{Child, Command};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::{Mutex, Semaphore};
use tokio::time::{Instant, sleep, timeout};

use crate::exit::{Exit, Failure};

const TOOLS: &str = include_str!("mcp/tools.json");
/// Most bytes of a request, and of a line of output.
const MOST_LINE: usize = 1 << 20;
/// Most bytes of an answer, at its beginning and at its end.
const MOST_SHOWN: usize = 6000;
/// Most calls at a time.
const MOST_CALLS: u32 = 8;
/// Most failures, and most events and frames before the first, that are explained.
const MOST_FAILURES: usize = 30;
const MOST_BEFORE: [usize; 2] = [12, 8];
/// Time within which a simulator has to be there.
const START: Duration = Duration::from_secs(20);
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
    /// Words, left out together if one of them is an argument that is not given.
    command: Vec<Vec<String>>,
    /// What to do after success and after failure.
    next: [String; 2],
}

/// Arguments by name, each as its words.
type Arguments<'a> = BTreeMap<&'a str, Vec<String>>;

impl Row {
    fn tool(&self) -> Tool {
        let schema =
            json!({"type": "object", "properties": self.arguments, "required": self.required});
        Tool::new(self.name.clone(), self.description.clone(), object(schema))
    }

    fn read(&self, given: &JsonObject) -> Result<Arguments<'_>, String> {
        let mut names = given.keys();
        if let Some(unknown) = names.find(|name| !self.arguments.contains_key(*name)) {
            let known: Vec<&str> = self.arguments.keys().map(String::as_str).collect();
            let known = known.join(", ");
            return Err(format!(
                "no argument is called `{unknown}`; allowed: {known}"
            ));
        }
        let mut read = BTreeMap::new();
        for (name, schema) in &self.arguments {
            let about = schema["description"].as_str().unwrap_or_default();
            let Some(value) = given.get(name).or(schema.get("default")) else {
                if self.required.contains(name) {
                    return Err(format!("the argument `{name}` is missing: {about}"));
                }
                continue;
            };
            let (words, kind) = match (schema["type"].as_str(), value) {
                (Some("array"), words) => (
                    serde_json::from_value(words.clone()).ok(),
                    "a list of texts",
                ),
                (Some("integer"), value) => (
                    value.as_u64().map(|number| vec![number.to_string()]),
                    "a whole number",
                ),
                (_, value) => (value.as_str().map(|word| vec![word.to_owned()]), "a text"),
            };
            let words = words.ok_or_else(|| format!("`{name}` has to be {kind}: {about}"))?;
            let allowed: Vec<&str> = schema["enum"]
                .as_array()
                .into_iter()
                .flatten()
                .filter_map(Value::as_str)
                .collect();
            if !allowed.is_empty() && !words.iter().all(|word| allowed.contains(&word.as_str())) {
                return Err(format!("`{name}` has to be one of: {}", allowed.join(", ")));
            }
            read.insert(name.as_str(), words);
        }
        Ok(read)
    }

    fn words(&self, arguments: &Arguments<'_>, output: &Path) -> Vec<String> {
        let mut words = Vec::new();
        for group in &self.command {
            let mut filled = Vec::new();
            let is_whole = group.iter().all(|word| {
                let word = word.replace("{output}", &output.to_string_lossy());
                let name = word
                    .strip_prefix('{')
                    .and_then(|word| word.strip_suffix('}'));
                let Some(name) = name else {
                    filled.push(word);
                    return true;
                };
                let each = name.strip_prefix("each ");
                let Some(given) = arguments
                    .get(each.unwrap_or(name))
                    .filter(|given| !given.is_empty())
                else {
                    return false;
                };
                for (index, word) in given.iter().enumerate() {
                    if index > 0 && each.is_some() {
                        filled.extend(group.first().cloned());
                    }
                    // A file is no flag; what stands for a whole command line has flags.
                    let is_flag = word.starts_with('-') && !matches!(name, "client" | "words");
                    filled.push(if is_flag {
                        format!("./{word}")
                    } else {
                        word.clone()
                    });
                }
                true
            });
            if is_whole {
                words.append(&mut filled);
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
        fs::read_to_string(&self.log)
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
    folder: TempDir,
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
        folder: tempfile::Builder::new().prefix("sim-mcp-").tempdir()?,
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
        let mut shown = Excerpt::default();
        let (is_good, next) = match row.read(&request.arguments.unwrap_or_default()) {
            Ok(arguments) => {
                let done = self.carry_out(row, &arguments, &context, &mut shown).await;
                let is_good = done.unwrap_or_else(|error| {
                    shown.add(&error.to_string());
                    false
                });
                (is_good, row.next[usize::from(!is_good)].clone())
            }
            Err(why) => {
                shown.add(&why);
                (
                    false,
                    format!("Call `{}` again without this mistake.", row.name),
                )
            }
        };
        let text = format!("{}\n\nNext: {next}", shown.text().trim_end());
        let content = vec![ContentBlock::text(text)];
        let result = if is_good {
            CallToolResult::success(content)
        } else {
            CallToolResult::error(content)
        };
        Ok(result.into())
    }
}

impl Server {
    /// Adds what there is to say, and returns whether it went well.
    async fn carry_out(
        &self,
        row: &Row,
        arguments: &Arguments<'_>,
        context: &RequestContext<RoleServer>,
        shown: &mut Excerpt,
    ) -> io::Result<bool> {
        let number = self.number.fetch_add(1, Ordering::Relaxed);
        let output = self.folder.path().join(number.to_string());
        let words = row.words(arguments, &output);
        match row.name.as_str() {
            "start" => self.start(&words, &output, context, shown).await,
            "stop" => {
                let Some(live) = self.live.lock().await.take() else {
                    shown.add("no simulator was started");
                    return Ok(false);
                };
                shown.add(&live.stop().await?);
                Ok(true)
            }
            "list" if words[0] == "devices" => {
                let devices = self.devices.iter();
                devices.for_each(|one| shown.add(&format!("{}: {}\n", one.id, one.about)));
                Ok(true)
            }
            "list" => {
                let mut text = String::new();
                let is_good = sim(&words, None, context, &mut |line| text.push_str(line)).await?;
                // Comments stand above a setting, and what a fault does below its name.
                let gap = if text.contains("\n\n") { "\n\n" } else { "\n" };
                let matching = arguments.get("matching").and_then(|words| words.first());
                let parts = text.split(gap).filter_map(|part| match matching {
                    Some(matching) => part.contains(matching).then_some(part),
                    None => entry(part),
                });
                text = parts
                    .collect::<Vec<_>>()
                    .join(if matching.is_some() { gap } else { "\n" });
                shown.add(&text);
                Ok(is_good)
            }
            "explain" => {
                let mut explained = Explanation::default();
                let mut keep = |line: &str| match serde_json::from_str(line) {
                    Ok(line) => explained.add(&line),
                    Err(_) => shown.add(line),
                };
                let is_good = sim(&words, None, context, &mut keep).await?;
                shown.add(&explained.text());
                Ok(is_good)
            }
            "control" => {
                let url = self.live.lock().await.as_ref().map(|live| live.url.clone());
                sim(&words, url.as_deref(), context, &mut |line| shown.add(line)).await
            }
            _ => sim(&words, None, context, &mut |line| shown.add(line)).await,
        }
    }

    async fn start(
        &self,
        words: &[String],
        output: &Path,
        context: &RequestContext<RoleServer>,
        shown: &mut Excerpt,
    ) -> io::Result<bool> {
        let mut live = self.live.lock().await;
        if let Some(live) = live.take() {
            live.stop().await?;
        }
        let log = output.with_extension("log");
        let out = File::create(&log)?;
        let mut started = Live {
            simulator: spawn(words, None, out.into())?,
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
                shown.add(&started.stop().await?);
                return Ok(false);
            }
            sleep(Duration::from_millis(10)).await;
        };
        let mut lines = text.lines();
        let url = lines.find_map(|line| line.trim().strip_prefix("control on "));
        started.url = url.unwrap_or_default().to_owned();
        shown.add(&text);
        let started = live.insert(started);
        let pause = ["ctl".to_owned(), "pause".to_owned()];
        sim(&pause, Some(&started.url), context, &mut |line| {
            shown.add(line)
        })
        .await
    }
}

/// What an entry of a list is called, without its meaning; `None` if it is none.
fn entry(part: &str) -> Option<&str> {
    let name = part.lines().find(|line| !line.starts_with("# "))?;
    match name.strip_prefix("### ") {
        Some(fault) => Some(fault),
        // A setting, or a name.
        None if name.contains(" = ") => Some(name),
        None => name.split(' ').next().filter(|name| name.contains('.')),
    }
}

/// Starts this program.
fn spawn(words: &[String], url: Option<&str>, out: OwnedFd) -> io::Result<Child> {
    Command::new(std::env::current_exe()?)
        .args(words)
        .env_remove("SIM_CONTROL")
        .envs(url.map(|url| ("SIM_CONTROL", url)))
        .stdin(Stdio::null())
        .stderr(out.try_clone()?)
        .stdout(out)
        .spawn()
}

/// Runs this program, hands on each line that it prints, and says whether it went well. Ends it if the call
/// is cancelled.
async fn sim(
    words: &[String],
    url: Option<&str>,
    context: &RequestContext<RoleServer>,
    keep: &mut (dyn FnMut(&str) + Send),
) -> io::Result<bool> {
    let (reader, out) = io::pipe()?;
    let mut program = spawn(words, url, out.into())?;
    let mut reader = BufReader::new(Receiver::from_owned_fd(reader.into())?);
    let reading = async {
        let mut line = Vec::new();
        while (&mut reader)
            .take(MOST_LINE as u64)
            .read_until(b'\n', &mut line)
            .await?
            > 0
        {
            keep(&String::from_utf8_lossy(&line));
            line.clear();
        }
        io::Result::Ok(())
    };
    tokio::select! {
        read = reading => read?,
        () = context.ct.cancelled() => end(&program),
    }
    Ok(program.wait().await?.success())
}

/// Failures of a trace, and what came just before the first of them.
#[derive(Default)]
struct Explanation {
    failures: Vec<String>,
    /// Events and frames.
    before: [VecDeque<String>; 2],
}

impl Explanation {
    fn add(&mut self, line: &Value) {
        let [code, text, device] =
            ["code", "text", "device"].map(|key| line[key].as_str().unwrap_or_default());
        let time = line["time_s"].as_f64().unwrap_or_default();
        let shown = format!("{time:.3} s {device} {text} [{code}]\n");
        let kind = usize::from(line["level"] == "traffic");
        if code == "failure" && self.failures.len() < MOST_FAILURES {
            self.failures.push(shown);
        } else if self.failures.is_empty() {
            let before = &mut self.before[kind];
            before.push_back(shown);
            before.drain(..before.len().saturating_sub(MOST_BEFORE[kind]));
        }
    }

    fn text(mut self) -> String {
        if self.failures.is_empty() {
            self.failures.push("nothing failed\n".to_owned());
        }
        let failures = self.failures.concat();
        let [events, frames] = self.before.map(|lines| Vec::from(lines).concat());
        format!("{failures}\nWhat happened before:\n{events}\nThe last frames before:\n{frames}")
    }
}

/// The beginning and the end of a long text.
#[derive(Default)]
struct Excerpt {
    text: String,
    left_out: usize,
}

impl Excerpt {
    fn add(&mut self, text: &str) {
        self.text.push_str(text);
        if self.text.len() > 4 * MOST_SHOWN {
            self.cut();
        }
    }

    fn cut(&mut self) {
        let ends = [MOST_SHOWN, self.text.len().saturating_sub(MOST_SHOWN)];
        let [begin, end] = ends.map(|at| self.text.floor_char_boundary(at));
        if begin < end {
            self.text.drain(begin..end);
            self.left_out += end - begin;
        }
    }

    fn text(mut self) -> String {
        self.cut();
        if self.left_out > 0 {
            let middle = self.text.floor_char_boundary(MOST_SHOWN);
            let words = format!("\n… {} bytes are left out …\n", self.left_out);
            self.text.insert_str(middle, &words);
        }
        self.text
    }
}
